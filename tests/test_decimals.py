"""Decimal text of many numbers: what Python reads back, and what Python would write."""

from decimal import Decimal

import numpy as np
import pytest

from calibtool.compensation.decimals import decimal_rows


def test_numbers_are_read_back_to_half_a_unit_of_the_last_digit(rng: np.random.Generator) -> None:
    values = rng.normal(size=(5000, 6)) * 10.0 ** rng.integers(-13, 3, size=(5000, 6))
    values = values[np.abs(values).max(axis=-1) < 999]
    back = np.array([row.split(",") for row in decimal_rows(values, 12)], dtype=float)
    assert np.abs(back - values).max() < 0.5e-12 + 2e-13  # of rounding at 999
    small = np.abs(values) < 10
    assert np.abs(back - values)[small].max() < 0.51e-12


def test_radians_and_metres_are_read_back_to_the_rounding_of_a_double(
    rng: np.random.Generator,
) -> None:
    values = rng.uniform(-9.9, 9.9, size=(5000, 6)) * 10.0 ** -rng.integers(0, 6, size=(5000, 6))
    back = np.array([row.split(",") for row in decimal_rows(values, 16)], dtype=float)
    assert (np.abs(back - values) < 0.51e-16 + 2.0**-52 * np.abs(values)).all()


@pytest.mark.parametrize(
    ("row", "text"),
    [
        ([0.3, -0.1, 1.2345, -0.0], "0.3,-0.1,1.2345,0"),
        ([10.5, 0.1, 2.0, -3.0], "10.5,0.1,2,-3"),
        ([9.0, 1e-16, 0, 0], "9,0.0000000000000001,0,0"),
    ],
)
def test_edges_of_radians(row: list[float], text: str) -> None:
    assert decimal_rows(np.array([row]), 16) == [text]


def test_every_number_of_few_digits_is_written_as_people_would(rng: np.random.Generator) -> None:
    numbers = [
        Decimal(int(k)).scaleb(-int(e))
        for k, e in zip(rng.integers(-999, 1000, 4000), rng.integers(0, 13, 4000), strict=True)
    ]
    text = "".join(
        f"{row}\n" for row in decimal_rows(np.array(numbers, dtype=float).reshape(-1, 4), 12)
    )
    expected = [
        f"{number:f}".rstrip("0").rstrip(".") if "." in f"{number:f}" else f"{number:f}"
        for number in numbers
    ]
    assert text.replace("\n", ",").split(",")[:-1] == [
        "0" if e in ("-0", "0") else e for e in expected
    ]


@pytest.mark.parametrize(
    ("row", "text"),
    [
        ([0.0, -0.0, 1e-13, -1e-13], "0,0,0,0"),
        ([90.0, -0.5, 100.25, 1e-12], "90,-0.5,100.25,0.000000000001"),
        ([-999.999, 0.1, 0.2, 0.30000000000000004], "-999.999,0.1,0.2,0.3"),
        ([1.0, 2.0, np.nan, 3.0], ",,,"),
        ([1000.0, 1 / 3, 0.5, -2.0], "1000,0.33333333333333,0.5,-2"),
        ([123456.789, -1e9, 0.0, 1.0], "123456.789,-1000000000,0,1"),
    ],
)
def test_edges(row: list[float], text: str) -> None:
    assert decimal_rows(np.array([[1.5] * 4, row, [-2.25] * 4]), 12) == [
        "1.5,1.5,1.5,1.5",
        text,
        "-2.25,-2.25,-2.25,-2.25",
    ]


def test_no_rows() -> None:
    assert decimal_rows(np.zeros((0, 6)), 12) == []
