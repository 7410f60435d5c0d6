"""The syntax of FANUC's TP programs, English and German: sections, statements, motions."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from calibtool.programs.numbers import LineNumbers

_PROGRAM = re.compile(r"^[ \t]*/PROG\b[ \t]*([^\s;]*)", re.MULTILINE)
_SECTION = re.compile(r"^[ \t]*/(MN|POS)[ \t]*\r?$", re.MULTILINE)
_TRACKING = re.compile(r"\bLINE_TRACK_SCHEDULE_NUMBER\s*:\s*0*[1-9]", re.IGNORECASE)
# A statement has a number; without one its line goes on with the statement before, if that has
# no semicolon yet.
_LINE = re.compile(r"[ \t]*(?:(?P<number>\d*)[ \t]*(?P<colon>:)[ \t]*)?(?P<body>[^\n]*)\n?")
_BRACKETS = r"\[(?:[^\[\]]++|\[(?:[^\[\]]++|\[[^\[\]]*+\])*+\])*+\]"  # three in each other at most
_MOTION = re.compile(r"([JLCAS])[ \t]+(?=(?:PR?|PAL_\d+)[ \t]*\[)")
_TARGET = re.compile(rf"[ \t]*:?[ \t]*(PR?|PAL_\d+)[ \t]*({_BRACKETS})")
_NUMBER = re.compile(r"\[\s*(\d{1,9})\s*(?::.*)?\]", re.DOTALL)
_CALLED = re.compile(r"\b(?:CALL|AUFRUF)\s+[\w-]+(?:\([^)]*\))?|\bP-\w+", re.IGNORECASE)
_WORD = re.compile(r"[A-Z_]\w*", re.IGNORECASE)
_LABEL = re.compile(r",\s*(?:LBL|LABEL)\s*\[\s*(\d+)", re.IGNORECASE)
_IN_BRACKETS = re.compile(_BRACKETS)


@dataclass(frozen=True, slots=True)
class Section:
    """A program's name and where its instructions and its positions stand in the text.

    tracking  a conveyor moves the frame of its positions
    """

    name: str
    instructions: tuple[int, int]
    positions: tuple[int, int]
    tracking: bool = False


@dataclass(frozen=True, slots=True)
class Statement:
    """An instruction: its first line, and its text in one line without the semicolon."""

    line: int
    text: str


@dataclass(frozen=True, slots=True)
class Point:
    """A target point of a motion.

    kind    `P`, `PR` or `PAL_1`
    number  None if a register holds it
    text    as it is written
    """

    kind: str
    number: int | None
    text: str


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion instruction: J, L, C, A or S, its points, and the words of its options in capitals.

    label  where it jumps if the motion is interrupted
    """

    line: int
    letter: str
    points: tuple[Point, ...]
    options: frozenset[str]
    label: str = ""


def sections(code: str) -> Iterator[Section]:
    """The programs of a text."""
    heads = list(_PROGRAM.finditer(code))
    starts = [0, *(head.start() for head in heads[1:])]
    for k, (start, end) in enumerate(zip(starts, [*starts[1:], len(code)], strict=True)):
        found = {m[1]: m for m in reversed(list(_SECTION.finditer(code, start, end)))}
        name = heads[k][1].upper() if heads else ""
        positions = found["POS"].end() if "POS" in found else end
        first = found["MN"].end() if "MN" in found else start
        last = found["POS"].start() if "POS" in found else end
        tracking = _TRACKING.search(code, start, max(first, start)) is not None
        yield Section(name, (min(first, last), last), (positions, end), tracking)


def statements(code: str, span: tuple[int, int], lines: LineNumbers) -> Iterator[Statement]:
    """The statements in a part of the text; remarks are left out."""
    waiting: list[str] = []
    first, position = 0, span[0]
    while position < span[1]:
        found = _LINE.match(code, position, span[1])
        assert found is not None
        position = max(found.end(), position + 1)
        body = found["body"].strip()
        if found["number"] and waiting:
            yield Statement(first, " ".join(waiting))
            waiting = []
        if not waiting:
            first = lines(found.start("body"))
        if body and (waiting or not body.startswith(("!", "//", "--"))):
            waiting.append(body)
        if body.endswith(";") and waiting:
            yield Statement(first, " ".join(waiting)[:-1].rstrip())
            waiting = []
    if waiting:
        yield Statement(first, " ".join(waiting))


def motion(statement: Statement) -> Motion | None:
    """The motion of a statement; None if it is no motion."""
    text = statement.text
    head = _MOTION.match(text)
    if head is None:
        return None
    points: list[Point] = []
    position = head.end()
    while len(points) < (2 if head[1] == "C" else 1):
        found = _TARGET.match(text, position)
        if found is None:
            break
        number = _NUMBER.fullmatch(found[2])
        what = int(number[1]) if number else None
        points.append(Point(found[1], what, found[1] + found[2]))
        position = found.end()
    label = _LABEL.search(text, position)
    rest = _IN_BRACKETS.sub(" ", text[position:])
    words = frozenset(word.upper() for word in _WORD.findall(_CALLED.sub(" ", rest)))
    return Motion(statement.line, head[1], tuple(points), words, label[1] if label else "")


def parts(text: str) -> list[str]:
    """The text cut at commas outside of brackets."""
    found, depth, first = [], 0, 0
    for k, mark in enumerate(text):
        depth += (mark in "[(") - (mark in "])")
        if mark == "," and depth == 0:
            found.append(text[first:k].strip())
            first = k + 1
    return [*found, text[first:].strip()]
