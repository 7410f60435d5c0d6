"""Bounds of a correction: largest change, weights of the components, usual remaining error."""

from dataclasses import dataclass

import numpy as np

from calibtool.compensation.weighted_error import Weights
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array


@dataclass(frozen=True)
class Bounds:
    """What a correction may do; see `default_bounds`.

    largest_change   of a joint, rad, for a slide characteristic lengths
    usual            largest weighted error (rad) that one step leaves in an `ok` row: of the task
                     components, and of all six
    weights          of the components x, y, z, rx, ry, rz for n < 6 (`Task`); None: those that are
                     no virtual joints
    """

    largest_change: float
    usual: tuple[float, float]
    weights: Weights | None = None

    def of_joints(self, robot: Robot) -> Array:
        """B (n,): the largest change of each joint, rad or m."""
        return self.largest_change * np.where(robot.prismatic, robot.length, 1.0)

    def box(self, robot: Robot, q: Array) -> tuple[Array, Array]:
        """Smallest and largest change of joints q (N, n), rad or m: (N, n) each.

        max(−B, min(0, q_min − q)) and min(B, max(0, q_max − q)); −B and B for a joint that is
        commanded outside its limits, by more than a rounding error of 1e-9.
        """
        most = self.of_joints(robot)
        inside = robot.joints_within_limits(q)
        lower = np.where(inside, np.maximum(-most, np.minimum(0.0, robot.lower - q)), -most)
        upper = np.where(inside, np.minimum(most, np.maximum(0.0, robot.upper - q)), most)
        return lower, upper
