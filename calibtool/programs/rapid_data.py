"""Data of RAPID: positions, tools and work objects as they are written."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from calibtool.programs.bracketed_lists import Item, item
from calibtool.programs.configurations import Abb, Digit
from calibtool.programs.external_axes import UNUSED, arm_units, beside_pose, joints, unit_of
from calibtool.programs.frames import pose
from calibtool.programs.motions import (
    BASE,
    FRAME,
    JOINT,
    POSE,
    TOOL,
    Aim,
    Literal,
    Unknown,
    Value,
    frame_of,
)
from calibtool.programs.numbers import NUMBER, LineNumbers, Number, is_not_finite, number_at
from calibtool.robot.orientation import QUATERNION, UNIT_TOLERANCE
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.units import LARGEST, TO_SI

HELD = "the robot holds the work piece and not the tool"
_FORMS = {
    "jointtarget": "[[6 joints],[6 external]]",
    "robtarget": "[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[6 external]]",
}


def _numbers(count: int, number: str = NUMBER) -> str:
    return r"\[\s*+" + r"\s*+,\s*+".join([f"({number})"] * count) + r"\s*+\]"


def _lists(*lists: str) -> re.Pattern[str]:
    return re.compile(r"\[\s*+" + r"\s*+,\s*+".join(lists) + r"\s*+\]")


_SOLVED = re.compile(r"\b(\w+)\s*:=\s*CalcJointT\s*\(\s*\Z", re.IGNORECASE)
_LOOK_BACK = 200  # characters in which such an assignment is looked for
_INTEGER = r"-?\d{1,9}"
_ROBTARGET = _lists(_numbers(3), _numbers(4), _numbers(4, _INTEGER), _numbers(6))
_JOINTTARGET = _lists(_numbers(6), _numbers(6))
SHAPES = {"robtarget": _ROBTARGET, "jointtarget": _JOINTTARGET}


@dataclass(eq=False)
class Text:
    """A module's text, its code without comments and strings, and the positions found in it."""

    number: int
    text: str
    code: str
    lines: LineNumbers
    robot: Robot
    literals: list[Literal]
    # Where positions begin that are among the literals.
    taken: set[int] = field(default_factory=set)

    def shape(self, start: int, end: int) -> str | None:
        """The type of the position that code[start:end] writes in full."""
        for type_, shape in SHAPES.items():
            if shape.fullmatch(self.code, start, end):
                return type_
        return None

    def position(self, type_: str, start: int, end: int, name: str) -> int:
        """The number of the literal in code[start:end]."""
        self.taken.add(start)
        found = SHAPES[type_].fullmatch(self.code, start, end)
        if found is None or any(abs(float(number)) >= LARGEST for number in found.groups()):
            literal = self._strange(type_, start, end, name)
        elif type_ == "jointtarget":
            literal = self._joints(found, name)
        else:
            literal = self._robtarget(found, name)
        self.literals.append(literal)
        return len(self.literals) - 1

    def pose(self, start: int, end: int) -> Array | None:
        """T (4, 4) of `[[x,y,z],[q1,q2,q3,q4]]`."""
        value = item(self.code, start, end)
        if value.shape() != (3, 4):
            return None
        numbers = [
            number_at(self.text, part.start, part.end, "mm" if k == 0 else "")
            for k, row in enumerate(value.parts or ())
            for part in row.parts or ()
        ]
        values = [number.value for number in numbers if number is not None]
        if len(values) != 7 or not _unit(values[3:]):
            return None
        return pose(values, QUATERNION)

    def tool(self, start: int, end: int, name: str | None, line: int = 0) -> Value:
        """T_flange_tool of a tooldata `[robhold, tframe, load]`."""
        parts = item(self.code, start, end).parts or ()
        if len(parts) != 3:
            return Unknown(f"is no tooldata that can be read (line {self.lines(start)})")
        if self._word(parts[0]).upper() != "TRUE":
            return Unknown(HELD)
        T = self.pose(parts[1].start, parts[1].end)
        if T is None:
            return Unknown(f"its numbers cannot be read (line {self.lines(start)})")
        return frame_of(TOOL, name, T, line)

    def work_object(self, start: int, end: int, line: int = 0) -> tuple[Value, Value]:
        """User frame and object frame of a wobjdata `[robhold, ufprog, ufmec, uframe, oframe]`."""
        parts = item(self.code, start, end).parts or ()
        if len(parts) != 5:
            unknown = Unknown(f"is no wobjdata that can be read (line {self.lines(start)})")
            return unknown, BASE
        words = [self._word(part).upper() for part in parts[:2]]
        if words[0] != "FALSE":
            return Unknown(HELD), BASE
        if words[1] != "TRUE":
            return Unknown("a mechanical unit moves the work object"), BASE
        T = [self.pose(part.start, part.end) for part in parts[3:]]
        frames = [None if one is None else frame_of(FRAME, None, one, line) for one in T]
        unread = Unknown(f"its numbers cannot be read (line {self.lines(start)})")
        return frames[0] or unread, frames[1] or unread

    def others(self) -> Iterator[Literal]:
        """Positions in code other than the data, assignments and arguments that are followed."""
        for type_, shape in SHAPES.items():
            for found in shape.finditer(self.code):
                start = found.start()
                if start not in self.taken:
                    why = "stands in something that is not followed"
                    kind = POSE if type_ == "robtarget" else JOINT
                    literal = self._literal(kind, start, type_, why)
                    yield replace(literal, moved_to=self._is_solved(start))

    def _is_solved(self, position: int) -> bool:
        """Whether a position's joints are assigned to data to which a motion goes."""
        solved = _SOLVED.search(self.code, max(0, position - _LOOK_BACK), position)
        return solved is not None and bool(
            re.search(rf"\bMoveAbsJ\s*(?:\\Conc\s*,)?\s*{solved[1]}\b", self.code, re.IGNORECASE)
        )

    def _word(self, part: Item) -> str:
        return self.code[part.start : part.end].strip()

    def _number(self, found: re.Match[str], group: int, unit: str) -> Number:
        value = float(found[group]) * TO_SI.get(unit, 1.0)
        return Number(found.start(group), found.end(group), unit, value)

    def _literal(self, kind: str, start: int, name: str, why: str, bad: bool = False) -> Literal:
        line = self.lines(start)
        return Literal(kind, (), line, name, source=self.number, not_corrected=why, bad=bad)

    def _joints(self, found: re.Match[str], name: str) -> Literal:
        robot, groups = self.robot, found.groups()
        used = [k for k in range(6) if abs(float(groups[k])) < UNUSED]
        if not used:
            return self._literal(JOINT, found.start(), name, "external axes alone")
        if len(used) != len(robot.arm):
            why = f"holds {len(used)} joints, but {robot.name} has {len(robot.arm)}"
            return self._literal(JOINT, found.start(), name, why, bad=True)
        units = arm_units(robot)
        axes = [self._number(found, k + 1, unit) for k, unit in zip(used, units, strict=True)]
        if not any(number.value for number in axes):
            why = "a mastering position: all joints are zero"
            return self._literal(JOINT, found.start(), name, why)
        numbers = joints(robot, axes, self._beside(found, 7))
        if isinstance(numbers, str):
            return self._literal(JOINT, found.start(), name, numbers)
        number, line = len(self.literals), self.lines(found.start())
        return Literal(JOINT, numbers, line, name, source=self.number, alone=Aim(number))

    def _beside(self, found: re.Match[str], first: int) -> dict[int, Number]:
        """The numbers of external axes, the first one in this group."""
        return {k: self._number(found, first + k, unit_of(self.robot, k)) for k in range(6)}

    def _robtarget(self, found: re.Match[str], name: str) -> Literal:
        numbers = [self._number(found, k, "mm") for k in (1, 2, 3)]
        numbers += [self._number(found, k, "") for k in (4, 5, 6, 7)]
        values = [number.value for number in numbers]
        blank = not any(values[:3]) and values[3:] in ([1, 0, 0, 0], [0, 0, 0, 0])
        if blank and not any(values):
            return self._literal(POSE, found.start(), name, "not taught: its numbers are zero")
        if not _unit(values[3:]):
            why = f"quaternion of length {np.linalg.norm(values[3:]):.4g}; expected 1"
            return self._literal(POSE, found.start(), name, why, bad=True)
        digits = [Digit(found.start(k), found.end(k), int(found[k])) for k in range(8, 12)]
        external, not_corrected = beside_pose(self.robot, self._beside(found, 12))
        return Literal(
            POSE,
            tuple(numbers),
            self.lines(found.start()),
            name,
            QUATERNION,
            Abb((digits[0], digits[1], digits[2]), digits[3].value),
            self.number,
            not_corrected,
            blank=blank,
            external=external,
        )

    def _strange(self, type_: str, start: int, end: int, name: str) -> Literal:
        """Why a text is not a position: an expression among its numbers, or an error."""
        kind = JOINT if type_ == "jointtarget" else POSE
        expected = (6, 6) if kind == JOINT else (3, 4, 4, 6)
        value = item(self.code, start, end)
        parts = value.parts
        lists = parts is not None and all(part.parts is not None for part in parts)
        if value.shape() != expected and (lists or len(parts or ()) != len(expected)):
            why = f"is no {type_}; expected {_FORMS[type_]}"
            return self._literal(kind, start, name, why, bad=True)
        for row in parts or ():
            for part in row.parts if row.parts is not None else (row,):
                word = self._word(part)
                if is_not_finite(word):
                    return self._literal(kind, start, name, f"'{word}'; expected a number", True)
                if number_at(self.text, part.start, part.end, "") is None:
                    why = f"a variable or an expression ({word[:30]})"
                    return self._literal(kind, start, name, why)
        return self._literal(kind, start, name, f"is no {type_}; expected {_FORMS[type_]}", True)


def _unit(quaternion: list[float]) -> bool:
    return bool(abs(np.linalg.norm(quaternion) - 1.0) <= UNIT_TOLERANCE)
