"""The bytes of a file → its table: text with a header, SpatialAnalyzer's points, Excel."""

import re
from dataclasses import dataclass
from typing import Literal, get_args

from calibtool.errors import InputError, UsageError
from calibtool.measurement.importing.encoding import decoded
from calibtool.measurement.importing.excel import ZIP, parse_workbook
from calibtool.measurement.importing.preamble import names_by_number, without_preamble
from calibtool.measurement.importing.spatial_analyzer import (
    PointList,
    looks_like_points,
    parse_points,
)
from calibtool.tables import Table, read_tables, text_lines

Format = Literal["table", "spatial-analyzer", "excel"]
_OTHERS = {
    "a JSON file": re.compile(r"\s*(?:\{\s*\"|\[\s*[\[{])"),
    "an XML or HTML file": re.compile(r"\s*<[?!A-Za-z]"),
}
_MINUS = re.compile(r"\u2212(?=[\d.,])")  # what spreadsheets of some languages write
FORMATS: tuple[str, ...] = get_args(Format)


@dataclass(frozen=True)
class SourceTable:
    """The table of a file and how it was read; `points` if it is a list of points instead of a
    table with a header.

    notes: remarks on how it was read.
    """

    table: Table
    format: str
    points: PointList | None = None
    notes: tuple[str, ...] = ()


def read_source(
    data: bytes | str,
    name: str,
    format: str | None = None,
    *,
    delimiter: str | None = None,
    decimal: str | None = None,
    sheet: str | None = None,
    layout: str | None = None,
    encoding: str | None = None,
) -> SourceTable:
    """The table in a file's contents. Without `format` the contents decide: a workbook is a zip
    file, a list of points has numbers where a header would have names.

    Raises InputError for contents that are not of the format, UsageError for an option of another
    format.
    """
    if format is None and not isinstance(data, str) and data.startswith(ZIP):
        format = "excel"
    if sheet is not None and format != "excel":
        raise UsageError(f"--sheet {sheet}: {name} is no Excel workbook")
    if format == "excel":
        if isinstance(data, str):
            raise UsageError(f"{name}: a workbook is bytes, not text")
        return SourceTable(parse_workbook(data, name, sheet, decimal), format)
    text, found = (data, None) if isinstance(data, str) else decoded(data, name, encoding)
    if other := next((kind for kind, begins in _OTHERS.items() if begins.match(text)), None):
        raise InputError(f"{name}: {other}; expected a table (CSV, Excel) or a list of points")
    text = _MINUS.sub("-", text)
    notes: tuple[str, ...] = ()
    if found:
        notes = (f"{name}: not UTF-8, read as {found}; --encoding says otherwise",)
    if format is None:
        format = "spatial-analyzer" if looks_like_points(text) else "table"
    if format == "spatial-analyzer":
        points = parse_points(text, name, layout)
        return SourceTable(points.table, format, points, notes)
    if layout is not None:
        raise UsageError(
            f"--layout {layout}: {name} is no list of points; give --format spatial-analyzer if it "
            "is"
        )
    lines, skipped = without_preamble(text_lines(text), delimiter)
    names = names_by_number(lines, delimiter)
    table = next(read_tables(lines, name, delimiter, decimal, names=names))
    if names is not None:
        notes += (
            f"{name}: no header; its columns are called {names[0]} … {names[-1]} "
            "(--columns MAP.toml)",
        )
    if skipped:
        notes += (
            f"{name}: the header is line {table.header_line}, the lines before it are not used",
        )
    return SourceTable(table, format, notes=notes)
