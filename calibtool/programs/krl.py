"""The syntax of KRL: statements and products of frames, as spans of the text."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from calibtool.programs.bracketed_lists import split, trimmed

NAME = r"\$?[A-Za-z_][\w$]*"
_INDEX = r"\[[^\[\]]*\]"
_PART = rf"\.\s*+\w+\s*+(?:{_INDEX})?\s*+"
_TYPES = "INT|REAL|BOOL|CHAR|FRAME|(?:E3|E6)?(?:POS|AXIS)"
_LINE = re.compile(r"[^\r\n]+")
_HEAD = re.compile(
    r"(?P<move>S?(?:PTP|LIN|CIRC)|SPL)(?P<relative>_REL)?(?![\w$=.\[]|\s*+=)"
    rf"|(?:GLOBAL\s+)?(?:DEF|DEFFCT\s+[\w$]+(?:\s*+{_INDEX})?)"
    rf"\s+(?P<routine>{NAME})(?=\s*+(?:\(|$))"
    rf"|DEFDAT\s+(?P<data>{NAME})"
    r"|(?P<block>IF|ELSEIF|ELSE|ENDIF|SWITCH|CASE|DEFAULT|ENDSWITCH|FOR|ENDFOR|WHILE|ENDWHILE"
    r"|REPEAT|UNTIL|LOOP|ENDLOOP|EXIT|RETURN|GOTO|END|ENDFCT|ENDDAT|SPLINE|PTP_SPLINE|ENDSPLINE)"
    r"(?![\w$]|\s*+[=.\[])"
    r"|(?P<aside>(?:GLOBAL\s+)?INTERRUPT|TRIGGER|EXTFCTP?|EXTP?|STRUC|ENUM|SIGNAL|IMPORT|CONTINUE)"
    r"(?![\w$]|\s*+[=.\[])"
    r"|(?P<declares>(?:(?:GLOBAL|DECL|CONST|PUBLIC)\s+)+(?P<type>[\w$]+)(?:\s*+\[\s*+\d*\s*+\])?"
    rf"|(?P<known>{_TYPES}))\s+(?={NAME})"
    rf"|(?P<name>{NAME})\s*+(?P<index>{_INDEX})?\s*+(?P<parts>(?:{_PART})*)=(?!=)\s*+"
    rf"|(?P<label>[A-Za-z_]\w*)\s*+:\s*+$",
    re.IGNORECASE,
)
_THEN = re.compile(r"\bTHEN\b\s*+", re.IGNORECASE)
_DECLARED = re.compile(
    rf"\s*+(?P<name>{NAME})\s*+(?P<index>{_INDEX})?\s*+"
    r"(?:=\s*+(?P<value>\{(?:[^{}]|\{[^{}]*\})*\}|\{.*|[^,]*))?\s*+(?:,|$)"
)
_FACTOR = re.compile(
    rf"\s*+(?:(?P<items>\{{[^{{}}]*\}})|(?P<word>{NAME}(?:\s*+{_INDEX})?(?:\s*+{_PART})*)"
    r"(?P<call>\s*+\((?:[^()]|\([^()]*\))*\))?)\s*+"
)
_REFERENCE = re.compile(rf"({NAME})\s*+({_INDEX})?\s*+((?:{_PART})*)")


@dataclass(frozen=True, slots=True)
class Statement:
    """A statement of KRL; what follows its first words is code[start:end].

    word      `move`, `relative`, `routine`, `data`, `decl`, `assign`, `label`, `other`, `aside` (a
              declaration, or an action beside the motions), or a keyword of a block in lower case
    name      the motion, routine, data list, type, variable or label, as it is written
    more      of an assignment its index and components; of a declaration the words before its type
    position  where it begins
    """

    word: str
    name: str
    position: int
    start: int
    end: int
    more: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Declared:
    """A declared name, its index, and the span of its value; start is −1 without a value."""

    name: str
    index: str
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Factor:
    """A frame or position in an expression: an aggregate `{…}`, or a word or function call."""

    start: int
    end: int
    items: bool
    word: str = ""
    call: str = ""


def statements(code: str) -> Iterator[Statement]:
    """Statements of a text without comments; another one may follow THEN or ELSE."""
    for line in _LINE.finditer(code):
        position, end = trimmed(code, *line.span())
        while position < end:
            statement = statement_at(code, position, end)
            position = end
            if statement.word == "else":
                position = statement.start
            elif statement.word in ("if", "elseif") and (
                then := _THEN.search(code, statement.start, end)
            ):
                statement = Statement(
                    statement.word, "", statement.position, statement.start, then.start()
                )
                position = then.end()
            yield statement


def statement_at(code: str, position: int, end: int) -> Statement:
    """The statement in code[position:end]."""
    head = _HEAD.match(code, position, end)
    if head is None:
        return Statement("other", "", position, position, end)
    start, _ = trimmed(code, head.end(), end)
    if head["move"]:
        name = head["move"] + (head["relative"] or "")
        return Statement("relative" if head["relative"] else "move", name, position, start, end)
    if head["block"]:
        return Statement(head["block"].lower(), "", position, start, end)
    if head["name"]:
        assigned = head["index"] or "", re.sub(r"\s", "", head["parts"])
        return Statement("assign", head["name"], position, start, end, assigned)
    if head["declares"]:
        type_ = head["type"] or head["known"]
        more = tuple(code[position : head.end()].upper().split()[:-1])
        return Statement("decl", type_.upper(), position, start, end, more)
    for word in ("routine", "data", "label"):
        if head[word]:
            return Statement(word, head[word], position, start, end)
    return Statement("aside", head["aside"], position, start, end)


def declared(code: str, start: int, end: int) -> Iterator[Declared]:
    """The names of a declaration, and their values."""
    position = start
    while position < end and (found := _DECLARED.match(code, position, end)):
        span = found.span("value")
        last = span[0] + len((found["value"] or "").rstrip())
        yield Declared(found["name"], found["index"] or "", span[0], last)
        position = max(found.end(), position + 1)


def product(code: str, start: int, end: int) -> tuple[list[Factor], int]:
    """The factors of `a : b : …` from start on, and its end; no factors for anything else."""
    found: list[Factor] = []
    position = start
    while factor := _FACTOR.match(code, position, end):
        first = factor.start("items") if factor["items"] else factor.start("word")
        word = (factor["word"] or "").strip()
        call = (factor["call"] or "").strip()
        last = first + len(code[first : factor.end()].rstrip())
        found.append(Factor(first, last, factor["items"] is not None, word, call))
        position = factor.end()
        if code[position : position + 1] != ":" or position >= end:
            return found, position
        position += 1
    return [], start


@lru_cache(maxsize=4096)
def reference(word: str) -> tuple[str, str, str] | None:
    """Name, index without brackets and components of a variable; None for another expression."""
    match = _REFERENCE.fullmatch(word.strip())
    if match is None:
        return None
    index = re.sub(r"[\s\[\]]", "", match[2] or "")
    return match[1].lower(), index.lower(), re.sub(r"\s", "", match[3]).lower()


def arguments(code: str, start: int, end: int) -> list[tuple[int, int]]:
    """Spans between the commas of code[start:end] outside of brackets, blanks dropped."""
    return [trimmed(code, *span) for span in split(code, start, end)]
