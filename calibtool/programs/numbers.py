"""Numbers in program text: their spans, units and values, and new numbers in the same style."""

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from struct import Struct
from typing import overload

from calibtool.programs.bracketed_lists import trimmed
from calibtool.units import LARGEST, TO_SI

# Decimals that keep 1e-6 deg and 1e-4 mm; a quaternion's components are as fine as 1e-6 deg.
DECIMALS = {"deg": 6, "rad": 8, "mm": 4, "m": 7, "": 9}

BYTE_ORDER_MARK = "\xef\xbb\xbf"  # of UTF-8, as Latin-1
NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_NUMBER = re.compile(NUMBER)
_NOT_FINITE = re.compile(r"[-+]?\.?(?:nan|inf|infinity)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Number:
    """A number in the text: characters start to end, its unit (`""` for a quaternion's component),
    its SI value.

    It may be a constant expression, such as `pi/2`, which the new number replaces.
    """

    start: int
    end: int
    unit: str
    value: float


_NUMBER_PACKED = Struct("<IId")  # start, end, value


class Numbers(Sequence[Number]):
    """Numbers of a position in compact form: a program may have tens of thousands of positions."""

    __slots__ = ("_packed", "_units")

    def __init__(self, numbers: Iterable[Number]) -> None:
        found = tuple(numbers)
        self._units = _shared(tuple(number.unit for number in found))
        self._packed = b"".join(_NUMBER_PACKED.pack(n.start, n.end, n.value) for n in found)

    @property
    def values(self) -> tuple[float, ...]:
        """In SI units."""
        return tuple(value for _, _, value in _NUMBER_PACKED.iter_unpack(self._packed))

    def __len__(self) -> int:
        return len(self._units)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and tuple(self) == tuple(other)

    def __hash__(self) -> int:
        return hash(self._packed)

    @overload
    def __getitem__(self, index: int) -> Number: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Number, ...]: ...
    def __getitem__(self, index: int | slice) -> Number | tuple[Number, ...]:
        if isinstance(index, slice):
            return tuple(self[k] for k in range(*index.indices(len(self))))
        unit = self._units[index]  # IndexError behind the last one
        place = index % len(self._units) * _NUMBER_PACKED.size
        start, end, value = _NUMBER_PACKED.unpack_from(self._packed, place)
        return Number(start, end, unit, value)

    def __iter__(self) -> Iterator[Number]:
        for (start, end, value), unit in zip(
            _NUMBER_PACKED.iter_unpack(self._packed), self._units, strict=True
        ):
            yield Number(start, end, unit, value)


@lru_cache(maxsize=1000)
def _shared(units: tuple[str, ...]) -> tuple[str, ...]:
    return units


@dataclass(frozen=True)
class Remark:
    """Something in the program that is not corrected: its line, its name and why; bad: it is an
    error of the program.

    source: number of its text
    """

    line: int
    name: str
    why: str
    bad: bool = False
    source: int = 0


class LineNumbers:
    """Line numbers (from 1) of positions in a text."""

    def __init__(self, text: str) -> None:
        self._starts = [0, *(match.end() for match in re.finditer(r"\r\n|\n|\r", text))]

    def __call__(self, position: int) -> int:
        return bisect_right(self._starts, position)


def number_at(text: str, start: int, end: int, unit: str) -> Number | None:
    """The number in text[start:end] without blanks; None for anything else, NaN and 1e999 too."""
    first, last = trimmed(text, start, end)
    match = _NUMBER.fullmatch(text, first, last)
    if match is None or abs(float(match[0])) >= LARGEST:
        return None
    return Number(first, last, unit, float(match[0]) * TO_SI.get(unit, 1.0))


def is_not_finite(text: str) -> bool:
    """Whether a text is NaN or infinite, as a program with bad data would write it."""
    return _NOT_FINITE.fullmatch(text.strip()) is not None


def comments_blanked(text: str, comment: str, string: str = r'"[^"\n]*"') -> str:
    """The text with comments and strings replaced by blanks, so that positions stay."""

    def blank(match: re.Match[str]) -> str:
        return re.sub(r"[^\r\n]", " ", match[0])

    return re.sub(f"\\A{BYTE_ORDER_MARK}|{string}|{comment}", blank, text, flags=re.MULTILINE)


def replaced(text: str, edits: Sequence[tuple[int, int, str]]) -> str:
    """The text with spans (start, end, new text) exchanged and nothing else changed.

    A number that is right-aligned in a column (at least two blanks before it) keeps its column's
    width.
    """
    return "".join(pieces(text, sorted(edits)))


def pieces(text: str, edits: Iterable[tuple[int, int, str]]) -> Iterator[str]:
    """The same in pieces, for edits in the order of the text."""
    position = 0
    for start, end, new in edits:
        room = start
        while room > position and text[room - 1] == " ":
            room -= 1
        if start - room >= 2:
            width = end - room
            close = len(new) <= width and text[room - 1 : room] in ("=", ",", "[", "(", "{", ":")
            wanted = new if close else f" {new}"
            yield text[position:room]
            yield wanted.rjust(width)
        else:
            yield text[position:start]
            yield new
        position = end
    yield text[position:]


def rewritten(
    text: str, numbers: Sequence[Number], values: Sequence[float]
) -> list[tuple[int, int, str]]:
    """Edits that replace numbers by new SI values; none for a number that would not change."""
    edits = []
    for number, value in zip(numbers, values, strict=True):
        old = text[number.start : number.end]
        factor = TO_SI.get(number.unit, 1.0)
        if _NUMBER.fullmatch(old) is None:
            decimals = DECIMALS[number.unit]
            stays = abs(value - number.value) / factor < 0.5 * 10.0**-decimals
            new = old if stays else f"{value / factor:.{decimals}f}"
        else:
            new = written(old, value / factor, number.unit)
        if new != old:
            edits.append((number.start, number.end, new))
    return edits


def written(old: str, value: float, unit: str) -> str:
    """A value with the decimals of the old number, or as many as the unit needs; `old` if equal."""
    mantissa = re.split("[eE]", old)[0]
    decimals = max(DECIMALS[unit], len(mantissa.partition(".")[2]))
    if abs(value - float(old)) < 0.5 * 10.0**-decimals:
        return old
    new = f"{value:.{decimals}f}"
    if not float(new):
        new = new.lstrip("-")  # no minus zero
    if old.startswith("+") and not new.startswith("-"):
        new = "+" + new
    if re.match(r"[-+]?\.", old):
        new = re.sub(r"^([-+]?)0\.", r"\1.", new)
    return new
