"""Numbers in program text: found where they stand, written in the style of what they replace."""

import re

import pytest

from calibtool.programs.bracketed_lists import closing, item, split
from calibtool.programs.numbers import (
    DECIMALS,
    LineNumbers,
    Number,
    comments_blanked,
    number_at,
    replaced,
    rewritten,
    written,
)


@pytest.mark.parametrize(
    ("old", "value", "unit", "new"),
    [
        ("10", 10.25, "deg", "10.250000"),
        ("10.000", 10.2500004, "mm", "10.2500"),
        ("-0.5", 0.25, "deg", "0.250000"),
        ("+1.0", 2.0, "mm", "+2.0000"),
        (".5", 0.25, "mm", ".2500"),
        ("-.5", -0.25, "mm", "-.2500"),
        ("1E1", 10.5, "mm", "10.5000"),
        ("0.1234567891", 0.2, "rad", "0.2000000000"),
        ("-0.0002", -1e-9, "mm", "0.0000"),
    ],
)
def test_the_style_of_the_number_is_kept(old: str, value: float, unit: str, new: str) -> None:
    assert written(old, value, unit) == new


@pytest.mark.parametrize("unit", DECIMALS)
@pytest.mark.parametrize("old", ["10", "10.0", "-3.7", "1e1", "+0.125", ".25", "7.123456789012"])
def test_a_number_that_stays_keeps_its_text(old: str, unit: str) -> None:
    decimals = max(DECIMALS[unit], len(old.partition(".")[2]))
    for step in (0.0, 1e-13, -0.4 * 10.0**-decimals):
        assert written(old, float(old) + step, unit) == old


@pytest.mark.parametrize("unit", DECIMALS)
def test_what_is_written_is_near_enough(unit: str) -> None:
    for value in (0.123456789123, -179.987654321, 2104.690123456):
        assert abs(float(written("1.0", value, unit)) - value) <= 0.5 * 10.0 ** -DECIMALS[unit]


def test_columns_keep_their_width_where_there_is_room() -> None:
    text = "X =   10.000  mm, Y = 1.0 mm"
    first, second = (m.span(1) for m in re.finditer(r"= *(\S+)", text))
    assert (
        replaced(text, [(*first, "10.12345"), (*second, "1.23456")])
        == "X = 10.12345  mm, Y = 1.23456 mm"
    )
    assert replaced(text, [(*first, "7")]) == "X =        7  mm, Y = 1.0 mm"
    assert replaced(text, [(*first, "12345.1234")]) == "X = 12345.1234  mm, Y = 1.0 mm"
    assert (
        replaced("X   10.0", [(4, 8, "10.12345")]) == "X 10.12345"
    )  # a blank stays between a word and its number
    assert replaced(text, [(*first, "123456.1234")]) == "X = 123456.1234  mm, Y = 1.0 mm"


def test_only_the_spans_change() -> None:
    text = "a [1.0, 2.0] é\r\n b 3.0"
    numbers = [
        Number(m.start(), m.end(), "mm", float(m[0]) * 1e-3) for m in re.finditer(r"\d\.\d", text)
    ]
    assert replaced(text, rewritten(text, numbers, [n.value for n in numbers])) == text
    assert (
        replaced(text, rewritten(text, numbers, [0.001, 0.0025, 0.003]))
        == "a [1.0, 2.5000] é\r\n b 3.0"
    )


@pytest.mark.parametrize("text", ["nan", "NaN", "1_0", "0x10", "d2r(90)", "1+2", "", "--1", "1,5"])
def test_what_is_no_number(text: str) -> None:
    assert number_at(text, 0, len(text), "deg") is None


def test_blanks_around_a_number_do_not_belong_to_it() -> None:
    number = number_at("[  -1.5e2 ]", 1, 10, "mm")
    assert number == Number(3, 9, "mm", -0.15)


def test_lines_of_every_kind() -> None:
    text = "a\r\nb\nc\rd"
    assert [LineNumbers(text)(text.index(letter)) for letter in "abcd"] == [1, 2, 3, 4]


def test_comments_and_strings_are_blanked_in_place() -> None:
    text = 'x ; [1]\n"[2]" y ;"\nz'
    blanked = comments_blanked(text, r";[^\n]*")
    assert len(blanked) == len(text)
    assert blanked.split() == ["x", "y", "z"]
    assert [k for k, c in enumerate(blanked) if c == "\n"] == [
        k for k, c in enumerate(text) if c == "\n"
    ]


def test_lists() -> None:
    code = " [[1, 2], [ 3 ] , []]"
    whole = item(code, 0, len(code))
    assert whole.shape() == (2, 1, 0)
    assert [code[p.start : p.end] for row in whole.parts or () for p in row.parts or ()] == [
        "1",
        "2",
        "3",
    ]
    assert item("[1, [2]]", 0, 8).shape() is None
    assert item("f([1], 2)", 0, 9).parts is None
    assert closing("[(])", 0) == 3 or closing("[[]", 0) is None
    assert [code_[0] for code_ in split("f(1,2),[3,4],5", 0, 14)] == [0, 7, 13]
