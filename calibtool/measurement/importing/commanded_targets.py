"""Commanded targets of rows that were measured at corrected joints."""

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
    """The input of `compensate`, joints or poses, and how its rows match the measured ones."""

    data: bytes | str
    name: str
    join: Join = "index"


def join_commanded(
    measured: Table, commanded: CommandedFile, columns: JoinColumns | None
) -> tuple[Table, Table, list[str]]:
    """The measured rows that have a commanded one, these commanded rows, and warnings about the
    others.

    Rows match by a shared name if this is how rows are joined, otherwise by their order. Raises
    InputError where the numbers of rows differ, or nothing matches.
    """
    table = read_source(commanded.data, commanded.name).table
    how: Join = "name" if commanded.join == "name" else "index"
    return join_rows(measured, table, how, columns)


def of_kept_rows(commanded: Table, before: Table, kept: Table) -> Table:
    """The commanded rows of the measured rows `kept`, which are a part of `before`, in order."""
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
