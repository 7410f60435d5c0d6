"""Tables of joint positions to drive to, with planned positions rounded as they are written."""

from collections.abc import Mapping, Sequence

import numpy as np

from calibtool.joint_and_pose_columns import unit_of
from calibtool.robot.coupling import JointValues
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.tables import format_table
from calibtool.units import TO_SI

_DECIMALS = 6  # of a degree or mm: 0.05 µm at 3 m, and no joint list needs more


def in_columns(robot: Robot, q: Array, joint_values: JointValues = "serial") -> Array:
    """Joint positions (N, n), rad or m, in columns `robot.columns(joint_values)`, as written."""
    # no −0
    result: Array = np.round(robot.serial_as(joint_values, q) / _factors(robot), _DECIMALS) + 0.0
    return result


def as_written(robot: Robot, q: Array) -> Array:
    """The joint positions (N, n), rad or m, that a reader of the table gets."""
    result: Array = in_columns(robot, q) * _factors(robot)
    return result


def joint_table(
    robot: Robot,
    q: Array,
    extra: Mapping[str, Sequence[str]] | None = None,
    joint_values: JointValues = "serial",
) -> str:
    """CSV of joint positions q (N, n), columns `robot.columns(joint_values)`, then `extra`."""
    extra = {} if extra is None else extra
    rows = [
        [f"{value:.{_DECIMALS}f}" for value in row] for row in in_columns(robot, q, joint_values)
    ]
    added = zip(*extra.values(), strict=True) if extra else [()] * len(rows)
    header = [*robot.columns(joint_values), *extra]
    return format_table(header, [[*row, *more] for row, more in zip(rows, added, strict=True)])


def _factors(robot: Robot) -> Array:
    return np.array([TO_SI[unit_of(column)] for column in robot.columns(None)])
