"""Correction of any number of rows, CSV or newline-delimited JSON, in batches."""

import io
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Literal

import numpy as np

from calibtool.calibration import Calibration
from calibtool.calibration.uncertainty import predicted_uncertainty, with_discrepancy
from calibtool.compensation.backlash_path import BacklashPath
from calibtool.compensation.bounds import Bounds
from calibtool.compensation.jumps import CorrectionJump, CorrectionPath
from calibtool.compensation.one_step import default_bounds
from calibtool.compensation.row_texts import (
    CorrectedRows,
    csv_text,
    objects_text,
    read_objects,
)
from calibtool.compensation.solve import Compensation, Method
from calibtool.compensation.status import CORRECTED, DOUBTFUL, JUMP, MEANING, OK
from calibtool.compensation.targets import OutsidePolicy, guarded, no_targets
from calibtool.compensation.weighted_error import Weights
from calibtool.errors import InputError
from calibtool.joint_and_pose_columns import (
    Joints,
    joints_from_header,
    poses_from_header,
    unit_of,
)
from calibtool.processes import in_order
from calibtool.robot.coupling import JointValues
from calibtool.robot.se3 import Array
from calibtool.tables import Table, read_tables
from calibtool.units import TO_SI, without_values

RowFormat = Literal["csv", "ndjson"]
BATCH = 4096
_ALONE = 16  # number of batches before other processes help: starting them takes as long as these
# Numbers, 31 MiB: the C library keeps freed memory for the next batch up to the largest block that
# it ever got back.
_LARGEST_KEPT = 31 * 2**17
# between neighbours of a path: another branch, or a singularity on the way
_JUMP = np.deg2rad(60.0)
_Targets = tuple[Array | None, Array | None]  # joints (N, n) and T_base_tool (N, 4, 4)
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
    workers: processes that help with many rows which hold joints, see `in_order`; the answers do
    not depend on it.
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
    workers: int = 1


@dataclass
class StreamReport:
    """Counts and remarks of the rows so far.

    remarks                a line for each of the first `listed` rows whose status is not `ok`
    others                 number of further such rows
    without_joints         rows that got no joints, unreachable or refused
    in_full                rows that are fully corrected
    remaining_position     largest error of these under the calibrated model, m
    remaining_orientation  the same, rad
    both                   whether rows hold joints beside poses, which then choose the branch
    """

    listed: int = 10
    rows: int = 0
    remarks: list[str] = field(default_factory=list)
    others: int = 0
    without_joints: int = 0
    in_full: int = 0
    remaining_position: float = 0.0
    remaining_orientation: float = 0.0
    both: bool = False

    @property
    def full(self) -> bool:
        """Whether further remarks are only counted."""
        return len(self.remarks) >= self.listed

    def remark(self, line: str) -> None:
        """Keep a line, or count it when there are enough."""
        if self.full:
            self.others += 1
        else:
            self.remarks.append(line)


@dataclass(frozen=True, eq=False)
class _Batch:
    """A batch as read: joints, poses (T_base_tool and their columns), and objects of its rows."""

    table: Table
    joints: Joints | None
    poses: tuple[Array, list[str]] | None
    objects: list[dict[str, object]]

    def targets(self, seed: Array | None = None) -> _Targets:
        """What to correct; without joints, poses start from `seed` (n,)."""
        q = seed if self.joints is None else self.joints.q
        return q, None if self.poses is None else self.poses[0]


def compensate_stream(
    calibration: Calibration,
    lines: Iterable[str],
    name: str,
    options: StreamOptions,
    report: StreamReport,
    row_format: RowFormat = "csv",
) -> Iterator[str]:
    """Text of corrected rows, batch by batch; `report` is updated.

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
    tables: Iterable[tuple[Table, list[dict[str, object]]]]
    if row_format == "ndjson":
        tables = read_objects(lines, name, options.batch)
    else:
        tables = ((table, []) for table in read_tables(lines, name, batch=options.batch))
    first = True
    for batch, result in _answered(corrector, tables, options.workers):
        corrected = corrector.corrected(batch, result)
        if row_format == "ndjson":
            yield objects_text(corrected, batch.objects)
        else:
            yield csv_text(corrected, first)
        first = False


def _answered(
    corrector: "_Corrector",
    tables: Iterable[tuple[Table, list[dict[str, object]]]],
    workers: int,
) -> Iterator[tuple[_Batch, Compensation]]:
    """Every batch and its corrections, in order. Poses without joints are a path: each batch
    starts where the one before ends. Other batches may be computed in parallel.
    """
    read = (corrector.batch(table, objects) for table, objects in tables)
    first = next(read, None)
    if first is None:
        return
    batches = chain([first], read)
    if first.joints is None or workers == 1:
        for batch in batches:
            yield batch, corrector.compute(batch.targets(corrector.seed))
        return
    waiting: deque[_Batch] = deque()

    def targets() -> Iterator[_Targets]:
        for batch in batches:
            waiting.append(batch)
            yield batch.targets()

    for result in in_order(corrector.compute, targets(), workers, _ALONE):
        yield waiting.popleft(), result


def compensate_text(
    calibration: Calibration, text: str, name: str, options: StreamOptions | None = None
) -> tuple[str, StreamReport]:
    """A whole CSV at once, and every remark."""
    report = StreamReport(listed=len(text))
    lines = io.StringIO(text, newline=None)
    return "".join(
        compensate_stream(calibration, lines, name, options or StreamOptions(), report)
    ), report


def _corrections(
    calibration: Calibration,
    method: Method,
    outside: OutsidePolicy,
    bounds: Bounds,
    targets: _Targets,
) -> Compensation:
    """`guarded` for a batch, as other processes can call it."""
    return guarded(calibration, *targets, method, outside, bounds)


class _Corrector:
    """Corrects tables in order; keeps the last joints and the state of the backlash."""

    def __init__(
        self, calibration: Calibration, options: StreamOptions, report: StreamReport
    ) -> None:
        self.calibration, self.options, self.report = calibration, options, report
        self.seed: Array | None = None
        bounds = default_bounds(calibration, options.largest_change, options.weights)
        self.compute = partial(_corrections, calibration, options.method, options.outside, bounds)
        self.correction = CorrectionPath(calibration.robot)
        self.path = BacklashPath.of(calibration) if options.backlash else None

    def batch(self, table: Table, objects: list[dict[str, object]]) -> _Batch:
        """The targets of a table. InputError where it has none, or was written by compensate."""
        joints = joints_from_header(table, self.calibration.robot, self.options.joint_values)
        poses = poses_from_header(table)
        if poses is None and joints is None:
            raise no_targets(table)
        self.report.both = poses is not None and joints is not None
        for column in _ADDED:
            if column in table.header:
                raise InputError(
                    f"{table.name}: a column '{column}' is there already; is this an output "
                    "of compensate?"
                )
        return _Batch(table, joints, poses, objects)

    def corrected(self, batch: _Batch, result: Compensation) -> CorrectedRows:
        """The batch to write; updates remarks and the last joints."""
        robot, options = self.calibration.robot, self.options
        table, joints, poses = batch.table, batch.joints, batch.poses
        values = (
            robot.joint_values(table.name, options.joint_values)
            if joints is None
            else joints.values
        )
        if joints is None:
            self._note_branches(table, result.q)
        jumps = self.correction.jumps(result.commanded, result.q)
        rows = np.array([jump.row for jump in jumps], dtype=int)
        result.status[rows[result.status[rows] == OK]] = JUMP
        self._note(table, result, {jump.row: jump for jump in jumps})
        taken = np.zeros_like(result.q) if self.path is None else self.path.taken_up(result.q)
        added = self._added(result, np.sign(taken))
        result = replace(result, q=result.q + taken)
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
        return CorrectedRows(
            table=table,
            kept=[i for i, column in enumerate(table.header) if column not in replaced],
            joint_names=names,
            values=robot.serial_as(values, result.q)[:, order] / factors,
            added=added,
        )

    def _added(self, result: Compensation, direction: Array) -> dict[str, list[str]]:
        added: dict[str, list[str]] = {"status": result.status.tolist()}
        if self.calibration.robot.n < 6 or self.options.verify:
            for column, errors in (("left_mm", result.position), ("left_mrad", result.orientation)):
                added[column] = [
                    "" if np.isnan(value) else f"{value * 1e3:.6g}" for value in errors
                ]
        if self.options.uncertainty:
            known = np.flatnonzero(~np.isnan(result.q).any(axis=-1))
            sure = np.full((2, len(result.q)), np.nan)
            parameters = predicted_uncertainty(self.calibration, result.q[known], direction[known])
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
