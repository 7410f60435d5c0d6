"""Universal Robots programs (URScript): motions, and variables that hold positions."""

import re
from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np

from calibtool.programs.bracketed_lists import closing
from calibtool.programs.motions import (
    BASE,
    FLANGE,
    POSE,
    TOOL,
    Aim,
    Assign,
    Begin,
    Break,
    Call,
    Edited,
    Either,
    Else,
    End,
    Jump,
    Label,
    Literal,
    Move,
    Product,
    Program,
    ProgramText,
    Return,
    Routine,
    Unknown,
    Value,
    frame_of,
)
from calibtool.programs.motions import Statement as Step
from calibtool.programs.numbers import Remark
from calibtool.programs.ur_names import TCP, Function, Names
from calibtool.programs.ur_positions import Positions, elements_of
from calibtool.programs.urscript import (
    CALL,
    MOTION_CALL,
    MOTIONS,
    Statement,
    arguments,
    statements,
)
from calibtool.robot.orientation import ROTATION_VECTOR
from calibtool.robot.robot import Robot

NAME = "ur-script"
SUFFIXES = (".script", ".urscript")
_THREADS = "threads"  # no displacement of the tool, until a thread is started that sets it
_INVERSE = ("x", "qnear", "maxPositionError", "maxOrientationError", "tcp")  # get_inverse_kin
_IK = re.compile(r"get_inverse_kin\s*(?=\()")
_RUN = re.compile(r"\brun[^\S\n\r]+\Z")  # a thread is started
_NEARBY = 300  # characters in which such a word, or the next motion, is looked for
_LOOPS = ("while", "for")
_BLOCKS = ("if", "switch", *_LOOPS)


def matches(text: str) -> bool:
    """Whether this is a URScript program."""
    return MOTION_CALL.search(text) is not None


def program(sources: Sequence[ProgramText], robot: Robot) -> Program:
    """The positions and motions of scripts that are run together."""
    literals: list[Literal] = []
    routines: list[Routine] = []
    remarks: list[Remark] = []
    notes: tuple[str, ...] = ()
    names = Names()
    scripts = [_Script(k, source, robot, names, literals) for k, source in enumerate(sources)]
    for script in scripts:
        script.declare()
    for script in scripts:
        script.declare_solved()
    names.solved -= names.computed
    for script in scripts:
        routines += script.routines()
        script.others()
        remarks += script.remarks
        if script.without_tool:
            notes = ("no set_tcp above: poses are taken as those of the calibration's tool",)
    return Program(
        tuple(sources),
        tuple(literals),
        tuple(routines),
        {TCP: FLANGE, _THREADS: frame_of(TOOL, None, np.eye(4))},
        tuple(remarks),
        notes,
        unused="no motion that is known goes there",
    )


@lru_cache(maxsize=1000)
def _with_threads(tool: Value) -> Product:
    """A tool that threads may change, too; one object for all motions, to save memory."""
    return Product(TOOL, (tool, _THREADS))


class _Script(Positions):
    """A text, its routines and remarks on it."""

    def __init__(
        self, number: int, source: ProgramText, robot: Robot, names: Names, literals: list[Literal]
    ) -> None:
        super().__init__(number, source, robot, names, literals)
        self.remarks: list[Remark] = []
        self.with_tool = self.without_tool = False

    def declare(self) -> None:
        """Add the names of functions and variables."""
        self.names.texts = max(self.names.texts, self.number + 1)
        around: list[str] = []
        for statement in statements(self.code):
            if statement.word != "def":
                inside = next((name for name in reversed(around) if name), f"{self.number}")
                called = CALL.findall(self.code, statement.start, statement.end)
                self.names.called.setdefault(inside, set()).update(called)
            if statement.word == "def":
                words = re.findall(r"([A-Za-z_]\w*)(?=\s*[,)=])", self._text(statement))
                key, parent = (
                    f"{self.number}|{statement.name}()",
                    next((name for name in reversed(around) if name), f"{self.number}"),
                )
                self.names.functions[self.number, statement.name] = Function(
                    key, parent, statement.position, tuple(words)
                )
                around.append(key)
            elif statement.word in _BLOCKS:
                around.append("")
            elif statement.word == "end" and around:
                around.pop()
            elif statement.word == "assign":
                self.names.variables.add((self.number, statement.name))

    def declare_solved(self) -> None:
        """Add the variables that hold joints by get_inverse_kin."""
        for statement in statements(self.code):
            if statement.word == "assign":
                key = self.names.variable(self.number, statement.name)
                moved_to = self._is_moved_to(statement)
                (self.names.solved if moved_to else self.names.computed).add(key)

    def _text(self, statement: Statement) -> str:
        return self.code[statement.start : statement.end]

    # --- routines ------------------------------------------------------------------------------

    def routines(self) -> Iterator[Routine]:
        """The functions and threads, and the statements outside of them."""
        outside = Function(f"{self.number}", "", 0, ())
        open_: list[tuple[Function, list[Step]]] = [(outside, [])]
        blocks: list[str] = []
        loops: list[str] = []
        first_case = False
        for statement in statements(self.code):
            self.function, steps = open_[-1]
            word = statement.word
            if word == "def":
                blocks.append(word)
                open_.append((self.names.functions[self.number, statement.name], []))
            elif word in _BLOCKS:
                blocks.append(word)
                steps += self._calls(statement)
                first_case = word == "switch"
                if word in _LOOPS:
                    loops.append(f"loop at {statement.position}")
                    steps.append(Label(loops[-1]))
                steps.append(Begin(loop=word in _LOOPS))
            elif word in ("elif", "elseif", "else", "case", "default"):
                if not first_case:
                    steps.append(Else(last=word in ("else", "default")))
                first_case = False
            elif word == "end":
                ended = blocks.pop() if blocks else ""
                if ended == "def":
                    function, steps = open_.pop()
                    yield Routine(function.key, tuple(steps), self.number)
                elif ended:
                    if ended in _LOOPS:
                        loops.pop()
                    steps.append(End())
            elif word in ("break", "continue"):
                steps += [Break()] if word == "break" else [Jump(loops[-1])] if loops else []
            else:
                steps += self._calls(statement)
                if word == "assign":
                    steps += self._assignment(statement)
                elif word in ("return", "halt"):
                    steps.append(Return())
        for function, steps in reversed(open_):
            yield Routine(function.key, tuple(steps), self.number)

    def _calls(self, statement: Statement) -> Iterator[Step]:
        """Motions, tools and calls of functions in a statement, in the order of the text."""
        for call in CALL.finditer(self.code, statement.start, statement.end):
            name, line = call[1], self.lines(call.start())
            known = name in MOTIONS or name == "set_tcp"
            if known and closing(self.code, call.end()) is None:
                self._bad(call.start(), name, "a bracket is not closed")
            elif name in MOTIONS:
                yield Move(line, name, tuple(self._aims(call)))
            elif name == "set_tcp":
                self.with_tool = True
                given = arguments(self.code, call.end())
                yield Assign(line, TCP, self.tool(*given[0][1:]) if given else FLANGE)
            elif function := self.names.function(self.number, name):
                if self.function.key == function.parent and call.start() < function.position:
                    place = self.lines(function.position)
                    self._bad(call.start(), name, f"is called before it exists (line {place})")
                step = self._call(function, call.end(), line)
                if not _RUN.search(self.code, max(0, call.start() - _NEARBY), call.start()):
                    yield step
                    continue
                yield from (Begin(), step, End())  # what it has done by then is not known
                if self.names.sets_tool(self.number, function):
                    why = Unknown(f"thread {name} sets it too, and when is not known (line {line})")
                    yield Assign(line, _THREADS, why)

    def _call(self, function: Function, opening: int, line: int) -> Call:
        given = arguments(self.code, opening)
        named = {word: (start, end) for word, start, end in given if word}
        plain = [(start, end) for word, start, end in given if not word]
        passed: list[tuple[str, Value]] = []
        for parameter in function.parameters:
            span = named.get(parameter) or (plain.pop(0) if plain else None)
            nothing = Unknown("an argument that is not given")
            value = nothing if span is None else self.value(*span, parameter)
            passed.append((f"{function.key}|{parameter}", value))
        return Call(line, function.key, tuple(passed))

    def _assignment(self, statement: Statement) -> Iterator[Step]:
        key, line = self.key(statement.name), self.lines(statement.position)
        start, end, name = statement.start, statement.end, statement.name
        if statement.index:
            why = f"a component of it is assigned (line {line})"
            elements = self.names.elements.get(key)
            if not elements:
                yield Assign(line, key, Edited(key, (), ROTATION_VECTOR, line, why))
            value = self.value(start, end, f"{name}[{statement.index}]")
            for number, element in enumerate(elements or ()):
                if statement.index == f"{number}":
                    yield Assign(line, element, value)
                elif not statement.index.isdecimal():
                    yield Assign(line, element, Either((element, value)))
            return
        if self.code[start : start + 1] == "[" and closing(self.code, start) == end - 1:
            parts = elements_of(self.code, start, end)
            if parts and all(re.match(r"p?\[", self.code[slice(*part)]) for part in parts):
                self.names.elements[key] = [f"{key}[{k}]" for k in range(len(parts))]
                for k, part in enumerate(parts):
                    yield Assign(line, f"{key}[{k}]", self.value(*part, f"{name}[{k}]"))
                return
        if key in self.names.solved:
            start, end, tool, near = self._solved(start, end)
            yield Assign(line, f"{key} tool", tool)
            yield Assign(line, f"{key} near", near or Unknown("where the robot stands"))
        yield Assign(line, key, self.value(start, end, name))

    # --- positions -----------------------------------------------------------------------------

    def _aims(self, call: re.Match[str]) -> Iterator[Aim]:
        name, given = call[1], arguments(self.code, call.end())
        named = {word: (start, end) for word, start, end in given if word}
        plain = [(start, end) for word, start, end in given if not word]
        for parameter in MOTIONS[name]:
            others = ("q", "pose") if len(MOTIONS[name]) == 1 else (parameter,)
            spans = [named[word] for word in others if word in named]
            span = spans[0] if spans else plain.pop(0) if plain else None
            if span is not None:
                yield self._aim(*span, name)

    def _aim(self, start: int, end: int, name: str) -> Aim:
        start, end, tool, near = self._solved(start, end)
        value = self.value(start, end, name, in_motion=True)
        if isinstance(value, str) and value in self.names.solved:
            tool, near = f"{value} tool", f"{value} near"
        if isinstance(value, int) and self.literals[value].kind == POSE:
            self.without_tool |= tool == TCP and not self.with_tool
        return Aim(value, BASE, _with_threads(tool), near=near)

    def _solved(self, start: int, end: int) -> tuple[int, int, Value, Value | None]:
        """The span of the pose, the tool and `near` of get_inverse_kin; of anything else its own
        span, the current tool.
        """
        opening = self._inverse(start, end)
        tool: Value = TCP
        near = None
        if opening is not None:
            given = arguments(self.code, opening)
            names = dict(zip(_INVERSE, [(a, b) for word, a, b in given if not word], strict=False))
            names |= {word: (a, b) for word, a, b in given if word}
            if "tcp" in names:
                tool = self.tool(*names["tcp"])
            if "qnear" in names:
                near = self.value(*names["qnear"], "qnear")
            start, end = names.get("x", (start, start))
        return start, end, tool, near

    def _inverse(self, start: int, end: int) -> int | None:
        """The opening parenthesis of a call of get_inverse_kin that is the whole expression."""
        found = _IK.match(self.code, start, end)
        return found.end() if found and closing(self.code, found.end()) == end - 1 else None

    def _is_moved_to(self, statement: Statement) -> bool:
        """Whether joints solved here start at qnear, or are the target of the next motion, which
        starts where the robot is.
        """
        opening = self._inverse(statement.start, statement.end)
        if opening is None or statement.index:
            return False
        words = [word for word, _, _ in arguments(self.code, opening)]
        if words.count("") > 1 or "qnear" in words:
            return True
        near = statement.end + _NEARBY  # further on it does not matter, and takes long
        following = MOTION_CALL.search(self.code, statement.end, near)
        aims = arguments(self.code, following.end() - 1) if following else []
        return bool(aims) and self.code[slice(*aims[0][1:])] == statement.name

    def _bad(self, position: int, name: str, why: str) -> None:
        self.remarks.append(Remark(self.lines(position), name, why, True, self.number))
