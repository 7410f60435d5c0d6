"""Part of a series that a cause explains beyond errors of the robot (generalised least squares)."""

from dataclasses import dataclass

import numpy as np

from calibtool.errormodel.families import BY_ID
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errormodel.tolerances import Tolerances
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import observation_matrix, target_columns
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array

_FREE = 0.1  # m and rad: assumed error of a set-up that is not known
_ORDERS = {"harmonics": 2}  # of the families that have several


@dataclass(frozen=True, eq=False)
class Unexplained:
    """The covariance of residuals (N, d) of an arm with errors of every family within its
    tolerance, and noise.

    A   (N d, p) effect of an error of one tolerance, or of a free set-up, over the stated noise
    K   (p, p) (AᵀA + I)⁻¹
    """

    A: Array
    K: Array

    @classmethod
    def of(cls, measurements: Measurements, setup: Setup) -> "Unexplained":
        """For the points of measurements (orientations left aside) in a set-up."""
        robot = measurements.robot
        context = RobotErrors.of(robot).context(measurements.q, measurements.conditions)
        tolerances, blocks = Tolerances.of_robot(robot), []
        for family in BY_ID.values():
            order = _ORDERS.get(family.id, family.orders[-1])
            if not order or family.by_row or not family.known(context.rows):
                continue
            shape = family.shape(family.joints(robot), order)
            size = np.ravel(family.tolerance(robot, tolerances, shape))
            blocks.append(family.columns(shape, context) * size)
        seen = measurements.seen.repeat(3, axis=-1)[..., None]
        tool, place = context.frames.tool, measurements.place
        if not setup.frame_known:  # the registration fits the frame freely
            blocks.append(np.broadcast_to(_FREE * np.eye(6), (len(tool), 6, 6)))
        columns = observation_matrix(setup, tool, place) @ np.concatenate(blocks, axis=-1)
        free = _FREE * target_columns(setup, tool, place)
        A = (np.concatenate([columns, free], axis=-1) * seen).reshape(seen.size, -1)
        A /= measurements.noise_position
        return cls(A, np.linalg.inv(A.T @ A + np.eye(A.shape[1])))

    def slope(self, x: Array, y: Array) -> tuple[float, float]:
        """Slope of y over x, both (N, d), and its standard error, with an estimated scale."""
        x, y = x.ravel(), y.ravel()
        weighted = self._weighted(x)
        power = max(float(x @ weighted), 1e-300)
        slope = float(weighted @ y) / power
        rest = y - slope * x
        weighted_rest = self._weighted(rest)
        B = (self.A.T @ self.A) @ self.K
        noise = len(rest) - 2 * np.trace(B) + (B * B.T).sum()  # trace of the square of the weights
        # The noise alone as well: errors smaller than their tolerances would make it look smaller.
        variance = max(
            float(rest @ weighted_rest) / max(len(rest) - 1, 1),
            float(weighted_rest @ weighted_rest) / max(noise, 1.0),
        )
        return slope, float(np.sqrt(max(variance, 0.0) / power))

    def _weighted(self, series: Array) -> Array:
        """The inverse covariance times a series, up to the noise: (N d,)."""
        return series - self.A @ (self.K @ (self.A.T @ series))
