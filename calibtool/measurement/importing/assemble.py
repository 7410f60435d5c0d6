"""Instrument tables → measurements and their auxiliary; unknown parts of the set-up are
registered afterwards.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calibtool.errormodel.operating_conditions import Conditions, directions
from calibtool.errors import InputError, NoSolutionError
from calibtool.measurement.auxiliary import AuxiliaryReadings
from calibtool.measurement.importing.column_map import ColumnMap, Frame
from calibtool.measurement.importing.commanded_targets import (
    CommandedFile,
    commanded_poses,
    join_commanded,
    of_kept_rows,
)
from calibtool.measurement.importing.header import Stated, complete_map
from calibtool.measurement.importing.joint_files import JOIN_TOLERANCE, Join, join_rows
from calibtool.measurement.importing.known_setup import known_setup
from calibtool.measurement.importing.readings import (
    read_auxiliary,
    read_joints,
    read_payload,
    read_points,
    read_rotations,
)
from calibtool.measurement.importing.row_selection import choose_rows, line_ranges
from calibtool.measurement.importing.sources import SourceTable, read_source
from calibtool.measurement.measurements import Measurements, Setup
from calibtool.measurement.registration import register
from calibtool.measurement.sampling import spread_rows
from calibtool.robot.coupling import JointValues
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly
from calibtool.tables import Table

REGISTRATION_ROWS = (
    20_000  # evenly spaced ones of a longer table; the set-up has at most some twenty unknowns
)


class JointFile(NamedTuple):
    """The joint values' own file and how its rows find theirs, see `joining.join_rows`."""

    data: bytes | str
    name: str
    join: Join = "index"
    tolerance_s: float = JOIN_TOLERANCE


@dataclass(frozen=True)
class Understood:
    """How the files were read: for people, before anything is written (`preview.preview`)."""

    source: SourceTable
    columns: ColumnMap
    joints_name: str
    noise_stated: bool
    ignored: dict[str, list[str]]  # columns that nothing is read from, by file
    lines: np.ndarray  # (N,) in the measured table


class Imported(NamedTuple):
    """Measurements, warnings, what stands beside the measurements, and how the files
    were understood.
    """

    measurements: Measurements
    warnings: list[str]
    auxiliary: AuxiliaryReadings
    understood: Understood

    def split(
        self, rows: str | None, sample: int | None, seed: int
    ) -> "tuple[Imported, Imported | None]":
        """The chosen rows and the rest (None if there is none), see `rows.choose_rows`."""
        taken, rest = choose_rows(len(self.measurements), rows, sample, seed)
        return self.rows(taken), self.rows(rest) if len(rest) else None

    def rows(self, index: np.ndarray) -> "Imported":
        """Some of the rows: their indices (k,)."""
        return self._replace(
            measurements=self.measurements.rows(index),
            auxiliary=self.auxiliary.rows(index),
            understood=replace(self.understood, lines=self.understood.lines[index]),
        )

    def with_setup(self, setup: Setup) -> "Imported":
        """The same with another set-up."""
        return self._replace(measurements=replace(self.measurements, setup=setup))

    def registered(self) -> "Imported":
        """The same with the unknown parts of the set-up fitted to these rows (nominal robot).

        Raises NoSolutionError for too few rows; a warning about the table goes along,
        it may tell why.
        """
        used = self.measurements
        used = used.rows(spread_rows(len(used), REGISTRATION_ROWS))
        try:
            return self.with_setup(register(used))
        except NoSolutionError as error:
            hint = f" ({self.warnings[0]})" if self.warnings else ""
            raise NoSolutionError(f"{error}{hint}") from None


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
    """Measurements from a table, registered to all of its rows:
    `read_table(…).registered()`, which see.
    """
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
    stated: Stated = Stated(),
    joints: JointFile | None = None,
    joint_values: JointValues | None = None,
    commanded: CommandedFile | None = None,
) -> Imported:
    """Measurements and auxiliary from the contents of a file; nothing of the set-up
    is estimated yet.

    columns: what it leaves out is taken from the header's names (docs/file-formats.md). frame:
    overrides the map's.
    robot_targets: the targets are those of the robot's description, in their order. format, sheet,
    layout: see `sources.read_source`. stated: units and convention where the header is silent.
    joints: their own file. joint_values: whose they are where the header does not state it
    (`Robot.joint_values`); overrides the map's. commanded: targets whose corrected joints the arm
    was driven to. Raises InputError for a bad cell, column or target set, UsageError for options
    that do not fit the file, and for joint values of which nothing states whose they are, where it
    matters.
    """
    how = {"delimiter": columns.delimiter, "decimal": columns.decimal} if columns else {}
    source = read_source(data, name, format, sheet=sheet, layout=layout, **how)
    warnings: list[str] = []
    by = columns.join if columns else None
    targets: Table | None = None
    if commanded is not None:
        table, targets, warnings = join_commanded(source.table, commanded, by)
        source = replace(source, table=table)
    joint_table = source.table
    if joints is not None:
        joint_table = read_source(joints.data, joints.name).table
        table, joint_table, unmatched = join_rows(
            source.table, joint_table, joints.join, by, joints.tolerance_s
        )
        if targets is not None:
            targets = of_kept_rows(targets, source.table, table)
        source, warnings = replace(source, table=table), warnings + unmatched
    mapped = columns is not None and columns.joints is not None
    complete = complete_map(source, joint_table, robot, columns, stated)
    assert complete.joints is not None
    stated_values = complete.joints.values
    if mapped and joint_values is not None:
        stated_values = joint_values
    values = robot.joint_values(joint_table.name, stated_values, joint_values)
    complete = complete.with_joint_values(values)
    assert complete.joints is not None
    table = source.table
    q = read_joints(joint_table, robot, complete.joints)
    points = read_points(table, complete)
    zero = (points == 0.0).all(axis=-1)
    if zero.any():  # no instrument measures its own origin to the last digit
        points = np.where(zero[..., None], np.nan, points)
        warnings.append(
            f"{table.name}: 0, 0, 0 was taken for 'not seen' in {int(zero.sum())} places: line "
            f"{line_ranges([table.lines[k] for k in _rows(zero.any(axis=-1))])}"
        )
    seen = ~np.isnan(points[..., 0])
    if not seen.any(axis=-1).all():
        row = int(np.argmin(seen.any(axis=-1)))
        why = " (0, 0, 0 is not seen)" if zero[row].any() else ""
        raise InputError(f"{table.place(row)}: no target was measured in this row{why}")
    rotations = None if complete.pose is None else readonly(read_rotations(table, complete.pose))
    auxiliary = read_auxiliary(table, joint_table, robot, complete, q)
    measurements = Measurements(
        robot=robot,
        q=readonly(q),
        points=readonly(points),
        rotations=rotations,
        setup=known_setup(
            complete, robot, points, frame or complete.instrument.frame, robot_targets, name
        ),
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
    warnings += _lacking(table, complete, seen) + _outside(joint_table, robot, measurements)
    understood = Understood(
        source=replace(source, table=replace(table, rows=[], lines=[])),
        columns=complete.model_copy(
            update={
                "instrument": complete.instrument.model_copy(
                    update={"frame": frame or complete.instrument.frame}
                )
            }
        ),
        joints_name=joint_table.name,
        noise_stated=columns is not None and "noise" in columns.model_fields_set,
        ignored=_ignored(source, joint_table, complete),
        lines=np.array(table.lines),
    )
    return Imported(measurements, warnings, auxiliary, understood)


def _lacking(table: Table, columns: ColumnMap, seen: np.ndarray) -> list[str]:
    """A warning per target that is missing somewhere, with every line."""
    return [
        f"{table.name}: target {i + 1} ({target.columns[0]} …) is missing in "
        f"{int((~seen[:, i]).sum())} of {len(seen)} rows; their other targets count: line "
        f"{line_ranges([table.lines[k] for k in _rows(~seen[:, i])])}"
        for i, target in enumerate(columns.targets)
        if not seen[:, i].all()
    ]


def _whole(values: Array | None) -> bool:
    """Whether there is a number in every row."""
    return values is not None and bool(np.isfinite(values).all())


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


def _ignored(source: SourceTable, joints: Table, columns: ColumnMap) -> dict[str, list[str]]:
    """Columns of each file that nothing is read from."""
    of_joints = {
        column for part in (columns.joints, columns.joints_read) if part for column in part.columns
    }
    of_table = {column for target in columns.targets for column in target.columns}
    of_table |= {column for reference in columns.references for column in reference.measured}
    of_table |= {
        part.column for part in (columns.time, columns.temperature, columns.payload) if part
    }
    if columns.pose is not None:
        of_table |= {*columns.pose.position, *columns.pose.orientation}
    keys = (
        {columns.join.measured, columns.join.joints}
        if columns.join
        else {"name", "time_s", "time_ms", "time_iso"}
    )
    used = {source.table.name: of_table}
    used[joints.name] = used.get(joints.name, set()) | of_joints
    headers = {source.table.name: source.table.header, joints.name: joints.header}
    separate = joints.name != source.table.name
    return {
        name: [c for c in header if c and c not in used[name] and not (separate and c in keys)]
        for name, header in headers.items()
    }
