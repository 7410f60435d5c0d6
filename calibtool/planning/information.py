"""Prior information and the information of a configuration: rows of the whitened identification
matrix.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from calibtool.errors import InputError
from calibtool.identification.evidence import inverse
from calibtool.identification.identification import Identification
from calibtool.identification.parameters import Parameters, State
from calibtool.measurement.observation import observation_matrix, target_columns
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import ORIENTATION_NOISE
from calibtool.robot.gravity_torque import load_carrying, turned_by_gravity
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly

# Orders per joint in a design; higher ones ask for more configurations than a plan has
HARMONICS = 2


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Errors to be identified, as a Gaussian, and the instrument that will measure them.

    parameters    errors of the complete model: geometry, joint offsets, gravity and up to
                  `HARMONICS` harmonics
    state         where the columns are computed: the nominal robot, or a calibrated one
    prior_std     (p,) tolerances, SI, by which parameters are divided
    covariance    (p, p) of the parameters over their tolerances: I without any measurement
    noise_position, noise_orientation   of the instrument per coordinate, m and rad
    """

    robot: Robot
    parameters: Parameters
    state: State
    prior_std: Array
    covariance: Array
    noise_position: float
    noise_orientation: float = ORIENTATION_NOISE

    @classmethod
    def of_tolerances(
        cls,
        robot: Robot,
        noise: float,
        unregistered: bool = False,
        setup: Setup | None = None,
        noise_orientation: float = ORIENTATION_NOISE,
    ) -> Self:
        """Only the robot's tolerances are known. unregistered: instrument frame and targets are
        unknown as well.

        setup: of an instrument, instead of points of known targets.
        """
        setup = setup or Setup(
            readonly(np.eye(4)),
            robot.targets,
            frame_known=not unregistered,
            targets_known=not unregistered,
        )
        parameters = Parameters.of(robot, setup, twists=1, harmonics=HARMONICS, gravity=1)
        # Configurations are spent on the wind-up that the description lets expect.
        expected = np.ones(parameters.count, dtype=bool)
        expected[parameters.blocks["gravity"]] = load_carrying(robot)[turned_by_gravity(robot)]
        parameters = parameters.only(expected)
        prior_std = parameters.prior_std()
        state = State.nominal(robot, setup)
        return cls(
            robot,
            parameters,
            state,
            readonly(prior_std),
            readonly(np.eye(parameters.count)),
            noise,
            noise_orientation,
        )

    @classmethod
    def of_identification(
        cls,
        robot: Robot,
        identified: Identification,
        noise_position: float,
        noise_orientation: float,
    ) -> Self:
        """The posterior of a complete model; harmonics beyond `HARMONICS` and functions of pairs
        of joints are taken as exact.

        The noise is that of future measurements. Raises InputError for a model without a posterior.
        """
        posterior = identified.posterior
        if posterior is None:
            raise InputError(
                f"a '{identified.model}' model has no posterior to start from; identify "
                "--model complete"
            )
        orders = posterior.parameters.orders
        orders |= {"harmonics": min(orders.get("harmonics", 0), HARMONICS)}
        # A plan does not choose directions, loads and temperatures.
        left_out = ("backlash", "payload", "temperature", "pairs")
        parameters = Parameters.of(robot, identified.setup, **orders).without(*left_out)
        known = np.isin(parameters.names, posterior.parameters.names)
        parameters = parameters.only(known)  # not every joint has what its family offers
        kept = np.flatnonzero(np.isin(posterior.parameters.names, parameters.names))
        std = posterior.prior_std[kept]
        covariance = posterior.covariance[np.ix_(kept, kept)] / np.outer(std, std)
        state = identified.state
        return cls(
            robot,
            parameters,
            state,
            readonly(std),
            readonly(covariance),
            noise_position,
            noise_orientation,
        )

    @property
    def effective(self) -> float:
        """Effective number of parameters known beyond the tolerances: p − tr(covariance)."""
        return self.parameters.count - float(np.trace(self.covariance))

    def after(self, rows: Array) -> Self:
        """Knowledge after configurations with these rows (N, r, p) have been measured too."""
        A = rows.reshape(-1, self.parameters.count)
        root = np.linalg.cholesky(self.covariance)
        seen = A @ root
        return replace(
            self, covariance=readonly(root @ inverse(np.eye(len(root)) + seen.T @ seen) @ root.T)
        )

    def rows(self, q: Array, place: np.ndarray | None = None) -> Array:
        """Rows of the identification matrix for q (N, n), over the noise, columns times the
        tolerances: (N, r, p).

        place (N,): the labelled place of each row. More measured coordinates than a pose and the
        set-up have unknowns are condensed to as many rows of the same information.
        """
        seen, poses, targets = self._columns(q, place)
        setup = self.state.setup
        lengths = setup.kind.lengths(setup)
        noise = np.where(lengths, self.noise_position, self.noise_orientation)
        both = (seen if targets is None else np.concatenate([seen, targets], -1)) / noise[:, None]
        if both.shape[1] > both.shape[2]:
            both = np.asarray(np.linalg.qr(both, mode="r"))
        rows = np.concatenate([both[..., :6] @ poses, both[..., 6:]], axis=-1)
        result: Array = rows * self.prior_std
        return result

    def target_rows(self, q: Array) -> Array:
        """∂(target points)/∂θ at q (M, n), m, columns times the tolerances: (M, 3 m, p).

        In the instrument's frame where that is unknown, because the tool frame itself cannot be
        predicted then. For instruments that see no points, the part that a fit of base and tool
        frame to all of these points explains is subtracted.
        """
        if self.state.setup.kind.id in ("points", "pose"):
            seen, poses, targets = self._columns(q)
            columns = seen @ poses
            if targets is not None:
                columns = np.concatenate([columns, targets], axis=-1)
            found: Array = columns[:, : 3 * len(self.state.setup.targets)] * self.prior_std
            return found
        robot = self.robot
        context = self.state.errors.context(q)
        poses = self.parameters.pose_columns(context)
        points = Setup(np.eye(4), robot.targets, targets_known=False)
        seen = observation_matrix(points, context.frames.tool)
        free = np.concatenate([seen, target_columns(points, context.frames.tool)], axis=-1)
        columns = np.zeros((*seen.shape[:2], self.parameters.count))
        columns[..., : poses.shape[-1]] = seen @ poses
        flat, frames = columns.reshape(-1, columns.shape[-1]), free.reshape(-1, free.shape[-1])
        unexplained = flat - frames @ np.linalg.lstsq(frames, flat, rcond=1e-10)[0]
        result: Array = unexplained.reshape(columns.shape) * self.prior_std
        return result

    def target_deviation(self, q: Array) -> Array:
        """Predicted standard deviation of the target points at q (N, n), m: root of the sum over x,
        y, z, RMS over points; see `target_rows`.
        """
        columns = self.target_rows(q)
        variance: Array = ((columns @ self.covariance) * columns).sum(axis=(1, 2))
        deviation: Array = np.sqrt(3 * variance / columns.shape[1])
        return deviation

    def _columns(
        self, q: Array, place: np.ndarray | None = None
    ) -> tuple[Array, Array, Array | None]:
        """∂(observation)/∂δy (N, d, 6), ∂δy/∂θ (N, 6, ·) and, of unknown targets,
        ∂(observation)/∂(free elements of the set-up) (N, d, k).
        """
        setup = self.state.setup
        context = self.state.errors.context(q)
        frames, poses = context.frames, self.parameters.pose_columns(context)
        targets = target_columns(setup, frames.tool, place) if self.parameters.targets else None
        return observation_matrix(setup, frames.tool, place), poses, targets
