"""Tables with units in their headers: reading text into rows, rows into numbers, and messages that name line and column."""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress, islice

import numpy as np
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError, near_names
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array
from calibtool.units import TO_SI, joint_and_factor, joint_column

_DELIMITERS = ("\t", ";", ",")


@dataclass(frozen=True)
class Table:
    """Rows of text with their line numbers; `name` is the file's name in messages."""

    name: str
    header: list[str]
    rows: list[list[str]]
    lines: list[int]
    delimiter: str
    decimal: str
    header_line: int = 1

    def __len__(self) -> int:
        return len(self.rows)

    def index(self, column: str) -> int:
        """Position of a column. InputError with near names if there is none."""
        if column not in self.header:
            raise InputError(f"{self.name}: no column '{column}'; {near_names(column, self.header)}")
        return self.header.index(column)

    def numbers(self, columns: Sequence[str]) -> Array:
        """The named columns as numbers, (N, len(columns)). InputError names the first bad cell by line and column."""
        indices = [self.index(column) for column in columns]
        whole = indices == list(range(len(self.header)))
        cells = self.rows if whole else [[row[i] for i in indices] for row in self.rows]
        if self.decimal != ".":
            cells = [[cell.replace(self.decimal, ".") for cell in row] for row in cells]
        try:
            values = np.array(cells, dtype=float).reshape(len(cells), len(columns))
        except ValueError:
            values = None
        if values is None or not np.isfinite(values).all() or any("_" in "".join(row) for row in cells):
            raise self._bad_cell(cells, columns)
        return values

    def optional_numbers(self, columns: Sequence[str]) -> Array:
        """The same with NaN where all of the columns are empty in a row."""
        indices = [self.index(column) for column in columns]
        there = np.array([any(row[i] for i in indices) for row in self.rows])
        part = replace(
            self,
            rows=[row for row, keep in zip(self.rows, there, strict=True) if keep],
            lines=[line for line, keep in zip(self.lines, there, strict=True) if keep],
        )
        values = np.full((len(self.rows), len(columns)), np.nan)
        values[there] = part.numbers(columns)
        return values

    def place(self, row: int) -> str:
        """File and line of a data row (from 0), for messages."""
        return f"{self.name}:{self.lines[row]}"

    def _bad_cell(self, cells: list[list[str]], columns: Sequence[str]) -> InputError:
        for row, texts in enumerate(cells):
            for column, text in zip(columns, texts, strict=True):
                try:
                    finite = "_" not in text and np.isfinite(float(text))  # Python would read 1_0 as ten
                except ValueError:
                    finite = False
                if not finite:
                    holds = f"holds '{self.rows[row][self.index(column)]}'" if text.strip() else "is empty"
                    return InputError(f"{self.place(row)}: column '{column}' {holds}; expected a number")
        return InputError(f"{self.name}: a cell is not a number")


def parse_table(text: str, name: str, delimiter: str | None = None, decimal: str | None = None) -> Table:
    """A table from text with one header line; empty lines are skipped, a byte order mark is dropped.

    delimiter: found in the header (tab, semicolon, comma, otherwise blanks) unless given. decimal: '.' or ','; a comma is
    recognised only where it is not the delimiter. Raises InputError for an empty table, a repeated column or a row of
    another length.
    """
    text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    return next(read_tables(text.split("\n"), name, delimiter, decimal))


def read_tables(
    lines: Iterable[str], name: str, delimiter: str | None = None, decimal: str | None = None, batch: int | None = None
) -> Iterator[Table]:
    """The same from any number of lines, as tables of `batch` rows (all of them unless given) under one header."""
    numbered = ((number, line.rstrip("\n")) for number, line in enumerate(lines, start=1))
    filled = ((number, line) for number, line in numbered if line.strip())
    header_line, first = next(filled, (0, ""))
    if not header_line:
        raise InputError(f"{name}: empty; expected a header line and rows")
    first = first.removeprefix("\ufeff")
    if delimiter is None:
        delimiter = next((d for d in _DELIMITERS if d in first), " ")
    header = _cells([(header_line, first)], name, delimiter)[0]
    repeated = {column for column in header if column and header.count(column) > 1}
    if repeated:
        raise InputError(f"{name}:{header_line}: column '{min(repeated)}' appears more than once")
    empty = True
    while part := list(islice(filled, batch)):
        rows = _cells(part, name, delimiter)
        there = [any(row) for row in rows]  # a line of delimiters alone is an empty one
        if not all(there):
            rows, part = list(compress(rows, there)), list(compress(part, there))
            if not rows:
                continue
        for (line, _), row in zip(part, rows, strict=True):
            if len(row) != len(header):
                raise InputError(f"{name}:{line}: {len(row)} cells, but the header has {len(header)} columns")
        if decimal is None:
            decimal = "," if delimiter != "," and any("," in cell for row in rows for cell in row) else "."
        empty = False
        yield Table(name, header, rows, [line for line, _ in part], delimiter, decimal, header_line)
    if empty:
        raise InputError(f"{name}: a header but no rows")


def _cells(lines: list[tuple[int, str]], name: str, delimiter: str) -> list[list[str]]:
    """Stripped cells of every line. InputError for broken quotes."""
    if delimiter == " ":
        return [line.split() for _, line in lines]
    rows = []
    for number, line in lines:
        if '"' in line:
            rows.append(_quoted(number, line, name, delimiter))
        elif " " in line or "\t" in line:
            rows.append([cell.strip() for cell in line.split(delimiter)])
        else:
            rows.append(line.split(delimiter))
    return rows


def _quoted(number: int, line: str, name: str, delimiter: str) -> list[str]:
    if line.count('"') % 2:
        raise InputError(f"{name}:{number}: a quote is not closed in its line; expected one row per line")
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    except csv.Error as error:
        raise InputError(f"{name}:{number}: {error}; check the quotes") from None


def format_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """CSV text, comma separated, one line feed per row."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return out.getvalue()


def number(value: float) -> str:
    """A number with all the digits that matter (15), empty for NaN."""
    return "" if np.isnan(value) else f"{value:.15g}"


# --- joint positions ------------------------------------------------------------------------------------------------


def joint_columns_of(table: Table, robot: Robot) -> list[str] | None:
    """The header's joint columns in the order of the joints; None when it has none at all. InputError if some lack."""
    found: dict[int, str] = {}
    for column in table.header:
        if joint_column(column) is None:
            continue
        index, _ = joint_and_factor(column, robot.prismatic, f"{table.name}:{table.header_line}")
        if index in found:
            raise InputError(f"{table.name}: joint {index + 1} has two columns, '{found[index]}' and '{column}'")
        found[index] = column
    if not found:
        return None
    missing = [robot.joint_columns[i] for i in range(robot.n) if i not in found]
    if missing:
        raise InputError(f"{table.name}: no column {', '.join(missing)}; {robot.name} has {robot.n} joints")
    return [found[i] for i in range(robot.n)]


def joint_positions(table: Table, robot: Robot, columns: Sequence[str], units: Sequence[str]) -> Array:
    """Joint positions (N, n) in rad or m from columns in joint order, each with its unit.

    Raises InputError for radian columns whose values can only be degrees.
    """
    q = table.numbers(columns) * np.array([TO_SI[unit] for unit in units])
    for j, unit in enumerate(units):
        bound = 2 * max(np.pi, abs(robot.lower[j]), abs(robot.upper[j]))
        if unit == "rad" and np.abs(q[:, j]).max() > bound:
            row = int(np.argmax(np.abs(q[:, j]) > bound))
            raise InputError(
                f"{table.place(row)}: column '{columns[j]}' holds {q[row, j]:g} rad, which looks like degrees; "
                f"name the column j{j + 1}_deg, or give its unit with --columns"
            )
    return q


def joints_from_header(table: Table, robot: Robot) -> tuple[Array, list[str]] | None:
    """Joint positions (N, n) and their columns by the header's names, None when the header has no joint columns."""
    columns = joint_columns_of(table, robot)
    if columns is None:
        return None
    units = [column.split("_")[1] for column in columns]
    return joint_positions(table, robot, columns, units), columns


# --- poses ----------------------------------------------------------------------------------------------------------

_ORIENTATIONS = {
    "quaternion": ("qw", "qx", "qy", "qz"),
    "rotation vector": ("rx_rad", "ry_rad", "rz_rad"),
    "roll, pitch, yaw": ("roll_deg", "pitch_deg", "yaw_deg"),
}


def pose_columns_of(table: Table) -> tuple[list[str], list[str]] | None:
    """Position and orientation columns (`x_mm …`, one of the three orientation forms); None when a part is missing."""
    for unit in ("mm", "m"):
        position = [f"{axis}_{unit}" for axis in "xyz"]
        if all(column in table.header for column in position):
            break
    else:
        return None
    present = [list(c) for c in _ORIENTATIONS.values() if all(column in table.header for column in c)]
    if len(present) > 1:
        raise InputError(f"{table.name}: two orientations, {present[0]} and {present[1]}; keep one")
    return (position, present[0]) if present else None


def poses_from_header(table: Table) -> tuple[Array, list[str]] | None:
    """Poses (N, 4, 4) in metres and their columns by the header's names, None when the header has no complete pose."""
    found = pose_columns_of(table)
    if found is None:
        return None
    position, orientation = found
    T = np.zeros((len(table), 4, 4))
    T[:, 3, 3] = 1.0
    T[:, :3, 3] = table.numbers(position) * TO_SI[position[0].split("_")[1]]
    values = table.numbers(orientation)
    if len(orientation) == 4:
        lengths = np.linalg.norm(values, axis=-1)
        wrong = np.abs(lengths - 1.0) > 1e-3
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(f"{table.place(row)}: quaternion of length {lengths[row]:.4g}; expected 1")
        rotation = Rotation.from_quat(values, scalar_first=True)
    elif orientation[0] == "rx_rad":
        rotation = Rotation.from_rotvec(values)
    else:
        rotation = Rotation.from_euler("xyz", values, degrees=True)  # lower case: fixed axes
    T[:, :3, :3] = rotation.as_matrix()
    return T, [*position, *orientation]
