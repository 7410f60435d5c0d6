"""Positions, tools and variables of a URScript text as values of motions."""

import re
from collections.abc import Container, Sequence

from calibtool.programs.bracketed_lists import closing, split, trimmed
from calibtool.programs.frames import pose
from calibtool.programs.motions import (
    JOINT,
    POSE,
    TOOL,
    Either,
    Literal,
    Product,
    ProgramText,
    Unknown,
    Value,
    frame_of,
)
from calibtool.programs.numbers import (
    LineNumbers,
    Number,
    comments_blanked,
    is_not_finite,
    number_at,
)
from calibtool.programs.ur_names import Function, Names
from calibtool.programs.urscript import CALL, MOTION_CALL, MOVED_TO, constant
from calibtool.robot.orientation import ROTATION_VECTOR
from calibtool.robot.robot import Robot
from calibtool.units import LARGEST

_RELATIVE = ("pose_trans", "pose_add", "pose_sub", "interpolate_pose")
_READ = re.compile(r"get_(?:actual|target)_\w+|get_forward_kin")
_SHAPE = re.compile(r"\bp\[(?=[^\[\],]*(?:,[^\[\],]*){5,}\])")
_UNITS = ("m", "m", "m", "rad", "rad", "rad")
_LOOK_BACK = 300  # characters in which the function is looked for that a pose is given to
_LAST_CALL = re.compile(r"(\w+)\s*\(([^()]*)\Z")
_DEGREES = re.compile(r"d2r\s*\(\s*([^()]*?)\s*\)")


class Positions:
    """A text and the positions found in it.

    number    of the text
    literals  of the whole program
    function  around the statement that is read
    """

    def __init__(
        self, number: int, source: ProgramText, robot: Robot, names: Names, literals: list[Literal]
    ) -> None:
        self.number, self.text, self.robot = number, source.text, robot
        self.names, self.literals = names, literals
        self.code = comments_blanked(source.text, r"#[^\r\n]*", r'"[^"\n]*"|\'[^\'\n]*\'')
        self.lines = LineNumbers(source.text)
        self.function = Function("", "", 0, ())
        self._taken: set[int] = set()  # where literals begin

    def tool(self, start: int, end: int) -> Value:
        """A tool from a pose, or from a variable that holds one."""
        if self.code[start:end].startswith("p["):
            self._taken.add(start)
            numbers = self._numbers(start + 1, end, _UNITS)
            if isinstance(numbers, str):
                return Unknown(f"an expression ({numbers[:30]})")
            T = pose([number.value for number in numbers], ROTATION_VECTOR)
            return frame_of(TOOL, None, T, self.lines(start))
        value = self.value(start, end, "tool")
        return value if isinstance(value, Unknown) else Product(TOOL, (value,))

    def key(self, name: str) -> str:
        """The variable of a name here: a parameter of the function, or a variable of the script."""
        if name in self.function.parameters:
            return f"{self.function.key}|{name}"
        return self.names.variable(self.number, name)

    def value(self, start: int, end: int, name: str, in_motion: bool = False) -> Value:
        """The value of an expression: a position, a variable, or unknown. in_motion: of
        a motion instruction."""
        word, line = self.code[start:end], self.lines(start)
        opening = re.match(r"p?(?=\[)", word)
        if opening and closing(self.code, start + opening.end()) == end - 1:
            if in_motion or opening[0] or self._is_joints(start, end):
                return self._literal(start, end, name, in_motion)
            return Unknown(f"is no position (line {line})")
        variable = re.fullmatch(r"([A-Za-z_]\w*)\s*(?:\[([^\[\]]*)\])?", word)
        function = re.match(r"(\w+)\s*\(", word)
        if variable and variable[1] not in ("True", "False"):
            key = self.key(variable[1])
            if variable[2] is None:
                return key
            elements = self.names.elements.get(key, [])
            if variable[2].strip().isdecimal():
                return f"{key}[{int(variable[2])}]"
            return Either(tuple(elements)) if elements else Unknown(f"an expression ({word[:40]})")
        if function and (function[1] in _RELATIVE or _READ.match(function[1])):
            return Unknown(f"a relative motion ({function[1]})")
        if in_motion:
            return Unknown(f"an expression ({self.text[start:end][:40]})")
        return Unknown(f"is computed (line {line})")

    def _is_joints(self, start: int, end: int) -> bool:
        """Whether a list is one of as many numbers as the robot has joints."""
        return not isinstance(self._numbers(start, end, self.robot.joint_units), str)

    def _literal(self, start: int, end: int, name: str, in_motion: bool) -> int:
        kind = POSE if self.code[start] == "p" else JOINT
        units = _UNITS if kind == POSE else self.robot.joint_units
        opening = start + 1 if kind == POSE else start
        self._taken.add(start)
        read = self._numbers(opening, end, units)
        not_corrected, bad = "", False
        if isinstance(read, str):
            count = len(elements_of(self.code, opening, end))
            not_corrected = f"an expression ({read[:30]})"
            if count != len(units):
                which = "6" if kind == POSE else f"{self.robot.n} ({self.robot.name})"
                not_corrected, bad = f"holds {count} values; expected {which}", in_motion
            elif is_not_finite(read):
                not_corrected, bad = f"'{read}'; expected a number", True
        numbers = () if isinstance(read, str) else tuple(read)
        line = self.lines(start)
        turn = ROTATION_VECTOR if kind == POSE else ""
        found = Literal(
            kind,
            numbers,
            line,
            name,
            turn,
            source=self.number,
            not_corrected=not_corrected,
            bad=bad,
        )
        self.literals.append(found)
        return len(self.literals) - 1

    def _numbers(self, start: int, end: int, units: Sequence[str]) -> list[Number] | str:
        """The numbers of a list in brackets, or the element that is no number."""
        parts = elements_of(self.code, start, end)
        if len(parts) != len(units):
            return f"{len(parts)} values"
        found = []
        for (first, last), unit in zip(parts, units, strict=True):
            number = number_at(self.text, first, last, unit)
            degrees = _DEGREES.fullmatch(self.code, first, last) if unit == "rad" else None
            if number is None and degrees:
                number = number_at(self.text, *degrees.span(1), "deg")
            if number is None:
                word = self.text[first:last]
                value = constant(word)
                if value is None or abs(value) >= LARGEST:
                    return word
                number = Number(first, last, unit, value)
            found.append(number)
        return found

    def others(self) -> None:
        """Poses outside of the assignments and motions that are known."""
        aims = {found[1] for found in MOVED_TO.finditer(self.code)}
        for found in _SHAPE.finditer(self.code):
            if found.start() not in self._taken:
                before = self.code[max(0, found.start() - _LOOK_BACK) : found.start()]
                before = re.split(r"[\r\n]", before)[-1]
                name = next(reversed(CALL.findall(before)), "")
                where = f"an argument of {name}" if name else "an expression"
                self.literals.append(
                    Literal(
                        POSE,
                        (),
                        self.lines(found.start()),
                        name,
                        source=self.number,
                        not_corrected=f"{where}, which is no motion that is known",
                        moved_to=_is_place(before, aims),
                    )
                )


def _is_place(before: str, aims: Container[str]) -> bool:
    """Whether a motion goes to a pose, and does not use it as an offset.

    before: the line up to it; aims: words in motions. An offset is added to a pose that is read,
    written or the target of a motion. In any other variable, a feature, the pose is a place.
    """
    call = _LAST_CALL.search(before)
    assigned = re.match(r"\s*(?:global\s+|local\s+)?(\w+)\s*=(?!=)", before)
    moves = MOTION_CALL.search(before) or (assigned and assigned[1] in aims)
    if call is None or not moves or call[1] not in (*_RELATIVE, "get_inverse_kin"):
        return False
    first = call[2].strip().rstrip(",").strip()
    return not first or (re.fullmatch(r"[A-Za-z_]\w*", first) is not None and first not in aims)


def elements_of(code: str, start: int, end: int) -> list[tuple[int, int]]:
    """The elements of a list in brackets, without blanks."""
    spans = [trimmed(code, *span) for span in split(code, start + 1, end - 1)]
    return [(first, last) for first, last in spans if first < last]
