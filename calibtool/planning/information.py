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
from calibtool.measurement.measurements import Setup
from calibtool.measurement.observation import observation_matrix, target_columns
from calibtool.measurement.simulate import ORIENTATION_NOISE
from calibtool.robot.gravity_torque import load_carrying, turned_by_gravity
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly

HARMONICS = (
    2  # orders per joint in a design; higher ones ask for more configurations than a plan has
)


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Errors to be identified, as a Gaussian, and the instrument that will measure them.

    parameters    errors of the complete model: geometry, joint offsets, gravity and up to
                  `HARMONICS` harmonics
    state         where the columns are taken: the nominal robot, or a calibrated one
    prior_std     (p,) tolerances, SI; they make every parameter a number without unit
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
    def of_tolerances(cls, robot: Robot, noise: float, unregistered: bool = False) -> Self:
        """Nothing but the robot's tolerances; unregistered: instrument frame and targets are
        unknown as well.
        """
        setup = Setup(
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
            robot, parameters, state, readonly(prior_std), readonly(np.eye(parameters.count)), noise
        )

    @classmethod
    def of_identification(
        cls,
        robot: Robot,
        identified: Identification,
        noise_position: float,
        noise_orientation: float,
    ) -> Self:
        """The posterior of a complete model, its harmonics beyond `HARMONICS` taken as they are.

        The noise is that of the measurements to come. Raises InputError for a model
        without a posterior.
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
        left_out = ("backlash", "payload", "temperature")
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

    def rows(self, q: Array) -> Array:
        """Rows of the identification matrix for q (N, n), over the noise, columns times the
        tolerances: (N, r, p).

        Where the targets are known, more than six measured coordinates are condensed to six rows of
        the same information.
        """
        seen, poses, targets = self._columns(q)
        noise = np.full(seen.shape[1], self.noise_position)
        noise[3 * len(self.state.setup.targets) :] = self.noise_orientation
        seen = seen / noise[:, None]
        if targets is not None:
            rows = np.concatenate([seen @ poses, targets / noise[:, None]], axis=-1)
        else:
            rows = (np.linalg.qr(seen, mode="r") if seen.shape[1] > 6 else seen) @ poses
        result: Array = rows * self.prior_std
        return result

    def target_deviation(self, q: Array) -> Array:
        """Predicted standard deviation of the target points at q (N, n), m: root of the sum over x,
        y, z, RMS over points.

        In the instrument's frame where that is unknown: what every set-up lets predict, unlike the
        tool frame itself.
        """
        seen, poses, targets = self._columns(q)
        columns = (
            seen @ poses if targets is None else np.concatenate([seen @ poses, targets], axis=-1)
        )
        points = len(self.state.setup.targets)
        columns = columns[:, : 3 * points] * self.prior_std
        variance: Array = ((columns @ self.covariance) * columns).sum(axis=(1, 2))
        return np.sqrt(variance / points)

    def _columns(self, q: Array) -> tuple[Array, Array, Array | None]:
        """∂(observation)/∂δy (N, d, 6), ∂δy/∂θ (N, 6, ·) and, of unknown targets,
        ∂(observation)/∂(targets) (N, d, d).
        """
        setup = self.state.setup
        context = self.state.errors.context(q)
        frames, poses = context.frames, self.parameters.pose_columns(context)
        targets = target_columns(setup, frames.tool) if self.parameters.targets else None
        return observation_matrix(setup, frames.tool), poses, targets
