"""Every format: what is found in the small programs of tests/programs, what is left alone, and what
is refused, by line.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from program_reading import reader

from calibtool.programs.formats import PROGRAM_FORMATS, detected
from calibtool.programs.numbers import number_at
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

FOLDER = Path(__file__).parent / "programs"
SAMPLES = {
    "weld.ls": "fanuc-ls",
    "drill.src": "kuka-krl",
    "drill.dat": "kuka-krl",
    "pick.mod": "abb-rapid",
    "pick.script": "ur-script",
    "path.yaml": "ros2-trajectory",
}


@cache
def robot(name: str = "fanuc-m1000ia") -> Robot:
    return load_robot(name)


def robot_of(sample: str) -> Robot:
    return robot("ur5" if sample in ("pick.script", "path.yaml") else "fanuc-m1000ia")


def text_of(sample: str) -> str:
    return (FOLDER / sample).read_bytes().decode("latin-1")


@pytest.mark.parametrize("sample", SAMPLES)
def test_the_format_is_seen_in_the_contents(sample: str) -> None:
    assert detected(text_of(sample), "") == SAMPLES[sample]
    assert detected(text_of(sample), f"renamed{Path(sample).suffix.upper()}") == SAMPLES[sample]


@pytest.mark.parametrize("text", ["j1_deg,j2_deg\n1,2\n", "", "x_mm;y_mm\n", "hello\n"])
def test_anything_else_is_a_table(text: str) -> None:
    assert detected(text, "") is None


@pytest.mark.parametrize(
    ("name", "expected"), [("a.LS", "fanuc-ls"), ("a.src", "kuka-krl"), ("a.mod", "abb-rapid")]
)
def test_the_name_tells_where_the_contents_do_not(name: str, expected: str) -> None:
    assert detected("; nothing here\n", name) == expected


@pytest.mark.parametrize("program_format", PROGRAM_FORMATS)
def test_nothing_in_it(program_format: str) -> None:
    program = reader(program_format)("", robot())
    assert (program.literals, program.remarks) == ((), ())


@pytest.mark.parametrize("sample", SAMPLES)
def test_numbers_stand_where_they_are_stated_to(sample: str) -> None:
    text = text_of(sample)
    literals = reader(SAMPLES[sample])(text, robot_of(sample)).literals
    assert len(literals) > 1
    for literal in (literal for literal in literals if not literal.not_corrected):
        for number in literal.numbers:
            factor = {"deg": np.pi / 180, "mm": 1e-3}.get(number.unit, 1.0)
            assert float(text[number.start : number.end]) * factor == pytest.approx(
                number.value, abs=1e-15
            )
        assert (
            text[: min(number.start for number in literal.numbers)].count("\n") + 1 == literal.line
        )


# --- numbers --------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["1", "-1.", "+.5", "1.5e3", "0.5E-12", "00.10"])
def test_numbers_of_programs_are_those_of_python(text: str) -> None:
    found = number_at(f" {text} ", 0, len(text) + 2, "")
    assert found is not None
    assert (found.start, found.end, found.value) == (1, 1 + len(text), float(text))


@pytest.mark.parametrize(
    "text", ["", ".", "-", "e5", "1e", "1.5.2", "1 2", "0x1", "1_0", "1,5", "9" * 20_000 + "z"]
)
def test_other_texts_of_programs_are_no_numbers(text: str) -> None:
    assert number_at(text, 0, len(text), "") is None
