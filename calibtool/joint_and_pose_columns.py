"""Joint positions and poses of a table, by the names and units of its columns."""

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from calibtool.errors import InputError
from calibtool.robot.coupling import JointValues
from calibtool.robot.orientation import (
    FIXED_ANGLES,
    QUATERNION,
    ROTATION_VECTOR,
    orthogonal,
    rotation_matrices,
    wrong_length,
)
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.tables import Table
from calibtool.units import TO_SI, joint_and_factor, joint_column, without_values


class Joints(NamedTuple):
    """Joint positions that a table holds.

    q        (N, n) of the serial chain, rad or m
    columns  the joints' columns in the order of the joints, as the header names them
    values   whose joint values stand in the table
    """

    q: Array
    columns: list[str]
    values: JointValues


def joint_columns_of(table: Table, robot: Robot) -> list[str] | None:
    """The header's joint columns in the order of the joints; None when it has none at all.

    InputError if some lack.
    """
    found: dict[int, str] = {}
    for column in table.header:
        plain, _ = without_values(column)
        if joint_column(plain) is None:
            continue
        index, _ = joint_and_factor(plain, robot.prismatic, f"{table.name}:{table.header_line}")
        if index in found:
            raise InputError(
                f"{table.name}: joint {index + 1} has two columns, '{found[index]}' and '{column}'"
            )
        found[index] = column
    if not found:
        return None
    missing = [robot.columns(None)[i] for i in range(robot.n) if i not in found]
    if missing:
        raise InputError(
            f"{table.name}: no column {', '.join(missing)}; {robot.name} has {robot.n} joints"
        )
    return [found[i] for i in range(robot.n)]


def stated_values(table: Table, columns: Sequence[str]) -> JointValues | None:
    """Whose joint values some columns hold by their names, `j3_controller_deg`; None: not stated.

    Raises InputError where they say both.
    """
    words = {word for _, word in map(without_values, columns) if word is not None}
    if len(words) > 1:
        raise InputError(
            f"{table.name}:{table.header_line}: some joint columns are serial, others controller; "
            "keep one kind"
        )
    return cast(JointValues | None, next(iter(words), None))


def joint_positions(
    table: Table, robot: Robot, columns: Sequence[str], units: Sequence[str]
) -> Array:
    """Joint positions (N, n) in rad or m from columns in joint order, each with its unit.

    Raises InputError for radian columns whose values can only be degrees.
    """
    q: Array = table.numbers(columns) * np.array([TO_SI[unit] for unit in units])
    for j, unit in enumerate(units):
        bound = 2 * max(np.pi, abs(robot.lower[j]), abs(robot.upper[j]))
        if unit == "rad" and np.abs(q[:, j]).max() > bound:
            row = int(np.argmax(np.abs(q[:, j]) > bound))
            raise InputError(
                f"{table.place(row)}: column '{columns[j]}' holds {q[row, j]:g} rad, which looks "
                f"like degrees; name the column j{j + 1}_deg, or give its unit with --columns"
            )
    return q


def joints_from_header(
    table: Table, robot: Robot, joint_values: JointValues | None = None
) -> Joints | None:
    """Joint positions (N, n) in rad or m by the header's names; None when it has no joint columns.

    joint_values: whose they are where the header does not state it. Raises UsageError where nothing
    states it and it matters (`Robot.joint_values`), InputError for a bad header or cell.
    """
    columns = joint_columns_of(table, robot)
    if columns is None:
        return None
    values = robot.joint_values(table.name, stated_values(table, columns), joint_values)
    q = joint_positions(table, robot, columns, [unit_of(column) for column in columns])
    return Joints(robot.serial_from(values, q), columns, values)


def unit_of(column: str) -> str:
    """The unit at the end of a header: `j3_serial_deg` is in deg."""
    return column.rsplit("_", 1)[1]


_ORIENTATIONS = {
    QUATERNION: ("qw", "qx", "qy", "qz"),
    ROTATION_VECTOR: ("rx_rad", "ry_rad", "rz_rad"),
    FIXED_ANGLES: ("roll_deg", "pitch_deg", "yaw_deg"),
}


def pose_columns_of(table: Table) -> tuple[list[str], list[str]] | None:
    """Position and orientation columns, in one of three forms; None when a part is missing."""
    for unit in ("mm", "m"):
        position = [f"{axis}_{unit}" for axis in "xyz"]
        if all(column in table.header for column in position):
            break
    else:
        return None
    present = [
        list(c) for c in _ORIENTATIONS.values() if all(column in table.header for column in c)
    ]
    if len(present) > 1:
        raise InputError(f"{table.name}: two orientations, {present[0]} and {present[1]}; keep one")
    return (position, present[0]) if present else None


def poses_from_header(table: Table) -> tuple[Array, list[str]] | None:
    """Poses (N, 4, 4) in metres and their columns by the header's names; None without any."""
    found = pose_columns_of(table)
    if found is None:
        return None
    position, orientation = found
    T = np.zeros((len(table), 4, 4))
    T[:, 3, 3] = 1.0
    T[:, :3, 3] = table.numbers(position) * TO_SI[unit_of(position[0])]
    values = table.numbers(orientation)
    if len(orientation) == 4:
        check_quaternions(table, values)
    factors = [TO_SI.get(column.rpartition("_")[2], 1.0) for column in orientation]
    convention = next(name for name, columns in _ORIENTATIONS.items() if columns[0] in orientation)
    T[:, :3, :3] = rotation_matrices(values * factors, convention)
    return T, [*position, *orientation]


def check_quaternions(table: Table, quaternions: Array) -> None:
    """InputError for the first row of (N, 4) whose length is not 1."""
    found = wrong_length(quaternions)
    if found is not None:
        row, length = found
        raise InputError(f"{table.place(row)}: quaternion of length {length:.4g}; expected 1")


def check_matrices(table: Table, values: Array) -> None:
    """InputError for the first row of (N, 9) that is no rotation, or is mirrored."""
    wrong = np.flatnonzero(~orthogonal(values))
    if len(wrong):
        R = values[wrong[0]].reshape(3, 3)
        off = np.abs(R @ R.T - np.eye(3)).max()
        raise InputError(
            f"{table.place(int(wrong[0]))}: the matrix is no rotation: R Rᵀ is {off:.2g} from 1"
        )
    mirrored = np.flatnonzero(np.linalg.det(values.reshape(-1, 3, 3)) < 0)
    if len(mirrored):
        raise InputError(
            f"{table.place(int(mirrored[0]))}: the matrix has the determinant -1: its axes are "
            "left-handed, or two of its columns are swapped"
        )
