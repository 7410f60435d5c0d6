"""ABB programs (RAPID): the data of a task's modules and the motions of their routines."""

import re
from collections.abc import Iterator, Sequence

from calibtool.programs.bracketed_lists import trimmed
from calibtool.programs.motions import (
    BASE,
    FLANGE,
    FRAME,
    OFF,
    ON,
    Assign,
    Begin,
    Call,
    Either,
    Else,
    End,
    Jump,
    Label,
    Literal,
    Program,
    ProgramText,
    Return,
    Routine,
    Unknown,
    Value,
    frame_of,
)
from calibtool.programs.motions import Statement as Step
from calibtool.programs.numbers import LineNumbers, Remark, comments_blanked
from calibtool.programs.rapid import Argument, Statement, arguments
from calibtool.programs.rapid_changes import HANDLER, TYPES, Changes, by_name
from calibtool.programs.rapid_data import Text
from calibtool.programs.rapid_motions import (
    CONFJ,
    CONFL,
    DISPLACEMENT,
    MOTION,
    is_motion,
    motion,
)
from calibtool.programs.rapid_names import Data, Names, Procedure, placed
from calibtool.programs.rapid_values import Values
from calibtool.robot.robot import Robot

NAME = "abb-rapid"
SUFFIXES = (".mod", ".modx", ".prg", ".sys", ".sysx")
_START = re.compile(
    r"^[^\S\n]*(?:MODULE\s+\w+|%%%)|\b(?:robtarget|jointtarget)\s+\w+\s*:="
    r"|\bMove(?:AbsJ|[JLC])\w*\s*+\[\s*+\[",
    re.MULTILINE | re.IGNORECASE,
)
_ENDS = ("endproc", "endfunc", "endtrap", "endmodule")
_PREDEFINED = ("tool0", "wobj0")


def matches(text: str) -> bool:
    """Whether this is a RAPID module."""
    return _START.search(text) is not None


def program(sources: Sequence[ProgramText], robot: Robot) -> Program:
    """The positions and motions of modules of one task."""
    literals: list[Literal] = []
    names = Names()
    texts = []
    for number, source in enumerate(sources):
        code = comments_blanked(source.text, r"![^\r\n]*")
        text = Text(number, source.text, code, LineNumbers(source.text), robot, literals)
        names.read(text)
        texts.append(text)
    declared: dict[str, Value] = {"tool0": FLANGE, "wobj0.u": BASE, "wobj0.o": BASE}
    if any(re.search(r"\bPDisp(?:On|Set)\b", text.code, re.IGNORECASE) for text in texts):
        declared[DISPLACEMENT] = BASE
    if any(re.search(r"\bConf[JL]\s*\\Off", text.code, re.IGNORECASE) for text in texts):
        declared |= {CONFJ: ON, CONFL: ON}
    changes = Changes(names)
    modules = [_Module(Values(text, names, declared), changes) for text in texts]
    places: dict[str, tuple[int, int]] = {}
    for module in modules:
        module.declare(places, sources)
    routines = [routine for module in modules for routine in module.routines()]
    for text in texts:
        literals += text.others()
    return Program(
        tuple(sources),
        tuple(literals),
        changes.settled(routines, declared),
        declared,
        tuple(remark for module in modules for remark in module.values.remarks),
        persistent=True,
        unused="no instruction of the program moves there: its tool and work object are not known",
    )


class _Module:
    """The text of a module, or of several: declarations and routines."""

    def __init__(self, values: Values, changes: Changes) -> None:
        self.changes = changes
        self.values, self.names, self.code = values, values.names, values.code

    # --- data ----------------------------------------------------------------------------------

    def declare(self, places: dict[str, tuple[int, int]], sources: Sequence[ProgramText]) -> None:
        """The values of data when the program begins. places: text and line of declarations."""
        values, declared = self.values, self.values.declared
        for statement, scopes in placed(self.code, values.text.number):
            values.scopes = scopes
            if statement.word != "data" or len(values.scopes) != 1:
                continue
            here = values.text.number, values.text.lines(statement.position)
            for key, value in self._data(statement):
                if key.split(".")[0] in _PREDEFINED:
                    continue
                if key in places and not self._same(declared[key], value):
                    other, line = places[key]
                    if other != here[0]:
                        where = f"{sources[other].name}:{line}"
                        values.bad(statement.position, statement.name, f"differs from {where}")
                    value = Either((declared[key], value))
                places.setdefault(key, here)
                declared[key] = value

    def _same(self, one: Value, other: Value) -> bool:
        literals = self.values.text.literals
        if isinstance(one, int) and isinstance(other, int):
            return literals[one].values == literals[other].values
        return one == other

    def _data(self, statement: Statement) -> Iterator[tuple[str, Value]]:
        """Variables and what a declaration gives them."""
        values = self.values
        data = self.names.data(statement.name, values.scopes)
        if data is None or data.type != statement.more[2]:
            return
        start, end = trimmed(self.code, statement.start, statement.end)
        if start == end or not values.closed(start, statement.name):
            return
        if not statement.ended:
            values.bad(statement.position, statement.name, "no ; at its end")
            return
        for index, first, last in values.elements(data, start, end):
            if index:
                self.names.elements.setdefault(data.key, []).append(data.key + index)
            yield from values.held(data, data.key + index, first, last, statement.name + index)

    # --- routines ------------------------------------------------------------------------------

    def routines(self) -> Iterator[Routine]:
        """The routines of the text; statements outside of routines form one of their own."""
        number = self.values.text.number
        outside: list[Step] = []
        steps, name = outside, ""
        cases: list[bool] = []  # of open TEST: whether a CASE was seen
        for statement, scopes in placed(self.code, number):
            self.values.scopes = scopes
            if statement.word in ("routine", *_ENDS):
                if name:
                    yield Routine(name, tuple(steps), number)
                steps, name, cases = outside, "", []
                if statement.word == "routine":
                    steps, name = [], scopes[0]
            elif statement.word == "data":
                line = self.values.text.lines(statement.position)
                if name:
                    steps += [Assign(line, key, value) for key, value in self._data(statement)]
            else:
                steps += self._steps(statement, cases)
        if name:
            yield Routine(name, tuple(steps), number)
        yield Routine(f"{number}|", tuple(outside), number)

    def _steps(self, statement: Statement, cases: list[bool]) -> Iterator[Step]:
        word = statement.word
        effects = list(self.changes.functions(self.values, statement.start, statement.end))
        yield from effects
        if word in ("if", "for", "while", "test"):
            yield Begin(loop=word in ("for", "while"))
            yield from effects if word == "while" else ()
            if word == "test":
                cases.append(False)
        elif word in ("elseif", "else"):
            yield Else(last=word == "else")
            yield from effects
        elif word in ("case", "default"):
            if cases and not cases[-1]:
                cases[-1] = True
            else:
                yield Else(last=word == "default")
        elif word in ("endif", "endfor", "endwhile", "endtest"):
            if word == "endtest" and cases:
                cases.pop()
            yield End()
        elif word == "label":
            yield Label(statement.name.lower())
        elif word in ("error", "undo", "backward"):
            yield Return()
            yield HANDLER
        elif word == "assign":
            yield from self._assignment(statement)
        elif word == "instruction":
            yield from self._instruction(statement)

    def _assignment(self, statement: Statement) -> Iterator[Step]:
        values = self.values
        data = self.names.data(statement.name, values.scopes)
        if data is None or data.type not in TYPES:
            return
        start, end = trimmed(self.code, statement.start, statement.end)
        line = values.text.lines(statement.position)
        index, parts = statement.more
        name = statement.name + index
        if start == end or not values.closed(start, statement.name):
            return
        if data.dimensions and not index:
            for place, first, last in values.elements(data, start, end):
                held = values.held(data, data.key + place, first, last, name + place, line)
                yield from (Assign(line, key, value) for key, value in held)
            return
        target = values.reference(name, data.type)
        elements = target.parts if isinstance(target, Either) else (target,)
        keys = [key for key in elements if isinstance(key, str)]
        if parts:
            new = [p for key in keys for p in values.component(data, key, parts, start, end, line)]
        else:
            given = list(values.held(data, "", start, end, name, line))
            new = [(key + part, value) for key in keys for part, value in given]
        for key, value in new:
            several = isinstance(target, Either)  # any of them, and the others stay
            yield Assign(line, key, Either((key, value)) if several else value)

    # --- instructions --------------------------------------------------------------------------

    def _instruction(self, statement: Statement) -> Iterator[Step]:
        values, name, low = self.values, statement.name, statement.name.lower()
        line = values.text.lines(statement.position)
        rest = self.code[statement.start : statement.end]
        if not statement.ended:
            if MOTION.fullmatch(name):
                number = values.text.number
                values.remarks.append(Remark(line, name, "no ; at its end", source=number))
        elif low == "goto":
            yield Jump(rest.strip().lower())
        elif low in ("return", "exit", "raise", "retry", "trynext", "exitcycle"):
            yield Return()
        elif low in ("confj", "confl"):
            if low in values.declared:
                yield Assign(line, low, OFF if "off" in rest.lower() else ON)
        elif low == "%":
            yield from self._late(statement)
        elif low in ("callbyvar", "setdataval", "setalldataval"):
            text = values.text.text[statement.start : statement.end].partition(",")[0]
            if low == "callbyvar":
                self.changes.called_late(text, True)
            else:
                text = text if low == "setdataval" else ""
                yield from by_name(values, text, line, f"{name} may change it (line {line})")
        elif low == "pdispoff":
            yield Assign(line, DISPLACEMENT, BASE)
        elif low in ("pdispon", "pdispset"):
            span = trimmed(self.code, statement.start, statement.end)
            T = values.text.pose(*span) if low == "pdispset" else None
            why = Unknown(f"a program displacement (line {line}) moves it")
            yield Assign(line, DISPLACEMENT, why if T is None else frame_of(FRAME, None, T, line))
        else:
            given = arguments(self.code, statement.start, statement.end)
            if not all(values.closed(argument.start, name) for argument in given):
                return
            procedure = self.names.routine(name, values.scopes[-1])
            if procedure is not None:
                yield self._call(procedure, given, line)
                yield from self.changes.arguments(values, name, given, line)
                return
            yield from self._changed(name, given, line)
            if low != "moveextj":  # no joint of the arm moves
                yield from motion(values, name, given, line)

    def _late(self, statement: Statement) -> Iterator[Step]:
        """A call whose routine is an expression. It may change all of its arguments."""
        end = self.code.find("%", statement.start, statement.end)
        if end >= 0:
            self.changes.called_late(self.values.text.text[statement.start : end], False)
            given = arguments(self.code, end + 1, statement.end)
            line = self.values.text.lines(statement.position)
            yield from self.changes.arguments(self.values, "%…%", given, line)

    def _changed(self, name: str, given: Sequence[Argument], line: int) -> Iterator[Step]:
        """The arguments that a controller's instruction may change: those it may not only read."""
        values = self.values
        if not is_motion(values, name, given):
            yield from self.changes.arguments(values, name, given, line)

    def _call(self, procedure: Procedure, given: Sequence[Argument], line: int) -> Call:
        """A call of a routine of the program, with the values of its parameters."""
        passed: list[tuple[str, Value]] = []
        for data, argument in procedure.matched(given):
            if data.type not in TYPES:
                continue
            if argument is None:
                passed += _not_given(data)
                continue
            start, end = argument.start, argument.end
            passed += self.values.held(data, data.key, start, end, self.code[start:end][:40], line)
        return Call(line, procedure.key, tuple(passed))


def _not_given(data: Data) -> list[tuple[str, Value]]:
    if data.type == "tooldata":
        return [(data.key, FLANGE)]
    if data.type == "wobjdata":
        return [(f"{data.key}.u", BASE), (f"{data.key}.o", BASE)]
    return [(data.key, Unknown("an argument that is not given"))]
