"""Bracketed lists and arguments in program text: where each element stands."""

from dataclasses import dataclass

_OPEN, _CLOSE = "([{", ")]}"


@dataclass(frozen=True)
class Item:
    """An element: characters start to end; `parts` are the elements of a list in square brackets, None for a word."""

    start: int
    end: int
    parts: tuple["Item", ...] | None = None

    def shape(self) -> tuple[int, ...] | None:
        """Numbers of words in a list of lists, as (3, 4, 4, 6); None for a word or for deeper or mixed nesting."""
        if self.parts is None or any(part.parts is None for part in self.parts):
            return None
        if any(inner.parts is not None for part in self.parts for inner in part.parts or ()):
            return None
        return tuple(len(part.parts or ()) for part in self.parts)


def closing(code: str, start: int) -> int | None:
    """Position of the bracket that closes the one at `start`; None if there is none."""
    depth = 0
    for position in range(start, len(code)):
        if code[position] in _OPEN:
            depth += 1
        elif code[position] in _CLOSE:
            depth -= 1
            if depth == 0:
                return position
    return None


def split(code: str, start: int, end: int) -> list[tuple[int, int]]:
    """Spans between the commas of code[start:end] that stand outside of brackets."""
    spans, depth, first = [], 0, start
    for position in range(start, end):
        character = code[position]
        depth += (character in _OPEN) - (character in _CLOSE)
        if character == "," and depth == 0:
            spans.append((first, position))
            first = position + 1
    return [*spans, (first, end)]


def item(code: str, start: int, end: int) -> Item:
    """The element in code[start:end], blanks around it dropped."""
    inner = code[start:end]
    start += len(inner) - len(inner.lstrip())
    end = max(start, end - (len(inner) - len(inner.rstrip())))
    if end - start >= 2 and code[start] == "[" and closing(code, start) == end - 1:
        if not code[start + 1 : end - 1].strip():
            return Item(start, end, ())
        return Item(start, end, tuple(item(code, *span) for span in split(code, start + 1, end - 1)))
    return Item(start, end)
