"""The correction of one program: its positions as rows, and the result for each literal."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import get_args

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.backlash_path import BacklashPath
from calibtool.compensation.one_step import default_bounds
from calibtool.compensation.solve import Compensation, Method
from calibtool.compensation.status import MEANING, OK, OUTSIDE, UNCORRECTED
from calibtool.compensation.targets import OUTSIDE_POLICIES, OutsidePolicy, guarded
from calibtool.compensation.weighted_error import Weights
from calibtool.errors import CalibtoolError, InputError, NoSolutionError, check_choice
from calibtool.programs.agreement import AS_FRAME, SEED, Position, half_circles, positions
from calibtool.programs.branches import Controller
from calibtool.programs.controller_poses import check_controller_known, poses_to_write
from calibtool.programs.frames import NamedFrames
from calibtool.programs.motion_flow import Circle, follow
from calibtool.programs.motions import JOINT, POSE, Program
from calibtool.programs.nominal_joints import NominalJoints, nominal_joints
from calibtool.programs.numbers import Remark
from calibtool.programs.program_summary import CompensatedProgram, Fate
from calibtool.programs.writing import NewPositions, Writing, remark_of
from calibtool.robot.coupling import JointValues, check_joint_values, coupling_text
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.se3 import Array

ON_ERROR = ("stop", "skip")
_KINDS = 4  # number of kinds of errors named in one message
_TOGETHER = 4096  # number of rows that are corrected at once
_AGREE = 1e-7  # rad or m: results for several branches may differ by this much


@dataclass(frozen=True)
class ProgramOptions:
    """How a program is compensated; see the command's help.

    method, outside   see `guarded`
    on_error          `stop` or `skip`: what happens at a target without a solution
    joint_values      which joint values the program states; None: see `coupling_of`
    frames            frames and tools that the program does not define
    backlash          correct backlash where the text is in the order of motion
    controller_model  T_base_tool by which the controller solves poses; None: not stated, then the
                      nominal robot's unless the description says that there may be another one
    ignore_external   correct poses with external axes as those of the arm alone
    largest_change    rad; this and weights: see `default_bounds`
    """

    method: Method = "exact"
    outside: OutsidePolicy = "mark"
    on_error: str = "stop"
    joint_values: JointValues | None = None
    frames: NamedFrames = field(default_factory=NamedFrames)
    backlash: bool = True
    controller_model: Mechanism | None = None
    ignore_external: bool = False
    largest_change: float | None = None
    weights: Weights | None = None

    def __post_init__(self) -> None:
        """UsageError for a word that is no choice."""
        check_choice(self.method, get_args(Method), "method")
        check_choice(self.outside, OUTSIDE_POLICIES, "outside")
        check_choice(self.on_error, ON_ERROR, "on_error")
        if self.joint_values is not None:
            check_joint_values(self.joint_values)


_Failure = type[CalibtoolError]


class Correction:
    """The result for each literal, collected while a program is corrected."""

    def __init__(
        self,
        calibration: Calibration,
        program: Program,
        controller: Controller,
        options: ProgramOptions,
        program_format: str,
    ) -> None:
        self.calibration, self.program, self.controller = calibration, program, controller
        self.options, self.format = options, program_format
        self.failures: list[tuple[Remark, _Failure]] = []
        self.uncorrected: list[Remark] = []
        self.reasons: dict[int, str] = {}  # why a literal is not corrected, by its number

    def result(self) -> CompensatedProgram:
        program = self.program
        flow = follow(program, self.options.frames)
        for remark in (*program.remarks, *flow.remarks):
            if remark.bad:
                self.failures.append((remark, InputError))
            elif program.sources[remark.source].edited:
                self.uncorrected.append(remark)
        moved_to = {use.literal for use in flow.uses if use.line and not use.relative} | flow.edited
        found, reasons = positions(program, flow)
        for number, why in reasons.items():
            self._skip(number, why, InputError if program.literals[number].bad else None)
        self._raise_failures()
        answers = nominal_joints(self.controller, program, flow, found)
        circles = flow.circles
        del flow
        rows, q = self._rows(found, answers)
        self._raise_failures()
        corrected = self._corrected(found, answers, rows, q)
        notes = program.notes + self._joint_values_note(found)
        if any(program.literals[one.literal].kind == POSE for one in found):
            notes += check_controller_known(
                self.calibration, self.options.controller_model, program.sources[0].name
            )
        path = BacklashPath.of(self.calibration) if self.options.backlash else None
        if path is not None:
            if program.in_order:
                taken = path.taken_up(corrected.q)
                corrected = replace(corrected, q=corrected.q + taken)
            else:
                notes += (
                    "the backlash is not taken up: a program does not state in which order its "
                    "targets are reached",
                )
        new = self._agreed(found, answers, rows, q, corrected, circles)
        self._raise_failures()
        del answers, rows, q, corrected
        writing = Writing(program, self.controller, new)
        texts = tuple(writing.texts())
        return self._summary(writing, texts, moved_to, notes)

    # --- literals that are not corrected, and errors ----------------------------------------------

    def _skip(self, number: int, why: str, failure: _Failure | None = None) -> None:
        """Do not change a literal. failure: this is an error unless `on_error` is `skip`."""
        self.reasons[number] = why
        literal = self.program.literals[number]
        if why in (SEED, AS_FRAME) or not self.program.sources[literal.source].edited:
            return
        if failure is None:
            self.uncorrected.append(remark_of(literal, why))
        else:
            self.failures.append((remark_of(literal, why), failure))

    def _raise_failures(self) -> None:
        if not self.failures or self.options.on_error != "stop":
            return
        first, kind = min(self.failures, key=lambda one: (one[0].source, one[0].line))
        more = _others([failure for failure, _ in self.failures if failure is not first])
        label = f"{first.name}: " if first.name else ""
        raise kind(
            f"{self.program.sources[first.source].name}:{first.line}: {label}{first.why}{more}; "
            "nothing is written (--on-error skip leaves such targets)"
        )

    # --- joints and poses ------------------------------------------------------------------------

    def _rows(self, found: Sequence[Position], answers: NominalJoints) -> tuple[np.ndarray, Array]:
        """Rows to correct: a position with joints (N, n) for each branch on which it is used."""
        robot = self.controller.robot
        rows = np.array([k for k, q in enumerate(answers.q) for _ in q], dtype=int)
        q = np.array([row for rows_of in answers.q for row in rows_of]).reshape(-1, robot.n)
        inside = robot.within_limits(q)
        beyond = {int(rows[k]): k for k in np.flatnonzero(~inside)[::-1]}
        for k, position in enumerate(found):
            why = answers.why[k]
            if k in beyond and not why:
                why = _beyond(self.controller, q[beyond[k]])
            if why and self.program.literals[position.literal].blank:
                self._skip(position.literal, "not taught: its numbers are zero")
            elif why:
                self._skip(position.literal, why, NoSolutionError)
        good = np.array([k not in beyond for k in rows.tolist()], dtype=bool)
        return rows[good], q[good]

    def _corrected(
        self, found: Sequence[Position], answers: NominalJoints, rows: np.ndarray, q: Array
    ) -> Compensation:
        """The compensation of all rows: joint targets in one batch, poses in another."""
        count, options = len(rows), self.options
        bounds = default_bounds(self.calibration, options.largest_change, options.weights)
        result = Compensation(
            q.copy(), np.full(count, OK, dtype=object), np.zeros(count), np.zeros(count), q
        )
        poses = np.array(
            [self.program.literals[found[k].literal].kind == POSE for k in rows.tolist()], bool
        )
        for kind in (False, True):
            every = np.flatnonzero(poses == kind)
            for first in range(0, len(every), _TOGETHER):
                here = every[first : first + _TOGETHER]
                T = answers.T[rows[here]] if kind else None
                part = guarded(
                    self.calibration, q[here], T, options.method, options.outside, bounds
                )
                for name in ("q", "status", "position", "orientation"):
                    getattr(result, name)[here] = getattr(part, name)
        return result

    def _agreed(
        self,
        found: Sequence[Position],
        answers: NominalJoints,
        rows: np.ndarray,
        q: Array,
        corrected: Compensation,
        circles: Sequence[Circle],
    ) -> NewPositions:
        """Positions whose rows all get the same numbers; of a circle both points."""
        robot = self.controller.robot
        finite = np.nan_to_num(corrected.q)
        poses = [self.program.literals[found[k].literal].kind == POSE for k in rows.tolist()]
        commanded = [answers.T[k] if pose else None for k, pose in zip(rows, poses, strict=True)]
        T, untouched = poses_to_write(
            self.calibration, self.options.controller_model, commanded, q, corrected.q
        )
        first = np.flatnonzero(np.diff(rows, prepend=-1)).tolist()
        good: list[int] = []
        for start, end in pairwise([*first, len(rows)]):
            literal = found[rows[start]].literal
            here = corrected.status[start:end].tolist()
            if np.isnan(corrected.q[start:end]).any():
                refused = " (--outside refuse)" if OUTSIDE in here else ""
                self._skip(literal, MEANING[here[0]] + refused, NoSolutionError)
            elif UNCORRECTED in here:
                self._skip(literal, MEANING[UNCORRECTED])
            elif untouched[start:end].any():
                why = "the controller's own model already brings the tool nearer to it"
                self._skip(literal, why)
            elif end > start + 1 and np.abs(T[start:end] - T[start]).max() > _AGREE:
                why = "reached on several branches, which need different numbers"
                self._skip(literal, why)
            else:
                good.append(start)
        half = half_circles(circles, (found[rows[start]].literal for start in good))
        for literal in half:
            self._skip(literal, half[literal])
        good = [start for start in good if found[rows[start]].literal not in half]
        nominal = robot.mechanism.forward(q[good])
        return NewPositions(
            [found[rows[k]] for k in good],
            q[good],
            finite[good],
            T[good],
            nominal,
            corrected.status[good],
            np.array([answers.guessed[rows[k]] for k in good], dtype=bool),
        )

    def _joint_values_note(self, found: Sequence[Position]) -> tuple[str, ...]:
        """Which joint values were read and written, for robots where they differ."""
        if not any(self.program.literals[one.literal].kind == JOINT for one in found):
            return ()
        taken = coupling_text(self.controller.coupling)
        own = coupling_text(self.controller.robot.coupling)
        if taken:
            return (f"joint values are the controller's, {taken}; if not: --joint-values serial",)
        if own:
            return (
                f"joint values are the serial chain's; if not, {own}: --joint-values controller",
            )
        return ()

    # --- the result ------------------------------------------------------------------------------

    def _summary(
        self,
        writing: Writing,
        texts: tuple[bytes, ...],
        moved_to: set[int],
        notes: tuple[str, ...],
    ) -> CompensatedProgram:
        program = self.program
        fates: list[Fate] = []
        looks = {(look.source, look.line, look.name): look.why for look in writing.looks}
        targets, corrected, inconsistent = 0, 0, 0
        for number, literal in enumerate(program.literals):
            if not program.sources[literal.source].edited:
                continue
            skipped = number in self.reasons
            targets += not literal.not_corrected and self.reasons.get(number) not in (
                SEED,
                AS_FRAME,
            )
            what = "left" if skipped else "corrected" if number in writing.changed else "unchanged"
            place = (literal.source, literal.line, literal.name)
            why = self.reasons[number] if skipped else looks.get(place, "")
            fates.append(Fate(*place, literal.kind, what, why))
            if literal.kind == POSE:
                corrected += not skipped
                followed = bool(literal.numbers) and number in moved_to
                inconsistent += skipped and (followed or literal.moved_to)
        listed = program.literals or program.remarks or self.uncorrected
        return CompensatedProgram(
            names=tuple(source.name for source in program.sources),
            texts=texts,
            targets=targets,
            changed=len(writing.changed),
            largest_mm=1e3 * writing.largest_m,
            largest_deg=float(np.rad2deg(writing.largest_rad)),
            left_alone=(*self.uncorrected, *(remark for remark, _ in self.failures)),
            remarks=tuple(writing.looks),
            notes=notes if listed else (_nothing(self.format),),
            fates=tuple(fates),
            inconsistent=inconsistent if corrected else 0,
        )


def _others(failures: Sequence[Remark]) -> str:
    """Their number, and their kinds if there are several."""
    if not failures:
        return ""
    kinds = Counter(re.sub(r"\s*[('\d].*", "", failure.why) for failure in failures)
    listed = ", ".join(f"{count} × {kind}" for kind, count in kinds.most_common(_KINDS))
    more = ", …" if len(kinds) > _KINDS else ""
    return f"; and {len(failures)} more" + (f" ({listed}{more})" if len(kinds) > 1 else "")


def _nothing(program_format: str) -> str:
    return (
        f"no positions are written in it as {program_format}; if it is something else, say "
        "so with --format"
    )


def _beyond(controller: Controller, q: Array) -> str:
    robot = controller.robot
    j = int(np.argmin(robot.joints_within_limits(q)))
    factor, unit = robot.display_unit(j)
    limits = f"{robot.lower[j] * factor:.6g} … {robot.upper[j] * factor:.6g} {unit}"
    return f"joint {j + 1} at {q[j] * factor:.6g} {unit} is outside its limits ({limits})"
