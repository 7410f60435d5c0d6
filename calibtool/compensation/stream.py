"""Rows of commanded targets of any number, as CSV or newline-delimited JSON, corrected in batches
of constant memory.
"""

import csv
import io
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from calibtool.calibration import Calibration
from calibtool.calibration.uncertainty import predicted_uncertainty, with_discrepancy
from calibtool.compensation.backlash_path import BacklashPath
from calibtool.compensation.decimals import DECIMALS, decimal_rows
from calibtool.compensation.jumps import CorrectionJump, CorrectionPath
from calibtool.compensation.one_step import default_bounds
from calibtool.compensation.solve import Compensation, Method
from calibtool.compensation.status import CORRECTED, DOUBTFUL, JUMP, MEANING, OK
from calibtool.compensation.targets import OutsidePolicy, guarded, no_targets
from calibtool.compensation.weighted_error import Weights
from calibtool.errors import InputError
from calibtool.joint_and_pose_columns import joints_from_header, poses_from_header, unit_of
from calibtool.robot.coupling import JointValues
from calibtool.robot.se3 import Array
from calibtool.tables import Table, number, read_tables
from calibtool.units import TO_SI, without_values

RowFormat = Literal["csv", "ndjson"]
BATCH = 4096
# Numbers, 31 MiB: the C library keeps freed memory for the next batch up to the largest block that
# it ever got back.
_LARGEST_KEPT = 31 * 2**17
_JUMP = np.deg2rad(
    60.0
)  # between neighbours of a path: another branch, or a singularity on the way
_ADDED = ("status", "left_mm", "left_mrad", "sd_mm", "sd_mrad")


@dataclass(frozen=True)
class StreamOptions:
    """How rows are corrected: see `compensate_joints` and `guarded`; `uncertainty` and
    `verify` add columns.

    backlash: take up the calibration's backlash; needs rows in the order of motion, see
    `BacklashPath`.
    joint_values: whose joint values come in, where the header does not state it, and go out
    (`Robot.joint_values`).
    largest_change (rad) and weights: see `default_bounds`.
    """

    method: Method = "exact"
    outside: OutsidePolicy = "mark"
    uncertainty: bool = False
    verify: bool = False
    joint_values: JointValues | None = None
    backlash: bool = True
    largest_change: float | None = None
    weights: Weights | None = None
    batch: int = BATCH


@dataclass
class StreamReport:
    """Counts and remarks of the rows so far.

    remarks                a line for each of the first `listed` rows that are not plainly `ok`
    others                 how many more of these there are
    without_joints         rows that got no joints, unreachable or refused
    in_full                rows that are corrected in full
    remaining_position     largest error of these under the calibrated model, m
    remaining_orientation  the same, rad
    """

    listed: int = 10
    rows: int = 0
    remarks: list[str] = field(default_factory=list)
    others: int = 0
    without_joints: int = 0
    in_full: int = 0
    remaining_position: float = 0.0
    remaining_orientation: float = 0.0

    @property
    def full(self) -> bool:
        """Whether further remarks are counted only."""
        return len(self.remarks) >= self.listed

    def remark(self, line: str) -> None:
        """Keep a line, or count it when there are enough."""
        if self.full:
            self.others += 1
        else:
            self.remarks.append(line)


@dataclass(frozen=True, eq=False)
class _Corrected:
    """A batch: the table, which of its columns stay, the corrected joints in its units,
    and what is added.
    """

    table: Table
    kept: list[int]
    joint_names: list[str]
    values: Array
    added: dict[str, list[str]]


def compensate_stream(
    calibration: Calibration,
    lines: Iterable[str],
    name: str,
    options: StreamOptions,
    report: StreamReport,
    row_format: RowFormat = "csv",
) -> Iterator[str]:
    """Text of corrected rows, batch by batch; `report` counts along.

    Joint columns are replaced by the corrected joints, in their units; pose columns give way to
    joints in degrees (mm if prismatic). Where the controller shows other values than the serial
    chain's, the columns written state whose they are. Where a row has both, the pose is commanded
    and the joints choose the branch. Other columns pass through; a column `status` is added, for n
    < 6 and with `verify` the remaining error under the calibrated model (`left_mm`, `left_mrad`),
    and with `uncertainty` the predicted standard deviations of the tool (`sd_mm`, `sd_mrad`). Poses
    in order are a path: each starts from the row before, and jumps of the joints are reported. Rows
    whose correction changes faster than the command (`CorrectionPath`) have the status `jump`.
    Backlash is taken up along the rows, which must be in the order of motion then
    (`StreamOptions.backlash`). Raises InputError for the first bad row.
    """
    np.empty(_LARGEST_KEPT)  # given back at once
    corrector = _Corrector(calibration, options, report)
    if row_format == "ndjson":
        for table, objects in _read_objects(lines, name, options.batch):
            yield _objects_text(corrector.corrected(table), objects)
        return
    first = True
    for table in read_tables(lines, name, batch=options.batch):
        yield _csv_text(corrector.corrected(table), first)
        first = False


def compensate_text(
    calibration: Calibration, text: str, name: str, options: StreamOptions | None = None
) -> tuple[str, StreamReport]:
    """A whole CSV at once, and every remark."""
    report = StreamReport(listed=len(text))
    lines = io.StringIO(text, newline=None)
    return "".join(
        compensate_stream(calibration, lines, name, options or StreamOptions(), report)
    ), report


class _Corrector:
    """Corrects tables in order; remembers the last joints, from which the next pose starts, and
    where backlash stands.
    """

    def __init__(
        self, calibration: Calibration, options: StreamOptions, report: StreamReport
    ) -> None:
        self.calibration, self.options, self.report = calibration, options, report
        self.seed: Array | None = None
        self.bounds = default_bounds(calibration, options.largest_change, options.weights)
        self.correction = CorrectionPath(calibration.robot)
        backlash = calibration.base.errors["backlash"]
        self.path = None
        if options.backlash and backlash.any():
            robot = calibration.robot
            self.path = BacklashPath(backlash, robot.lower, robot.upper)

    def corrected(self, table: Table) -> _Corrected:
        robot, options = self.calibration.robot, self.options
        joints = joints_from_header(table, robot, options.joint_values)
        poses = poses_from_header(table)
        if poses is None and joints is None:
            raise no_targets(table)
        for column in _ADDED:
            if column in table.header:
                raise InputError(
                    f"{table.name}: a column '{column}' is there already; is this an output "
                    "of compensate?"
                )
        if joints is None:
            q, values = self.seed, robot.joint_values(table.name, options.joint_values)
        else:
            q, values = joints.q, joints.values
        T = None if poses is None else poses[0]
        result = guarded(self.calibration, q, T, options.method, options.outside, self.bounds)
        if joints is None:
            self._note_branches(table, result.q)
        jumps = self.correction.jumps(result.commanded, result.q)
        rows = np.array([jump.row for jump in jumps], dtype=int)
        result.status[rows[result.status[rows] == OK]] = JUMP
        self._note(table, result, {jump.row: jump for jump in jumps})
        added = self._added(result)
        if self.path is not None:
            result = replace(result, q=result.q + self.path.taken_up(result.q))
        given = [] if joints is None else joints.columns
        order = sorted(range(robot.n), key=lambda j: table.header.index(given[j]) if given else j)
        columns = robot.columns(values)
        if given:  # their names and units, with whose values they are
            columns = [
                column if without_values(column)[1] else robot.column(j, unit_of(column), values)
                for j, column in enumerate(given)
            ]
        names = [columns[j] for j in order]
        replaced = {*given, *([] if poses is None else poses[1])}
        factors = np.array([TO_SI[unit_of(name)] for name in names])
        return _Corrected(
            table=table,
            kept=[i for i, column in enumerate(table.header) if column not in replaced],
            joint_names=names,
            values=robot.serial_as(values, result.q)[:, order] / factors,
            added=added,
        )

    def _added(self, result: Compensation) -> dict[str, list[str]]:
        added: dict[str, list[str]] = {"status": result.status.tolist()}
        if self.calibration.robot.n < 6 or self.options.verify:
            for column, errors in (("left_mm", result.position), ("left_mrad", result.orientation)):
                added[column] = [
                    "" if np.isnan(value) else f"{value * 1e3:.6g}" for value in errors
                ]
        if self.options.uncertainty:
            known = np.flatnonzero(~np.isnan(result.q).any(axis=-1))
            sure = np.full((2, len(result.q)), np.nan)
            parameters = predicted_uncertainty(self.calibration, result.q[known])
            spread = with_discrepancy(self.calibration, parameters)
            sure[:, known] = spread.position, spread.orientation
            for column, values in zip(("sd_mm", "sd_mrad"), sure, strict=True):
                added[column] = [
                    "" if np.isnan(value) else f"{value * 1e3:.6g}" for value in values
                ]
        return added

    def _note(self, table: Table, result: Compensation, jumps: dict[int, CorrectionJump]) -> None:
        report = self.report
        report.rows += len(table)
        report.without_joints += int(np.isnan(result.q).any(axis=-1).sum())
        full = np.isin(result.status, CORRECTED)
        report.in_full += int(full.sum())
        if self.options.verify and full.any():
            report.remaining_position = max(
                report.remaining_position, float(result.position[full].max())
            )
            report.remaining_orientation = max(
                report.remaining_orientation, float(result.orientation[full].max())
            )
        for k in np.flatnonzero(result.status != OK).tolist():
            status = result.status[k]
            if report.full:
                report.others += 1
                continue
            text = MEANING[status]
            if status == JUMP:
                text += f": {self._size(jumps[k])}"
            elif status in DOUBTFUL and np.isfinite(result.position[k]):
                millimetres, milliradians = result.position[k] * 1e3, result.orientation[k] * 1e3
                text += f"; {millimetres:.3g} mm and {milliradians:.3g} mrad of the error stay"
            report.remark(f"{table.place(k)}: {text}")

    def _size(self, jump: CorrectionJump) -> str:
        factor, unit = self.calibration.robot.display_unit(jump.joint)
        return f"joint {jump.joint + 1} by {jump.change * factor:.3g} {unit}"

    def _note_branches(self, table: Table, q: Array) -> None:
        """Branch flips of a path, and where the next batch starts."""
        reached = np.flatnonzero(np.isfinite(q).all(axis=-1))
        angles = ~np.array(self.calibration.robot.prismatic)
        path = q[reached] if self.seed is None else np.concatenate([self.seed[None], q[reached]])
        first = len(reached) - (len(path) - 1)
        jumps = np.abs(np.diff(path, axis=0)) * angles
        for k in np.flatnonzero(jumps.max(axis=-1, initial=0.0) > _JUMP):
            joint = int(jumps[k].argmax())
            place = table.place(int(reached[k + first]))
            self.report.remark(
                f"{place}: joint {joint + 1} jumps by {np.rad2deg(jumps[k, joint]):.0f} deg from "
                "the row before: another branch, or a singularity on the way"
            )
        if len(path):
            self.seed = path[-1]


# --- CSV ------------------------------------------------------------------------------------------


def _csv_text(corrected: _Corrected, with_header: bool) -> str:
    table, kept = corrected.table, corrected.kept
    units = [name.rsplit("_", 1)[1] for name in corrected.joint_names]
    numbers = decimal_rows(corrected.values, max(DECIMALS[unit] for unit in units))
    columns = list(corrected.added.values())
    rest = (
        columns[0]
        if len(columns) == 1
        else [",".join(cells) for cells in zip(*columns, strict=True)]
    )
    if kept:
        others = _written([[row[i] for i in kept] for row in table.rows])
        rest = [f"{other},{added}" for other, added in zip(others, rest, strict=True)]
    lines = [f"{a},{b}\n" for a, b in zip(numbers, rest, strict=True)]
    if with_header:
        header = [*corrected.joint_names, *(table.header[i] for i in kept), *corrected.added]
        lines.insert(0, _written([header])[0] + "\n")
    return "".join(lines)


def _written(rows: list[list[str]]) -> list[str]:
    """Rows of cells as CSV lines, without line ends."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    lines = []
    for row in rows:
        writer.writerow(row)
        lines.append(out.getvalue()[:-1])
        out.seek(0)
        out.truncate()
    return lines


# --- newline-delimited JSON -----------------------------------------------------------------------


def _read_objects(
    lines: Iterable[str], name: str, batch: int
) -> Iterator[tuple[Table, list[dict[str, object]]]]:
    """Objects, one per line, with the keys of the first as columns of a table."""
    header: list[str] = []
    part: list[tuple[int, dict[str, object]]] = []

    def table() -> tuple[Table, list[dict[str, object]]]:
        objects = [found for _, found in part]
        cells = [
            ["" if found[key] is None else str(found[key]) for key in header] for found in objects
        ]
        return Table(name, header, cells, [line for line, _ in part], ",", "."), objects

    for line, text in enumerate(lines, start=1):
        text = text.removeprefix("\ufeff").strip()
        if not text:
            continue
        try:
            found = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise InputError(
                f"{name}:{line}: not JSON: {error}; expected one object per line"
            ) from None
        if not isinstance(found, dict):
            raise InputError(f"{name}:{line}: expected one JSON object per line")
        header = header or list(found)
        if set(found) != set(header):
            different = sorted(set(found) ^ set(header))
            raise InputError(
                f"{name}:{line}: key '{different[0]}' is not in every object; keys must be the same"
            )
        part.append((line, found))
        if len(part) == batch:
            yield table()
            part = []
    if part:
        yield table()
    elif not header:
        raise InputError(f"{name}: empty; expected one JSON object per line")


def _objects_text(corrected: _Corrected, objects: list[dict[str, object]]) -> str:
    table = corrected.table
    convert: dict[str, Callable[[str], object]] = {"status": str}
    lines = []
    result: dict[str, object]
    for k, given in enumerate(objects):
        joints = [
            None if np.isnan(value) else float(number(value)) for value in corrected.values[k]
        ]
        result = dict(zip(corrected.joint_names, joints, strict=True))
        result |= {table.header[i]: given[table.header[i]] for i in corrected.kept}
        for column, cells in corrected.added.items():
            as_value = convert.get(column, float)
            result[column] = None if cells[k] == "" else as_value(cells[k])
        lines.append(json.dumps(result, ensure_ascii=False) + "\n")
    return "".join(lines)
