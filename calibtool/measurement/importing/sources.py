"""The bytes of a file → its table: text with a header, SpatialAnalyzer's
points, or an Excel sheet.
"""

import codecs
from dataclasses import dataclass
from typing import Literal, get_args

from calibtool.errors import InputError, UsageError
from calibtool.measurement.importing.excel import ZIP, parse_workbook
from calibtool.measurement.importing.spatial_analyzer import (
    PointList,
    looks_like_points,
    parse_points,
)
from calibtool.tables import Table, parse_table

Format = Literal["table", "spatial-analyzer", "excel"]
FORMATS: tuple[str, ...] = get_args(Format)


@dataclass(frozen=True)
class SourceTable:
    """What was read, how it was understood; `points` where it is a list of points instead of a
    table with a header.
    """

    table: Table
    format: str
    points: PointList | None = None


def read_source(
    data: bytes | str,
    name: str,
    format: str | None = None,
    *,
    delimiter: str | None = None,
    decimal: str | None = None,
    sheet: str | None = None,
    layout: str | None = None,
) -> SourceTable:
    """The table in a file's contents.

    Without `format` the contents tell: a workbook starts as a zip file, a list of points has
    numbers where a header would have names. Raises InputError for contents that are not of the
    format, UsageError for an option that is of another format.
    """
    if format is None and not isinstance(data, str) and data.startswith(ZIP):
        format = "excel"
    if sheet is not None and format != "excel":
        raise UsageError(f"--sheet {sheet}: {name} is no Excel workbook")
    if format == "excel":
        if isinstance(data, str):
            raise UsageError(f"{name}: a workbook is bytes, not text")
        return SourceTable(parse_workbook(data, name, sheet, decimal), format)
    text = data if isinstance(data, str) else _decoded(data, name)
    if format is None:
        format = "spatial-analyzer" if looks_like_points(text) else "table"
    if format == "spatial-analyzer":
        points = parse_points(text, name, layout)
        return SourceTable(points.table, format, points)
    if layout is not None:
        raise UsageError(
            f"--layout {layout}: {name} is no list of points; give --format "
            "spatial-analyzer if it is"
        )
    return SourceTable(parse_table(text, name, delimiter, decimal), format)


def _decoded(data: bytes, name: str) -> str:
    """UTF-8, or UTF-16 by its byte order mark (what Excel calls Unicode text)."""
    encoding = "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8"
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        raise InputError(
            f"{name}: not a UTF-8 text file (byte {error.start + 1}); save it as UTF-8 or "
            "export it as CSV"
        ) from None
