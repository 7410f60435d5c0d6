"""Where a network that was trained on corrections may be used."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from calibtool.equivalent.loss import joint_loss
from calibtool.equivalent.network import Network
from calibtool.equivalent.optimisers import LM_STOPPING, levenberg_marquardt, run
from calibtool.errors import NoSolutionError
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.singularity import MIN_SINGULARITY_DISTANCE

NODES = 24
# Configurations of the training are at least MIN_SINGULARITY_DISTANCE away from singularities.
LEAST_DISTANCE = 0.75 * MIN_SINGULARITY_DISTANCE
_FAR = 2.0 * MIN_SINGULARITY_DISTANCE  # how far away does not matter beyond
_DRAWN = 4000  # configurations
_MOST_DRAWS = 50
_SHRUNK = 0.98  # of the radius of the nearest configuration that has to be outside


@dataclass(frozen=True, eq=False)
class TaughtRegion:
    """The configurations in which a correction was taught.

    lower, upper  (n,) range of the joints in training, rad or m
    centre, axes  ellipsoid around the training, |axes (q − centre)| ≤ 1: (n,), (n, n); None where
                  the whole range closes and is far from singularities
    distance      network of one output that approximates the distance to the nearest singularity,
                  0 where the loops do not close; None with the ellipsoid
    """

    lower: Array
    upper: Array
    centre: Array | None = None
    axes: Array | None = None
    distance: Network | None = None

    @classmethod
    def of(cls, robot: Robot, q: Array, network: Network) -> Self:
        """Around the configurations q (K, n) of the training of a network, with its scaling."""
        rng = np.random.default_rng(0)
        region = cls(q.min(axis=0), q.max(axis=0))
        if (robot.singularity_distance(region.drawn(_DRAWN, rng)) >= LEAST_DISTANCE).all():
            return region
        centre = q.mean(axis=0)
        axes = np.linalg.inv(np.linalg.cholesky(np.cov(q.T).reshape(robot.n, robot.n)))
        axes /= np.linalg.norm((q - centre) @ axes.T, axis=-1).max()
        region = replace(region, centre=centre, axes=axes)
        inside = np.concatenate([region.drawn(_DRAWN, rng), q])
        target = np.minimum(robot.singularity_distance(inside), _FAR)[:, None]
        loss = joint_loss(inside, np.ones((len(inside), 1, 1)), target)
        start = Network.initial(inside, np.array([LEAST_DISTANCE]), NODES, rng)
        start = replace(start, input_centre=network.input_centre, input_scale=network.input_scale)
        distance, _ = run(levenberg_marquardt, start, loss, None, LM_STOPPING)
        assert isinstance(distance, Network)
        return replace(region, distance=distance)

    def holds(self, q: Array) -> np.ndarray:
        """Which configurations (N, n) are in the region: (N,) bool."""
        held = ((q >= self.lower) & (q <= self.upper)).all(axis=-1)
        if self.centre is not None and self.axes is not None:
            held &= np.linalg.norm((q - self.centre) @ self.axes.T, axis=-1) <= 1.0
        if self.distance is not None:
            held &= self.distance(q)[:, 0] >= LEAST_DISTANCE
        return np.asarray(held)

    def without(self, q: Array) -> Self:
        """The region with a smaller ellipsoid, such that none of the configurations q (k, n) lies
        in it. Raises NoSolutionError for a region without an ellipsoid, which cannot be made
        smaller."""
        if not len(q):
            return self
        if self.centre is None or self.axes is None:
            raise NoSolutionError("a range of joints without an ellipsoid cannot be made smaller")
        radius = _SHRUNK * np.linalg.norm((q - self.centre) @ self.axes.T, axis=-1).min()
        return replace(self, axes=self.axes / radius)

    def drawn(self, count: int, rng: np.random.Generator) -> Array:
        """Up to `count` configurations (N, n) of the region, uniform."""
        found: list[Array] = []
        for _ in range(_MOST_DRAWS):
            q = self.lower + (self.upper - self.lower) * rng.random((count, len(self.lower)))
            found.append(q[self.holds(q)])
            if sum(map(len, found)) >= count:
                break
        return np.concatenate(found)[:count]
