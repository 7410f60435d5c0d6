"""The positions of a TP program, between /POS and /END."""

import re
from collections import Counter
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise

from calibtool.programs.bracketed_lists import trimmed
from calibtool.programs.configurations import Digit, Fanuc
from calibtool.programs.external_axes import arm_units, beside_pose, joints
from calibtool.programs.motions import JOINT, POSE, Literal
from calibtool.programs.numbers import LineNumbers, Number, Remark, is_not_finite, number_at
from calibtool.robot.orientation import FIXED_ANGLES
from calibtool.robot.robot import Robot

HELD = "the robot holds the work piece and not the tool"
_POSITION = re.compile(
    r"^[ \t]*P[ \t]*\[[ \t]*(\d{1,9})[ \t]*(?::[^\n]*?)?\][ \t]*\{", re.MULTILINE
)
_END = re.compile(r"\}[ \t]*;")
_GROUP = re.compile(r"\bGP(\d+)[ \t]*:")
_ITEM = re.compile(r"(?:'[^'\n]*'|[^,'\n])+")
_VALUE = re.compile(r"([A-Z]+\d*)\s*=\s*(\S+?)\s*(mm|deg)?")
_EXTERNAL = re.compile(r"E([1-9]\d?)")
_FRAME = re.compile(r"(UF|UT)\s*:\s*(\w+)")
_CONFIG = re.compile(r"[CK]ONFIG\s*:\s*'([^']*)'")
_SIX_JOINTS = re.compile(r"\s*([NF])\s*(?:[LR]\s*)?([UD])\s*([TB])\s*((?:,\s*[-+]?\d{1,4}\s*)*)")
_TURN = re.compile(r"[-+]?\d+")
_POSE = (("X", "mm"), ("Y", "mm"), ("Z", "mm"), ("W", "deg"), ("P", "deg"), ("R", "deg"))


@dataclass(frozen=True, slots=True)
class Taught:
    """A position of a program: number of its literal, and its frame and tool as written."""

    literal: int
    frame: str = "F"
    tool: str = "F"


@dataclass(eq=False)
class _Group:
    """The contents of a position for one motion group."""

    line: int
    end: int = 0  # where its last item begins
    frame: str = "F"
    tool: str = "F"
    config: re.Match[str] | None = None
    offset: int = 0  # where the items begin in the text
    values: dict[str, Number | None] = field(default_factory=dict)  # None: not taught
    why: str = ""
    bad: bool = False

    def refuse(self, line: int, why: str) -> None:
        self.line, self.why, self.bad = line, why, True


@dataclass(eq=False)
class Positions:
    """Reads the positions of programs into literals.

    axes  joints that the three turn numbers count, from 0
    """

    text: str
    code: str
    source: int
    lines: LineNumbers
    robot: Robot
    axes: tuple[int, ...]
    literals: list[Literal]
    remarks: list[Remark]

    def read(
        self, span: tuple[int, int], not_corrected: Callable[[int], str], relative: Container[int]
    ) -> dict[int, Taught]:
        """The positions for motion group 1 in a part of the text.

        not_corrected: why a position is not corrected, by its number; relative: positions that are
        distances
        """
        twice = Counter(int(position[1]) for position in _POSITION.finditer(self.code, *span))
        taught: dict[int, Taught] = {}
        for position, following in pairwise(chain(_POSITION.finditer(self.code, *span), [None])):
            assert position is not None
            limit = span[1] if following is None else following.start()
            number, line = int(position[1]), self.lines(position.start(1))
            name = f"P[{number}]"
            closed = _END.search(self.code, position.end(), limit)
            if closed is None:
                self._bad(line, name, "is not closed by };")
                continue
            groups = list(_GROUP.finditer(self.code, position.end(), closed.start()))
            if not groups:
                self._bad(line, name, "no motion group; expected GP1:")
            ends = [group.start() for group in groups[1:]] + [closed.start()]
            for group, end in zip(groups, ends, strict=False):
                read = self._group(group.end(), end)
                if group[1] != "1":
                    why = "another motion group: only group 1 is this robot"
                    kind = JOINT if any(key.startswith("J") for key in read.values) else POSE
                    place, label = self.lines(group.start()), f"{name} GP{group[1]}"
                    self._add(
                        Literal(kind, (), place, label, source=self.source, not_corrected=why)
                    )
                    continue
                why = "is written more than once" if twice[number] > 1 else not_corrected(number)
                literal = self._literal(read, name, why)
                if why and not literal.bad and number in relative:
                    literal = replace(
                        literal, line=line
                    )  # it is no position, and its numbers are none
                elif why and not literal.bad:
                    whole = self._literal(read, name, "")
                    literal = literal if whole.bad else replace(whole, not_corrected=why)
                self._add(literal)
                taught[number] = Taught(len(self.literals) - 1, read.frame, read.tool)
        return taught

    def _add(self, literal: Literal) -> None:
        self.literals.append(literal)

    def _bad(self, line: int, name: str, why: str) -> None:
        self.remarks.append(Remark(line, name, why, True, self.source))

    def _group(self, start: int, end: int) -> _Group:
        """The items of a motion group."""
        group = _Group(self.lines(start))
        for item in _ITEM.finditer(self.code, start, end):
            word = item[0].strip()
            first, _ = trimmed(self.code, *item.span())
            if not word or group.bad:
                continue
            group.end = first
            if match := _FRAME.fullmatch(word):
                number = (match[2].lstrip("0") or "0") if match[2].isdecimal() else "F"
                group.frame, group.tool = (
                    (number, group.tool) if match[1] == "UF" else (group.frame, number)
                )
            elif match := _CONFIG.fullmatch(word):
                group.config, group.offset = match, first
            elif match := _VALUE.fullmatch(word):
                span = first + match.start(2), first + match.end(2)
                value = number_at(self.text, *span, match[3] or "")
                taught = "*" not in match[2]
                if taught and (value is None or not match[3]):
                    what = f"{match[1]} is '{match[2]}'; expected a number with mm or deg"
                    group.refuse(self.lines(first), what)
                group.values[match[1]] = value if taught else None
            elif is_not_finite(word):
                group.refuse(self.lines(first), f"'{word}' is not a number")
            else:
                group.refuse(self.lines(first), f"'{word[:30]}' is not known in a position")
        return group

    def _literal(self, group: _Group, name: str, not_corrected: str) -> Literal:
        """The literal of group 1. not_corrected: why not, although it can be read."""
        axes = {k: value for k, value in group.values.items() if not _EXTERNAL.fullmatch(k)}
        kind = JOINT if "J1" in axes else POSE
        remote = set(axes) == {f"R{key}" for key, _ in _POSE}
        numbers: tuple[Number, ...] = ()
        external: tuple[tuple[int, Number], ...] = ()
        configuration = None
        if not group.bad and not not_corrected and None in group.values.values():
            not_corrected = "not taught"
        if not group.bad and not not_corrected and kind == JOINT:
            numbers, not_corrected = self._joints(group, axes)
        elif not group.bad and not not_corrected:
            numbers = self._pose(group, {k[1:]: v for k, v in axes.items()} if remote else axes)
            configuration, not_corrected = self._configuration(group)
            if remote:
                not_corrected = f"a remote TCP position (RX, RY, …): {HELD}"
            elif not not_corrected:
                external, not_corrected = beside_pose(self.robot, _beside(group))
        first = next((value for value in axes.values() if value is not None), None)
        line = self.lines(first.start) if first and not group.bad else group.line
        return Literal(
            kind, () if group.bad else numbers, line, name, FIXED_ANGLES if kind == POSE else "",
            configuration, self.source, group.why or not_corrected, group.bad,
            blank=kind == POSE and not any(number.value for number in numbers), external=external,
        )  # fmt: skip

    def _joints(
        self, group: _Group, values: dict[str, Number | None]
    ) -> tuple[tuple[Number, ...], str]:
        robot, count = self.robot, len(self.robot.arm)
        numbers = [values.get(f"J{k + 1}") for k in range(count)]
        found = tuple(number for number in numbers if number is not None)
        if len(found) != count or len(values) != count:
            line = next(self.lines(value.start) for value in values.values() if value is not None)
            why = f"holds {', '.join(values)}, but {robot.name} has {count} joints"
            group.refuse(line, why)
            return (), ""
        for k, (number, unit) in enumerate(zip(found, arm_units(robot), strict=True)):
            if number.unit != unit:
                why = f"J{k + 1} is in {number.unit}, which does not fit the joint"
                group.refuse(self.lines(number.start), why)
        if not any(number.value for number in found):
            return found, "a mastering position: all joints are zero"
        whole = joints(robot, found, _beside(group))
        return (found, whole) if isinstance(whole, str) else (whole, "")

    def _pose(self, group: _Group, values: dict[str, Number | None]) -> tuple[Number, ...]:
        numbers = tuple(number for key, _ in _POSE if (number := values.get(key)) is not None)
        if set(values) != {key for key, _ in _POSE}:
            what = ", ".join(values) or "nothing"
            group.refuse(self.lines(group.end), f"holds {what}; expected J1 … or X Y Z W P R")
        for (key, unit), number in zip(_POSE, numbers, strict=False):
            if number.unit != unit and not group.bad:
                line = self.lines(number.start)
                group.refuse(line, f"{key} is in {number.unit}; expected {unit}")
        return numbers

    def _configuration(self, group: _Group) -> tuple[Fanuc | None, str]:
        text = group.config[1] if group.config else ""
        match = _SIX_JOINTS.fullmatch(text)
        if match is None or group.config is None:
            return None, f"a configuration that is not of a six-joint arm ('{text}')"
        first = group.offset + group.config.start(1) + match.start(4)
        turns = [
            Digit(first + turn.start(), first + turn.end(), int(turn[0]))
            for turn in _TURN.finditer(match[4])
        ]
        return Fanuc(match[1], match[2], match[3], tuple(turns), self.axes), ""


def _beside(group: _Group) -> dict[int, Number | None]:
    """The numbers of a group's external axes."""
    return {
        int(axis[1]) - 1: value
        for key, value in group.values.items()
        if (axis := _EXTERNAL.fullmatch(key))
    }


def turn_axes(codes: Sequence[str], robot: Robot) -> tuple[int, ...]:
    """The joints that turn numbers count, from 0: the controller's setting $TURN_AXIS, where no
    file gives it.

    Joints 1, 4 and 6; or 4, 5 and 6 where the first number of a program cannot be a turn of joint
    1.
    """
    pattern = re.compile(r"[CK]ONFIG\s*:\s*'[^',\n]*,\s*([-+]?\d{1,4})\s*,\s*([-+]?\d{1,4})\b")
    numbers = {(int(m[1]), int(m[2])) for code in codes for m in pattern.finditer(code)}
    reach = max(abs(float(robot.lower[0])), abs(float(robot.upper[0])))
    first = any(first for first, _ in numbers) and not any(second for _, second in numbers)
    return (3, 4, 5) if first and reach <= _HALF_TURN else (0, 3, 5)


_HALF_TURN = 3.1420  # rad, with room for limits written as ±180 deg in rounded numbers
