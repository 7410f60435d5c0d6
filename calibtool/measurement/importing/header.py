"""Meaning of the names of a header: the parts of a column map that are not given."""

import re
from collections.abc import Sequence
from typing import NamedTuple, TypeVar, get_args

from pydantic import BaseModel

from calibtool.errors import InputError
from calibtool.joint_and_pose_columns import (
    joint_columns_of,
    stated_values,
    unit_of,
)
from calibtool.measurement.importing.column_map import (
    ColumnMap,
    JointColumns,
    PayloadColumn,
    PlaceColumn,
    ReferenceColumns,
    TemperatureColumn,
    TimeColumn,
    TimeUnit,
)
from calibtool.measurement.importing.dates import is_date
from calibtool.measurement.importing.measured_columns import (
    measured_columns,
    place_column,
    reference_columns,
)
from calibtool.measurement.importing.names import Named, named
from calibtool.measurement.importing.sources import SourceTable
from calibtool.measurement.importing.stated_units import Stated
from calibtool.robot.robot import Robot
from calibtool.tables import Table


class Found(NamedTuple):
    """The parts that the names of headers define; an error for a part that they do not define."""

    joints: JointColumns | InputError
    measured: ColumnMap | InputError
    joints_read: JointColumns | None
    time: TimeColumn | None
    temperature: TemperatureColumn | None
    payload: PayloadColumn | None
    place: PlaceColumn | None
    references: list[ReferenceColumns]


def parts_found(
    source: SourceTable, joints: Table, robot: Robot, stated: Stated, given: ColumnMap | None = None
) -> Found:
    """The parts of a map that the headers' names define, without those in `given`.

    source: the measured values; joints: the table with the joint values, which may be the same.
    """
    given = given or ColumnMap()
    names = list(robot.chain.model.names)[1:]
    chosen = bool(given.targets) or given.pose is not None or given.lengths is not None
    measured = named(source.table, names, given.columns, chosen)
    of_joints = measured if joints is source.table else named(joints, names, given.columns, chosen)
    of_arm: JointColumns | InputError = given.joints or InputError("")
    of_points: ColumnMap | InputError = given
    if given.joints is None:
        try:
            of_arm = _joints(of_joints, robot, source, stated)
        except InputError as error:
            of_arm = error
    if not chosen:
        try:
            of_points = ColumnMap().model_copy(update=measured_columns(measured, source, stated))
        except InputError as error:
            of_points = error
    return Found(
        of_arm,
        of_points,
        given.joints_read or _joints_read(of_joints, robot, stated),
        given.time or time_column(measured),
        given.temperature or _one(measured, TemperatureColumn, "temperature", "CK"),
        given.payload or _one(measured, PayloadColumn, "payload", ("kg", "g")),
        given.place or place_column(measured),
        given.references or reference_columns(measured, stated),
    )


def complete_map(
    source: SourceTable, joints: Table, robot: Robot, given: ColumnMap | None, stated: Stated
) -> ColumnMap:
    """The map, with its missing parts taken from the names of the headers (docs/file-formats.md).

    source, joints: see `parts_found`. Raises InputError where names or units are missing, or
    contradict what is stated.
    """
    table, given = source.table, given or ColumnMap()
    found = parts_found(source, joints, robot, stated, given)
    for part in (found.joints, found.measured):
        if isinstance(part, InputError):
            raise part
    assert isinstance(found.measured, ColumnMap)
    complete = given.model_copy(
        update={
            **{name: value for name, value in found._asdict().items() if name != "measured"},
            "targets": found.measured.targets,
            "pose": found.measured.pose,
            "lengths": found.measured.lengths,
        }
    )
    units: list[str] = [target.unit for target in complete.targets]
    units += [part.unit for part in (complete.pose, complete.lengths) if part]
    if stated.unit is not None and any(unit != stated.unit for unit in units):
        raise InputError(
            f"{table.name}: the measured columns are in {units[0]}, but --unit says {stated.unit}"
        )
    found_convention = complete.pose.convention if complete.pose else "no orientation"
    if stated.convention not in (None, found_convention):
        raise InputError(
            f"{table.name}: --convention {stated.convention}, but the columns hold "
            f"{found_convention}; name three angles "
            "rx_deg ry_deg rz_deg, or map them with --columns MAP.toml"
        )
    return complete


def time_column(names: Named) -> TimeColumn | None:
    """The column `time_s`, `time_ms`, `time_iso`, or one of dates; None when there is none."""
    for unit in get_args(TimeUnit):
        if f"time_{unit}" in names.original:
            return TimeColumn(column=names.original[f"time_{unit}"], unit=unit)
    if "time" in names.original and any(map(is_date, names.table.texts("time")[:1])):
        return TimeColumn(column=names.original["time"], unit="iso")
    return None


_Column = TypeVar("_Column", bound=BaseModel)


def _one(names: Named, kind: type[_Column], word: str, units: Sequence[str]) -> _Column | None:
    """A single column of one meaning: `temperature_c`."""
    for unit in units:
        if (column := names.original.get(f"{word}_{unit.lower()}")) is not None:
            return kind.model_validate({"column": column, "unit": unit})
    return None


def _joints(names: Named, robot: Robot, source: SourceTable, stated: Stated) -> JointColumns:
    table = names.table
    columns = joint_columns_of(table, robot)
    if columns is not None:
        found = {
            "columns": [names.original[column] for column in columns],
            "unit": list(map(unit_of, columns)),
            "values": stated_values(table, columns),
        }
        return JointColumns.model_validate(found)
    if source.points is not None and table.name == source.table.name:
        raise InputError(
            f"{table.name}: a list of points holds no joint values; give their file with --joints "
            "FILE"
        )
    bare = [f"j{i + 1}" for i in range(robot.n)]
    if not names.has(bare):
        if table.header[:2] == ["c1", "c2"]:
            raise InputError(
                f"{table.name}: no joint columns: without a header its columns are called c1 … "
                f"{table.header[-1]}; say with --columns MAP.toml what they are (--map-template "
                "begins one)"
            )
        raise InputError(
            f"{table.name}: no joint columns {robot.columns(None)[0]} …; name the columns so, or "
            "map them with --columns MAP.toml"
        )
    units = [stated.unit if prismatic else stated.angle_unit for prismatic in robot.prismatic]
    if None in units or "in" in units:
        wrong = units.index(None) if None in units else 0
        option = "--unit mm|m" if robot.prismatic[wrong] else "--angle-unit deg|rad"
        raise InputError(
            f"{table.name}: the unit of column '{names.original[bare[wrong]]}' is not stated; "
            f"name it {robot.columns(None)[0]} …, or give {option}"
        )
    columns = [names.original[column] for column in bare]
    return JointColumns.model_validate({"columns": columns, "unit": units})


def _joints_read(names: Named, robot: Robot, stated: Stated) -> JointColumns | None:
    found: dict[int, tuple[str, str]] = {}
    for name, column in names.original.items():
        bare = re.fullmatch(r"read_j(\d{1,9})", name)
        if bare and 0 < int(bare[1]) <= robot.n:
            unit = stated.unit if robot.prismatic[int(bare[1]) - 1] else stated.angle_unit
            if unit not in (None, "in"):
                found[int(bare[1])] = (column, unit)
        match = re.fullmatch(r"j(\d{1,9})_read_(deg|rad|mm|m)", name)
        if match:
            found[int(match[1])] = (column, match[2])
    if not found:
        return None
    missing = [i for i in range(1, robot.n + 1) if i not in found]
    if missing or len(found) > robot.n:
        raise InputError(
            f"{names.table.name}: read joint values of {len(found)} joints, {robot.name} has "
            f"{robot.n}; "
            f"expected j1_read_{'mm' if robot.prismatic[0] else 'deg'} … j{robot.n}_read_…"
        )
    columns = [found[i] for i in range(1, robot.n + 1)]
    return JointColumns.model_validate(
        {"columns": [c for c, _ in columns], "unit": [unit for _, unit in columns]}
    )
