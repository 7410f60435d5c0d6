"""A controller program in, the corrected program and a summary out."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.backlash import BacklashPath
from calibtool.compensation.one_step import default_bounds
from calibtool.compensation.program import OutsidePolicy, guarded
from calibtool.compensation.solve import Compensation, Method
from calibtool.compensation.status import MEANING, OK, OUTSIDE, UNCORRECTED
from calibtool.compensation.weighed import Weights
from calibtool.errors import CalibtoolError, InputError, NoSolutionError
from calibtool.programs.agreement import AS_FRAME, SEED, Position, positions
from calibtool.programs.branches import Controller
from calibtool.programs.configurations import Digit
from calibtool.programs.controller_poses import check_controller_known, poses_to_write
from calibtool.programs.flow import Flow, follow
from calibtool.programs.formats import coupling_of, read_program
from calibtool.programs.frames import Frames, poses_values
from calibtool.programs.motions import EXTERNAL, JOINT, POSE, Literal, Program, Source
from calibtool.programs.nominal import Stands, placed, stands
from calibtool.programs.summary import CompensatedProgram, Fate
from calibtool.programs.targets import Remark, replaced, rewritten
from calibtool.robot.coupling import JointValues, coupling_text
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.se3 import Array

ON_ERROR = ("stop", "skip")
_KINDS = 4  # of errors, told in one message
_NO_CHANGE = 1e-9  # rad or m: below, a target's text stays as it is
_AGREE = 1e-7  # rad or m: what is written for several branches may differ by so much


@dataclass(frozen=True)
class ProgramOptions:
    """How a program is compensated; see the command's help.

    method, outside   see `guarded`
    on_error          `stop` or `skip`: what a target without an answer does
    joint_values      whose they are; None: what the format says, see `coupling_of`
    frames            frames and tools that the program does not define
    backlash          take it up where the text is in the order of motion
    controller_model  T_base_tool by which the controller solves poses; None: nobody says, which is
                      the nominal robot's where the description knows of no other
    ignore_external   poses beside external axes are those of the arm alone
    largest_change    rad; this and weights: see `default_bounds`
    """

    method: Method = "exact"
    outside: OutsidePolicy = "mark"
    on_error: str = "stop"
    joint_values: JointValues | None = None
    frames: Frames = field(default_factory=Frames)
    backlash: bool = True
    controller_model: Mechanism | None = None
    ignore_external: bool = False
    largest_change: float | None = None
    weights: Weights | None = None


def compensate_program(
    calibration: Calibration,
    data: bytes,
    name: str,
    program_format: str,
    options: ProgramOptions | None = None,
) -> CompensatedProgram:
    """Correct every joint and pose target of a program.

    A joint target gets the joints that bring the calibrated robot where the nominal one would be; a pose target, solved
    on the branch that the controller takes there, gets the pose that the controller's robot takes at the corrected
    joints, in its own frame and with its own tool. program_format: one of docs/programs; name stands in messages;
    options: exact, stop at the first failure, unless given.

    Raises InputError for bad data and NoSolutionError for targets without an answer, both with the line; with on_error
    `skip` such targets stay as they are and are listed. Raises UsageError for poses without the controller's model
    where the robot's description says that it may differ from the nominal robot.
    """
    return compensate_texts(calibration, [(name, data, True)], program_format, options)


def compensate_texts(
    calibration: Calibration,
    texts: Sequence[tuple[str, bytes, bool]],
    program_format: str,
    options: ProgramOptions | None = None,
) -> CompensatedProgram:
    """The same for a program of several texts: name, bytes and whether it is corrected or only looked up."""
    options = options or ProgramOptions()
    for name, data, _ in texts:
        if b"\0" in data:
            raise InputError(
                f"{name}: holds zero bytes; expected a program in ASCII, UTF-8 or Latin-1"
            )
    sources = [Source(name, data.decode("latin-1"), edited) for name, data, edited in texts]
    robot = calibration.robot
    program = read_program(program_format, sources, robot)
    if options.ignore_external:
        program = replace(program, literals=tuple(map(_alone, program.literals)))
    controller = Controller(robot, coupling_of(robot, program_format, options.joint_values))
    return _Correction(calibration, program, controller, options, program_format).result()


_Failure = type[CalibtoolError]


class _Correction:
    """What is found out about each literal on the way through a program."""

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
        self.left: list[Remark] = []
        self.looks: list[Remark] = []
        self.why: dict[int, str] = {}  # of literals that are left
        self.edits: dict[int, list[tuple[int, int, str]]] = {}  # of literals that are corrected
        self.largest = [0.0, 0.0]  # m and rad

    def result(self) -> CompensatedProgram:
        program = self.program
        self._read_errors()
        flow = follow(program, self.options.frames)
        for remark in flow.remarks:
            self._list(remark)
        found, left = positions(program, flow)
        for number, why in left.items():
            self._leave(number, why, InputError if program.literals[number].bad else None)
        self._stop()
        answers = stands(self.controller, program, flow, found)
        rows, q = self._rows(found, answers)
        self._stop()
        corrected = self._corrected(found, answers, rows, q)
        if len(found) and any(program.literals[one.literal].kind == POSE for one in found):
            check_controller_known(
                self.calibration, self.options.controller_model, program.sources[0].name
            )
        notes = program.notes + self._joint_values_note(found)
        backlash = self.calibration.base.errors["backlash"]
        if self.options.backlash and backlash.any():
            if program.in_order:
                taken = BacklashPath(backlash).taken_up(corrected.q)
                corrected = replace(corrected, q=corrected.q + taken)
            else:
                notes += (
                    "the backlash is not taken up: a program does not say in which order its targets are reached",
                )
        self._write(found, answers, rows, q, corrected)
        self._stop()
        return self._told(flow, notes)

    # --- what is left ------------------------------------------------------------------------------------------------

    def _read_errors(self) -> None:
        for remark in self.program.remarks:
            self._list(remark)

    def _list(self, remark: Remark) -> None:
        if remark.bad:
            self.failures.append((remark, InputError))
        elif self.program.sources[remark.source].edited:
            self.left.append(remark)

    def _leave(self, number: int, why: str, failure: _Failure | None = None) -> None:
        """A literal is left as it is; failure: unless it may be, that is an error."""
        self.why[number] = why
        if (
            why not in (SEED, AS_FRAME)
            and self.program.sources[self.program.literals[number].source].edited
        ):
            remark = _remark(self.program.literals[number], why)
            if failure is None:
                self.left.append(remark)
            else:
                self.failures.append((remark, failure))

    def _stop(self) -> None:
        if not self.failures or self.options.on_error != "stop":
            return
        first, kind = min(self.failures, key=lambda one: (one[0].source, one[0].line))
        more = _others([failure for failure, _ in self.failures if failure is not first])
        label = f"{first.name}: " if first.name else ""
        raise kind(
            f"{self.program.sources[first.source].name}:{first.line}: {label}{first.why}{more}; "
            "nothing is written (--on-error skip leaves such targets)"
        )

    # --- joints and poses --------------------------------------------------------------------------------------------

    def _rows(self, found: Sequence[Position], answers: Stands) -> tuple[np.ndarray, Array]:
        """Rows to correct, a position and its joints (N, n): one for each branch on which a position is used."""
        robot = self.controller.robot
        rows: list[int] = []
        q: list[Array] = []
        for k, position in enumerate(found):
            why = answers.why[k]
            inside = [robot.within_limits(row[None])[0] for row in answers.q[k]]
            if not why and not all(inside):
                why = _beyond(self.controller, answers.q[k][inside.index(False)])
            if why and self.program.literals[position.literal].blank:
                self._leave(position.literal, "not taught: its numbers are zero")
                continue
            if why:
                self._leave(position.literal, why, NoSolutionError)
                continue
            rows += [k] * len(inside)
            q += answers.q[k]
        return np.array(rows, dtype=int), np.array(q).reshape(-1, robot.n)

    def _corrected(
        self, found: Sequence[Position], answers: Stands, rows: np.ndarray, q: Array
    ) -> Compensation:
        """The compensation of all rows, joint targets and poses each in one batch."""
        count, options = len(rows), self.options
        result = Compensation(
            q.copy(), np.full(count, OK, dtype=object), np.zeros(count), np.zeros(count), q
        )
        bounds = default_bounds(self.calibration, options.largest_change, options.weights)
        kinds = [self.program.literals[found[k].literal].kind for k in rows]
        for kind in (JOINT, POSE):
            here = np.array([k for k, one in enumerate(kinds) if one == kind], dtype=int)
            if not len(here):
                continue
            T = answers.T[rows[here]] if kind == POSE else None
            part = guarded(self.calibration, q[here], T, options.method, options.outside, bounds)
            for name in ("q", "status", "position", "orientation"):
                getattr(result, name)[here] = getattr(part, name)
        return result

    def _write(
        self,
        found: Sequence[Position],
        answers: Stands,
        rows: np.ndarray,
        q: Array,
        corrected: Compensation,
    ) -> None:
        """Edits of all positions whose rows have an answer, agree and change something."""
        robot, literals = self.controller.robot, self.program.literals
        finite = np.nan_to_num(corrected.q)
        nominal = robot.mechanism.forward(q)
        poses = [literals[found[k].literal].kind == POSE for k in rows]
        commanded = [answers.T[k] if pose else None for k, pose in zip(rows, poses, strict=True)]
        written, untouched = poses_to_write(
            self.calibration, self.options.controller_model, commanded, q, corrected.q
        )
        stays = np.abs(written - nominal).max(axis=(1, 2), initial=0.0) < _NO_CHANGE
        first = np.flatnonzero(np.diff(rows, prepend=-1))
        good: list[int] = []
        for start, end in pairwise([*first.tolist(), len(rows)]):
            position = found[rows[start]]
            status = corrected.status[start]
            if np.isnan(corrected.q[start:end]).any():
                why = f"{MEANING[status]} (--outside refuse)" if status == OUTSIDE else MEANING[status]
                self._leave(position.literal, why, NoSolutionError)
            elif (corrected.status[start:end] == UNCORRECTED).any():
                self._leave(position.literal, MEANING[UNCORRECTED])
            elif untouched[start:end].any():
                self._leave(
                    position.literal, "the controller's own model already brings the tool nearer to it"
                )
            elif np.abs(written[start:end] - written[start]).max() > _AGREE:
                self._leave(
                    position.literal, "reached on several branches, which need different numbers"
                )
            else:
                good.append(start)
        numbers = self._numbers([found[rows[k]] for k in good], written[good], finite[good])
        moved = np.linalg.norm(written[good, :3, 3] - nominal[good, :3, 3], axis=-1)
        turned = np.abs(corrected.q[good] - q[good])
        revolute = ~np.array(robot.prismatic)
        for k, start in enumerate(good):
            number = found[rows[start]].literal
            literal = literals[number]
            self._look(literal, corrected.status[start], answers.guessed[rows[start]])
            if turned[k].max() < _NO_CHANGE and (literal.kind == JOINT or stays[start]):
                self.edits[number] = []
                continue
            text = self.program.sources[literal.source].text
            edits = rewritten(text, literal.numbers, numbers[k])
            digits = self._digits(literal, q[start], corrected.q[start])
            if digits:
                self.looks.append(
                    _remark(
                        literal,
                        "a joint passes into another turn: its configuration data are changed too",
                    )
                )
            self.edits[number] = edits + [(d.start, d.end, str(value)) for d, value in digits]
            if self.edits[number]:
                self.largest[0] = max(self.largest[0], float(moved[k]))
                self.largest[1] = max(self.largest[1], float(turned[k][revolute].max(initial=0.0)))

    def _numbers(self, found: Sequence[Position], T: Array, q: Array) -> list[list[float]]:
        """What to write for positions: joints as the controller shows them, or poses in their frames."""
        literals = [self.program.literals[position.literal] for position in found]
        result: list[list[float]] = self.controller.to_controller(q).tolist()
        groups: dict[str, list[int]] = {}
        for k, literal in enumerate(literals):
            if literal.kind == POSE:
                groups.setdefault(literal.orientation, []).append(k)
        for orientation, rows in groups.items():
            near = np.array([literals[k].values for k in rows])
            here = placed(T[rows], [found[k] for k in rows], back=True)
            values = poses_values(here, orientation, near).tolist()
            for k, row in zip(rows, values, strict=True):
                result[k] = row
        return result

    def _digits(self, literal: Literal, q: Array, corrected: Array) -> list[tuple[Digit, int]]:
        """Configuration data to change: those that were right and are not for the corrected joints."""
        data = literal.configuration
        if data is None or not data.turns(self.controller.to_controller(q)):
            return []
        return data.digits(self.controller.to_controller(corrected))

    def _look(self, literal: Literal, status: str, guessed: bool) -> None:
        if status != OK:
            self.looks.append(_remark(literal, MEANING[status]))
        if guessed:
            why = "its branch is a guess: the program does not say from where the robot comes"
            self.looks.append(_remark(literal, why))

    def _joint_values_note(self, found: Sequence[Position]) -> tuple[str, ...]:
        """Whose joint values were read and written, where that matters."""
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

    # --- the result --------------------------------------------------------------------------------------------------

    def _told(self, flow: Flow, notes: tuple[str, ...]) -> CompensatedProgram:
        program = self.program
        edits: list[list[tuple[int, int, str]]] = [[] for _ in program.sources]
        fates: list[Fate] = []
        looks = {(look.source, look.line, look.name): look.why for look in self.looks}
        moved_to = {use.literal for use in flow.uses if use.line and not use.relative}
        targets, corrected, alone = 0, 0, 0
        for number, literal in enumerate(program.literals):
            if not program.sources[literal.source].edited:
                continue
            own = self.edits.get(number)
            targets += not literal.left and self.why.get(number) not in (SEED, AS_FRAME)
            edits[literal.source] += own or []
            what = "left" if own is None else "corrected" if own else "unchanged"
            place = (literal.source, literal.line, literal.name)
            why = self.why.get(number, "") if own is None else looks.get(place, "")
            fates.append(Fate(*place, literal.kind, what, why))
            if literal.kind == POSE and own is not None:
                corrected += 1
            if literal.kind == POSE and own is None and literal.numbers and number in moved_to:
                alone += 1
        listed = program.literals or program.remarks or self.left
        return CompensatedProgram(
            names=tuple(source.name for source in program.sources),
            texts=tuple(
                replaced(source.text, own).encode("latin-1")
                for source, own in zip(program.sources, edits, strict=True)
            ),
            targets=targets,
            changed=sum(
                1
                for number, own in self.edits.items()
                if own and program.sources[program.literals[number].source].edited
            ),
            largest_mm=1e3 * self.largest[0],
            largest_deg=float(np.rad2deg(self.largest[1])),
            left_alone=(*self.left, *(remark for remark, _ in self.failures)),
            remarks=tuple(self.looks),
            notes=notes if listed else (_nothing(self.format),),
            fates=tuple(fates),
            inconsistent=alone if corrected else 0,
        )


def _alone(literal: Literal) -> Literal:
    """A literal without its external axes."""
    return replace(literal, left="") if literal.left == EXTERNAL and literal.numbers else literal


def _others(failures: Sequence[Remark]) -> str:
    """How many there are, and of which kinds if there are several."""
    if not failures:
        return ""
    kinds = Counter(re.sub(r"\s*[('\d].*", "", failure.why) for failure in failures)
    listed = ", ".join(f"{count} × {kind}" for kind, count in kinds.most_common(_KINDS))
    more = ", …" if len(kinds) > _KINDS else ""
    return f"; and {len(failures)} more" + (f" ({listed}{more})" if len(kinds) > 1 else "")


def _nothing(program_format: str) -> str:
    return f"no positions are written in it as {program_format}; if it is something else, say so with --format"


def _beyond(controller: Controller, q: Array) -> str:
    robot = controller.robot
    outside = np.flatnonzero((q < robot.lower - 1e-9) | (q > robot.upper + 1e-9))
    j = int(outside[0])
    factor, unit = (1e3, "mm") if robot.prismatic[j] else (180 / np.pi, "deg")
    limits = f"{robot.lower[j] * factor:.6g} … {robot.upper[j] * factor:.6g} {unit}"
    return f"joint {j + 1} at {q[j] * factor:.6g} {unit} is outside its limits ({limits})"


def _remark(literal: Literal, why: str) -> Remark:
    return Remark(literal.line, literal.name, why, source=literal.source)
