"""Columns → arrays in m and rad: joints, target points, orientations, auxiliary readings."""

import numpy as np

from calibtool.errors import InputError
from calibtool.joint_and_pose_columns import check_matrices, check_quaternions, joint_positions
from calibtool.measurement.auxiliary import AuxiliaryReadings
from calibtool.measurement.importing.column_map import (
    ColumnMap,
    JointColumns,
    LengthColumns,
    PayloadColumn,
    PoseColumns,
    TargetColumns,
    TemperatureColumn,
)
from calibtool.measurement.importing.joint_files import times
from calibtool.robot.orientation import numbers_in, rotation_matrices
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.tables import Table
from calibtool.units import TO_SI

_CELSIUS = -273.15  # added to a temperature in K
_COLDEST, _WARMEST = -100.0, 200.0  # °C: no arm works beyond
_HEAVIEST = 1e4  # kg: four times what the strongest arms carry


def read_joints(table: Table, robot: Robot, joints: JointColumns) -> Array:
    """Joint positions (N, n), rad or m.

    InputError for a wrong number of columns, a unit of the wrong kind, a bad cell.
    """
    name, units = table.name, joints.units()
    if len(joints.columns) != robot.n:
        raise InputError(
            f"{name}: {len(joints.columns)} joint columns, but {robot.name} has {robot.n} joints"
        )
    if len(units) != robot.n:
        raise InputError(f"{name}: {len(units)} joint units for {robot.n} joints")
    for unit, prismatic, column in zip(units, robot.prismatic, joints.columns, strict=True):
        if (unit in ("mm", "m")) != prismatic:
            raise InputError(
                f"{name}: column '{column}' is in {unit}, but its joint is "
                f"{'prismatic' if prismatic else 'revolute'}"
            )
    return robot.serial_from(
        joints.values or "serial", joint_positions(table, robot, joints.columns, units)
    )


def read_points(table: Table, columns: ColumnMap) -> Array:
    """Measured points (N, m, 3), m; NaN for a target whose cells are empty."""
    if columns.lengths is not None:
        return np.full((len(table), 1, 3), np.nan)
    if columns.pose is not None:
        return (table.numbers(columns.pose.position) * TO_SI[columns.pose.unit])[:, None, :]
    return np.stack([_target_points(table, target) for target in columns.targets], axis=1)


def read_lengths(table: Table, lengths: LengthColumns) -> Array:
    """Measured lengths (N, w), m; NaN for an empty cell. InputError for a distance below zero, and
    for one of zero where the row has no other.
    """
    if not lengths.columns:
        return np.zeros((len(table), 1))
    values = np.concatenate(
        [table.optional_numbers([column]) * TO_SI[lengths.unit] for column in lengths.columns],
        axis=-1,
    )
    if lengths.of in ("distance", "centre"):
        alone = ~(values > 0).any(axis=-1, keepdims=True)  # 0 beside others was not read
        wrong = (values < 0) | ((values == 0) & alone)
        if wrong.any():
            row, column = (int(i) for i in np.argwhere(wrong)[0])
            raise InputError(
                f"{table.place(row)}: column '{lengths.columns[column]}' holds a distance that is "
                "not above zero"
            )
    return values


def read_places(table: Table, column: str) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Number of each row's label (N,) and the labels in their order; None for one alone.

    Raises InputError for an empty cell.
    """
    texts = table.texts(column)
    if "" in texts:
        raise InputError(f"{table.place(texts.index(''))}: column '{column}' is empty")
    labels = tuple(dict.fromkeys(texts))
    if len(labels) == 1:
        return None, ()
    return np.array([labels.index(text) for text in texts]), labels


def read_rotations(table: Table, pose: PoseColumns) -> Array:
    """R_instrument_sensor (N, 3, 3) by the convention of the map, see `rotation_matrices`; zyx is
    intrinsic-zyx.

    Raises InputError for another number of columns, a quaternion that is not of length 1, or a
    matrix that is no rotation.
    """
    values = table.numbers(pose.orientation)
    convention = "intrinsic-zyx" if pose.convention == "zyx" else pose.convention
    expected = numbers_in(convention)
    if values.shape[1] != expected:
        raise InputError(
            f"{table.name}: {pose.convention} takes {expected} columns, "
            f"{values.shape[1]} are mapped"
        )
    if expected == 4:
        check_quaternions(table, values)
        return rotation_matrices(values, convention)
    if expected == 9:
        check_matrices(table, values)
        return rotation_matrices(values, convention)
    if pose.orientation_unit == "rad" and np.abs(values).max() > 4 * np.pi:
        row, column = (int(i) for i in np.argwhere(np.abs(values) > 4 * np.pi)[0])
        raise InputError(
            f"{table.place(row)}: column '{pose.orientation[column]}' holds "
            f"{values[row, column]:g} rad, which looks like degrees; state the unit deg"
        )
    return rotation_matrices(values * TO_SI[pose.orientation_unit or "rad"], convention)


def read_payload(table: Table, payload: PayloadColumn) -> Array:
    """Mass at the tool (N,), kg. InputError for a negative one, or one that no arm carries."""
    values = table.numbers([payload.column])[:, 0] * (1e-3 if payload.unit == "g" else 1.0)
    if (values < 0).any():
        raise InputError(
            f"{table.place(int(np.argmax(values < 0)))}: column '{payload.column}' holds "
            "a negative mass"
        )
    if (values > _HEAVIEST).any():
        row = int(np.argmax(values > _HEAVIEST))
        raise InputError(
            f"{table.place(row)}: column '{payload.column}' holds {values[row]:g} kg, more than "
            "any arm carries; state its unit: payload_kg or payload_g"
        )
    return values


def read_auxiliary(
    table: Table, joints_table: Table, robot: Robot, columns: ColumnMap, q: Array
) -> AuxiliaryReadings:
    """The columns beside the measurements; joint values come from `joints_table`, all others from
    the measured table.

    q (N, n) are the commanded joint positions, rad or m. InputError for a temperature in which no
    arm works.
    """
    references = [
        table.optional_numbers(ref.measured) * TO_SI[ref.unit] for ref in columns.references
    ]
    return AuxiliaryReadings(
        q_commanded=q,
        q_read=read_joints(joints_table, robot, columns.joints_read)
        if columns.joints_read
        else None,
        time_s=times(table, columns.time) if columns.time else None,
        temperature_c=_celsius(table, columns.temperature) if columns.temperature else None,
        reference_points=np.stack(references, axis=1) if references else None,
    )


def _celsius(table: Table, temperature: TemperatureColumn) -> Array:
    """Temperatures (N,), °C, NaN where none was read."""
    shift = _CELSIUS if temperature.unit == "K" else 0.0
    celsius = table.optional_numbers([temperature.column])[:, 0] + shift
    wrong = (celsius < _COLDEST) | (celsius > _WARMEST)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"{table.place(row)}: column '{temperature.column}' holds {celsius[row]:.4g} °C, in "
            "which no arm works; state its unit: temperature_c or temperature_k"
        )
    return celsius


def _target_points(table: Table, target: TargetColumns) -> Array:
    if target.measured is not None:
        points = table.optional_numbers(target.measured)
    else:
        assert target.nominal is not None
        assert target.error is not None
        sign = 1.0 if target.error_is == "measured-minus-nominal" else -1.0
        points = table.optional_numbers(target.nominal) + sign * table.optional_numbers(
            target.error
        )
    return points * TO_SI[target.unit]
