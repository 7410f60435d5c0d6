"""A controller program in, the corrected program and a summary out."""

from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.backlash import BacklashPath
from calibtool.compensation.one_step import default_bounds
from calibtool.compensation.program import OutsidePolicy, guarded
from calibtool.compensation.solve import Compensation, Method
from calibtool.compensation.status import MEANING, OK, OUTSIDE, UNCORRECTED
from calibtool.compensation.weighed import Weights
from calibtool.errors import CalibtoolError, InputError, NoSolutionError
from calibtool.programs.branches import Controller, coupling_of, solve_pose
from calibtool.programs.controller_poses import check_controller_known, poses_to_write
from calibtool.programs.formats import reader
from calibtool.programs.frames import Frames, pose, pose_values
from calibtool.programs.targets import Program, Remark, Target, replaced, rewritten
from calibtool.robot.coupling import JointValues, coupling_text
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.se3 import Array, inverse

ON_ERROR = ("stop", "skip")
_NO_CHANGE = 1e-9  # rad or m: below, a target's text stays as it is
_IN_ORDER = ("ros2-trajectory",)  # formats whose text is in the order of motion, without calls, loops and named targets
_LISTED = 20  # lines named for one reason


@dataclass(frozen=True)
class ProgramOptions:
    """How a program is compensated; see the command's help.

    method, outside   see `guarded`
    on_error          `stop` or `skip`: what a target without an answer does
    joint_values      whose they are; None: what the format says, see `coupling_of`
    frames            frames and tools that the program does not define
    backlash          take it up where the text is in the order of motion
    largest_change    of a joint, rad, and weights of the pose error's components: see `default_bounds`
    controller_model  T_base_tool by which the controller solves poses; None: nobody says, which is
                      the nominal robot's where the description knows of no other
    """

    method: Method = "exact"
    outside: OutsidePolicy = "mark"
    on_error: str = "stop"
    joint_values: JointValues | None = None
    frames: Frames = field(default_factory=Frames)
    backlash: bool = True  # taken up where the text is in the order of motion
    largest_change: float | None = None
    weights: Weights | None = None
    controller_model: Mechanism | None = None


@dataclass(frozen=True)
class CompensatedProgram:
    """What came of a program.

    data          the corrected program; every byte that is no number of a changed target is as it was
    targets       how many could be read
    changed       how many have other numbers now
    largest_mm, largest_deg   the largest change: of the nominal tool's place, and of a joint
    left_alone    what was not corrected, and why
    remarks       corrected targets that need a look
    notes         what else a reader has to know
    """

    data: bytes
    targets: int
    changed: int
    largest_mm: float
    largest_deg: float
    left_alone: tuple[Remark, ...]
    remarks: tuple[Remark, ...]
    notes: tuple[str, ...]

    def summary(self, name: str) -> list[str]:
        """Lines for people: counts, the largest change, and every reason with its lines."""
        most = f", at most {self.largest_mm:.3f} mm and {self.largest_deg:.4f} deg" if self.changed else ""
        alone = f"; {len(self.left_alone)} left alone" if self.left_alone else ""
        lines = [f"{name}: {self.changed} of {self.targets} targets changed{most}{alone}"]
        for what, remarks in (("left alone", self.left_alone), ("changed, but look", self.remarks)):
            ordered = sorted(remarks, key=lambda remark: (remark.why, remark.line))
            for why, group in groupby(ordered, key=lambda remark: remark.why):
                lines.append(f"{name}: {what}: {why}: {_places(list(group))}")
        return lines + [f"{name}: note: {note}" for note in self.notes]


def compensate_program(
    calibration: Calibration, data: bytes, name: str, program_format: str, options: ProgramOptions | None = None
) -> CompensatedProgram:
    """Correct every joint and pose target of a program.

    A joint target gets the joints that bring the calibrated robot where the nominal one would be; a
    pose target, solved on the branch of its configuration data, gets the pose at which the
    controller's own model (the nominal robot unless given) is at the corrected joints, in its own
    frame and with its own tool. program_format: one of docs/programs; name stands in messages;
    options: exact, stop at the first failure, unless given.

    Raises InputError for bad data and NoSolutionError for targets without an answer, both with the
    line; with on_error `skip` such targets stay as they are and are listed. Raises UsageError for
    poses without the controller's model where the robot's description says that it may differ from
    the nominal robot.
    """
    options = options or ProgramOptions()
    if b"\0" in data:
        raise InputError(f"{name}: holds zero bytes; expected a program in ASCII, UTF-8 or Latin-1")
    robot = calibration.robot
    program = reader(program_format)(data.decode("latin-1"), robot)
    if any(target.kind == "pose" for target in program.targets):
        check_controller_known(robot, options.controller_model, name)
    controller = Controller(robot, coupling_of(robot, program_format, options.joint_values))
    failures: list[tuple[Remark, type[CalibtoolError]]] = [(r, InputError) for r in program.remarks if r.bad]
    left = [remark for remark in program.remarks if not remark.bad]
    if failures and options.on_error == "stop":
        raise _stopped(name, failures)
    solved, unsolved, unknown = _nominal(controller, program, options.frames)
    failures += unsolved
    left += unknown
    if failures and options.on_error == "stop":
        raise _stopped(name, failures)

    q = np.array([item.q for item in solved]).reshape(-1, robot.n)
    result = _corrected(calibration, solved, q, options)
    backlash = calibration.base.motion.backlash
    notes = program.notes + _joint_values_note(controller, program)
    if options.backlash and backlash.any():
        if program_format in _IN_ORDER:
            result = replace(result, q=result.q + BacklashPath(backlash).taken_up(result.q))
        else:
            notes += ("the backlash is not taken up: a program does not say in which order its targets are reached",)
    edits: list[tuple[int, int, str]] = []
    remarks: list[Remark] = []
    changed, moved_mm, turned_deg = 0, [0.0], [0.0]
    nominal, commanded = robot.mechanism.forward(q), [item.T_base_tool for item in solved]
    new, better_left = poses_to_write(calibration, options.controller_model, commanded, q, result.q)
    for k, item in enumerate(solved):
        status = result.status[k]
        if np.isnan(result.q[k]).any():
            why = f"{MEANING[status]} (--outside refuse)" if status == OUTSIDE else MEANING[status]
            failures.append((_remark(item.target, why), NoSolutionError))
            continue
        if better_left[k]:
            why = "the controller's own model already brings the tool nearer to it"
            left.append(_remark(item.target, why))
            continue
        own, digits = _edits(controller, program, item, result.q[k], nominal[k], new[k])
        if status != OK:
            (left if status == UNCORRECTED else remarks).append(_remark(item.target, MEANING[status]))
        if digits:
            remarks.append(
                _remark(item.target, "a joint passes into another turn: its configuration data are changed too")
            )
        if own:
            changed += 1
            moved_mm.append(1e3 * float(np.linalg.norm(new[k, :3, 3] - nominal[k, :3, 3])))
            revolute = ~np.array(robot.prismatic)
            turned_deg.append(float(np.rad2deg(np.abs(result.q[k] - item.q)[revolute].max(initial=0.0))))
        edits += own
    if failures and options.on_error == "stop":
        raise _stopped(name, failures)
    return CompensatedProgram(
        data=replaced(program.text, edits).encode("latin-1"),
        targets=len(program.targets),
        changed=changed,
        largest_mm=max(moved_mm),
        largest_deg=max(turned_deg),
        left_alone=(*left, *(remark for remark, _ in failures)),
        remarks=tuple(remarks),
        notes=notes if program.targets or program.remarks else (_nothing(program_format),),
    )


@dataclass(frozen=True, eq=False)
class _Solved:
    """A target with its nominal joint positions q (n,); of a pose T_base_tool, T_base_frame and T_flange_tool."""

    target: Target
    q: Array
    T_base_tool: Array | None = None
    T_base_frame: Array | None = None
    T_flange_tool: Array | None = None


def _nominal(
    controller: Controller, program: Program, frames: Frames
) -> tuple[list[_Solved], list[tuple[Remark, type[CalibtoolError]]], list[Remark]]:
    """Targets with their nominal joints in the order of the text; those without; those in unknown frames."""
    robot = controller.robot
    solved: list[_Solved] = []
    failures: list[tuple[Remark, type[CalibtoolError]]] = []
    unknown: list[Remark] = []
    before: Array | None = None
    known_frames, known_tools = {**program.frames, **frames.frames}, {**program.tools, **frames.tools}
    for target in program.targets:
        if target.kind == "joint":
            item: _Solved | str = _Solved(target, controller.to_serial(np.array(target.values)))
        else:
            T_base_frame, T_flange_tool = _known(known_frames, target.frame), _known(known_tools, target.tool)
            if T_base_frame is None or T_flange_tool is None:
                unknown.append(_remark(target, _unknown(target, T_base_frame is None)))
                continue
            T = T_base_frame @ pose(target.values, target.orientation) @ inverse(T_flange_tool)
            near = before
            if target.joints:
                near = controller.to_serial(np.array([number.value for number in target.joints]))
            q = solve_pose(controller, T, target.configuration, near)
            item = q if isinstance(q, str) else _Solved(target, q, T, T_base_frame, T_flange_tool)
        if isinstance(item, str):
            failures.append((_remark(target, item), NoSolutionError))
        elif not robot.within_limits(item.q[None])[0]:
            failures.append((_remark(target, _beyond(controller, item.q)), NoSolutionError))
        else:
            solved.append(item)
            before = item.q
    return solved, failures, unknown


def _corrected(calibration: Calibration, solved: list[_Solved], q: Array, options: ProgramOptions) -> Compensation:
    """The compensation of all targets, joint targets and poses each in one batch."""
    count = len(solved)
    result = Compensation(q.copy(), np.full(count, OK, dtype=object), np.zeros(count), np.zeros(count), q)
    bounds = default_bounds(calibration, options.largest_change, options.weights)
    poses = np.array([item.T_base_tool is not None for item in solved], dtype=bool)
    for kind in (False, True):
        rows = np.flatnonzero(poses == kind)
        if not len(rows):
            continue
        T = np.array([solved[k].T_base_tool for k in rows]) if kind else None
        part = guarded(calibration, q[rows], T, options.method, options.outside, bounds)
        for name in ("q", "status", "position", "orientation"):
            getattr(result, name)[rows] = getattr(part, name)
    return result


def _edits(
    controller: Controller, program: Program, item: _Solved, q: Array, nominal: Array, new: Array
) -> tuple[list[tuple[int, int, str]], bool]:
    """What has to be written for corrected joints q (n,), configuration data among it or not.

    nominal (4, 4): where the nominal robot is at the commanded joints; new (4, 4): where the
    controller's model, which may be another one, is at q.
    """
    target = item.target
    same = target.kind == "joint" or np.abs(new - nominal).max() < _NO_CHANGE
    if same and np.abs(q - item.q).max() < _NO_CHANGE:
        return [], False
    joints = controller.to_controller(q).tolist()
    if target.kind == "joint":
        return rewritten(program.text, target.numbers, joints), False
    edits = rewritten(program.text, target.joints, joints) if target.joints else []
    assert item.T_base_frame is not None
    assert item.T_flange_tool is not None
    T = inverse(item.T_base_frame) @ new @ item.T_flange_tool
    edits += rewritten(program.text, target.numbers, pose_values(T, target.orientation, target.values))
    digits = target.configuration.digits(np.array(joints)) if target.configuration else []
    return edits + [(digit.start, digit.end, str(value)) for digit, value in digits], bool(digits)


def _joint_values_note(controller: Controller, program: Program) -> tuple[str, ...]:
    """Whose joint values were read and written, where that matters."""
    if not any(target.kind == "joint" or target.joints for target in program.targets):
        return ()
    taken, own = coupling_text(controller.coupling), coupling_text(controller.robot.coupling)
    if taken:
        return (f"joint values are the controller's, {taken}; if not: --joint-values serial",)
    if own:
        return (f"joint values are the serial chain's; if not, {own}: --joint-values controller",)
    return ()


def _nothing(program_format: str) -> str:
    return f"no positions are written in it as {program_format}; if it is something else, say so with --format"


def _known(known: dict[str, Array], name: str | None) -> Array | None:
    if name == "":
        return known.get("0", np.eye(4))
    return known.get("default" if name is None else name)


def _unknown(target: Target, frame: bool) -> str:
    kind, name = ("frame", target.frame) if frame else ("tool", target.tool)
    key = "default" if name is None else name
    what = f"the program does not say its {kind}" if name is None else f"{kind} '{name}' is not known"
    return f"{what}; give it with --frames, [{kind}s.{key}]"


def _beyond(controller: Controller, q: Array) -> str:
    robot = controller.robot
    outside = np.flatnonzero((q < robot.lower - 1e-9) | (q > robot.upper + 1e-9))
    j = int(outside[0])
    factor, unit = (1e3, "mm") if robot.prismatic[j] else (180 / np.pi, "deg")
    limits = f"{robot.lower[j] * factor:.6g} … {robot.upper[j] * factor:.6g} {unit}"
    return f"joint {j + 1} at {q[j] * factor:.6g} {unit} is outside its limits ({limits})"


def _remark(target: Target, why: str) -> Remark:
    return Remark(target.line, target.name, why)


def _stopped(name: str, failures: list[tuple[Remark, type[CalibtoolError]]]) -> CalibtoolError:
    first, kind = min(failures, key=lambda failure: failure[0].line)
    more = f"; and {len(failures) - 1} more" if len(failures) > 1 else ""
    label = f"{first.name}: " if first.name else ""
    return kind(
        f"{name}:{first.line}: {label}{first.why}{more}; nothing is written (--on-error skip leaves such targets)"
    )


def _places(remarks: list[Remark]) -> str:
    """`line 3 (P[1])`, or `lines 3, 5, 9 and 14 more`."""
    if len(remarks) == 1:
        return f"line {remarks[0].line}" + (f" ({remarks[0].name})" if remarks[0].name else "")
    numbers = [str(line) for line in sorted({remark.line for remark in remarks})]
    more = f" and {len(numbers) - _LISTED} more" if len(numbers) > _LISTED else ""
    return f"lines {', '.join(numbers[:_LISTED])}{more}"
