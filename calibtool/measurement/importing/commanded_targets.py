"""Commanded targets of rows that were measured while the arm was driven to corrected joints."""

from typing import NamedTuple

import numpy as np

from calibtool.errors import InputError
from calibtool.joint_and_pose_columns import joints_from_header, poses_from_header
from calibtool.measurement.importing.column_map import JoinColumns
from calibtool.measurement.importing.joint_files import Join, join_rows
from calibtool.measurement.importing.sources import read_source
from calibtool.robot.coupling import JointValues
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly
from calibtool.tables import Table


class CommandedFile(NamedTuple):
    """What went into `compensate`, joints or poses, and how its rows find the measured ones."""

    data: bytes | str
    name: str
    join: Join = "index"


def join_commanded(
    measured: Table, commanded: CommandedFile, columns: JoinColumns | None
) -> tuple[Table, Table, list[str]]:
    """The measured rows that have a commanded one, those commanded, warnings about the others.

    By a shared name where that is how rows find each other, otherwise by row order. Raises
    InputError where the numbers of rows differ, or nothing fits.
    """
    table = read_source(commanded.data, commanded.name).table
    how: Join = "name" if commanded.join == "name" else "index"
    return join_rows(measured, table, how, columns)


def of_kept_rows(commanded: Table, before: Table, kept: Table) -> Table:
    """The commanded rows that belong to the measured rows `kept`, of those `before`, in order."""
    return commanded.take(np.flatnonzero(np.isin(list(before.lines), list(kept.lines))))


def commanded_poses(table: Table, robot: Robot, joint_values: JointValues | None = None) -> Array:
    """Commanded T_base_tool (N, 4, 4): of the nominal robot where the table holds joints.

    Where a row has both, the pose is commanded. joint_values: as in `joints_from_header`. Raises
    InputError for a table with neither.
    """
    poses = poses_from_header(table)
    if poses is not None:
        return readonly(poses[0])
    joints = joints_from_header(table, robot, joint_values)
    if joints is None:
        raise InputError(
            f"{table.name}: neither joints (j1_deg …) nor poses (x_mm y_mm z_mm with an "
            "orientation) among the columns; give what went into compensate"
        )
    return readonly(robot.mechanism.forward(joints.q))
