"""Meaning of the names of a header: the parts of a column map that no file gives."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

from calibtool.errors import InputError
from calibtool.measurement.importing.column_map import (
    CONVENTIONS,
    AngleUnit,
    ColumnMap,
    JointColumns,
    LengthUnit,
    PayloadColumn,
    PoseColumns,
    ReferenceColumns,
    TargetColumns,
    TemperatureColumn,
    TimeColumn,
    TimeUnit,
    check_convention,
)
from calibtool.measurement.importing.sources import SourceTable
from calibtool.robot.robot import Robot
from calibtool.tables import Table, joint_columns_of, pose_columns_of, stated_values, unit_of

_LENGTHS: tuple[LengthUnit, ...] = ("mm", "m", "in")
_TARGET = re.compile(r"t(\d{1,9})_(?:nominal_|error_)?[xyz](?:_(mm|m|in))?")
_REFERENCE = re.compile(r"ref(\d{1,9})_[xyz](?:_(mm|m|in))?")
_ANGLES = (("rx", "ry", "rz"), ("a", "b", "c"), ("roll", "pitch", "yaw"))


@dataclass(frozen=True)
class Stated:
    """Units and conventions that the user states where a header does not; None where not stated.

    unit         of lengths: mm, m or in
    angle_unit   deg or rad
    convention   of three angles: `intrinsic-…`, `extrinsic-…`, `zyx`, `rotation-vector`
                 (docs/file-formats.md)
    """

    unit: LengthUnit | None = None
    angle_unit: AngleUnit | None = None
    convention: str | None = None


def complete_map(
    source: SourceTable, joints: Table, robot: Robot, given: ColumnMap | None, stated: Stated
) -> ColumnMap:
    """The map with every part that it leaves out taken from the names of the headers
    (docs/file-formats.md).

    source: the measured values; joints: the table that holds the joint values, the same one
    unless they have their own. Raises InputError where names or units are missing, or
    contradict what is stated.
    """
    table, given = source.table, given or ColumnMap()
    found: dict[str, object] = {
        "joints": given.joints or _joints(joints, robot, source, stated),
        "joints_read": given.joints_read or _joints_read(joints, robot),
        "time": given.time or time_column(table),
        "temperature": given.temperature or _temperature(table),
        "payload": given.payload or _payload(table),
        "references": given.references or _references(table, stated),
    }
    if not given.targets and given.pose is None:
        found |= _measured(source, stated)
    complete = given.model_copy(update=found)
    units = [target.unit for target in complete.targets] + (
        [complete.pose.unit] if complete.pose else []
    )
    if stated.unit is not None and any(unit != stated.unit for unit in units):
        raise InputError(
            f"{table.name}: the measured columns are in {units[0]}, but --unit says {stated.unit}"
        )
    found_convention = complete.pose.convention if complete.pose else "no orientation"
    if stated.convention not in (None, found_convention):
        raise InputError(
            f"{table.name}: --convention {stated.convention}, but the columns hold "
            f"{found_convention}; name three angles rx_deg ry_deg rz_deg, or map them with "
            "--columns MAP.toml"
        )
    return complete


def time_column(table: Table) -> TimeColumn | None:
    """The column `time_s`, `time_ms` or `time_iso`, None when there is none."""
    for unit in get_args(TimeUnit):
        if f"time_{unit}" in table.header:
            return TimeColumn(column=f"time_{unit}", unit=unit)
    return None


def _temperature(table: Table) -> TemperatureColumn | None:
    if "temperature_c" in table.header:
        return TemperatureColumn(column="temperature_c", unit="C")
    return (
        TemperatureColumn(column="temperature_k", unit="K")
        if "temperature_k" in table.header
        else None
    )


def _payload(table: Table) -> PayloadColumn | None:
    return PayloadColumn(column="payload_kg", unit="kg") if "payload_kg" in table.header else None


def _joints(table: Table, robot: Robot, source: SourceTable, stated: Stated) -> JointColumns:
    columns = joint_columns_of(table, robot)
    if columns is not None:
        found = {
            "columns": columns,
            "unit": list(map(unit_of, columns)),
            "values": stated_values(table, columns),
        }
        return JointColumns.model_validate(found)
    if source.points is not None and table is source.table:
        raise InputError(
            f"{table.name}: a list of points holds no joint values; give their file "
            "with --joints FILE"
        )
    bare = [f"j{i + 1}" for i in range(robot.n)]
    if not all(column in table.header for column in bare):
        raise InputError(
            f"{table.name}: no joint columns {robot.columns(None)[0]} …; name the columns so, or "
            "map them with --columns MAP.toml"
        )
    units = [stated.unit if prismatic else stated.angle_unit for prismatic in robot.prismatic]
    if None in units or "in" in units:
        option = (
            "--unit mm|m"
            if robot.prismatic[units.index(None) if None in units else 0]
            else "--angle-unit deg|rad"
        )
        raise InputError(
            f"{table.name}: the unit of column "
            f"'{bare[units.index(None)] if None in units else bare[0]}' is not stated; name it "
            f"{robot.columns(None)[0]} …, or give {option}"
        )
    return JointColumns.model_validate({"columns": bare, "unit": units})


def _joints_read(table: Table, robot: Robot) -> JointColumns | None:
    found = {}
    for name in table.header:
        match = re.fullmatch(r"j(\d{1,9})_read_(deg|rad|mm|m)", name)
        if match:
            found[int(match[1])] = (name, match[2])
    if not found:
        return None
    missing = [i for i in range(1, robot.n + 1) if i not in found]
    if missing or len(found) > robot.n:
        raise InputError(
            f"{table.name}: read joint values of {len(found)} joints, {robot.name} has {robot.n}; "
            f"expected j1_read_{'mm' if robot.prismatic[0] else 'deg'} … j{robot.n}_read_…"
        )
    columns = [found[i] for i in range(1, robot.n + 1)]
    return JointColumns.model_validate(
        {"columns": [c for c, _ in columns], "unit": [unit for _, unit in columns]}
    )


def _measured(source: SourceTable, stated: Stated) -> dict[str, object]:
    """Targets or pose by name: `t1_x_mm …`, `t1_nominal_x_mm …` with `t1_error_x_mm …`, `x_mm
    y_mm z_mm`, a pose.
    """
    table = source.table
    if source.points is not None:
        if stated.unit is None:
            raise InputError(
                f"{table.name}: a list of points does not state its unit; give --unit mm, m or in"
            )
        return {
            "targets": [TargetColumns(measured=c, unit=stated.unit) for c in source.points.columns]
        }
    targets = _targets(table, stated)
    if targets:
        return {"targets": targets}
    pose = _pose(table, stated)
    if pose is not None:
        return {"pose": pose}
    position = _position(table, stated)
    if position is not None:
        return {"targets": [TargetColumns(measured=position[0], unit=position[1])]}
    raise InputError(
        f"{table.name}: no measured points: expected t1_x_mm t1_y_mm t1_z_mm …, x_mm y_mm "
        "z_mm or a pose, or map the columns with --columns MAP.toml"
    )


def _targets(table: Table, stated: Stated) -> list[TargetColumns]:
    targets = []
    for number, unit, suffix in _numbered(table, _TARGET, stated):

        def triple(kind: str, number: int = number, suffix: str = suffix) -> list[str]:
            return [f"t{number}_{kind}{axis}{suffix}" for axis in "xyz"]

        if f"t{number}_nominal_x{suffix}" in table.header:
            targets.append(
                TargetColumns(nominal=triple("nominal_"), error=triple("error_"), unit=unit)
            )
        else:
            targets.append(TargetColumns(measured=triple(""), unit=unit))
    return targets


def _references(table: Table, stated: Stated) -> list[ReferenceColumns]:
    return [
        ReferenceColumns(measured=[f"ref{number}_{axis}{suffix}" for axis in "xyz"], unit=unit)
        for number, unit, suffix in _numbered(table, _REFERENCE, stated)
    ]


def _numbered(
    table: Table, pattern: re.Pattern[str], stated: Stated
) -> list[tuple[int, LengthUnit, str]]:
    """Number, unit and the suffix of the columns of numbered points, by number.

    InputError for two units or none.
    """
    found: dict[int, tuple[str, str | None]] = {}
    for column in table.header:
        match = pattern.fullmatch(column)
        if match is None:
            continue
        before, unit = found.setdefault(int(match[1]), (column, match[2]))
        if None not in (unit, match[2]) and unit != match[2]:
            raise InputError(
                f"{table.name}: columns '{before}' and '{column}' of one point have different units"
            )
    result = []
    for number, (column, unit) in sorted(found.items()):
        result.append(
            (number, _length(unit or stated.unit, column, table), f"_{unit}" if unit else "")
        )
    return result


def _length(unit: str | None, column: str, table: Table) -> LengthUnit:
    for known in _LENGTHS:
        if unit == known:
            return known
    raise InputError(
        f"{table.name}: the unit of column '{column}' is not stated; name it {column}_mm (_m, "
        "_in), or give --unit mm|m|in"
    )


def _position(table: Table, stated: Stated) -> tuple[list[str], LengthUnit] | None:
    for unit in _LENGTHS:
        if all(f"{axis}_{unit}" in table.header for axis in "xyz"):
            return [f"{axis}_{unit}" for axis in "xyz"], unit
    if all(axis in table.header for axis in "xyz"):
        return list("xyz"), _length(stated.unit, "x", table)
    return None


def _pose(table: Table, stated: Stated) -> PoseColumns | None:
    """A position with an orientation beside it.

    Three angles without a convention are refused, never guessed.
    """
    position = _position(table, stated)
    if position is None:
        return None
    own = pose_columns_of(table) if position[0][0] in ("x_mm", "x_m") else None
    if own is not None and stated.convention is None:
        orientation = own[1]
        convention = {"qw": "quaternion-wxyz", "rx_rad": "rotation-vector"}.get(
            orientation[0], "extrinsic-xyz"
        )
        return _pose_columns(
            position, orientation, convention, "deg" if orientation[0] == "roll_deg" else "rad"
        )
    quaternion = ["qw", "qx", "qy", "qz"]
    if all(column in table.header for column in quaternion):
        if stated.convention not in (None, "quaternion-wxyz"):
            raise InputError(
                f"{table.name}: columns qw qx qy qz, but --convention says {stated.convention}"
            )
        return _pose_columns(position, quaternion, "quaternion-wxyz", None)
    for names in _ANGLES:
        for suffix in ("_deg", "_rad", ""):
            angles = [f"{name}{suffix}" for name in names]
            if angles == ["a", "b", "c"] and stated.convention is None:
                continue  # might be anything
            if all(angle in table.header for angle in angles):
                unit = suffix[1:] or stated.angle_unit
                if stated.convention is None or unit is None:
                    what, option = (
                        ("convention", "--convention")
                        if stated.convention is None
                        else ("unit", "--angle-unit")
                    )
                    known = CONVENTIONS if stated.convention is None else "deg or rad"
                    raise InputError(
                        f"{table.name}: the {what} of the orientation {' '.join(angles)} "
                        f"is not stated; give {option}: {known}"
                    )
                return _pose_columns(position, angles, stated.convention, unit)
    return None


def _pose_columns(
    position: tuple[Sequence[str], LengthUnit],
    orientation: list[str],
    convention: str,
    unit: str | None,
) -> PoseColumns:
    try:
        check_convention(convention)
    except ValueError as error:
        raise InputError(f"--convention: {error}") from None
    return PoseColumns.model_validate(
        {
            "position": position[0],
            "unit": position[1],
            "orientation": orientation,
            "convention": convention,
            "orientation_unit": unit,
        }
    )
