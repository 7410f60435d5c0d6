"""The syntax of RAPID: statements, their parts and arguments, as spans of the text."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from calibtool.programs.bracketed_lists import trimmed

_ROUTINE = r"(?:LOCAL\s+)?(?:PROC|TRAP|FUNC\s+\w+)\s+(?P<routine>\w+)\s*+"
_BLOCK = re.compile(
    r"\s*+(?:"
    rf"(?P<head>{_ROUTINE})"
    r"|(?:MODULE|RECORD)\s+(?P<module>\w+)(?:\s*\([^)]*\))?"
    r"|(?P<end>END(?:MODULE|PROC|FUNC|TRAP|IF|FOR|WHILE|TEST|RECORD))\b"
    r"|(?P<selection>IF|ELSEIF|FOR|WHILE|TEST|CASE)\b"
    r"|(?P<alone>ELSE|ERROR|UNDO|BACKWARD|%%%)(?=\s|$)|(?P<default>DEFAULT)\s*:"
    r"|(?P<label>\w+)\s*:(?!=)"
    r"|(?:(?P<scope>LOCAL|TASK)\s+)?(?P<storage>CONST|PERS|VAR)\s+(?P<type>\w+)\s+(?P<data>\w+)\s*+"
    r")",
    re.IGNORECASE,
)
_UNTIL = {
    "if": re.compile(r"\bTHEN\b|;", re.IGNORECASE),
    "elseif": re.compile(r"\bTHEN\b|;", re.IGNORECASE),
    "for": re.compile(r"\bDO\b|;", re.IGNORECASE),
    "while": re.compile(r"\bDO\b|;", re.IGNORECASE),
    "test": re.compile(r"(?=\bCASE\b|\bDEFAULT\b)|;", re.IGNORECASE),
    "case": re.compile(r"[:;]"),
}
# A statement ends at its semicolon, or, if that is forgotten, before what can only
# begin another one.
_STATEMENT_END = re.compile(
    r";|^(?=[^\S\n]*+(?:END(?:MODULE|PROC|FUNC|TRAP|IF|FOR|WHILE|TEST)\b|PROC\s|Move[JLCA]\w*\s"
    r"|(?:LOCAL\s+|TASK\s+)?(?:CONST|PERS|VAR)\s))",
    re.MULTILINE | re.IGNORECASE,
)
_ASSIGNED = re.compile(
    r"(?P<name>\w+)\s*+(?P<index>\{[^{}]*\})?\s*+(?P<parts>(?:\.\s*\w+\s*+(?:\{[^{}]*\})?\s*+)*):="
)
_INSTRUCTION = re.compile(r"(?P<name>\w+)")
_SEPARATOR = re.compile(r"[,\\()\[\]{}]")
_OPERAND = re.compile(
    r"[\w\])]\s*+(?<=\s)(?!(?:AND|OR|XOR|NOT|DIV|MOD)\b)(?=[A-Za-z%])", re.IGNORECASE
)
_OPERATOR = re.compile(r"\b(?:AND|OR|XOR|NOT|DIV|MOD|IF)\s*$", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Statement:
    """A statement or a part of one that stands alone.

    word        its kind: `module`, `routine`, `endif` … in lower case; `data`, `assign`, `label`,
                `instruction`
    name        of the module, routine, data, label or instruction, as it is written
    start, end  the rest: parameters of a routine, the value of data and assignments, arguments
    ended       whether it has its semicolon
    more        of data (scope, storage, type, dimensions); of an assignment (index, components)
    """

    word: str
    name: str
    position: int
    start: int = 0
    end: int = 0
    ended: bool = True
    more: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Argument:
    """An argument: span, name of an optional one; after: number of the previous argument."""

    start: int
    end: int
    option: str = ""
    after: int = -1


def statements(code: str) -> Iterator[Statement]:
    """Statements without comments and strings; a short `IF` becomes `if`, statement, `endif`."""
    position = 0
    while position < len(code):
        block = _BLOCK.match(code, position)
        if block is None:
            yield from _simple(code, position)
            position = _after(code, position)
            continue
        at, _ = trimmed(code, position, block.end())
        position = block.end()
        if block["head"]:
            position = _parameters(code, position)
            yield Statement("routine", block["routine"], at, block.end(), position)
        elif block["module"]:
            yield Statement("module", block["module"], at)
        elif block["end"]:
            yield Statement(block["end"].lower(), "", at)
        elif block["selection"]:
            word = block["selection"].lower()
            found = _UNTIL[word].search(code, position)
            stop = len(code) if found is None else found.end()
            if word == "if" and found is not None and found[0] == ";":
                yield from _short_if(code, at, position, found.start())
            else:
                yield Statement(word, "", at, position, stop)
            position = stop
        elif block["data"]:
            end, position, ended = _end(code, position)
            yield _data(code, block, at, end, ended)
        elif block["label"]:
            yield Statement("label", block["label"], at)
        else:
            yield Statement((block["alone"] or block["default"]).lower(), "", at)


def arguments(code: str, start: int, end: int) -> list[Argument]:
    """The arguments in code[start:end]: between commas, and optional ones after backslashes."""
    found: list[Argument] = []
    depth, first, option = 0, start, False

    def add(stop: int) -> None:
        start, end = trimmed(code, first, stop)
        if start == end:
            return
        after = next((k for k in range(len(found) - 1, -1, -1) if not found[k].option), -1)
        if option:
            name = re.compile(r"(\w+)\s*+(?::=|\?)?\s*+").match(code, start, end)
            if name:
                found.append(Argument(name.end(), end, name[1].lower(), after))
        else:
            found.append(Argument(start, end, "", after))

    for mark in _SEPARATOR.finditer(code, start, end):
        if mark[0] in "([{":
            depth += 1
        elif mark[0] in ")]}":
            depth -= 1
        elif depth == 0:
            add(mark.start())
            first, option = mark.end(), mark[0] == "\\"
    add(end)
    return found


def _after(code: str, position: int) -> int:
    """Where the next statement begins after a simple one."""
    return _end(code, position)[1]


def _end(code: str, position: int) -> tuple[int, int, bool]:
    """Where a statement ends, where the next one begins, and whether it has its semicolon."""
    found = _STATEMENT_END.search(code, position)
    while found is not None and not found[0] and not code[position : found.start()].strip():
        found = _STATEMENT_END.search(code, found.start() + 1)
    if found is None:
        return len(code), len(code), False
    return found.start(), max(found.end(), position + 1), bool(found[0])


def _simple(code: str, position: int) -> Iterator[Statement]:
    """An assignment or instruction."""
    end, _, ended = _end(code, position)
    at, _ = trimmed(code, position, end)
    if at >= end:
        return
    assigned = _ASSIGNED.match(code, at, end)
    if assigned:
        more = (assigned["index"] or "", re.sub(r"\s", "", assigned["parts"]).lower())
        yield Statement("assign", assigned["name"], at, assigned.end(), end, ended, more)
    elif instruction := _INSTRUCTION.match(code, at, end):
        yield Statement("instruction", instruction["name"], at, instruction.end(), end, ended)
    elif code[at] == "%":  # a call whose routine is an expression
        yield Statement("instruction", "%", at, at + 1, end, ended)


def _short_if(code: str, at: int, start: int, end: int) -> Iterator[Statement]:
    """`IF condition statement;`: the statement begins at two words without an operator."""
    yield Statement("if", "", at, start, end)
    for match in _OPERAND.finditer(code, start, end):
        before = code[start : match.end()]
        if _OPERATOR.search(before) or before.count("(") != before.count(")"):
            continue
        yield from _simple(code, match.end())
        break
    yield Statement("endif", "", end)


def _data(code: str, block: re.Match[str], at: int, end: int, ended: bool) -> Statement:
    start = block.end()
    dimensions = re.compile(r"\{([^{}]*)\}\s*+").match(code, start, end)
    start = dimensions.end() if dimensions else start
    given = re.compile(r":=\s*+").match(code, start, end)
    more = (
        (block["scope"] or "").lower(),
        block["storage"].lower(),
        block["type"].lower(),
        dimensions[1] if dimensions else "",
    )
    return Statement("data", block["data"], at, given.end() if given else end, end, ended, more)


def _parameters(code: str, position: int) -> int:
    """The end of the parameters in parentheses that begin here, if they do."""
    if code[position : position + 1] != "(":
        return position
    closed = code.find(")", position)
    return len(code) if closed < 0 else closed + 1
