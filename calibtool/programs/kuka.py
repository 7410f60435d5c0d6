"""KUKA programs (KRL, .src and .dat): assignments and motions of their routines."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from calibtool.programs.krl import Declared, Statement, declared, statement_at
from calibtool.programs.krl_asynchronous import Started, uncertain
from calibtool.programs.krl_data import Text
from calibtool.programs.krl_motions import Motions
from calibtool.programs.krl_names import CALLED, Names, Procedure, call_arguments
from calibtool.programs.krl_values import BASE_NOW, MODE_NOW, ON_BASE, TOOL_NOW
from calibtool.programs.motions import (
    FRAME,
    TOOL,
    Assign,
    Begin,
    Break,
    Call,
    Else,
    End,
    Frame,
    Jump,
    Label,
    Literal,
    Program,
    ProgramText,
    Return,
    Routine,
    Value,
)
from calibtool.programs.motions import Statement as Step
from calibtool.programs.numbers import Remark
from calibtool.robot.robot import Robot

NAME = "kuka-krl"
SUFFIXES = (".src", ".dat", ".sub")
_START = re.compile(
    r"^[^\S\n]*(?:&ACCESS\b|(?:GLOBAL\s+)?DEF(?:DAT\s+\w+"
    r"|(?:FCT)?[^\S\r\n][^\r\n(]+\([^\r\n)]*\)[^\S\r\n]*(?:[;\r]|$)))",
    re.MULTILINE | re.IGNORECASE,
)
_UNSAID = {BASE_NOW: Frame(FRAME, None), TOOL_NOW: Frame(TOOL, None), MODE_NOW: ON_BASE}
_OPEN = re.compile(r"(?:BASE|TOOL)_DATA\s*\[\s*[A-Z_$][^\[\]]*\][\s.\w]*=(?!=)", re.IGNORECASE)
# BASE_DATA[1], BASE_NO 1, BAS(#BASE,1)
_NUMBERED = re.compile(r"(BASE|TOOL)(?:_DATA\s*\[|_NO\s|\s*,)\s*(\d+)", re.IGNORECASE)
_CYCLIC = re.compile(r"ANIN\s+ON\s+([^=]*?)\s*=", re.IGNORECASE)
_ASIDE = re.compile(
    r"(?:GLOBAL\s+)?(TRIGGER|ANIN\s+ON|INTERRUPT\s+(?:DECL|ON))\b\s*(\w+)?", re.IGNORECASE
)
_DO = re.compile(r"\bDO\s+(.*?)\s*(?:\bPRIO\s*=.*)?$", re.IGNORECASE | re.MULTILINE)
_LISTED = 5  # number of routines named in a note


def matches(text: str) -> bool:
    """Whether this is a KRL program or data list."""
    return _START.search(text) is not None


def program(sources: Sequence[ProgramText], robot: Robot) -> Program:
    """The positions and motions of programs and data lists of one controller."""
    literals: list[Literal] = []
    texts = [Text(k, source.name, source.text, robot, literals) for k, source in enumerate(sources)]
    names = Names()
    names.read(texts)
    held = any(re.search(r"#TCP\b", text.code, re.IGNORECASE) for text in texts)
    open_tables = any(_OPEN.search(text.code) for text in texts)
    values: dict[str, Value] = dict(_UNSAID)
    readers = [_Reader(text, names, values, held) for text in texts]
    for text in texts:
        for table, index in _NUMBERED.findall(text.code) if open_tables else ():
            readers[0].numbered(f"{table.lower()}_data", index, 0)
    for reader in readers:
        reader.declare()
    routines = [routine for reader in readers for routine in reader.routines()]
    routines = uncertain(routines, [start for reader in readers for start in reader.started])
    for text in texts:
        text.others()
    called = {step.routine for r in routines for step in r.body if isinstance(step, Call)}
    start = tuple(Assign(0, name, value) for name, value in _UNSAID.items())
    missing = sorted({name for reader in readers for name in reader.missing})
    direct = any(
        step.name == BASE_NOW for r in routines for step in r.body if isinstance(step, Assign)
    )
    return Program(
        tuple(sources),
        tuple(literals),
        tuple(r if r.name in called else replace(r, body=start + r.body) for r in routines),
        values,
        tuple(remark for reader in readers for remark in reader.remarks),
        (_missing(missing),) if missing and direct else (),
        persistent=True,
        unused="no motion of this program goes there, and nothing else tells its base and tool",
    )


def _missing(names: list[str]) -> str:
    more = " …" if len(names) > _LISTED else ""
    which = ", ".join(names[:_LISTED]) + more
    return f"no file holds {which}: taken to leave $BASE and $TOOL as they are"


class _Reader(Motions):
    """A text: the declarations of its data lists, and its routines as steps."""

    def __init__(self, text: Text, names: Names, values: dict[str, Value], held: bool) -> None:
        super().__init__(text, names, values, held)
        self.missing: set[str] = set()
        self.started: list[Started] = []

    def declare(self) -> None:
        """Read the data lists of the text, and declarations outside of routines."""
        inside = False
        for statement, scopes in self.text.scoped:
            self.scopes = scopes
            if statement.word == "routine":
                inside = True
            elif statement.word in ("end", "endfct"):
                inside = False
            elif not inside and statement.word in ("decl", "assign"):
                for step in self._data(statement, 0):
                    self._declare(step.name, step.value, statement)

    def _declare(self, key: str, value: Value, statement: Statement) -> None:
        old = self.declared.get(key)
        given = old is not None and not (isinstance(old, Frame) and old.values is None)
        if given and old != value and key not in _UNSAID:
            again = isinstance(value, int) and self._source(old) == self.text.number
            if not again:
                why = "another file, or another line, gives it another value"
                self._bad(statement.position, key.split("|")[-1], why)
                return
        self.declared[key] = value

    def _source(self, value: Value | None) -> int:
        return self.text.literals[value].source if isinstance(value, int) else -1

    def _data(self, statement: Statement, line: int) -> Iterator[Assign]:
        """The values of a declaration or an assignment; line: 0 in a data list."""
        if statement.word == "decl":
            for item in declared(self.code, statement.start, statement.end):
                if item.start >= 0:
                    yield from self.given(item, statement.name, line)
        else:
            yield from self.assigned(statement, line)

    def routines(self) -> Iterator[Routine]:
        """The routines of the text."""
        steps: list[Step] | None = None
        cases: list[bool] = []  # of open SWITCH: whether a CASE was seen
        name = ""
        for statement, scopes in self.text.scoped:
            self.scopes = scopes
            if statement.word == "routine":
                if steps is not None:
                    yield Routine(name, tuple(steps), self.text.number)
                name, steps, cases = self.scopes[0], [], []
            elif steps is None:
                if statement.word in ("move", "relative"):
                    self._bad(statement.position, statement.name, "a motion outside of a routine")
            elif statement.word in ("end", "endfct"):
                yield Routine(name, tuple(steps), self.text.number)
                steps = None
            elif statement.word == "aside" or _ASIDE.match(self.code, statement.position):
                self._aside(statement, name, len(steps))
            else:
                steps += self._steps(statement, cases)
        if steps is not None:
            yield Routine(name, tuple(steps), self.text.number)

    def _steps(self, statement: Statement, cases: list[bool]) -> Iterator[Step]:
        word, line = statement.word, self.text.lines(statement.position)
        if word != "decl" and "(" in self.code[statement.start : statement.end]:
            yield from self._calls(statement, line)
        if word in ("if", "switch", "for", "while", "repeat", "loop"):
            yield Begin(loop=word not in ("if", "switch"), once=word in ("repeat", "loop"))
            if word == "switch":
                cases.append(False)
        elif word in ("elseif", "else"):
            yield Else(last=word == "else")
        elif word in ("case", "default"):
            if cases and not cases[-1]:
                cases[-1] = True
            else:
                yield Else(last=word == "default")
        elif word in ("endif", "endswitch", "endfor", "endwhile", "until", "endloop"):
            if word == "endswitch" and cases:
                cases.pop()
            yield End()
        elif word == "exit":
            yield Break()
        elif word == "label":
            yield Label(statement.name.lower())
        elif word == "goto":
            yield Jump(self.code[statement.start : statement.end].strip().lower())
        elif word == "return":
            yield Return()
        elif word in ("decl", "assign"):
            yield from self._data(statement, line)
        elif word in ("spline", "ptp_spline", "endspline"):
            self.block = self.settings(statement.start, statement.end, line)
        elif word in ("move", "relative"):
            yield from self.motion(statement, line)

    def _aside(self, statement: Statement, routine: str, place: int) -> None:
        """Note the effect of an interrupt, a trigger or cyclic reading beside the motions."""
        line, end = self.text.lines(statement.position), statement.end
        found = _ASIDE.match(self.code, statement.position, end)
        if found is None:
            return
        words, number = " ".join(found[1].upper().split()), (found[2] or "").lower()
        steps: tuple[Step, ...] = ()
        if read := _CYCLIC.match(self.code, statement.start, end):
            number, steps = "", tuple(self.changed(read[1], "", line))
        elif done := _DO.search(self.code, statement.start, end):
            steps = tuple(self._steps(statement_at(self.code, *done.span(1)), []))
        self.started.append(Started(routine, place, line, words, number, steps))

    def _calls(self, statement: Statement, line: int) -> Iterator[Step]:
        """Calls of routines in a statement, with values of their parameters; BAS is included."""
        for match in CALLED.finditer(self.code, statement.start, statement.end):
            procedure = self.names.routine(match[1], self.text.module)
            if match[1].upper() == "BAS":
                yield from self.bas(match.end(), statement.end, line)
                continue
            alone = statement.word == "other" and match.start() == statement.start
            given = call_arguments(self.text, match.end(), statement.end)
            changed = list(self._changed(match[1], given, procedure is not None, line))
            if procedure is not None:
                yield self._call(procedure, given, line)
            elif alone and not any(step.name in _UNSAID for step in changed):
                self.missing.add(match[1])
            yield from changed

    def _call(self, procedure: Procedure, given: list[tuple[int, int]], line: int) -> Call:
        """The call of a routine of the program with these arguments."""
        passed: list[tuple[str, Value]] = []
        for parameter, (first, last) in zip(procedure.parameters, given, strict=False):
            item = Declared(parameter, "", first, last)
            type_ = self.names.type(parameter, (procedure.key,))
            key = f"{procedure.key}|{parameter}"
            passed += [(step.name, step.value) for step in self.held_by(key, item, type_, line)]
        return Call(line, procedure.key, tuple(passed))

    def _changed(
        self, called: str, given: list[tuple[int, int]], held: bool, line: int
    ) -> Iterator[Assign]:
        """Assignments, certain or possible, of a routine to its arguments by reference."""
        for place, (first, last) in enumerate(given):
            if self.names.changes(called, place, self.text.module):
                which = "is changed by a routine" if held else f"may be changed by {called}"
                yield from self.changed(self.code[first:last], f"{which} (line {line})", line)

    def _bad(self, position: int, name: str, why: str) -> None:
        self.remarks.append(Remark(self.text.lines(position), name, why, True, self.text.number))
