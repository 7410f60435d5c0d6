"""ROS 2 trajectories: trajectory_msgs/JointTrajectory as YAML or JSON text."""

import re
from collections.abc import Sequence

from calibtool.errors import InputError, near_names
from calibtool.programs.bracketed_lists import closing, split, trimmed
from calibtool.programs.motions import JOINT, Aim, Literal, Move, Program, ProgramText, Routine
from calibtool.programs.numbers import LineNumbers, Number, Remark, is_not_finite, number_at
from calibtool.robot.robot import Robot

NAME = "ros2-trajectory"
SUFFIXES = (".yaml", ".yml", ".json")
_COMMENT = re.compile(r"(?:^|(?<=\s))#[^\r\n]*", re.MULTILINE)
_LIST = re.compile(r"""(?:^|(?<=[\s{,\-]))(["']?)(joint_names|positions)\1\s*:""", re.MULTILINE)
_NODE = re.compile(r"(?:[ \t]*(?:&(?P<anchor>[^\s,\[\]{}]+)|![^\s,\[\]{}]*))*")  # anchors and tags
_ALIAS = re.compile(r"[ \t]*\*([^\s,\[\]{}]+)")
_NOTHING = re.compile(r"\s*(?:\[\s*\]|null\b|~|$|[^\S\r\n]*[\r\n])")
_MEASURED = re.compile(r"\b(actual|feedback|error)[\"']?\s*:\s*\{?\s*\Z")
_LOOK_BACK = 80  # characters before a point in which such a word is looked for
_BULLET = re.compile(r"(?:[ \t]*[\r\n])*+[ \t]*-[ \t]+(\S[^\r\n]*)")


def matches(text: str) -> bool:
    """Whether this holds a joint trajectory."""
    return {match[2] for match in _LIST.finditer(text)} == {"joint_names", "positions"}


def program(sources: Sequence[ProgramText], robot: Robot) -> Program:
    """Every `positions` list in order, joints by name; joints of other devices do not change."""
    reader = _Reader(robot)
    for number, source in enumerate(sources):
        reader.read(number, source)
    moves = (
        Move(reader.literals[k].line, reader.literals[k].name, (Aim(k),)) for k in reader.order
    )
    return Program(
        tuple(sources),
        tuple(reader.literals),
        (Routine("points", tuple(moves)),),
        remarks=tuple(reader.remarks),
        notes=tuple(dict.fromkeys(reader.notes)),
        in_order=True,
    )


class _Reader:
    """The contents of the texts: positions, and the order of those that are points."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.wanted = list(robot.chain.bodies.joints[: robot.n])
        self.literals: list[Literal] = []
        self.order: list[int] = []
        self.remarks: list[Remark] = []
        self.notes: list[str] = []

    def read(self, number: int, source: ProgramText) -> None:
        text = source.text
        code = _COMMENT.sub(lambda match: " " * len(match[0]), text)
        lines = LineNumbers(text)
        names: list[tuple[int, list[str]]] = []
        points: list[tuple[int, list[tuple[int, int]], str, str]] = []
        named: dict[str, list[str]] = {}
        for match in _LIST.finditer(code):
            node = _NODE.match(code, match.end())
            alias = _ALIAS.match(code, match.end())
            assert node is not None
            try:
                spans = [] if alias else _elements(code, node.end())
            except InputError as error:
                line = lines(match.start(2))
                self.remarks.append(Remark(line, match[2], str(error), True, number))
                return
            if match[2] == "joint_names":
                found = [code[a:b].strip(" \t\r\n\"'") for a, b in spans]
                if alias:
                    found = named.get(alias[1], [])
                named[node["anchor"] or ""] = found
                names.append((match.start(2), found))
            elif measured := _measured(code, match.start()):
                why = f"was measured ({measured}), not asked for"
                self._skip(lines(match.start(2)), measured, why, number)
            elif spans or alias:
                points.append(
                    (match.start(2), spans, node["anchor"] or "", alias[1] if alias else "")
                )
            elif not _NOTHING.match(code, node.end()):
                other = code[node.end() : node.end() + _LOOK_BACK].split("\n")[0].strip()
                points.append((match.start(2), [], "", other))
        at = 0
        anchored: dict[str, int] = {}
        for count, (position, spans, anchor, alias_name) in enumerate(points, start=1):
            while at + 1 < len(names) and names[at + 1][0] < position:
                at += 1
            line = lines(spans[0][0] if spans else position)
            if not spans and alias_name in anchored:
                self.order.append(anchored[alias_name])
                continue
            joints = names[at][1] if names else []
            found_here = (
                self._point(code, spans, joints)
                if spans
                else f"'{alias_name[:30]}' is no list of positions, and no anchor of one above"
            )
            if self._add(found_here, line, f"point {count}", number) and anchor:
                anchored[anchor] = self.order[-1]
        if re.search(r"\b(?:velocities|accelerations)[\"']?\s*:\s*\[?\s*-?\s*[\d.]", code):
            self.notes.append("velocities and accelerations are left as they are")
        extra = sorted({joint for _, found in names for joint in found} - set(self.wanted))
        if extra:
            why = "external axes: not joints of the calibration"
            self.remarks.append(Remark(lines(names[0][0]), ", ".join(extra), why, source=number))

    def _skip(self, line: int, name: str, why: str, source: int) -> None:
        literal = Literal(JOINT, (), line, name, source=source, not_corrected=why)
        self.literals.append(literal)

    def _add(self, found: list[Number] | str, line: int, name: str, source: int) -> bool:
        """Add a point; returns whether it can be read."""
        if isinstance(found, str):
            self.literals.append(
                Literal(JOINT, (), line, name, source=source, not_corrected=found, bad=True)
            )
        else:
            self.order.append(len(self.literals))
            self.literals.append(Literal(JOINT, tuple(found), line, name, source=source))
        return not isinstance(found, str)

    def _point(
        self, code: str, spans: list[tuple[int, int]], joints: list[str]
    ) -> list[Number] | str:
        """The numbers in the robot's order, or a text that says what is wrong."""
        missing = [joint for joint in self.wanted if joint not in joints]
        if missing:
            near = near_names(missing[0], joints)
            return f"joint_names has no '{missing[0]}' of {self.robot.name}; {near}"
        if len(spans) != len(joints):
            return f"holds {len(spans)} positions for {len(joints)} joint_names"
        numbers = []
        for joint, unit in zip(self.wanted, self.robot.joint_units, strict=True):
            start, end = spans[joints.index(joint)]
            number = number_at(code, start, end, unit)
            if number is None:
                word = code[start:end].strip()
                kind = "is not finite" if is_not_finite(word) else "is not a number"
                return f"{joint} holds '{word[:30]}', which {kind}"
            numbers.append(number)
        return numbers


def _measured(code: str, position: int) -> str:
    """The word of a controller's state before a measured point."""
    found = _MEASURED.search(code, max(0, position - _LOOK_BACK), position)
    return found[1] if found else ""


def _elements(code: str, start: int) -> list[tuple[int, int]]:
    """Spans of the elements of the list after a key: `[a, b]`, or one `- a` per line."""
    flow = re.compile(r"\s*\[").match(code, start)
    if flow:
        end = closing(code, flow.end() - 1)
        if end is None:
            raise InputError("a bracket is not closed")
        if not code[flow.end() : end].strip():
            return []
        return [trimmed(code, *span) for span in split(code, flow.end(), end)]
    spans = []
    rest = re.compile(r"[ \t]*(?:\r\n|\n|\r)").match(code, start)
    position = rest.end() if rest else start
    while bullet := _BULLET.match(code, position):
        if re.match(r"[\"']?\w+[\"']?\s*:", bullet[1]):  # the next mapping, not an element
            break
        spans.append(trimmed(code, *bullet.span(1)))
        position = bullet.end()
        position += len(code[position : position + 2]) - len(
            code[position : position + 2].lstrip("\r\n")
        )
    return spans
