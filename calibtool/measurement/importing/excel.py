"""Sheets of Excel workbooks (.xlsx) as tables; needs openpyxl, the extra `excel`."""

import contextlib
import io
import warnings
from typing import Any
from zipfile import ZipFile

from calibtool.errors import CalibtoolError, InputError, UsageError, near_names
from calibtool.tables import Table, check_header

ZIP = b"PK\x03\x04"  # first bytes of a workbook
_ROOM, _PACKED = 16 << 20, 40  # bytes that a workbook may unpack to: 16 MiB and 40 times its length
_ROWS = 1_048_576  # number of rows that a sheet may have


def parse_workbook(
    data: bytes, name: str, sheet: str | None = None, decimal: str | None = None
) -> Table:
    """The first sheet of a workbook, or the named one, as a table; line numbers are those of the
    sheet.

    Of formulas the stored value is read. Raises UsageError without openpyxl or for an unknown
    sheet, InputError for a file that is no workbook, an empty sheet, a repeated column or a cell
    outside the header's columns.
    """
    try:
        import openpyxl
    except ImportError:
        raise UsageError(
            f"{name}: reading Excel files needs openpyxl; pip install 'calibtool[excel]', or save "
            "the sheet as CSV"
        ) from None
    try:
        _check_size(data, name)
        # openpyxl warns, and prints, about styles and extensions, which are not looked at.
        with warnings.catch_warnings(action="ignore"), contextlib.redirect_stdout(io.StringIO()):
            return _read(
                openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True),
                name,
                sheet,
                decimal,
            )
    except (CalibtoolError, MemoryError):
        raise
    except (
        Exception
    ) as error:  # openpyxl checks little: a damaged workbook fails anywhere and in any way
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"{name}: not a readable Excel workbook: {reason or type(error).__name__}"
        ) from None


def _check_size(data: bytes, name: str) -> None:
    """InputError for a workbook that unpacks to far more than tables do.

    (Python unpacks no more than is stated.)
    """
    with ZipFile(io.BytesIO(data)) as archive:
        size = sum(member.file_size for member in archive.infolist())
    if size > _ROOM + _PACKED * len(data):
        raise InputError(
            f"{name}: a workbook of {len(data)} bytes that unpacks to {size}; save the sheet as CSV"
        )


def _read(book: Any, name: str, sheet: str | None, decimal: str | None) -> Table:
    try:
        names = [found.title for found in book.worksheets]
        if not names:
            raise InputError(f"{name}: a workbook without a sheet of cells")
        if sheet is not None and sheet not in names:
            raise UsageError(f"{name}: no sheet '{sheet}'; {near_names(sheet, names)}")
        chosen = book.worksheets[0 if sheet is None else names.index(sheet)]
        chosen.reset_dimensions()  # some programs write wrong ones
        return _table(chosen.iter_rows(values_only=True), f"{name}[{chosen.title}]", decimal)
    finally:
        book.close()


def _table(cells: Any, name: str, decimal: str | None) -> Table:
    header: list[str] = []
    header_line, rows, lines = 0, [], []
    for line, values in enumerate(cells, start=1):
        if line > _ROWS:
            raise InputError(f"{name}: a row beyond {_ROWS}, the last one of a sheet")
        row = [_text(value) for value in values]
        while row and not row[-1] and (not header or len(row) > len(header)):
            row.pop()
        if not any(row):
            continue
        if not header:
            header, header_line = row, line
            check_header(header, f"{name}:{line}")
            continue
        if len(row) > len(header):
            raise InputError(
                f"{name}:{line}: a cell stands right of the header's {len(header)} columns"
            )
        rows.append(row + [""] * (len(header) - len(row)))
        lines.append(line)
    if not rows:
        raise InputError(
            f"{name}: "
            + ("a header but no rows" if header else "empty; expected a header line and rows")
        )
    if decimal is None:
        decimal = "," if any("," in cell for row in rows for cell in row) else "."
    return Table(name, header, rows, lines, ",", decimal, header_line)


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return repr(value)
    return str(value.isoformat() if hasattr(value, "isoformat") else value).strip()
