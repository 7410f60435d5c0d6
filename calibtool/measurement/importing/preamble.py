"""Lines before the header that are the instrument's own text, and a line of units after it."""

import re

from calibtool.measurement.importing.grouped_header import (
    joined,
    marker_names,
    repeated,
    with_units,
)
from calibtool.measurement.importing.spelling import UNITS
from calibtool.tables import split_lines

_DELIMITERS = ("\t", ";", ",", " ")
_NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?")
_MOST_LINES = 500  # number of lines among which a header is looked for
_COMMENT = re.compile(r"\s*(?:#|//|%|;)\s*")


def without_preamble(lines: list[str], delimiter: str | None = None) -> tuple[list[str], bool]:
    """The lines with those before the header emptied, so that line numbers stay, and whether there
    were any.

    The header is the line before the first row. It has as many cells as the row: names, not
    numbers. A line of units below it is joined to its names (`X [mm]`), a comment sign before it is
    removed, and names that are repeated stand behind those above them.
    """
    head = lines[:_MOST_LINES]
    filled = [i for i, line in enumerate(head) if line.strip(" \t;,\r")]
    for position, row in enumerate(filled[1:], start=1):
        for sign in (delimiter,) if delimiter else _DELIMITERS:
            cells = _cells(head[row], sign)
            if len(cells) < 2 or not _is_row(cells):
                continue
            units: list[str] = []
            header = filled[position - 1]
            names = _cells(head[header], sign)
            if position > 1 and len(names) == len(cells) and _all_units(names):
                units, header = names, filled[position - 2]
                names = _cells(head[header], sign)
            names = _uncommented(names, head[header], len(cells), sign)
            above = [_cells(head[i], sign) for i in filled if i < header]
            if len(names) != len(cells):
                names = marker_names([*above, names], len(cells)) or names
            if repeated(names) and _between(head, filled, position, sign):
                continue
            if len(names) != len(cells) or _is_row(names) or len([n for n in names if n]) < 2:
                continue
            names = with_units(joined(names, above[::-1]), [*above, _cells(head[header], sign)])
            result = list(lines)
            before = [i for i in filled if i < header]
            for i in before:
                result[i] = ""
            if units:
                names = [
                    f"{n} [{u.strip('[]()')}]" if u else n
                    for n, u in zip(names, units, strict=True)
                ]
                result[filled[position - 1]] = ""
            if units or names != _cells(head[header], sign):
                quoted = [f'"{n}"' if sign in n else n for n in names]
                result[header] = sign.join(quoted)
            return result, bool(before)
    return lines, False


def _between(head: list[str], filled: list[int], position: int, sign: str) -> bool:
    """Whether a line of numbers is one of a header: no line of numbers follows it."""
    following = filled[position + 1 : position + 2]
    return any(not _is_row(_cells(head[i], sign)) for i in following)


def names_by_number(lines: list[str], delimiter: str | None = None) -> list[str] | None:
    """Names of columns where the first line is a row: c1, c2, … of numbers alone; name x y z of one
    name and three numbers, of which one has decimals; else None.
    """
    first = next((line for line in lines if line.strip(" \t;,\r\ufeff")), "")
    for sign in (delimiter,) if delimiter else _DELIMITERS:
        cells = _cells(first.removeprefix("\ufeff").strip(" \r\n"), sign)
        if len(cells) > 1 and all(map(_NUMBER.fullmatch, cells)):
            return [f"c{k}" for k in range(1, len(cells) + 1)]
        numbers = [cell for cell in cells if _NUMBER.fullmatch(cell)]
        if len(cells) == 4 and numbers == cells[1:] and re.search(r"[.,]", "".join(numbers)):
            return ["name", "x", "y", "z"]
    return None


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return next(split_lines([line], delimiter), [])
    except Exception:  # broken quotes: no row
        return []


def _is_row(cells: list[str]) -> bool:
    """At least half of the cells, and two of them, are numbers."""
    numbers = sum(bool(_NUMBER.fullmatch(cell)) for cell in cells)
    return numbers >= 2 and 2 * numbers >= len([cell for cell in cells if cell])


def _all_units(cells: list[str]) -> bool:
    """A line of units under the names."""
    units = [cell.strip("[]()").lower() for cell in cells if cell not in ("", "-")]
    return len(units) >= 2 and all(unit in UNITS for unit in units)


def _uncommented(names: list[str], line: str, count: int, delimiter: str) -> list[str]:
    """Names of a header behind a comment sign, where they are as many as the cells of a row."""
    match = _COMMENT.match(line)
    if match and match.end() and line.lstrip()[0] in "#%/":
        bare = _cells(line[match.end() :], delimiter)
        return bare if len(bare) == count else names
    return names
