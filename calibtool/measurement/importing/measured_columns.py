"""Columns of measured values: target points, a pose, lengths, by the names of a header."""

import re
from collections.abc import Sequence

from calibtool.errors import InputError
from calibtool.joint_and_pose_columns import pose_columns_of
from calibtool.measurement.importing.column_map import (
    CONVENTIONS,
    LengthUnit,
    PlaceColumn,
    PoseColumns,
    ReferenceColumns,
    TargetColumns,
    check_convention,
)
from calibtool.measurement.importing.matrix_names import MATRIX
from calibtool.measurement.importing.measured_lengths import measured_lengths
from calibtool.measurement.importing.names import Named
from calibtool.measurement.importing.sources import SourceTable
from calibtool.measurement.importing.spelling import spelt
from calibtool.measurement.importing.stated_units import Stated

_LENGTHS: tuple[LengthUnit, ...] = ("mm", "m", "in")
_TARGET = re.compile(r"t(\d{1,9})_(?:nominal_|error_)?[xyz](?:_(mm|m|in))?")
_REFERENCE = re.compile(r"ref(\d{1,9})_[xyz](?:_(mm|m|in))?")
_VECTORS = ("rvec", "rotv", "rodr")  # how names of rotation vectors begin
_ANGLES = (  # three angles, and whose convention it may be
    (("rx", "ry", "rz"), ""),
    (("roll", "pitch", "yaw"), ""),
    (("a", "b", "c"), " (KUKA's A B C: zyx)"),
    (("w", "p", "r"), " (FANUC's W P R: extrinsic-xyz)"),
    (("o", "a", "t"), " (Kawasaki's O A T: intrinsic-zyz)"),
    (("a", "e", "r"), " (Comau's A E R: intrinsic-zyz)"),
)


def measured_columns(names: Named, source: SourceTable, stated: Stated) -> dict[str, object]:
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
    lengths = measured_lengths(names, lambda unit, name: _length(unit or stated.unit, name, names))
    if lengths is not None:
        return {"lengths": lengths}
    raise InputError(
        f"{table.name}: no measured points: expected t1_x_mm t1_y_mm t1_z_mm …, x_mm y_mm z_mm or "
        "a pose, or map the columns with --columns MAP.toml"
    )


def place_column(names: Named) -> PlaceColumn | None:
    """The column that labels stations, placements, boards, planes or spheres."""
    for word in ("station", "placement", "board", "plane", "sphere"):
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
    """Their names in the file; a missing name stays for the message."""
    return [names.original.get(column, column) for column in columns]


def reference_columns(names: Named, stated: Stated) -> list[ReferenceColumns]:
    """Fixed points measured beside the targets, `ref1_x_mm ref1_y_mm ref1_z_mm …`."""
    return [
        ReferenceColumns(
            measured=_originals(names, [f"ref{number}_{axis}{suffix}" for axis in "xyz"]), unit=unit
        )
        for number, unit, suffix in _numbered(names, _REFERENCE, stated)
    ]


def _numbered(
    names: Named, pattern: re.Pattern[str], stated: Stated
) -> list[tuple[int, LengthUnit, str]]:
    """Number, unit and suffix of columns of numbered points. InputError for two units or none."""
    found: dict[int, tuple[str, str | None]] = {}
    for column in names.original:
        match = pattern.fullmatch(column)
        if match is None:
            continue
        before, unit = found.setdefault(int(match[1]), (column, match[2]))
        if None not in (unit, match[2]) and unit != match[2]:
            raise InputError(
                f"{names.table.name}: columns '{names.original[before]}' and "
                f"'{names.original[column]}' of one point have different units"
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
    """A position with an orientation. Three angles without a convention are refused."""
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
    if names.has(MATRIX) and asked in (None, "matrix"):
        return _pose_columns(place, _originals(names, MATRIX), "matrix", None)
    for angles, hint in _ANGLES:
        for suffix in ("_deg", "_rad", ""):
            if not names.has(f"{angle}{suffix}" for angle in angles):
                continue
            columns = _originals(names, [f"{angle}{suffix}" for angle in angles])
            stated_unit = suffix[1:] or stated.angle_unit
            if asked is None and all(spelt(column)[:4] in _VECTORS for column in columns):
                asked, stated_unit = "rotation-vector", suffix[1:] or "rad"
            if asked is None or stated_unit is None:
                what, option, known = (
                    ("convention", "--convention", CONVENTIONS + hint)
                    if asked is None
                    else ("unit", "--angle-unit", "deg or rad")
                )
                raise InputError(
                    f"{table.name}: the {what} of the orientation {' '.join(columns)} is not "
                    f"stated; give {option}: {known}"
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
