"""The part of the set-up that a table, its map and the options give; the rest is registered."""

import numpy as np

from calibtool.errors import InputError
from calibtool.measurement.importing.column_map import ColumnMap
from calibtool.measurement.measurements import Setup, check_targets
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly


def known_setup(
    columns: ColumnMap, robot: Robot, points: Array, frame: str, robot_targets: bool, name: str
) -> Setup:
    """What is known of the set-up; unknown parts stand at zero until they are registered.

    points (N, m, 3): measured targets. Raises InputError for targets that the robot does not have,
    or that do not determine what they should (collinear, two the same).
    """
    m = points.shape[1]
    targets, known = np.zeros((m, 3)), False
    if robot_targets:
        if columns.pose is not None or len(robot.targets) != m:
            raise InputError(
                f"{name}: {m} measured targets, but {robot.name} describes {len(robot.targets)}"
            )
        targets, known = robot.targets, True
    elif columns.targets and columns.targets[0].on_tool_mm is not None:
        targets, known = np.array([target.on_tool_mm for target in columns.targets]) * 1e-3, True
    if known:
        check_targets(targets, name)
    # Measured points show a collinear set too, whatever is known of the targets.
    whole = points[~np.isnan(points[..., 0]).any(axis=-1)]
    if len(whole):
        check_targets(whole[0], f"{name}: measured points")
    return Setup(
        T_instrument_base=readonly(np.eye(4)),
        targets=readonly(targets),
        R_tool_sensor=readonly(np.eye(3)) if columns.pose is not None else None,
        frame_known=frame == "base",
        targets_known=known,
    )
