"""Random features: a Gaussian process by its spectrum (Rahimi and Recht 2007)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from calibtool.equivalent.network import affine, input_scaling
from calibtool.equivalent.regressor import Regressor
from calibtool.robot.se3 import Array, readonly

_LENGTHS = (0.6, 3.0)  # of the kernels, in half ranges of the training: log-uniform
_FEATURES = 60


@dataclass(frozen=True, eq=False)
class RandomFeatures(Regressor):
    """N(q) = output_scale ∘ W cos(Ω s + b), s = (q − input_centre) / input_scale; Ω and b
    are drawn once and not trained.

    input_centre, input_scale   (n,) rad or m: the training range becomes [−1, 1]
    frequencies (h, n), phases (h,): Ω and b, in rad
    output_weights (p, h)
    output_scale                (p,) rad or m
    """

    input_centre: Array
    input_scale: Array
    frequencies: Array
    phases: Array
    output_weights: Array
    output_scale: Array

    id: ClassVar[str] = "random-features"
    fields: ClassVar[dict[str, tuple[str, str, tuple[str, ...]]]] = {
        "input_centre": ("q", "middle of the training range", ("joint",)),
        "input_scale": ("q", "half of the training range", ("joint",)),
        "frequencies": ("rad", "of the cosines", ("hidden", "joint")),
        "phases": ("rad", "of the cosines", ("hidden",)),
        "output_weights": ("1", "W", ("motion", "hidden")),
        "output_scale": ("rho", "unit of each joint motion error", ("motion",)),
    }

    @classmethod
    def initial(cls, q: Array, output_scale: Array, hidden: int, rng: np.random.Generator) -> Self:
        centre, scale = input_scaling(q)
        lengths = np.exp(rng.uniform(np.log(_LENGTHS[0]), np.log(_LENGTHS[1]), (hidden, 1)))
        return cls(
            input_centre=centre,
            input_scale=scale,
            frequencies=readonly(rng.normal(size=(hidden, q.shape[1])) / lengths),
            phases=readonly(rng.uniform(0, 2 * np.pi, hidden)),
            output_weights=readonly(rng.normal(size=(len(output_scale), hidden)) / hidden),
            output_scale=readonly(output_scale),
        )

    @classmethod
    def size_for(cls, n: int) -> int:
        return _FEATURES

    @classmethod
    def averaged(cls, members: Sequence[Self]) -> Self:
        return replace(
            members[0],
            frequencies=readonly(np.concatenate([member.frequencies for member in members])),
            phases=readonly(np.concatenate([member.phases for member in members])),
            output_weights=readonly(
                np.concatenate([m.output_weights for m in members], axis=1) / len(members)
            ),
        )

    def __call__(self, q: Array) -> Array:
        none = np.zeros(len(self.output_scale))
        return affine(self.output_weights, self._features(q), none).T * self.output_scale

    @property
    def hidden(self) -> int:
        """Number of features."""
        return len(self.phases)

    @property
    def weights(self) -> Array:
        return self.output_weights.ravel()

    def with_weights(self, weights: Array) -> Self:
        return replace(self, output_weights=readonly(weights).reshape(self.output_weights.shape))

    def through(self, R: Array, q: Array) -> tuple[Array, Array]:
        features, scaled = self._features(q).T, R * self.output_scale
        J = (scaled[..., None] * features[:, None, None, :]).reshape(*R.shape[:2], -1)
        return (J @ self.weights), J

    def _features(self, q: Array) -> Array:
        """cos(Ω s + b): (h, N)."""
        s = (q - self.input_centre) / self.input_scale
        return np.cos(affine(self.frequencies, s.T.copy(), self.phases))
