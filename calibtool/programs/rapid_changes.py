"""RAPID data that may change without an assignment that can be followed."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from calibtool.programs.bracketed_lists import closing
from calibtool.programs.motions import (
    Assign,
    Call,
    Edited,
    Either,
    Label,
    Routine,
    Statement,
    Unknown,
    Value,
)
from calibtool.programs.rapid import Argument, arguments
from calibtool.programs.rapid_data import SHAPES
from calibtool.programs.rapid_names import Data, Names
from calibtool.programs.rapid_values import Values
from calibtool.robot.orientation import QUATERNION

HANDLER = Label("ERROR")  # begins what a routine does on errors; labels of the text are lower case
FRAMES = {"tooldata": ("",), "wobjdata": (".u", ".o")}  # the variables of a tool, a work object
TYPES = (*SHAPES, *FRAMES)
_REFERENCE = re.compile(r"(\w+\s*+(?:\{[^{}]*\})?)\s*+((?:\.\s*+\w+\s*+(?:\{[^{}]*\}\s*+)?)*+)")
# Instructions and functions whose arguments only give values; those of motions do so too.
_READING = re.compile(
    r"and|or|xor|not|div|mod|abs|acos|asin|atan2?|calcjointt|calcrobt|confl|confj|connect"
    r"|corrwrite|cos|cpos|defaccframe"
    r"|defdframe|defframe|dist\w*|dot\w*|eoffs\w*|errlog|errwrite|euler\w*|gripload|ipers|isvalid"
    r"|argname|calcrotax\w+|cjointt|crobt|ctool|cwobj|dim|dnumtostr|egm\w+|exp|is\w+|max|min|pow"
    r"|present|setsysdata|strlen"
    r"|mirpos|moveextj|numtostr|offs|orientzyx|orobt|packrawbytes|pdisp\w*|pose(?:inv|mult|vect)"
    r"|reltool|round|set[adg]o|sin|singarea|socketsend|sqrt|tan|tp(?:write|erase|show)|trunc"
    r"|type|valtostr|vectmagn|wait\w*|write\w*|wz\w+def",
    re.IGNORECASE,
)
_CALL = re.compile(r"\b(\w+)\s*+(?=\()")
_NAME = re.compile(r'"(\w+)"')


def reading(name: str) -> bool:
    """Whether an instruction or function is known not to change its arguments."""
    return _READING.fullmatch(name) is not None


def variables(values: Values, word: str) -> list[tuple[str, ...]]:
    """The changeable variables of the target, tool or work object of a word or component."""
    match = _REFERENCE.fullmatch(word)
    data = values.data(match[1].strip()) if match else None
    if match is None or data is None or data.type not in TYPES or data.constant:
        return []
    parts = re.sub(r"\s", "", match[2]).lower()
    if data.type == "tooldata" and parts.startswith(".tload"):
        return []  # its mass does not move it
    keys = [data.key]
    if data.dimensions:
        index = re.search(r"\{([\d,\s]+)\}", match[1])
        every = values.names.elements.get(data.key, [])
        keys = [data.key + re.sub(r"\s", "", index[0])] if index else every
    return [tuple(key + part for part in FRAMES.get(data.type, ("",))) for key in keys]


def changed(values: Values, word: str, line: int, why: str) -> Iterator[Assign]:
    """The values of a word's data after something else has changed them."""
    for keys in variables(values, word):
        for key in keys:
            yield Assign(line, key, Edited(key, (), QUATERNION, line, why))


@dataclass(eq=False)
class Changes:
    """Changes of data by the routines of all modules.

    passed      assignments of arguments given by reference, with the parameter's variable
    unfollowed  routines that no followed call executes
    late        names of routines called by a text, and whether the text is only the beginning
    """

    names: Names
    passed: list[tuple[Assign, str]] = field(default_factory=list)
    late: list[tuple[str, bool]] = field(default_factory=list)

    def settled(
        self, routines: Sequence[Routine], declared: dict[str, Value]
    ) -> tuple[Routine, ...]:
        """The routines without assignments of unchanged parameters; uncertain data are unknown."""
        pending = {id(step): parameter for step, parameter in self.passed}
        assigned = {
            step.name
            for routine in routines
            for step in routine.body
            if isinstance(step, Assign) and id(step) not in pending
        }
        waiting = list(self.passed)
        while active := [one for one in waiting if one[1] in assigned]:
            assigned |= {step.name for step, _ in active}
            waiting = [one for one in waiting if one[1] not in assigned]
        dropped = {id(step) for step, _ in waiting}
        kept = [replace(r, body=tuple(s for s in r.body if id(s) not in dropped)) for r in routines]
        whys = self._uncertain(kept)
        for name, why in whys.items():
            if name in declared:
                declared[name] = self._unsure(name, declared[name], why)
        return tuple(replace(r, body=tuple(self._marked(r.body, whys))) for r in kept)

    def _marked(self, body: Iterable[Statement], whys: dict[str, str]) -> Iterator[Statement]:
        for step in body:
            if isinstance(step, Assign) and step.name in whys:
                value = self._unsure(step.name, step.value, whys[step.name])
                yield replace(step, value=value)
            else:
                yield step

    def _unsure(self, name: str, value: Value, why: str) -> Value:
        """A frame or tool is then unknown; a target is one of the assigned ones, or another."""
        target = name.partition("{")[0] in self.names.targets
        if not target:
            return Unknown(why)
        return value if isinstance(value, Edited) else Either((value, Unknown(why)))

    def _uncertain(self, routines: Sequence[Routine]) -> dict[str, str]:
        """Variables that are assigned in code that no followed call reaches, and why."""
        bodies = {routine.name: routine.body for routine in routines}
        waiting: list[tuple[str, Sequence[Statement]]] = []
        for routine in routines:
            if HANDLER in routine.body:
                handler = routine.body[routine.body.index(HANDLER) :]
                waiting.append((f"{routine.name}'s error handler", handler))
            if routine.name in self.names.unfollowed or self._is_late(routine.name):
                waiting.append((routine.name, routine.body))
        seen: set[str] = set()
        whys: dict[str, str] = {}
        while waiting:
            name, body = waiting.pop()
            if name in seen:
                continue
            seen.add(name)
            for step in body:
                if isinstance(step, Call) and step.routine in bodies:
                    waiting.append((step.routine, bodies[step.routine]))
                elif isinstance(step, Assign) and not step.name.startswith(f"{name}|"):
                    changer = name.rpartition("|")[2]
                    why = f"{changer} changes it, and when is not known (line {step.line})"
                    whys.setdefault(step.name, why)
        return whys

    def _is_late(self, routine: str) -> bool:
        name = routine.rpartition("|")[2]
        if routine not in self.names.procedures:
            return False
        return any(name.startswith(text) if begins else name == text for text, begins in self.late)

    def called_late(self, text: str, begins: bool) -> None:
        """A call whose routine is an expression: a named routine, or any."""
        name = _NAME.fullmatch(text.strip())
        self.late.append((name[1].lower(), begins) if name else ("", True))

    def functions(self, values: Values, start: int, end: int) -> Iterator[Assign]:
        """Changes of arguments by the functions that an expression calls."""
        if values.code.find("(", start, end) < 0:
            return
        for call in _CALL.finditer(values.code, start, end):
            close = closing(values.code, call.end())
            if close is not None:
                given = arguments(values.code, call.end() + 1, close)
                yield from self.arguments(values, call[1], given, values.text.lines(call.start()))

    def arguments(
        self, values: Values, name: str, given: Sequence[Argument], line: int
    ) -> Iterator[Assign]:
        """Changes of arguments by an instruction or function."""
        routine = values.names.routine(name, values.scopes[-1])
        if routine is not None:
            for data, argument in routine.matched(given):
                if data.reference and argument is not None and data.type in TYPES:
                    word = values.code[argument.start : argument.end]
                    yield from self._by_reference(values, word, data, line)
        elif not reading(name):
            for argument in given:
                word = values.code[argument.start : argument.end]
                yield from changed(values, word, line, f"{name} may change it (line {line})")

    def _by_reference(
        self, values: Values, word: str, parameter: Data, line: int
    ) -> Iterator[Assign]:
        """Assignments of an argument given by reference, valid if the parameter changes."""
        why = f"a routine changes it (line {line})"
        parts = FRAMES.get(parameter.type, ("",))
        for keys in variables(values, word):
            for k, key in enumerate(keys):
                step = Assign(line, key, Edited(key, (), QUATERNION, line, why))
                own = parts[k] if len(keys) == len(parts) else ""
                self.passed.append((step, parameter.key + own))
                yield step


def by_name(values: Values, text: str, line: int, why: str) -> Iterator[Assign]:
    """SetDataVal: the data of this name, or any if it is an expression."""
    name = _NAME.fullmatch(text.strip())
    if name:
        yield from changed(values, name[1], line, why)
        return
    names = values.names
    spaces = (names.everywhere, *names.inside.values())
    for data in [data for space in spaces for data in space.values()]:
        if data.key in ("tool0", "wobj0"):
            continue
        if not data.constant and data.type in TYPES:
            keys = values.names.elements.get(data.key, []) if data.dimensions else [data.key]
            for key in keys:
                for part in FRAMES.get(data.type, ("",)):
                    yield Assign(line, key + part, Edited(key + part, (), QUATERNION, line, why))
