"""Instrument tables → measurements and auxiliary readings, before the set-up is registered."""

from dataclasses import replace

import numpy as np

from calibtool.errormodel.operating_conditions import Conditions, directions
from calibtool.errors import InputError, UsageError
from calibtool.measurement.importing.column_map import ColumnMap, Frame
from calibtool.measurement.importing.commanded_targets import (
    CommandedFile,
    commanded_poses,
    join_commanded,
    of_kept_rows,
)
from calibtool.measurement.importing.header import complete_map, time_column
from calibtool.measurement.importing.imported import Imported, JointFile, Understood
from calibtool.measurement.importing.joint_files import join_rows, stamps
from calibtool.measurement.importing.known_setup import known_setup
from calibtool.measurement.importing.labels import label_pair
from calibtool.measurement.importing.long_form import one_row_each
from calibtool.measurement.importing.names import named
from calibtool.measurement.importing.readings import (
    read_auxiliary,
    read_joints,
    read_lengths,
    read_payload,
    read_places,
    read_points,
    read_rotations,
)
from calibtool.measurement.importing.row_selection import line_ranges
from calibtool.measurement.importing.second_arm_columns import SecondArm, is_second, seen_from
from calibtool.measurement.importing.sources import SourceTable, read_source
from calibtool.measurement.importing.stated_units import Stated
from calibtool.measurement.importing.template import map_template
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.streams import JointStream
from calibtool.robot.coupling import JointValues
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly
from calibtool.tables import Table
from calibtool.units import count_of

COMPENSATED = ("status", "left_mm", "left_mrad")  # what `compensate` adds to its rows


def import_table(
    data: bytes | str,
    name: str,
    robot: Robot,
    columns: ColumnMap | None = None,
    *,
    frame: Frame | None = None,
    robot_targets: bool = False,
    joint_values: JointValues | None = None,
) -> Imported:
    """Measurements from a table, registered to all of its rows: `read_table(…).registered()`."""
    return read_table(
        data,
        name,
        robot,
        columns,
        frame=frame,
        robot_targets=robot_targets,
        joint_values=joint_values,
    ).registered()


def read_table(
    data: bytes | str,
    name: str,
    robot: Robot,
    columns: ColumnMap | None = None,
    *,
    frame: Frame | None = None,
    robot_targets: bool = False,
    format: str | None = None,
    sheet: str | None = None,
    layout: str | None = None,
    encoding: str | None = None,
    stated: Stated = Stated(),
    joints: JointFile | None = None,
    joint_values: JointValues | None = None,
    commanded: CommandedFile | None = None,
    board: bool = False,
    second_arm: SecondArm | None = None,
) -> Imported:
    """Measurements and auxiliary readings from the contents of a file; the set-up is not estimated
    yet.

    columns        a map; missing parts are taken from the header's names (docs/file-formats.md)
    frame          replaces the map's
    robot_targets  the targets are those of the robot's description, in their order
    format, sheet, layout, encoding   see `sources.read_source`
    stated         units and convention that the header does not state
    joints         the file of the joint values, where the table has none
    joint_values   which joint values they are if the header does not say it
                   (`Robot.joint_values`); replaces the map's
    commanded      targets to whose corrected joints the arm was driven
    board          poses are those of a board in a camera on the tool
    second_arm     the arm whose sensor sees the points

    Raises InputError for a bad cell, column or target set, UsageError for options that do not fit
    the file, and for joint values of which it is not known whether they are the controller's, where
    they differ.
    """
    how = {"delimiter": columns.delimiter, "decimal": columns.decimal} if columns else {}
    source = read_source(data, name, format, sheet=sheet, layout=layout, encoding=encoding, **how)
    notes = source.notes
    warnings: list[str] = []
    by = columns.join if columns else None
    targets: Table | None = None
    if commanded is not None:
        table, targets, warnings = join_commanded(source.table, commanded, by)
        source = replace(source, table=table)
    of_joints = (
        None if joints is None else read_source(joints.data, joints.name, encoding=joints.encoding)
    )
    if source.points is None and not (columns and (columns.targets or columns.pose)):
        urdf = list(robot.chain.model.names)[1:]
        table, note = one_row_each(
            source.table, None if of_joints is None else of_joints.table, urdf
        )
        source, notes = replace(source, table=table), (*notes, *([note] if note else []))
    joint_table = source.table
    if joints is not None and of_joints is not None:
        joint_table, notes = of_joints.table, notes + of_joints.notes
        log = joint_table
        table, joint_table, unmatched = join_rows(
            source.table, log, joints.join, by, joints.tolerance_s
        )
        if targets is not None:
            targets = of_kept_rows(targets, source.table, table)
        source, warnings = replace(source, table=table), warnings + unmatched
    kept, left_out = _driven(joint_table)
    if left_out:
        joint_table, warnings = joint_table.take(kept), [*warnings, left_out]
        source = replace(source, table=source.table.take(kept) if joints else joint_table)
        targets = targets and targets.take(kept)
    complete = complete_map(source, joint_table, robot, columns, stated)
    if board:
        if complete.pose is None:
            raise UsageError("--poses-of board: the table holds no poses")
        pose = complete.pose.model_copy(update={"of": "board"})
        complete = complete.model_copy(update={"pose": pose})
    assert complete.joints is not None
    mapped = columns is not None and columns.joints is not None
    stated_values = (joint_values if mapped else None) or complete.joints.values
    kept, left_out = _measured(source.table, complete)
    if left_out:
        same = joint_table is source.table
        source = replace(source, table=source.table.take(kept))
        joint_table = source.table if same else joint_table.take(kept)
        targets, warnings = targets and targets.take(kept), [*warnings, left_out]
    whose = robot.joint_values(joint_table.name, stated_values, joint_values)
    complete = complete.with_joint_values(whose)
    if frame is not None:
        instrument = complete.instrument.model_copy(update={"frame": frame})
        complete = complete.model_copy(update={"instrument": instrument})
    assert complete.joints is not None
    table = source.table
    q = read_joints(joint_table, robot, complete.joints)
    points, values, zeros = _points_and_values(table, complete)
    warnings += zeros
    seen = ~np.isnan(points[..., 0]) if values is None else np.isfinite(values)
    place_of, places = (
        (None, ()) if complete.place is None else read_places(table, complete.place.column)
    )
    if complete.lengths is not None and complete.lengths.of == "distance":
        place_of, places = None, ()  # the same fixed points for all rows
    rotations = None if complete.pose is None else readonly(read_rotations(table, complete.pose))
    auxiliary = read_auxiliary(table, joint_table, robot, complete, q)
    measurements = Measurements(
        robot=robot,
        q=readonly(q),
        points=readonly(points),
        rotations=rotations,
        setup=known_setup(complete, robot, points, robot_targets, name, places),
        values=None if values is None else readonly(values),
        place=place_of,
        noise_position=complete.noise.position_mm * 1e-3,
        noise_orientation=complete.noise.orientation_mrad * 1e-3,
        conditions=Conditions(
            direction=readonly(directions(q)),
            payload_kg=None
            if complete.payload is None
            else readonly(read_payload(table, complete.payload)),
            temperature_c=auxiliary.temperature_c if _whole(auxiliary.temperature_c) else None,
        ),
        commanded=None if targets is None else commanded_poses(targets, robot, joint_values),
    )
    if second_arm is not None:
        measurements = seen_from(measurements, table, second_arm)
    stream = None
    if joints is not None and joints.join == "time":
        wanted, known = stamps(table, log, by)
        stream = JointStream.of(known, read_joints(log, robot, complete.joints), wanted)
        if len(stream.times) < 2 or stream.gaps().max() > 2 * joints.tolerance_s:
            stream = None  # joints at rest, one row each
    warnings += _lacking(table, complete, seen) + _outside(joint_table, robot, measurements)
    understood = Understood(
        source=replace(source, table=replace(table, rows=[], lines=[])),
        columns=complete,
        joints_name=joint_table.name,
        noise_stated=columns is not None and "noise" in columns.model_fields_set,
        ignored=_ignored(source, joint_table, complete, joints, second_arm is not None),
        lines=np.array(table.lines),
        notes=notes,
    )
    imported = Imported(measurements, warnings, auxiliary, understood, stream)
    return imported if stream is None else imported.with_clock_offset(0.0)


def _points_and_values(table: Table, columns: ColumnMap) -> tuple[Array, Array | None, list[str]]:
    """Points (N, m, 3) in m, other values (N, d), and warnings; what was not seen is NaN.

    InputError for a row in which nothing was measured.
    """
    points, warnings = read_points(table, columns), []

    def lines(rows: np.ndarray) -> str:
        missing = np.flatnonzero(rows.any(axis=-1)).tolist()
        return f"line {line_ranges([table.lines[k] for k in missing])}"

    if columns.lengths is None:
        zero = _not_seen(points)
        if zero.any():  # no instrument measures its own origin to the last digit
            points = np.where(zero[..., None], np.nan, points)
            warnings.append(
                f"{table.name}: 0, 0, 0 was taken for 'not seen' in "
                f"{count_of(int(zero.sum()), 'place')}: {lines(zero)}"
            )
        values, seen = None, ~np.isnan(points[..., 0])
    else:
        values = read_lengths(table, columns.lengths)
        zero = (values == 0.0) & (columns.lengths.of in ("distance", "centre"))
        if zero.any():
            values = np.where(zero, np.nan, values)
            warnings.append(
                f"{table.name}: a distance of 0 was taken for 'not read' in "
                f"{count_of(int(zero.sum()), 'place')}: {lines(zero)}"
            )
        seen = np.isfinite(values)
    if not seen.any(axis=-1).all():
        row = int(np.argmin(seen.any(axis=-1)))
        why = " (0, 0, 0 is not seen)" if values is None and zero[row].any() else ""
        raise InputError(f"{table.place(row)}: no target was measured in this row{why}")
    return points, values, warnings


def template_of(
    data: bytes | str,
    name: str,
    robot: Robot,
    stated: Stated = Stated(),
    joints: JointFile | None = None,
    **how: str | None,
) -> str:
    """A column map in TOML from the headers of a file and of the joints' file, see `read_table`."""
    source = read_source(data, name, **how)
    table = source.table
    if joints is not None:
        table = read_source(joints.data, joints.name, encoding=joints.encoding).table
    return map_template(source, table, robot, stated)


def _lacking(table: Table, columns: ColumnMap, seen: np.ndarray) -> list[str]:
    """A warning for every target that is missing in some rows, with their lines."""
    return [
        f"{table.name}: target {i + 1} ({target.columns[0]} …) is missing in "
        f"{int((~seen[:, i]).sum())} of {len(seen)} rows; their other targets count: line "
        f"{line_ranges([table.lines[k] for k in _rows(~seen[:, i])])}"
        for i, target in enumerate(columns.targets)
        if not seen[:, i].all()
    ]


def _measured(table: Table, columns: ColumnMap) -> tuple[list[int], str | None]:
    """Rows in which a target or the pose was seen, and a warning about the others.

    Motion capture has empty cells where nothing was seen. Where all rows are so, none is left out.
    """
    empty: list[int] = []
    if columns.pose is not None:
        at = [table.index(name) for name in (*columns.pose.position, *columns.pose.orientation)]
        empty = [k for k, row in enumerate(table.rows) if not any(row[i] for i in at)]
    elif columns.targets:
        points = read_points(table, columns)
        empty = _rows((np.isnan(points[..., 0]) | _not_seen(points)).all(axis=-1))
    if not empty or len(empty) == len(table):
        return list(range(len(table))), None
    count = "1 row" if len(empty) == 1 else f"{len(empty)} rows"
    lines = line_ranges([table.lines[k] for k in empty])
    return sorted(set(range(len(table))) - set(empty)), (
        f"{table.name}: {count} in which nothing was measured left out: line {lines}"
    )


def _driven(joints: Table) -> tuple[list[int], str | None]:
    """Rows that got joints from `compensate`, and a warning about the others."""
    if "status" not in joints.header:
        return list(range(len(joints))), None
    states = joints.texts("status")
    kept = [row for row, status in enumerate(states) if status != "unreachable"]
    if len(kept) == len(states):
        return kept, None
    lines = line_ranges([joints.lines[row] for row in range(len(states)) if row not in set(kept)])
    return kept, (
        f"{joints.name}: {len(states) - len(kept)} rows have the status unreachable and no joints; "
        f"left out: line {lines}"
    )


def _whole(values: Array | None) -> bool:
    """Whether there is a number in every row."""
    return values is not None and bool(np.isfinite(values).all())


def _not_seen(points: Array) -> np.ndarray:
    """Where points (N, m, 3) are exactly 0, 0, 0, which is not a reading: (N, m) bool.

    Points of a gauge are not readings; they repeat, and one of them may be the origin.
    """
    distinct = len(np.unique(points.reshape(-1, 3), axis=0))
    if 2 * distinct <= len(points):
        return np.zeros(points.shape[:2], dtype=bool)
    zero: np.ndarray = (points == 0.0).all(axis=-1)
    return zero


def _rows(chosen: np.ndarray) -> list[int]:
    return [int(row) for row in np.flatnonzero(chosen)]


def _outside(table: Table, robot: Robot, measurements: Measurements) -> list[str]:
    outside = ~robot.within_limits(measurements.q)
    if not outside.any():
        return []
    first = table.place(int(np.argmax(outside)))
    return [
        f"{first}: {int(outside.sum())} of {len(outside)} rows are outside the joint limits of "
        f"{robot.name}; kept"
    ]


def _ignored(
    source: SourceTable,
    joints: Table,
    columns: ColumnMap,
    joined: JointFile | None,
    two_arms: bool,
) -> dict[str, list[str]]:
    """Columns of each file that are not used, not even to match rows."""
    beside = set(COMPENSATED)
    if joined is not None and joined.join != "index" and columns.join is not None:
        beside |= {columns.join.measured, columns.join.joints}
    elif joined is not None and joined.join == "name":
        beside |= set(label_pair(source.table, joints) or ())
    elif joined is not None and joined.join == "time":
        found = (time_column(named(table)) for table in (source.table, joints))
        beside |= {column.column for column in found if column}
    of_joints = {
        column for part in (columns.joints, columns.joints_read) if part for column in part.columns
    }
    of_table = columns.columns - of_joints
    used = {source.table.name: of_table}
    used[joints.name] = used.get(joints.name, set()) | of_joints
    headers = {source.table.name: source.table.header, joints.name: joints.header}
    if two_arms:
        beside |= {column for column in source.table.header if is_second(column)}
    return {
        name: [c for c in header if c and c not in used[name] | beside]
        for name, header in headers.items()
    }
