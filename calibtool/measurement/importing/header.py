"""Meaning of the names of a header: the parts of a column map that no file gives."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar, get_args

from pydantic import BaseModel

from calibtool.errors import InputError
from calibtool.measurement.importing.column_map import (
    CONVENTIONS,
    AngleUnit,
    ColumnMap,
    JointColumns,
    LengthColumns,
    LengthUnit,
    PayloadColumn,
    PlaceColumn,
    PoseColumns,
    ReferenceColumns,
    TargetColumns,
    TemperatureColumn,
    TimeColumn,
    TimeUnit,
    check_convention,
)
from calibtool.measurement.importing.dates import is_date
from calibtool.measurement.importing.names import Named, named
from calibtool.measurement.importing.sources import SourceTable
from calibtool.robot.robot import Robot
from calibtool.tables import Table, joint_columns_of, pose_columns_of, stated_values, unit_of

_LENGTHS: tuple[LengthUnit, ...] = ("mm", "m", "in")
_TARGET = re.compile(r"t(\d{1,9})_(?:nominal_|error_)?[xyz](?:_(mm|m|in))?")
_REFERENCE = re.compile(r"ref(\d{1,9})_[xyz](?:_(mm|m|in))?")
_DISTANCE = re.compile(r"(?:distance|wire|length)_?(\d{1,3})?(?:_(mm|m|in))?")
_ANGLES = (  # three angles, and whose convention it may be
    (("rx", "ry", "rz"), ""),
    (("roll", "pitch", "yaw"), ""),
    (("a", "b", "c"), " (KUKA's A B C: zyx)"),
    (("w", "p", "r"), " (FANUC's W P R: extrinsic-xyz)"),
    (("o", "a", "t"), " (Kawasaki's O A T: intrinsic-zyz)"),
    (("a", "e", "r"), " (Comau's A E R: intrinsic-zyz)"),
)


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


class Found(NamedTuple):
    """What the names of headers say; an error instead of a part that they do not say, or not
    clearly.
    """

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
    """The parts of a map that the headers' names give, those in `given` left aside.

    source: the measured values; joints: the table that holds the joint values, the same one
    unless they have their own.
    """
    given = given or ColumnMap()
    names = list(robot.chain.model.names)[1:]
    measured = named(source.table, names, given.columns)
    of_joints = measured if joints is source.table else named(joints, names, given.columns)
    of_arm: JointColumns | InputError = given.joints or InputError("")
    of_points: ColumnMap | InputError = given
    if given.joints is None:
        try:
            of_arm = _joints(of_joints, robot, source, stated)
        except InputError as error:
            of_arm = error
    if not given.targets and given.pose is None and given.lengths is None:
        try:
            of_points = ColumnMap().model_copy(update=_measured(measured, source, stated))
        except InputError as error:
            of_points = error
    return Found(
        of_arm,
        of_points,
        given.joints_read or _joints_read(of_joints, robot),
        given.time or time_column(measured),
        given.temperature or _one(measured, TemperatureColumn, "temperature", "CK"),
        given.payload or _one(measured, PayloadColumn, "payload", ("kg", "g")),
        given.place or _place(measured),
        given.references or _references(measured, stated),
    )


def complete_map(
    source: SourceTable, joints: Table, robot: Robot, given: ColumnMap | None, stated: Stated
) -> ColumnMap:
    """The map with every part that it leaves out taken from the names of the headers
    (docs/file-formats.md).

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


def _joints_read(names: Named, robot: Robot) -> JointColumns | None:
    found = {}
    for name, column in names.original.items():
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


def _measured(names: Named, source: SourceTable, stated: Stated) -> dict[str, object]:
    """Targets or pose by name: `t1_x_mm …`, `t1_nominal_x_mm …` with `t1_error_x_mm …`, `x_mm y_mm
    z_mm`, a pose.
    """
    table = names.table
    if source.points is not None:
        if stated.unit is None:
            raise InputError(
                f"{table.name}: a list of points does not state its unit; give --unit mm, m or in"
            )
        return {
            "targets": [TargetColumns(measured=c, unit=stated.unit) for c in source.points.columns]
        }
    targets = _targets(names, stated)
    if targets:
        return {"targets": targets}
    pose = _pose(names, stated)
    if pose is not None:
        return {"pose": pose}
    position = _position(names, stated)
    if position is not None:
        own = _originals(names, position[0])
        return {"targets": [TargetColumns(measured=own, unit=position[1])]}
    lengths = _lengths(names, stated)
    if lengths is not None:
        return {"lengths": lengths}
    raise InputError(
        f"{table.name}: no measured points: expected t1_x_mm t1_y_mm t1_z_mm …, x_mm y_mm z_mm or "
        "a pose, "
        "or map the columns with --columns MAP.toml"
    )


def _lengths(names: Named, stated: Stated) -> LengthColumns | None:
    """`distance_mm`, `distance1_mm distance2_mm …`, or one coordinate alone: the height above a
    plane.
    """
    found: dict[int, tuple[str, str | None]] = {}
    for name in names.original:
        if match := _DISTANCE.fullmatch(name.lower()):
            found[int(match[1] or 1)] = (name, match[2])
    what = "distance"
    alone = [n for n in names.original if re.fullmatch(r"(?:[xyz]|height)(?:_(?:mm|m|in))?", n)]
    if not found and len(alone) == 1:
        what, unit = "plane", alone[0].partition("_")[2]
        found[1] = (alone[0], unit or None)
    if not found:
        return None
    units = {_length(unit or stated.unit, name, names) for name, unit in found.values()}
    if len(units) > 1:
        raise InputError(f"{names.table.name}: the measured lengths have different units")
    columns = [names.original[found[k][0]] for k in sorted(found)]
    return LengthColumns.model_validate({"columns": columns, "unit": units.pop(), "of": what})


def _place(names: Named) -> PlaceColumn | None:
    """The column that labels stations, placements, boards or planes."""
    for word in ("station", "placement", "board", "plane"):
        if word in names.original:
            return PlaceColumn(column=names.original[word])
    return None


def _targets(names: Named, stated: Stated) -> list[TargetColumns]:
    targets = []
    for number, unit, suffix in _numbered(names, _TARGET, stated):

        def triple(kind: str, number: int = number, suffix: str = suffix) -> list[str]:
            return _originals(names, [f"t{number}_{kind}{axis}{suffix}" for axis in "xyz"])

        if f"t{number}_nominal_x{suffix}" in names.original:
            targets.append(
                TargetColumns(nominal=triple("nominal_"), error=triple("error_"), unit=unit)
            )
        else:
            targets.append(TargetColumns(measured=triple(""), unit=unit))
    return targets


def _originals(names: Named, columns: list[str]) -> list[str]:
    """What the file calls them; a name that lacks stays, for the message that says so."""
    return [names.original.get(column, column) for column in columns]


def _references(names: Named, stated: Stated) -> list[ReferenceColumns]:
    return [
        ReferenceColumns(
            measured=_originals(names, [f"ref{number}_{axis}{suffix}" for axis in "xyz"]), unit=unit
        )
        for number, unit, suffix in _numbered(names, _REFERENCE, stated)
    ]


def _numbered(
    names: Named, pattern: re.Pattern[str], stated: Stated
) -> list[tuple[int, LengthUnit, str]]:
    """Number, unit and the suffix of the columns of numbered points, by number. InputError for two
    units or none.
    """
    found: dict[int, tuple[str, str | None]] = {}
    for column in names.original:
        match = pattern.fullmatch(column)
        if match is None:
            continue
        before, unit = found.setdefault(int(match[1]), (column, match[2]))
        if None not in (unit, match[2]) and unit != match[2]:
            raise InputError(
                f"{names.table.name}: columns '{names.original[before]}' and "
                f"'{names.original[column]}' of one point have "
                "different units"
            )
    result = []
    for number, (column, unit) in sorted(found.items()):
        result.append(
            (number, _length(unit or stated.unit, column, names), f"_{unit}" if unit else "")
        )
    return result


def _length(unit: str | None, column: str, names: Named) -> LengthUnit:
    for known in _LENGTHS:
        if unit == known:
            return known
    name = names.original[column]
    raise InputError(
        f"{names.table.name}: the unit of column '{name}' is not stated; name it {name}_mm (_m, "
        "_in), or give --unit mm|m|in"
    )


def _position(names: Named, stated: Stated) -> tuple[list[str], LengthUnit] | None:
    for unit in _LENGTHS:
        if names.has(f"{axis}_{unit}" for axis in "xyz"):
            return [f"{axis}_{unit}" for axis in "xyz"], unit
    if names.has("xyz"):
        return list("xyz"), _length(stated.unit, "x", names)
    return None


def _pose(names: Named, stated: Stated) -> PoseColumns | None:
    """A position with an orientation beside it. Three angles without a convention are refused,
    never guessed.
    """
    position = _position(names, stated)
    if position is None:
        return None
    table, asked = names.table, stated.convention
    place = _originals(names, position[0]), position[1]
    own = pose_columns_of(table) if position[0][0] in ("x_mm", "x_m") else None
    if own is not None and asked is None:
        first = own[1][0]
        convention = {"qw": "quaternion-wxyz", "rx_rad": "rotation-vector"}.get(
            first, "extrinsic-xyz"
        )
        unit = "deg" if first == "roll_deg" else "rad"
        return _pose_columns(place, _originals(names, own[1]), convention, unit)
    quaternion = ["qw", "qx", "qy", "qz"]
    if names.has(quaternion):
        columns = _originals(names, quaternion)
        if asked not in (None, "quaternion-wxyz"):
            raise InputError(
                f"{table.name}: columns {' '.join(columns)}, but --convention says {asked}"
            )
        return _pose_columns(place, columns, "quaternion-wxyz", None)
    for angles, hint in _ANGLES:
        for suffix in ("_deg", "_rad", ""):
            if not names.has(f"{angle}{suffix}" for angle in angles):
                continue
            columns = _originals(names, [f"{angle}{suffix}" for angle in angles])
            stated_unit = suffix[1:] or stated.angle_unit
            if asked is None or stated_unit is None:
                what, option, known = (
                    ("convention", "--convention", CONVENTIONS + hint)
                    if asked is None
                    else ("unit", "--angle-unit", "deg or rad")
                )
                raise InputError(
                    f"{table.name}: the {what} of the orientation {' '.join(columns)} is not "
                    "stated; "
                    f"give {option}: {known}"
                )
            return _pose_columns(place, columns, asked, stated_unit)
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
