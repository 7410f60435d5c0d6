"""Aggregates of KRL: positions and frames as they are written."""

import re
from dataclasses import dataclass, field, replace
from functools import cached_property

from calibtool.programs.bracketed_lists import trimmed
from calibtool.programs.configurations import Digit, Kuka
from calibtool.programs.external_axes import arm_units, beside_pose, joints, unit_of
from calibtool.programs.frames import pose
from calibtool.programs.krl import Statement, statements
from calibtool.programs.motions import JOINT, POSE, Aim, Literal, Unknown, Value
from calibtool.programs.numbers import (
    LineNumbers,
    Number,
    comments_blanked,
    is_not_finite,
    number_at,
)
from calibtool.robot.orientation import TURNED_ANGLES
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.units import LARGEST

_MAYBE = Unknown("the motion that goes there is not known")
_JOINTS = tuple(f"A{k}" for k in range(1, 7))
_POSE = ("X", "Y", "Z", "A", "B", "C")
_EXTERNAL = tuple(f"E{k}" for k in range(1, 7))
_KNOWN = frozenset((*_JOINTS, *_POSE, *_EXTERNAL, "S", "T"))
_UNITS = ("mm", "mm", "mm", "deg", "deg", "deg")
_TYPE = re.compile(r"\s*[A-Za-z]\w*\s*:")
_ITEM = re.compile(r"\s*(?:([A-Za-z]\w*)(?:\[\s*\])?)?\s*([^,]*),?")
_INTEGER = re.compile(r"(-?\d{1,9})|'B([01]{1,32})'|'H([0-9A-Fa-f]{1,8})'")
_GROUP = re.compile(r"\{[^{}]*\}")
# Members of structures: accelerations, centre of mass and the like, which are no positions.
_MEMBER = re.compile(r"\b(?:AX|CM|J|ROOT|OFFSET)\s*=?\s*$", re.IGNORECASE)

Spans = dict[str, tuple[int, int]]


@dataclass(eq=False)
class Text:
    """A text, its code with comments and strings replaced by blanks, and the positions found so
    far.

    module  the module of its names that are not global
    taken   where aggregates begin that have been read
    """

    number: int
    name: str
    text: str
    robot: Robot
    literals: list[Literal]
    module: str = ""
    taken: set[int] = field(default_factory=set)

    @cached_property
    def code(self) -> str:
        """The text without comments and strings."""
        return comments_blanked(self.text, r";[^\r\n]*|^[^\S\r\n]*&[^\r\n]*", r'"[^"\r\n]*"')

    @cached_property
    def lines(self) -> LineNumbers:
        """Line numbers of positions in the text."""
        return LineNumbers(self.text)

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """The statements of the text."""
        return tuple(statements(self.code))

    @cached_property
    def scoped(self) -> list[tuple[Statement, tuple[str, ...]]]:
        """The statements, each with its module and with its routine, if it is in one."""
        found: list[tuple[Statement, tuple[str, ...]]] = []
        scopes: tuple[str, ...] = (self.module,)
        for statement in self.statements:
            if statement.word == "routine":
                scopes = (f"{self.module}|{statement.name.lower()}", self.module)
            found.append((statement, scopes))
            if statement.word in ("end", "endfct"):
                scopes = (self.module,)
        return found

    def items(self, start: int, end: int) -> Spans:
        """Component → span of its value in an aggregate; a type before it (`E6POS:`) is skipped."""
        first, last = start + 1, end - 1
        prefix = _TYPE.match(self.code, first, last)
        position = prefix.end() if prefix else first
        found: Spans = {}
        while position < last and (item := _ITEM.match(self.code, position, last)):
            key = item[1].upper() if item[1] else item[2].strip()
            if key:
                found[key] = item.span(2)
            position = max(item.end(), position + 1)
        return found

    def complete(self, start: int, end: int) -> bool:
        """Whether an aggregate holds all axes or all of a pose."""
        keys = self.items(start, end).keys()
        return keys >= set(_POSE) or keys >= set(_JOINTS[: self.robot.n])

    def frame(self, start: int, end: int) -> Array | None:
        """T (4, 4) of the aggregate in code[start:end]; None if it is no frame with six numbers."""
        self.taken.add(start)
        spans = self.items(start, end)
        if not spans.keys() >= set(_POSE):
            return None
        numbers = [number_at(self.text, *spans[k], u) for k, u in zip(_POSE, _UNITS, strict=True)]
        values = [number.value for number in numbers if number is not None]
        return pose(values, TURNED_ANGLES) if len(values) == len(_POSE) else None

    def position(
        self,
        start: int,
        end: int,
        name: str,
        not_corrected: str = "",
        frames: tuple[Value, Value] | None = None,
    ) -> int:
        """The number of the literal in code[start:end].

        not_corrected: a reason not to correct it that does not depend on its numbers; frames: its
        base and tool where no motion goes there, None if they are not known.
        """
        self.taken.add(start)
        literal = self._literal(start, end, name, frames)
        if not_corrected and not literal.bad and not literal.not_corrected:
            literal = replace(literal, not_corrected=not_corrected, alone=None)
        self.literals.append(literal)
        return len(self.literals) - 1

    def others(self) -> None:
        """Note positions in code that is not followed: structures, unknown routines."""
        for group in _GROUP.finditer(self.code):
            start = group.start()
            if start in self.taken or _MEMBER.search(self.code, max(0, start - 20), start):
                continue
            if self.complete(start, group.end()):
                why = "stands in something that is not followed"
                kind = POSE if "X" in self.items(start, group.end()) else JOINT
                self.literals.append(self._skipped(kind, start, "{…}", why))

    def _skipped(self, kind: str, start: int, name: str, why: str, bad: bool = False) -> Literal:
        return Literal(
            kind, (), self.lines(start), name, source=self.number, not_corrected=why, bad=bad
        )

    def _literal(
        self, start: int, end: int, name: str, frames: tuple[Value, Value] | None
    ) -> Literal:
        spans, robot = self.items(start, end), self.robot
        joint = any(key in spans for key in _JOINTS)
        kind = JOINT if joint else POSE
        unknown = [key for key in spans if key not in _KNOWN]
        if unknown:
            why = f"'{unknown[0][:30]}' is not known in a position"
            return self._skipped(kind, start, name, why, bad=True)
        if joint and any(key in spans for key in (*_POSE, "S", "T")):
            return self._skipped(kind, start, name, "axes and a pose in one position", bad=True)
        keys = _JOINTS if joint else _POSE
        missing = [key for key in keys if key not in spans]
        count = len(robot.arm)
        if missing and not (joint and tuple(missing) == _JOINTS[count:]):
            why = f"a position without {', '.join(missing)}: the rest is where the robot stands"
            return self._skipped(kind, start, name, why)
        if joint and 6 - len(missing) != count:
            why = f"holds {6 - len(missing)} axes, but {robot.name} has {count} joints"
            return self._skipped(kind, start, name, why, bad=True)
        keys = keys[:count] if joint else keys
        units = arm_units(robot) if joint else _UNITS
        numbers: list[Number] = []
        for key, unit in zip(keys, units, strict=True):
            number = number_at(self.text, *spans[key], unit)
            if number is None:
                return self._no_number(kind, start, name, key, spans[key])
            numbers.append(number)
        place = self.lines(start)
        blank = not any(number.value for number in numbers)
        number_here = len(self.literals)
        beside = {
            k: number_at(self.text, *spans[key], unit_of(robot, k))
            for k, key in enumerate(_EXTERNAL)
            if key in spans
        }
        if joint and blank:
            return self._skipped(kind, start, name, "a mastering position: all joints are zero")
        if joint:
            found = joints(robot, numbers, beside)
            if isinstance(found, str):
                return self._skipped(kind, start, name, found)
            numbers = list(found)
            alone = Aim(number_here) if frames is not None else None
            return Literal(JOINT, tuple(numbers), place, name, source=self.number, alone=alone)
        digits = {key: self._integer(*spans[key]) for key in ("S", "T") if key in spans}
        if None in digits.values():
            return self._skipped(kind, start, name, "S or T is not an integer", bad=True)
        status, turn = digits.get("S"), digits.get("T")
        external, not_corrected = beside_pose(robot, beside)
        return Literal(
            POSE,
            tuple(numbers),
            place,
            name,
            TURNED_ANGLES,
            Kuka(None if status is None else status.value, turn) if digits else None,
            self.number,
            not_corrected,
            blank=blank,
            alone=None if frames is None else Aim(number_here, *frames, obeyed=_MAYBE),
            external=external,
        )

    def _no_number(
        self, kind: str, start: int, name: str, key: str, span: tuple[int, int]
    ) -> Literal:
        word = self.text[slice(*span)].strip()
        large = number_at(self.text, *span, "") is None and re.fullmatch(r"[-+\d.eE]+", word)
        if is_not_finite(word) or (large and _too_large(word)):
            why = f"{key} is '{word[:30]}'; expected a number"
            return self._skipped(kind, start, name, why, bad=True)
        why = f"a variable or an expression ({key} is '{word[:30]}')"
        return self._skipped(kind, start, name, why)

    def _integer(self, start: int, end: int) -> Digit | None:
        first, last = trimmed(self.text, start, end)
        match = _INTEGER.fullmatch(self.text, first, last)
        if match is None:
            return None
        value = int(match[1]) if match[1] else int(match[2], 2) if match[2] else int(match[3], 16)
        return Digit(first, last, value)


def _too_large(word: str) -> bool:
    try:
        return abs(float(word)) >= LARGEST
    except ValueError:
        return False
