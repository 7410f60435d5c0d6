"""Tables with units in their headers: text → rows → numbers, and messages with places."""

import csv
import io
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, repeat
from typing import overload

import numpy as np

from calibtool.errors import InputError, near_names
from calibtool.robot.se3 import Array
from calibtool.units import LARGEST, number_in

_DELIMITERS = ("\t", ";", ",")


_NUMBER = re.compile(r"[+-]?\d+[.,]\d+(?:[eE][+-]?\d+)?|[+-]?\d{5,}", re.ASCII)  # no column's name
_DECIMAL_POINT = re.compile(r"[+-]?\d+\.\d+(?:[eE][+-]?\d+)?", re.ASCII)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?", re.ASCII)
_GROUPED = re.compile(r"[+-]?\d{1,3}(?:[,.' \u00a0\u202f’]\d{3})+(?:[.,]\d+)?", re.ASCII)
_WITH_UNIT = re.compile(
    r"[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?\s*(?:[µu]?m|[mc]m|in|inch|deg|m?rad|grad|°C?|\"|'')",
    re.IGNORECASE,
)
_NOTHING = ("", "-", "--", "n/a", "#n/a", "na", "nan", "none", "null", "missing", "x")
_BLOCK = 20_000  # rows whose cells exist as text objects at one time
_FORMULA = re.compile(r"[\t\r ]*(?:[=@]|[+-](?![\d.,]*(?:[eE][+-]?\d+)?\s*$))", re.ASCII)
LONG_LINE = 100_000  # characters; csv refuses cells a little longer than this


class Lines(Sequence[list[str]]):
    """Rows of cells, split from their lines when used: a million rows fit in memory as text."""

    def __init__(self, lines: list[str], delimiter: str) -> None:
        self._lines, self._delimiter = lines, delimiter

    def __len__(self) -> int:
        return len(self._lines)

    @overload
    def __getitem__(self, index: int) -> list[str]: ...
    @overload
    def __getitem__(self, index: slice) -> list[list[str]]: ...
    def __getitem__(self, index: int | slice) -> list[str] | list[list[str]]:
        if isinstance(index, slice):
            return list(split_lines(self._lines[index], self._delimiter))
        return next(split_lines([self._lines[index]], self._delimiter))

    def __iter__(self) -> Iterator[list[str]]:
        return split_lines(self._lines, self._delimiter)

    def floats(self, rows: slice, columns: Sequence[int], decimal: str) -> Array | None:
        """Some columns of some rows as numbers, quickly; None if a cell is no number below
        LARGEST.
        """
        lines = self._lines[rows]
        if decimal == self._delimiter:  # only in quotes
            return None
        if decimal != ".":
            lines = [line.replace(decimal, ".") for line in lines]
        delimiter = None if self._delimiter == " " else self._delimiter
        try:
            values = np.loadtxt(
                lines,
                delimiter=delimiter,
                usecols=columns,
                comments=None,
                quotechar='"',
                ndmin=2,
                dtype=float,
            )
        except ValueError:
            return None
        return values if len(values) == len(lines) and (np.abs(values) < LARGEST).all() else None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)


def split_lines(lines: Iterable[str], delimiter: str) -> Iterator[list[str]]:
    """Stripped cells of lines; blanks give no empty cells, other delimiters respect quotes."""
    if delimiter == " ":
        return (line.split() for line in lines)
    return ([cell.strip() for cell in row] for row in csv.reader(lines, delimiter=delimiter))


@dataclass(frozen=True)
class Table:
    """Rows of text with their line numbers; `name` is the file's name in messages."""

    name: str
    header: list[str]
    rows: Sequence[list[str]]
    lines: Sequence[int]
    delimiter: str
    decimal: str
    header_line: int = 1

    def __len__(self) -> int:
        return len(self.rows)

    def index(self, column: str) -> int:
        """Position of a column. InputError with near names if there is none."""
        if column not in self.header:
            raise InputError(
                f"{self.name}: no column '{column}'; {near_names(column, self.header)}"
            )
        return self.header.index(column)

    def numbers(self, columns: Sequence[str]) -> Array:
        """The named columns as numbers, (N, len(columns)).

        InputError names the first bad cell by line and column.
        """
        return self._numbers(columns, optional=False)

    def optional_numbers(self, columns: Sequence[str]) -> Array:
        """The same, (N, len(columns)), with NaN where all of the columns are empty in a row."""
        return self._numbers(columns, optional=True)

    def texts(self, column: str) -> list[str]:
        """The cells of one column as they are written."""
        index = self.index(column)
        return [row[index] for row in self.rows]

    def take(self, index: Iterable[int]) -> "Table":
        """The rows at `index`, in that order, with the lines they come from."""
        chosen = [int(i) for i in index]
        return replace(
            self, rows=[self.rows[i] for i in chosen], lines=[self.lines[i] for i in chosen]
        )

    def place(self, row: int) -> str:
        """File and line of a data row (from 0), for messages."""
        return f"{self.name}:{self.lines[row]}"

    def _numbers(self, columns: Sequence[str], optional: bool) -> Array:
        indices = [self.index(column) for column in columns]
        values = np.full((len(self), len(columns)), np.nan)
        for start in range(0, len(self), _BLOCK):
            if isinstance(self.rows, Lines):
                quick = self.rows.floats(slice(start, start + _BLOCK), indices, self.decimal)
                if quick is not None:
                    values[start : start + _BLOCK] = quick
                    continue
            cells = [[row[i] for i in indices] for row in self.rows[start : start + _BLOCK]]
            there = (
                np.array([any(row) for row in cells])
                if optional
                else np.ones(len(cells), dtype=bool)
            )
            if not there.all():
                cells = [row for row, present in zip(cells, there, strict=True) if present]
            rows = start + np.flatnonzero(there)
            values[rows] = self._converted(cells, columns, rows, optional)
        return values

    def _converted(
        self, cells: list[list[str]], columns: Sequence[str], rows: np.ndarray, optional: bool
    ) -> Array:
        points = (
            [[cell.replace(self.decimal, ".") for cell in row] for row in cells]
            if self.decimal != "."
            else cells
        )
        try:
            values = np.array(points, dtype=float).reshape(len(cells), len(columns))
        except ValueError:
            values = None
        if (
            values is None
            or not (np.abs(values) < LARGEST).all()
            or any("_" in cell for row in cells for cell in row)
        ):
            raise self._bad_cell(cells, points, columns, rows, optional)
        return values

    def _bad_cell(
        self,
        cells: list[list[str]],
        points: list[list[str]],
        columns: Sequence[str],
        rows: np.ndarray,
        optional: bool,
    ) -> InputError:
        for row, (texts, spelt) in enumerate(zip(cells, points, strict=True)):
            for column, text, point in zip(columns, texts, spelt, strict=True):
                if np.isnan(number_in(point)):
                    holds = f"holds '{text}'" if text.strip() else "is empty"
                    return InputError(
                        f"{self.place(int(rows[row]))}: column '{column}' {holds}; "
                        f"expected a number{_remedy(text, columns, optional)}"
                    )
        return InputError(f"{self.name}: a cell is not a number")


def _remedy(text: str, columns: Sequence[str], optional: bool) -> str:
    """What to do with a cell that is no number, as the end of a message."""
    if text.strip("'").lower() in _NOTHING:
        if not optional:
            return ""
        return f": where nothing was seen, leave all of {', '.join(columns)} empty"
    if _DECIMAL_COMMA.fullmatch(text):
        return " with a decimal point and no separators of thousands"
    if _GROUPED.fullmatch(text):
        return " without separators of thousands"
    if _WITH_UNIT.fullmatch(text):
        return ": write the unit into the header"
    return ""


def _quoted_decimals(lines: Iterable[str], delimiter: str) -> bool:
    """Whether numbers have decimal commas in quotes between commas: `"12,5","-0,75"`.

    Never where a number has a decimal point, or where all of them may be thousands: `"1,234"`.
    """
    cells = [cell for row in split_lines(lines, delimiter) for cell in row]
    if any(_DECIMAL_POINT.fullmatch(cell) for cell in cells):
        return False
    commas = [cell for cell in cells if _DECIMAL_COMMA.fullmatch(cell)]
    return any(not _GROUPED.fullmatch(cell) for cell in commas)


def parse_table(
    text: str, name: str, delimiter: str | None = None, decimal: str | None = None
) -> Table:
    """A table from text with one header line; empty lines are skipped, a byte order
    mark is dropped.

    delimiter: found in the header (tab, semicolon, comma, otherwise blanks) unless given. decimal:
    '.' or ','; a comma is recognised where it is not the delimiter, or where numbers with it stand
    in quotes. Raises InputError for an empty table, a repeated column or a row of another length.
    """
    return next(read_tables(text_lines(text), name, delimiter, decimal))


def read_tables(
    lines: Iterable[str],
    name: str,
    delimiter: str | None = None,
    decimal: str | None = None,
    batch: int | None = None,
    names: Sequence[str] | None = None,
) -> Iterator[Table]:
    """The same for any number of lines, as tables of `batch` rows under one header; names: of the
    columns, where no line is a header.
    """
    source = iter(lines)
    passed, first = 0, ""
    for line in source:
        passed += 1
        first = line.rstrip("\r\n").removeprefix("\ufeff")
        if first.strip():
            break
    if delimiter is None:
        delimiter = next((d for d in _DELIMITERS if d in first), " ")
    header_line, text, columns = next(_records([(passed, first)], name, delimiter), (0, "", 0))
    if names is not None:
        source, passed = chain([first], source), passed - 1
    while not header_line:  # a line of delimiters alone is an empty one
        following = next(source, None)
        if following is None:
            raise InputError(f"{name}: empty; expected a header line and rows")
        passed += 1
        header_line, text, columns = next(
            _records([(passed, following.rstrip("\r\n"))], name, delimiter), (0, "", 0)
        )
    header = next(split_lines([text], delimiter)) if names is None else list(names)
    check_header(header, f"{name}:{header_line}")
    empty = True
    while taken := list(islice(source, batch)):
        numbers: Sequence[int] = range(passed + 1, passed + 1 + len(taken))
        passed += len(taken)
        kept = taken
        if not _plain(taken, delimiter, columns):
            whole = (
                (number, line.rstrip("\r\n")) for number, line in zip(numbers, taken, strict=True)
            )
            part = list(_records(whole, name, delimiter))
            for line_number, _, cells in part:
                if cells != columns:
                    raise InputError(
                        f"{name}:{line_number}: {cells} cells, but the header has {columns} columns"
                    )
            if not part:
                continue
            numbers, kept = [number for number, _, _ in part], [text for _, text, _ in part]
        if decimal is None:
            commas = any("," in text for text in kept)
            if delimiter == ",":
                commas = any('"' in text for text in kept) and _quoted_decimals(kept, delimiter)
            decimal = "," if commas else "."
        empty = False
        yield Table(name, header, Lines(kept, delimiter), numbers, delimiter, decimal, header_line)
    if empty:
        raise InputError(f"{name}: a header but no rows")


def _plain(lines: list[str], delimiter: str, columns: int) -> bool:
    """Whether all lines are rows of as many cells, without quotes."""
    if (
        delimiter == " "
        or columns < 2
        or set(map(str.count, lines, repeat(delimiter))) != {columns - 1}
    ):
        return False
    if max(map(len, lines)) >= LONG_LINE or any('"' in line for line in lines):
        return False
    return all(map(str.strip, lines, repeat(delimiter + " \t\r\n\f\v")))


def text_lines(text: str) -> list[str]:
    """Lines of a text without a byte order mark, whatever mixture of line ends it has."""
    return text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n").split("\n")


def check_header(header: Sequence[str], place: str) -> None:
    """InputError for no header: XML, a row of numbers, a name that is repeated."""
    if header and header[0].lstrip().startswith("<"):
        raise InputError(f"{place}: an XML file; expected a table with a header line")
    filled = [cell.strip() for cell in header if cell.strip()]
    if filled and sum(bool(_NUMBER.fullmatch(cell)) for cell in filled) > len(filled) / 2:
        raise InputError(
            f"{place}: the first line holds numbers; expected a header line that names the columns "
            "with their units, such as j1_deg"
        )
    repeated = [column for column, count in Counter(header).items() if column and count > 1]
    if repeated:
        raise InputError(f"{place}: column '{min(repeated)}' appears more than once")


def _records(
    lines: Iterable[tuple[int, str]], name: str, delimiter: str
) -> Iterator[tuple[int, str, int]]:
    """Number, text and number of cells of every line that is not empty.

    InputError for broken quotes.
    """
    if delimiter == " ":
        yield from ((number, line, len(line.split())) for number, line in lines if line.strip())
        return
    empty = delimiter + " \t\f\v"
    for number, line in lines:
        if '"' not in line and len(line) < LONG_LINE:
            if line.strip(empty):
                yield number, line, line.count(delimiter) + 1
            continue
        reader = csv.reader([line, ""], delimiter=delimiter)
        try:
            cells = next(reader)
        except csv.Error as error:
            raise InputError(f"{name}:{number}: {error}; check the quotes") from None
        if reader.line_num > 1 or line.count('"') % 2:
            raise InputError(
                f"{name}:{number}: a quote is not closed in its line; expected one row per line"
            )
        if any(cell.strip() for cell in cells):
            yield number, line, len(cells)


def format_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """CSV text, comma separated, one line feed per row."""
    return "\n".join([*csv_lines([header, *rows]), ""])


def csv_lines(rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Rows of cells as lines of CSV, without line ends: the one place where CSV is written.

    A text that a spreadsheet would take for a formula (it begins with = @ + or -, and is no number)
    gets an apostrophe in front, by which spreadsheets know text.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    for row in rows:
        writer.writerow([f"'{cell}" if _FORMULA.match(cell) else cell for cell in row])
        yield out.getvalue()[:-1]
        out.seek(0)
        out.truncate()


def number(value: float) -> str:
    """A number with all the digits that matter (15), empty for NaN."""
    return "" if np.isnan(value) else f"{value:.15g}"
