"""Motions of RAPID's instructions: their positions, tool and work object."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from calibtool.programs.motions import (
    BASE,
    FRAME,
    OFF,
    ON,
    Aim,
    Assign,
    Move,
    Product,
    Statement,
    Unknown,
    Value,
)
from calibtool.programs.rapid import Argument, arguments
from calibtool.programs.rapid_data import SHAPES
from calibtool.programs.rapid_values import Values

DISPLACEMENT, CONFJ, CONFL = "displacement", "confj", "confl"  # what instructions switch
_FAMILIES = "Move|Trigg|Search|Arc|Paint|Spot|Disp|Cap"
MOTION = re.compile(
    rf"(?:{_FAMILIES})(?P<way>AbsJ|[JLC])(?![a-z])(?i:\w*)|(?i:(?:{_FAMILIES})(?:AbsJ|[JLC]))"
)
_TOOL_AFTER = {"move": 3, "search": 2}  # arguments from the last point to the tool
_ZONE = re.compile(r"fine|z\d+", re.IGNORECASE)
_SPEED = re.compile(r"v\d+|vmax", re.IGNORECASE)
_FUNCTION = re.compile(r"(\w+)\s*+(?=\()")
_SOLVED = "calcjointt"  # joints of a position, with a tool and a work object of its own
_POSITIONS = ("offs", "reltool", "crobt", "cjointt", _SOLVED)  # functions that give a position
_RELATIVE = "a relative motion; the point it starts from is treated by itself"


def motion(values: Values, name: str, given: Sequence[Argument], line: int) -> Iterator[Statement]:
    """The motion of an instruction, known or not, if one of its arguments is a position."""
    yield from _Instruction(values, name, given, line).steps()


def is_motion(values: Values, name: str, given: Sequence[Argument]) -> bool:
    """Whether an instruction moves the robot, by its name or its arguments. It then does not change
    them.
    """
    return MOTION.fullmatch(name) is not None or _Instruction(values, name, given, 0).paced()


class _Instruction:
    def __init__(self, values: Values, name: str, given: Sequence[Argument], line: int) -> None:
        self.values, self.name, self.given, self.line = values, name, given, line
        self.plain = [k for k, argument in enumerate(given) if not argument.option]
        self.known = MOTION.fullmatch(name)

    def word(self, number: int) -> str:
        return self.values.code[self.given[number].start : self.given[number].end]

    def steps(self) -> Iterator[Statement]:
        name, known, plain = self.name, self.known, self.plain
        circle = known is not None and (known["way"] or name[-1]).upper() == "C"
        count = 2 if circle else 1
        aimed = [k for k in plain if self._is_position(k)]
        search = name.lower().startswith("search")
        if search and len(aimed) > count:  # the position that is found comes first
            for k in aimed[:-count]:
                found = self.values.reference(self.word(k), "robtarget")
                if isinstance(found, str):
                    why = Unknown(f"is found by {name} (line {self.line})")
                    yield Assign(self.line, found, why)
            aimed = aimed[-count:]
        elif known and not search and len(aimed) < count:
            aimed = plain[:count]
        if not aimed or (known and len(plain) < 2):
            return
        tool, frame = self._tool(aimed[-1]), self._frame()
        joint = re.search(r"J(?![a-z])", name) is not None or name.lower().endswith("j")
        switched = CONFJ in self.values.declared
        obeyed: Value = (CONFJ if joint else CONFL) if switched else ON
        aims = []
        for number, k in enumerate(aimed):
            via = circle and number == 0  # its configuration is not looked at
            aim = replace(self._aim(k), frame=frame, tool=tool, obeyed=OFF if via else obeyed)
            aims.append(self._solved(k) or aim)
        yield Move(self.line, name, tuple(aims))

    def _is_position(self, number: int) -> bool:
        """Whether an argument can only be a position: a list of lists, a function, or
        data of these types.
        """
        word, argument = self.word(number), self.given[number]
        if word.startswith("["):
            if self.values.text.shape(argument.start, argument.end) is not None:
                return True
            parts = self.values.parts(argument.start, argument.end)
            lists = [self.values.code[first] == "[" for first, _ in parts]
            if len(lists) == 4 and sum(lists) >= 2:
                return True
            pose = self.values.text.pose(argument.start, argument.end)
            return bool(lists) and lists[0] and pose is None
        function = _FUNCTION.match(word)
        if function:
            return function[1].lower() in _POSITIONS
        data = self.values.data(word)
        return data is not None and data.type in SHAPES

    def _aim(self, number: int) -> Aim:
        start, end = self.given[number].start, self.given[number].end
        word = self.word(number)
        if word.startswith("["):
            axes = re.search("AbsJ", self.name, re.IGNORECASE)
            type_ = self.values.text.shape(start, end) or ("jointtarget" if axes else "robtarget")
            return Aim(self.values.text.position(type_, start, end, f"{self.name} […]"))
        function = _FUNCTION.match(word)
        if function and function[1].lower() in _POSITIONS[:2]:
            inner = arguments(self.values.code, start + function.end() + 1, end - 1)
            first = self.values.code[inner[0].start : inner[0].end] if inner else ""
            value = self.values.reference(first, "robtarget")
            if value is not None:
                return Aim(value, relative=_RELATIVE)
            return Aim(Unknown(f"a relative motion from an expression ({first[:30]})"))
        data = self.values.data(word)
        value = self.values.reference(word, data.type) if data and data.type in SHAPES else None
        if value is not None:
            return Aim(value)
        if re.fullmatch(r"\w+", word):
            return Aim(Unknown(f"'{word}' is a variable that no file gives a position"))
        return Aim(Unknown(f"an expression ({word[:40]})"))

    def _solved(self, number: int) -> Aim | None:
        """The position whose joints CalcJointT gives, if this argument is such a call."""
        start, end = self.given[number].start, self.given[number].end
        function = _FUNCTION.match(self.word(number))
        if function is None or function[1].lower() != _SOLVED:
            return None
        inner = arguments(self.values.code, start + function.end() + 1, end - 1)
        call = _Instruction(self.values, function[1], inner, self.line)
        if len(call.plain) < 2:
            return None
        position, tool = call.plain[:2]
        frame = call._frame()
        return replace(
            call._aim(position), frame=frame, tool=self.values.named(call.word(tool), "tooldata")
        )

    def _tool(self, last: int) -> Value:
        """The tool: data of this type after the last point, before WObj, or at its usual place."""
        option = next((a for a in self.given if a.option == "tool"), None)
        if option is not None:
            return self.values.named(self.values.code[option.start : option.end], "tooldata")
        later = [k for k in self.plain if k > last]
        work_object = next((a for a in self.given if a.option == "wobj"), None)
        family = re.match(r"Move|Search", self.name, re.IGNORECASE) if self.known else None
        place = next(
            (k for k in later if self.values.reference(self.word(k), "tooldata") is not None), None
        )
        if place is None and work_object is not None and work_object.after > last:
            place = work_object.after
        if place is None and family:
            place = next(iter(later[_TOOL_AFTER[family[0].lower()] - 1 :]), None)
        if place is None and not family:
            zone = next((k for k in later if self._is_zone(k)), None)
            behind = [k for k in later if zone is not None and k > zone]
            place = next(iter(behind or (later[-1:] if self.known else [])), None)
        if place is None:
            return Unknown(f"{self.name} is no instruction whose tool is known")
        return self.values.named(self.word(place), "tooldata")

    def _frame(self) -> Value:
        option = next((a for a in self.given if a.option == "wobj"), None)
        frame: Value = BASE
        if option is not None:
            frame = self.values.named(self.values.code[option.start : option.end], "wobjdata")
        if DISPLACEMENT in self.values.declared:
            frame = Product(FRAME, (frame, DISPLACEMENT))
        return frame

    def paced(self) -> bool:
        """Whether a speed, a zone, or a work object by its option is among the arguments."""
        work_object = any(argument.option == "wobj" for argument in self.given)
        words = ((k, self.word(k)) for k in self.plain)
        return work_object or any(self._is_zone(k) or _SPEED.fullmatch(word) for k, word in words)

    def _is_zone(self, number: int) -> bool:
        word = self.word(number)
        data = self.values.data(word)
        return _ZONE.fullmatch(word) is not None or (data is not None and data.type == "zonedata")
