"""Denavit-Hartenberg parameters: from a table, and to the placements of a chain."""

import csv
import math
import re
from collections.abc import Sequence
from typing import Literal, NamedTuple, cast

from calibtool.errors import InputError
from calibtool.robot.constant_placements import Step
from calibtool.units import ANGLES, LENGTHS, TO_SI, number_in

DhConvention = Literal["standard", "modified"]
DH_CONVENTIONS = ("standard", "modified")

_UNITS = {"a": LENGTHS, "alpha": ANGLES, "d": LENGTHS, "theta": ANGLES}
_OFFSETS = {"theta": ANGLES, "d": LENGTHS}  # what a column `offset` is added to, by its unit
_LETTERS = str.maketrans({"α": "alpha", "θ": "theta", "ϑ": "theta", "°": "deg"})
_NAMES = {"i": "joint", "j": "joint", "link": "joint", "axis": "joint", "#": "joint"}
_WORDS = {
    "type": {"r": "revolute", "p": "prismatic", "t": "prismatic"},
    "convention": {"dh": "standard", "distal": "standard", "classic": "standard"}
    | {"mdh": "modified", "craig": "modified", "proximal": "modified"},
}
_ABOUT = {"joint", "type", "convention", "lower", "upper"}
_PI = re.compile(r"([+-]?)(?:(\d+(?:\.\d*)?)\s*\*?\s*)?(?:pi|π)(?:\s*/\s*(\d+(?:\.\d*)?))?", re.I)


class DhRow(NamedTuple):
    """One row: a, d in m, alpha, theta in rad.

    theta is added to the value of a revolute joint, d to that of a prismatic one.
    """

    a: float
    alpha: float
    d: float
    theta: float


class DhTable(NamedTuple):
    """The joints' rows, and constant ones before and behind them.

    prismatic: per joint, None where the table does not say; convention likewise. limits: (lower,
    upper) in rad or m by the number of the joint, from 0.
    """

    joints: list[DhRow]
    base: list[DhRow]
    tool: list[DhRow]
    prismatic: list[bool] | None = None
    convention: DhConvention | None = None
    limits: dict[int, tuple[float, float]] | None = None


class DhText(NamedTuple):
    """A table as it is written: columns, cells, and the place of each row for messages."""

    name: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    places: Sequence[str]

    def texts(self, column: str) -> list[str]:
        """The cells of a column, none where there is no such column."""
        if column not in self.header:
            return []
        index = list(self.header).index(column)
        return [row[index] for row in self.rows]

    def numbers(self, column: str) -> list[float]:
        """The cells of a column as numbers. InputError with place and column for what is none."""
        found = []
        for place, text in zip(self.places, self.texts(column), strict=True):
            value = number_in(text)
            if math.isnan(value) and column.endswith("_rad"):
                value = _of_pi(text)
            if math.isnan(value):
                holds = f"holds '{text}'" if text.strip() else "is empty"
                raise InputError(f"{place}: column '{column}' {holds}; expected a number")
            found.append(value)
        return found


def dh_columns(header: Sequence[str]) -> list[str] | None:
    """The columns of a, alpha, d, theta in a header, with units; None where one is missing."""
    found = [
        next((f"{name}_{unit}" for unit in units if f"{name}_{unit}" in header), None)
        for name, units in _UNITS.items()
    ]
    return [column for column in found if column] if all(found) else None


def _of_pi(text: str) -> float:
    """The number that `pi/2`, `-π` or `3*pi/4` is; NaN for another text."""
    match = _PI.fullmatch(text.strip())
    if match is None:
        return math.nan
    value = float(match[2] or 1) * math.pi / float(match[3] or 1)
    return -value if match[1] == "-" else value


def _column(cell: str) -> str:
    """A column's name in small Latin letters, its unit behind `_`: `θ [°]` is `theta_deg`."""
    words = re.findall(r"[^\s\[\](){}_]+", cell.lower().translate(_LETTERS))
    name = "_".join({"degrees": "deg", "radians": "rad"}.get(word, word) for word in words)
    return _NAMES.get(name, name)


def is_dh(text: str) -> bool:
    """Whether a text starts like a table of DH parameters, with units or without, after lines of
    comment.
    """
    lines = (line for line in text.removeprefix("\ufeff").splitlines() if line.strip())
    first = next((line for line in lines if not line.startswith("#")), "")
    cells = re.split(r"[,;\t]", first.replace('"', ""))
    cells = cells if len(cells) > 1 else first.split()
    names = list(map(_column, cells))
    return dh_columns(names) is not None or set(_UNITS) <= set(names)


def dh_text(text: str, name: str) -> DhText:
    """A CSV of DH parameters; lines that start with # are skipped.

    InputError for a repeated column, or a row with another number of cells.
    """
    lines = text.removeprefix("\ufeff").splitlines()
    filled = [k for k, line in enumerate(lines) if line.strip(",;\t ") and not line.startswith("#")]
    first = lines[filled[0]] if filled else ""
    delimiter = next((mark for mark in "\t;," if mark in first), " ")
    rows = []
    for k in filled:
        line = lines[k].replace(",", ".") if delimiter == ";" else lines[k]
        words = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
        rows.append([cell.strip() for cell in next(words)])
        if len(rows[-1]) != len(rows[0]):
            raise InputError(
                f"{name}:{k + 1}: {len(rows[-1])} cells, but the header has {len(rows[0])}"
            )
    header = list(map(_column, rows[0])) if rows else []
    if len(set(header)) < len(header):
        raise InputError(f"{name}: a column is there twice: {', '.join(header)[:80]}")
    return DhText(name, header, rows[1:], [f"{name}:{k + 1}" for k in filled[1:]])


def read_dh(table: DhText) -> DhTable:
    """DH parameters from columns `a_mm alpha_deg d_mm theta_deg` (or `_m`, `_rad`).

    A column `joint` numbers the rows, 1 to n; a first row `base` and a last row `tool` are
    constant. A column `offset_deg` (or `_rad`) is added to theta, `offset_mm` (or `_m`) to d. A
    column `type` names the kind of the joints, revolute or prismatic, `lower` and `upper` their
    limits in deg or mm, `convention` that of the table. Raises InputError for missing columns, bad
    cells, rows that are not in order, or numbers in a column that is not known, such as a β.
    """
    columns = dh_columns(table.header)
    if columns is None:
        raise InputError(
            f"{table.name}: no DH parameters; expected the columns joint a_mm alpha_deg d_mm "
            "theta_deg"
        )
    factors = [TO_SI[column.rsplit("_", 1)[1]] for column in columns]
    values = zip(*(table.numbers(column) for column in columns), strict=True)
    rows = [
        DhRow(*(value * factor for value, factor in zip(row, factors, strict=True)))
        for row in values
    ]
    rows = _with_offsets(table, rows, columns)
    count = len(rows)
    labels = table.texts("joint") or [str(k + 1) for k in range(count)]
    first = int(labels[:1] == ["base"])
    last = count - int(labels[first:][-1:] == ["tool"])
    for k, label in enumerate(labels[first:last], start=1):
        if label != str(k):
            raise InputError(
                f"{table.places[first + k - 1]}: joint '{label}'; expected {k}: the joints in "
                "order, before them a row 'base' and behind them a row 'tool' if there are any"
            )
    kinds = _one_of(table, "type", ("revolute", "prismatic"), first, last)
    conventions = set(_one_of(table, "convention", DH_CONVENTIONS, 0, count))
    if len(conventions) > 1:
        raise InputError(f"{table.name}: the column 'convention' holds both of them; expected one")
    return DhTable(
        rows[first:last],
        rows[:first],
        rows[last:],
        [kind == "prismatic" for kind in kinds] or None,
        cast("DhConvention | None", next(iter(conventions), None)),
        _limits(table, [kind == "prismatic" for kind in kinds], first, last),
    )


def _with_offsets(table: DhText, rows: list[DhRow], columns: list[str]) -> list[DhRow]:
    """Rows with the columns `offset_…`; InputError for columns of other numbers."""
    added = {
        f"{name}_{unit}": (key, TO_SI[unit])
        for key, units in _OFFSETS.items()
        for unit in units
        for name in ("offset", f"{key}_offset")
    }
    for column in table.header:
        if column in added:
            key, factor = added[column]
            rows = [
                row._replace(**{key: getattr(row, key) + offset * factor})
                for row, offset in zip(rows, table.numbers(column), strict=True)
            ]
        elif column not in columns and column not in _ABOUT and _counts(table.texts(column)):
            raise InputError(
                f"{table.name}: the column '{column}' is not known in a table of DH parameters; "
                "known are a alpha d theta offset (with units), joint, type, lower, upper, "
                "convention; leave it out if it says nothing of the geometry"
            )
    return rows


def _counts(texts: Sequence[str]) -> bool:
    """Whether cells hold a number that is not zero."""

    def number(text: str) -> float:
        try:
            return float(text)
        except ValueError:
            return _of_pi(text)

    return any(abs(number(text)) > 0 for text in texts)


def _limits(
    table: DhText, slides: list[bool], first: int, last: int
) -> dict[int, tuple[float, float]] | None:
    """Limits in rad or m by the number of the joint, from columns `lower` and `upper`."""
    if not {"lower", "upper"} <= set(table.header):
        return None
    joints = table._replace(rows=table.rows[first:last], places=table.places[first:last])
    ends = zip(joints.numbers("lower"), joints.numbers("upper"), strict=True)
    factors = [TO_SI["mm" if slide else "deg"] for slide in slides or [False] * (last - first)]
    return {
        j: (low * factor, high * factor)
        for j, ((low, high), factor) in enumerate(zip(ends, factors, strict=True))
    }


def _one_of(table: DhText, column: str, known: tuple[str, ...], first: int, last: int) -> list[str]:
    """Cells of a column, each of them one of the known words; InputError otherwise."""
    words = _WORDS[column]
    cells = [words.get(cell.lower(), cell.lower()) for cell in table.texts(column)[first:last]]
    for place, cell in zip(table.places[first:], cells, strict=False):
        if cell not in known:
            raise InputError(f"{place}: {column} '{cell}'; expected {' or '.join(known)}")
    return cells


def steps_of(table: DhTable, convention: DhConvention) -> list[list[Step]]:
    """The n + 1 products of placements of `chain_of` for a DH table.

    standard (distal): row j is Rz(θ_j + q_j) Tz(d_j) Tx(a_j) Rx(α_j). modified (Craig, proximal):
    row j, which holds a_{j−1} and α_{j−1}, is Tx(a) Rx(α) Rz(θ_j + q_j) Tz(d_j).
    """
    steps: list[list[Step]] = [[]]
    for row in table.base:
        steps[-1] += [step for part in _parts(row, convention) for step in part]
    for row in table.joints:
        before, behind = _parts(row, convention)
        steps[-1] += before
        steps.append(behind)
    for row in table.tool:
        steps[-1] += [step for part in _parts(row, convention) for step in part]
    return steps


def _parts(row: DhRow, convention: DhConvention) -> tuple[list[Step], list[Step]]:
    """Placements of a row before and after the joint's own motion about z."""
    if convention == "standard":
        return [Step(rpy=(0.0, 0.0, row.theta))], [Step((row.a, 0.0, row.d), (row.alpha, 0.0, 0.0))]
    return [
        Step((row.a, 0.0, 0.0), (row.alpha, 0.0, 0.0)),
        Step((0.0, 0.0, row.d), (0.0, 0.0, row.theta)),
    ], []
