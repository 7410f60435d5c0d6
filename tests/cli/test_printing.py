"""Tables and numbers for people: as wide as a terminal, nothing cut, no blanks at the ends."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from calibtool.cli.files import wrapped
from calibtool.cli.printing import table_lines
from calibtool.units import count_of, three_digits

_WORDS = st.text(st.characters(categories=("L", "N")), min_size=1, max_size=9)
_TABLES = st.integers(2, 12).flatmap(
    lambda n: st.lists(st.lists(_WORDS, min_size=n, max_size=n), min_size=2, max_size=5)
)


@given(_TABLES, st.integers(1, 2))
def test_a_table_keeps_every_cell_within_the_width(rows: list[list[str]], keys: int) -> None:
    keys = min(keys, len(rows[0]) - 1)
    lines = table_lines(rows[0], rows[1:], 80, keys)
    assert all(cell_len(line) <= 80 and line == line.rstrip() for line in lines)
    blocks = "\n".join(lines).split("\n\n")
    found = [[] for _ in rows]
    for number, block in enumerate(blocks):
        text = [line.split() for line in block.splitlines() if line and "─" not in line]
        for row, cells in zip(found, text, strict=True):
            row += cells if number == 0 else cells[keys:]
    assert found == rows


@given(st.floats(1e-4, 1e9))
def test_three_digits_are_near_and_have_no_exponent(value: float) -> None:
    text = three_digits(value)
    assert set(text) <= set("0123456789.")
    assert abs(float(text) - value) <= max(0.5001 * 10 ** (math.floor(math.log10(value)) - 2), 5e-5)
    if value >= 0.01:
        assert len(text.replace(".", "").lstrip("0").rstrip("0")) <= 3


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (2330.4, "2330"),
        (99.96, "100"),
        (1.0, "1.00"),
        (0.11, "0.110"),
        (-0.5, "-0.500"),
        (0.0213, "0.0213"),
        (1.03e-9, "<0.0001"),
        (0.0, "0"),
        (math.nan, "nan"),
    ],
)
def test_three_digits(value: float, text: str) -> None:
    assert three_digits(value) == text


def test_numbers_have_their_nouns() -> None:
    assert count_of(1, "row") == "1 row"
    assert count_of(2000, "row") == "2,000 rows"
    assert count_of(2, "pose is", "poses are") == "2 poses are"


@given(st.lists(_WORDS, max_size=40))
def test_prose_is_wrapped_between_words(words: list[str]) -> None:
    lines = wrapped(" ".join(words), 40)
    assert " ".join(lines).split() == words
    assert all(len(line) <= 40 for line in lines)
