"""ROS 2 trajectories: trajectory_msgs/JointTrajectory as YAML or JSON text."""

import re

from calibtool.errors import InputError, near_names
from calibtool.programs.lists import closing, split
from calibtool.programs.targets import Lines, Program, Remark, Target, is_not_finite, number_at
from calibtool.robot.model import Robot

NAME = "ros2-trajectory"
IN_ORDER = True
SUFFIXES = (".yaml", ".yml", ".json")
_COMMENT = re.compile(r"(?:^|(?<=\s))#[^\r\n]*", re.MULTILINE)
_LIST = re.compile(r"""(?:^|(?<=[\s{,\-]))(["']?)(joint_names|positions)\1\s*:""", re.MULTILINE)
_BULLET = re.compile(r"(?:[ \t]*\r?\n)*[ \t]*-[ \t]+(\S[^\r\n]*)")


def matches(text: str) -> bool:
    """Whether this holds a joint trajectory."""
    return {match[2] for match in _LIST.finditer(text)} == {"joint_names", "positions"}


def read(text: str, robot: Robot) -> Program:
    """Every `positions` list, its joints by name; joints that are not the robot's stay as they are."""
    code = _COMMENT.sub(lambda match: " " * len(match[0]), text)
    lines = Lines(text)
    wanted = [str(name) for name in robot.chain.model.names[1:]]
    names: list[tuple[int, list[str]]] = []
    points: list[tuple[int, list[tuple[int, int]]]] = []
    for match in _LIST.finditer(code):
        try:
            spans = _elements(code, match.end())
        except InputError as error:
            return Program(text, (), (Remark(lines(match.start(2)), match[2], str(error), bad=True),))
        if match[2] == "positions":
            points.append((match.start(2), spans))
        else:
            names.append((match.start(2), [code[a:b].strip(" \t\r\n\"'") for a, b in spans]))
    remarks: list[Remark] = []
    targets: list[Target] = []
    for number, (position, spans) in enumerate(points, start=1):
        name = f"point {number}"
        above = [found for start, found in names if start < position]
        joints = above[-1] if above else names[0][1] if names else []
        if not spans:
            continue
        line = lines(spans[0][0] + len(code[slice(*spans[0])]) - len(code[slice(*spans[0])].lstrip()))
        found = _target(text, code, spans, joints, wanted, robot, name, line)
        if isinstance(found, Target):
            targets.append(found)
        else:
            remarks.append(found)
    notes = []
    if re.search(r"\b(?:velocities|accelerations)[\"']?\s*:\s*\[?\s*-?\s*[\d.]", code):
        notes.append("velocities and accelerations are left as they are")
    extra = sorted({joint for _, found in names for joint in found} - set(wanted))
    if extra:
        remarks.append(Remark(lines(names[0][0]), ", ".join(extra), "external axes: not joints of the calibration"))
    return Program(text, tuple(targets), tuple(remarks), notes=tuple(notes))


def _target(
    text: str,
    code: str,
    spans: list[tuple[int, int]],
    joints: list[str],
    wanted: list[str],
    robot: Robot,
    name: str,
    line: int,
) -> Target | Remark:
    missing = [joint for joint in wanted if joint not in joints]
    if missing:
        why = f"joint_names has no '{missing[0]}' of {robot.name}; {near_names(missing[0], joints)}"
        return Remark(line, name, why, bad=True)
    if len(spans) != len(joints):
        return Remark(line, name, f"holds {len(spans)} positions for {len(joints)} joint_names", bad=True)
    numbers = []
    for joint, unit in zip(wanted, robot.joint_units, strict=True):
        start, end = spans[joints.index(joint)]
        number = number_at(text, start, end, unit)
        if number is None:
            word = code[start:end].strip()
            kind = "is not finite" if is_not_finite(word) else "is not a number"
            return Remark(line, name, f"{joint} holds '{word[:30]}', which {kind}", bad=True)
        numbers.append(number)
    return Target("joint", tuple(numbers), line, name)


def _elements(code: str, start: int) -> list[tuple[int, int]]:
    """Spans of the elements of the list after a key: `[a, b]` over any number of lines, or one `- a` per line."""
    flow = re.compile(r"\s*\[").match(code, start)
    if flow:
        end = closing(code, flow.end() - 1)
        if end is None:
            raise InputError("a bracket is not closed")
        if not code[flow.end() : end].strip():
            return []
        return split(code, flow.end(), end)
    spans = []
    rest = re.compile(r"[ \t]*\r?\n").match(code, start)
    position = rest.end() if rest else start
    while bullet := _BULLET.match(code, position):
        if re.match(r"[\"']?\w+[\"']?\s*:", bullet[1]):  # the next mapping, not an element
            break
        spans.append(bullet.span(1))
        position = bullet.end()
        position += len(code[position : position + 2]) - len(code[position : position + 2].lstrip("\r\n"))
    return spans
