"""Columns of a pose as a matrix: r11 … r33, T_14, m00 … m23, nx ny nz ox …, pose[0] … pose[15]."""

import re
from collections.abc import Sequence

from calibtool.errors import InputError
from calibtool.measurement.importing.spelling import spelt, split_unit, with_unit
from calibtool.robot.orientation import orthogonal
from calibtool.robot.se3 import Array
from calibtool.tables import Table

MATRIX = [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]  # row by row
_INDEXED = re.compile(r"(.*?) ?([0-4]) ?([0-4])")
_LETTERS = re.compile(r"(.*?) ?\b([nosa]) ?([xyz])")  # approach vectors: n, o (or s), a
_FLAT = re.compile(r"(.*?) ?(\d{1,2})")
_LONGEST = 60  # characters that such a name may have
_ASKED = {"nominal", "nom", "soll", "cmd", "command", "commanded", "design", "target", "desired"}

_Cells = dict[tuple[int, int], str]  # columns by row and column of the matrix, from zero


def matrix_names(table: Table, columns: Sequence[str]) -> dict[str, str]:
    """The meaning of columns: `r11` … `r33`, and `x y z` with their unit where the matrix holds
    them.

    Only numbers that are a rotation in most rows are accepted. The order of 12 or 16 numbered
    columns is found by their values. Raises InputError where there are two sets of such columns.
    """
    short = [column for column in columns if len(column) <= _LONGEST]
    found = [m for m in (*_indexed(short), *_lettered(short)) if _rotates(table, m)]
    found = found or [m for m in _numbered(table, short) if _rotates(table, m)]
    measured = [m for m in found if not set(spelt(m[0, 0]).split()) & _ASKED] or found
    if not measured:
        return {}
    if len(measured) > 1:
        raise InputError(
            f"{table.name}:{table.header_line}: more than one set of columns may be the measured "
            f"pose, those of {' and of '.join(repr(m[0, 0]) for m in measured)}; map the columns "
            "with --columns MAP.toml"
        )
    cells = measured[0]
    meant = {cells[i, j]: f"r{i + 1}{j + 1}" for i in range(3) for j in range(3)}
    place = [cells.get((i, 3)) for i in range(3)]
    if None in place:
        place = _place_beside(columns)
    for axis, column in zip("xyz", place, strict=True):
        if column is not None:
            meant[column] = with_unit(axis, split_unit(column)[1])
    return meant


def _place_beside(columns: Sequence[str]) -> list[str | None]:
    """Columns t1 t2 t3 (p1 p2 p3) of the position beside a rotation of nine."""
    names = {re.sub(r"[ \[\](){}]", "", spelt(column)): column for column in columns}
    for word in ("t", "p", "trans", "translation", "pos"):
        for first in (1, 0):
            three = [names.get(f"{word}{first + k}") for k in range(3)]
            if None not in three:
                return three
    return [None] * 3


def _indexed(columns: Sequence[str]) -> list[_Cells]:
    """r11 … r33, T_14, m00 … m23, R(1,1), M[0][3]: counted from one, or from zero."""
    groups = _groups(columns, _INDEXED)
    found = []
    for cells in groups.values():
        first = int(not any("0" in key for key in cells))
        shifted = {(int(i) - first, int(j) - first): column for (i, j), column in cells.items()}
        found.append(shifted)
    return found


def _lettered(columns: Sequence[str]) -> list[_Cells]:
    """nx ny nz ox oy oz ax ay az: the columns of the rotation."""
    return [
        {("xyz".index(axis), {"n": 0, "a": 2}.get(letter, 1)): c for (letter, axis), c in g.items()}
        for g in _groups(columns, _LETTERS).values()
    ]


def _numbered(table: Table, columns: Sequence[str]) -> list[_Cells]:
    """12 or 16 numbered columns, row by row or column by column."""
    found = []
    for cells in _groups(columns, _FLAT).values():
        numbers = sorted((int(key[0]), column) for key, column in cells.items())
        count, first = len(numbers), numbers[0][0]
        if count not in (12, 16) or first > 1 or numbers[-1][0] - first != count - 1:
            continue
        names = [column for _, column in numbers]
        wide = {(k // 4, k % 4): name for k, name in enumerate(names)}
        rows = count // 4
        tall = {(k % rows, k // rows): name for k, name in enumerate(names)}
        found += [m for m in (wide, tall) if count == 12 or _ends(table, m)]
    return found


def _groups(columns: Sequence[str], pattern: re.Pattern[str]) -> dict[str, dict]:  # type: ignore[type-arg]
    """Columns by what their names begin with, then by the rest of the pattern's groups."""
    found: dict[str, dict[tuple[str, ...], str]] = {}
    for column in columns:
        name = " ".join(re.sub(r"[\[\](){},;]", " ", spelt(column)).split())
        if match := pattern.fullmatch(name):
            found.setdefault(match[1], {})[match.groups()[1:]] = column
    return found


def _values(table: Table, names: Sequence[str]) -> Array | None:
    """Numbers (N, k) of columns; None where a cell is none."""
    try:
        return table.numbers(list(names))
    except InputError:
        return None


def _rotates(table: Table, cells: _Cells) -> bool:
    """Whether the matrix is complete and, mirrored or not, a rotation in most of the rows."""
    wanted = [(i, j) for i in range(3) for j in range(3)]
    if any(cell not in cells for cell in wanted):
        return False
    values = _values(table, [cells[cell] for cell in wanted])
    return values is not None and bool(orthogonal(values).mean() > 0.5)


def _ends(table: Table, cells: _Cells) -> bool:
    """Whether the fourth row is 0 0 0 1."""
    values = _values(table, [cells[3, j] for j in range(4)])
    return values is not None and bool((values == [0.0, 0.0, 0.0, 1.0]).all())
