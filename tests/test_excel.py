"""Workbooks: a sheet is the same table as its CSV; what cannot be read is said in one line."""

import datetime
import io
import sys

import numpy as np
import pytest

from calibtool.errors import InputError, UsageError
from calibtool.measurement.importing.excel import parse_workbook
from calibtool.measurement.importing.sources import read_source

openpyxl = pytest.importorskip(
    "openpyxl", reason="openpyxl is not installed; pip install 'calibtool[excel]'"
)


def workbook(**sheets: list[list[object]]) -> bytes:
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


VALUES = np.random.default_rng(1).normal(size=(6, 3)).round(14)  # openpyxl writes 16 digits, not 17
ROWS: list[list[object]] = [["a", "b", "c"], *VALUES.tolist()]


def test_numbers_arrive_to_the_last_digit() -> None:
    assert np.array_equal(
        parse_workbook(workbook(one=ROWS), "w.xlsx").numbers(["a", "b", "c"]), VALUES
    )


def test_the_first_sheet_or_the_named_one() -> None:
    data = workbook(one=ROWS, two=[["d"], [5]])
    assert parse_workbook(data, "w.xlsx").header == ["a", "b", "c"]
    assert parse_workbook(data, "w.xlsx", "two").numbers(["d"]).tolist() == [[5.0]]
    with pytest.raises(UsageError, match="no sheet 'Two'; did you mean two"):
        parse_workbook(data, "w.xlsx", "Two")


def test_empty_rows_and_columns_do_not_shift_the_row_that_is_named() -> None:
    data = workbook(one=[[], ["a", "b", None], [1, 2], [None, None, None], [3, "n/a"]])
    table = parse_workbook(data, "w.xlsx")
    assert (table.header, table.lines) == (["a", "b"], [3, 5])
    with pytest.raises(
        InputError, match=r"^w\.xlsx\[one\]:5: column 'b' holds 'n/a'; expected a number"
    ):
        table.numbers(["b"])


def test_cells_of_other_kinds() -> None:
    data = workbook(one=[["a", "t", "n"], ["1,5", datetime.datetime(2024, 5, 31, 14, 7), None]])
    table = parse_workbook(data, "w.xlsx")
    assert table.numbers(["a"]).tolist() == [[1.5]]
    assert table.texts("t") == ["2024-05-31T14:07:00"]
    assert np.isnan(table.optional_numbers(["n"])).all()


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([], "empty"),
        ([["a", "b"]], "a header but no rows"),
        ([["a", "a"], [1, 2]], r":1: column 'a' appears more than once"),
        ([["a"], [1, 2]], r":2: a cell stands right of the header"),
    ],
)
def test_a_sheet_that_is_no_table(rows: list[list[object]], message: str) -> None:
    with pytest.raises(InputError, match=rf"^w\.xlsx\[one\].*{message}"):
        parse_workbook(workbook(one=rows), "w.xlsx")


def test_a_workbook_is_known_by_its_contents_and_a_damaged_one_is_refused() -> None:
    assert read_source(workbook(one=ROWS), "w").format == "excel"
    with pytest.raises(InputError, match=r"^w\.xlsx: not a readable Excel workbook"):
        read_source(workbook(one=ROWS)[:300], "w.xlsx")
    with pytest.raises(UsageError, match=r"--sheet one: t\.csv is no Excel workbook"):
        read_source(b"a,b\n1,2\n", "t.csv", sheet="one")


def test_without_openpyxl_the_remedy_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    data = workbook(one=ROWS)
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(
        UsageError,
        match=r"^w\.xlsx: reading Excel files needs openpyxl; pip install 'calibtool\[excel\]'",
    ):
        parse_workbook(data, "w.xlsx")


def test_a_workbook_of_charts_only_has_no_table() -> None:
    from openpyxl.chart import BarChart

    book = openpyxl.Workbook()
    book.create_chartsheet("picture").add_chart(BarChart())
    book.remove(book.active)
    out = io.BytesIO()
    book.save(out)
    with pytest.raises(InputError, match="a workbook without a sheet of cells"):
        parse_workbook(out.getvalue(), "w.xlsx")


def test_a_stated_decimal_sign_is_taken() -> None:
    data = workbook(one=[["a"], ["1,5"]])
    assert parse_workbook(data, "w.xlsx", decimal=",").numbers(["a"]).tolist() == [[1.5]]
    with pytest.raises(InputError, match="holds '1,5'"):
        parse_workbook(data, "w.xlsx", decimal=".").numbers(["a"])


def test_a_workbook_read_as_text_is_wrong_usage() -> None:
    with pytest.raises(UsageError, match="a workbook is bytes"):
        read_source("a,b\n1,2\n", "w.xlsx", format="excel")
