"""Bracketed lists and arguments in program text, as spans of their elements."""

import re
from array import array
from bisect import bisect_left
from dataclasses import dataclass
from functools import lru_cache

_OPEN, _CLOSE = "([{", ")]}"
_BRACKET = re.compile(r"[(\[{)\]}]")
_COMMA_OR_BRACKET = re.compile(r"[,(\[{)\]}]")
_DEEPEST = 5  # levels of nested lists; a position takes two, an array of positions three


@dataclass(frozen=True)
class Item:
    """An element: characters start to end; `parts` of a list in square brackets, else None."""

    start: int
    end: int
    parts: tuple["Item", ...] | None = None

    def shape(self) -> tuple[int, ...] | None:
        """Numbers of words in a list of lists, as (3, 4, 4, 6); None for another nesting."""
        if self.parts is None or any(part.parts is None for part in self.parts):
            return None
        if any(inner.parts is not None for part in self.parts for inner in part.parts or ()):
            return None
        return tuple(len(part.parts or ()) for part in self.parts)


def closing(code: str, start: int) -> int | None:
    """Position of the bracket that closes the one at `start`; None if there is none."""
    opened, closed = _pairs(code)
    place = bisect_left(opened, start)
    return closed[place] if place < len(opened) and opened[place] == start else None


@lru_cache(maxsize=2)
def _pairs(code: str) -> tuple["array[int]", "array[int]"]:
    """Opening brackets in order, each with the closing one, of the whole text in linear time."""
    opened, closed = array("q"), array("q")
    waiting: list[int] = []  # their places in `opened`
    for match in _BRACKET.finditer(code):
        if match[0] in _OPEN:
            waiting.append(len(opened))
            opened.append(match.start())
            closed.append(-1)
        elif waiting:
            closed[waiting.pop()] = match.start()
    kept = [k for k, end in enumerate(closed) if end >= 0]
    if len(kept) < len(opened):
        return array("q", (opened[k] for k in kept)), array("q", (closed[k] for k in kept))
    return opened, closed


def trimmed(text: str, start: int, end: int) -> tuple[int, int]:
    """The span of text[start:end] without blanks at its ends; blanks alone: an empty span."""
    inner = text[start:end]
    first = start + len(inner) - len(inner.lstrip())
    return first, first + len(inner.strip())


def split(code: str, start: int, end: int) -> list[tuple[int, int]]:
    """Spans between the commas of code[start:end] that stand outside of brackets."""
    spans, depth, first = [], 0, start
    for mark in _COMMA_OR_BRACKET.finditer(code, start, end):
        depth += (mark[0] in _OPEN) - (mark[0] in _CLOSE)
        if mark[0] == "," and depth == 0:
            spans.append((first, mark.start()))
            first = mark.end()
    return [*spans, (first, end)]


def item(code: str, start: int, end: int, depth: int = _DEEPEST) -> Item:
    """The element in code[start:end] without blanks; lists deeper than `depth` are words."""
    start, end = trimmed(code, start, end)
    if depth and end - start >= 2 and code[start] == "[" and closing(code, start) == end - 1:
        if not code[start + 1 : end - 1].strip():
            return Item(start, end, ())
        return Item(
            start,
            end,
            tuple(item(code, *span, depth - 1) for span in split(code, start + 1, end - 1)),
        )
    return Item(start, end)
