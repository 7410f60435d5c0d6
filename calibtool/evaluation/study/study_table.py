"""The tidy table of a study: one row per run and method, units in the header."""

import csv
import io
import math
from collections.abc import Iterable
from dataclasses import dataclass

from calibtool.errors import InputError
from calibtool.evaluation.metrics import STATISTICS
from calibtool.tables import format_table

Cell = str | int | float | None
Row = tuple[Cell, ...]

OK = "ok"
REDUCTIONS = ("mean", "max", "std")
TEXTS = ("study", "robot", "workspace", "errors", "method", "status")
COUNTS = ("configurations", "fresh", "run", "seed", "networks", "marked")
COLUMNS = (
    *(
        "study",
        "robot",
        "workspace",
        "errors",
        "error_scale",
        "noise_mm",
        "configurations",
        "fresh",
        "run",
        "seed",
    ),
    *("method", "status", "networks", "marked"),
    *(f"position_{s}_mm" for s in STATISTICS),
    *(f"orientation_{s}_mrad" for s in STATISTICS),
    *(f"{part}_{s}_reduction_percent" for part in ("position", "orientation") for s in REDUCTIONS),
)
_FIRST_RESULT = COLUMNS.index("networks")


@dataclass(frozen=True)
class StudyTable:
    """Finished rows in the order of runs and methods; `key` is that of the study's definition."""

    key: str
    rows: tuple[Row, ...]

    def column(self, name: str) -> list[Cell]:
        """One column."""
        place = COLUMNS.index(name)
        return [row[place] for row in self.rows]

    def as_csv(self) -> str:
        """The whole table as CSV text; numbers are written so that they read back exactly."""
        return format_table(COLUMNS, ([_text(cell) for cell in row] for row in self.rows))


def rounded(value: float) -> float:
    """Nine significant digits, so that rounding differences of machines do not show."""
    return float(f"{value:.9g}")


def failed(head: Iterable[Cell], status: str) -> Row:
    """A row without results; head: the cells of a run up to `method`."""
    cells = [*head, status]
    return (*cells, *[None] * (len(COLUMNS) - len(cells)))


def is_table(data: bytes) -> bool:
    """Whether a file's bytes begin like a table that `as_csv` wrote."""
    return data.startswith(",".join(COLUMNS).encode())


def parse_csv(text: str, name: str) -> StudyTable:
    """A table that `as_csv` wrote. Raises InputError for anything else."""
    reader = csv.reader(io.StringIO(text))
    if text.partition("\n")[0].rstrip("\r") != ",".join(COLUMNS):
        raise InputError(
            f"{name}: not a table of calibtool study; choose another name, or overwrite "
            "it with --force"
        )
    next(reader)
    rows = []
    try:
        for cells in reader:
            if len(cells) != len(COLUMNS):
                raise InputError(
                    f"{name}:{reader.line_num}: {len(cells)} cells; expected {len(COLUMNS)}"
                )
            parsed = [_parsed(column, cell) for column, cell in zip(COLUMNS, cells, strict=True)]
            rows.append(checked_row(parsed))
    except ValueError:
        raise InputError(
            f"{name}:{reader.line_num}: a cell is not the number that its column needs"
        ) from None
    except csv.Error as error:
        raise InputError(f"{name}:{reader.line_num}: {error}; check the quotes") from None
    return table_of(rows, name)


def checked_row(cells: object) -> Row:
    """Cells from a file as a row: text, whole numbers that fit 64 bits and finite numbers as the
    columns require.

    None is allowed in columns of results only. Raises ValueError.
    """
    if not isinstance(cells, list | tuple) or len(cells) != len(COLUMNS):
        raise ValueError("no row")
    for k, (column, cell) in enumerate(zip(COLUMNS, cells, strict=True)):
        if column in TEXTS:
            sound = isinstance(cell, str)
        elif cell is None:
            sound = k >= _FIRST_RESULT
        elif column in COUNTS:
            sound = _fits(cell)
        else:
            sound = _fits(cell) or (isinstance(cell, float) and math.isfinite(cell))
        if not sound:
            raise ValueError(f"{column} cannot be that")
    return tuple(cells)


def _fits(cell: object) -> bool:
    return type(cell) is int and -(2**63) <= cell < 2**63


def table_of(rows: list[Row], name: str) -> StudyTable:
    """A table from its rows, which must belong to one study (InputError otherwise)."""
    keys = {str(row[0]) for row in rows}
    if len(keys) != 1:
        raise InputError(f"{name}: holds rows of {len(keys)} studies; expected one")
    return StudyTable(keys.pop(), tuple(rows))


def _parsed(column: str, cell: str) -> Cell:
    if column in TEXTS:
        return cell
    if cell == "" and COLUMNS.index(column) >= _FIRST_RESULT:
        return None
    # Python would take 1_0 and digits of any script for numbers
    if "_" in cell or not cell.isascii():
        raise ValueError(cell)
    return int(cell) if column in COUNTS else float(cell)


def _text(cell: Cell) -> str:
    if cell is None:
        return ""
    return f"{cell:.9g}" if isinstance(cell, float) else str(cell)
