"""Every format: what is found in the small programs of tests/programs, what is left alone, and what is refused, by line."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calibtool.programs import fanuc as fanuc_ls
from calibtool.programs.formats import PROGRAM_FORMATS, detected
from calibtool.programs.formats import reader as reader_of_motions
from calibtool.programs.targets import Program, Target, number_at
from calibtool.robot.catalogue import load_robot
from calibtool.robot.model import Robot

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


def reader(name: str) -> Callable[[str, Robot], Program]:
    """Readers of the languages that still report targets in the order of the text."""
    return {"fanuc-ls": fanuc_ls.read}[name]


def robot_of(sample: str) -> Robot:
    return robot("ur5" if sample in ("pick.script", "path.yaml") else "fanuc-m1000ia")


def text_of(sample: str) -> str:
    return (FOLDER / sample).read_bytes().decode("latin-1")


def read(sample: str) -> Program:
    return reader(SAMPLES[sample])(text_of(sample), robot_of(sample))


def found(sample: str) -> dict[int, tuple[str, str]]:
    return {target.line: (target.kind, target.name) for target in read(sample).targets}


def left(sample: str) -> dict[int, str]:
    return {remark.line: remark.why for remark in read(sample).remarks}


def bad(program_format: str, text: str, name: str = "fanuc-m1000ia") -> dict[int, str]:
    """Errors by line."""
    return {r.line: r.why for r in reader(program_format)(text, robot(name)).remarks if r.bad}


def degrees(target: Target) -> list[float]:
    return np.round(np.rad2deg(target.values), 9).tolist()


# --- which format ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sample", SAMPLES)
def test_the_format_is_seen_in_the_contents(sample: str) -> None:
    assert detected(text_of(sample), "") == SAMPLES[sample]
    assert detected(text_of(sample), f"renamed{Path(sample).suffix.upper()}") == SAMPLES[sample]


@pytest.mark.parametrize("text", ["j1_deg,j2_deg\n1,2\n", "", "x_mm;y_mm\n", "hello\n"])
def test_anything_else_is_a_table(text: str) -> None:
    assert detected(text, "") is None


@pytest.mark.parametrize(("name", "expected"), [("a.LS", "fanuc-ls"), ("a.src", "kuka-krl"), ("a.mod", "abb-rapid")])
def test_the_name_tells_where_the_contents_do_not(name: str, expected: str) -> None:
    assert detected("; nothing here\n", name) == expected


@pytest.mark.parametrize("program_format", PROGRAM_FORMATS)
def test_nothing_in_it(program_format: str) -> None:
    program = reader_of_motions(program_format)("", robot())
    assert (program.literals, program.remarks) == ((), ())


@pytest.mark.parametrize("sample", SAMPLES)
def test_numbers_stand_where_they_are_said_to(sample: str) -> None:
    text = text_of(sample)
    literals = reader_of_motions(SAMPLES[sample])(text, robot_of(sample)).literals
    assert len(literals) > 1
    for literal in (literal for literal in literals if not literal.left):
        for number in literal.numbers:
            factor = {"deg": np.pi / 180, "mm": 1e-3}.get(number.unit, 1.0)
            assert float(text[number.start : number.end]) * factor == pytest.approx(number.value, abs=1e-15)
        assert text[: min(number.start for number in literal.numbers)].count("\n") + 1 == literal.line


# --- FANUC ----------------------------------------------------------------------------------------------------------


def test_fanuc() -> None:
    assert found("weld.ls") == {
        21: ("joint", "P[1]"),
        27: ("pose", "P[2]"),
        39: ("pose", "P[4]"),
        45: ("pose", "P[5]"),
        51: ("joint", "P[6]"),
    }
    assert left("weld.ls") == {
        14: "a register: its value is not in the program",
        30: "a relative motion (INC in line 12)",
        53: "external axes (another motion group)",
    }
    home, hole, flipped, framed, _ = read("weld.ls").targets
    assert degrees(home) == [0, 10, -20, 0, -70, 0]
    assert hole.values[:3] == pytest.approx([1.904939, 0.662417, -0.093227])
    assert (hole.frame, hole.tool, framed.frame, framed.tool) == ("", "", "3", "2")
    assert [t.configuration.text for t in (hole, flipped) if t.configuration] == ["N U T, 0, 0, 0", "F U T, 0, 0, 0"]


FANUC_POSE = (
    "\tUF : 0, UT : 0,\t\tCONFIG : '{config}',\n\tX = 1 mm, Y = 2 mm, Z = {z},\n"
    "\tW = 0 deg, P = 0 deg, R = 0 deg{more}\n"
)


def fanuc(config: str = "N U T, 0, 0, 0", z: str = "3 mm", more: str = "") -> str:
    return f"/PROG A\n/MN\n/POS\nP[1]{{\n   GP1:\n{FANUC_POSE.format(config=config, z=z, more=more)}}};\n/END\n"


@pytest.mark.parametrize(
    ("text", "line", "why"),
    [
        (fanuc(z="nan mm"), 7, "Z is 'nan'"),
        (fanuc(z="3 deg"), 7, "Z is in deg"),
        (fanuc(z="3"), 7, "Z is '3'"),
        (fanuc(more=", Q = 1 mm"), 8, "holds"),
        (fanuc(more=", HELLO"), 8, "'HELLO' is not known"),
        ("/POS\nP[1]{\n GP1:\n UF : 0, UT : 0,\n J1= 1 deg, J2= 2 deg\n};\n", 5, "has 6 joints"),
        ("/POS\nP[1]{\n};\n", 2, "no motion group"),
        ("/POS\nP[1]{\n GP1:\n}\n", 2, "is not closed"),
    ],
)
def test_fanuc_errors(text: str, line: int, why: str) -> None:
    assert why in bad("fanuc-ls", text)[line]


def test_a_fanuc_position_that_is_not_closed_does_not_take_the_next_one() -> None:
    text = fanuc().replace("/POS", "/POS\nP[9]{\n GP1:\n UF : 0, UT : 0,", 1)
    assert bad("fanuc-ls", text) == {fanuc().splitlines().index("/POS") + 2: "is not closed by };"}
    found, alone = (reader("fanuc-ls")(text, robot("fanuc-m1000ia")).targets for text in (text, fanuc()))
    assert [(t.name, t.values) for t in found] == [(t.name, t.values) for t in alone]
    assert len(found) == 1


@pytest.mark.parametrize("text", ["1", "-1.", "+.5", "1.5e3", "0.5E-12", "00.10"])
def test_numbers_of_programs_are_those_of_python(text: str) -> None:
    found = number_at(f" {text} ", 0, len(text) + 2, "")
    assert found is not None
    assert (found.start, found.end, found.value) == (1, 1 + len(text), float(text))


@pytest.mark.parametrize("text", ["", ".", "-", "e5", "1e", "1.5.2", "1 2", "0x1", "1_0", "1,5", "9" * 20_000 + "z"])
def test_other_texts_of_programs_are_no_numbers(text: str) -> None:
    assert number_at(text, 0, len(text), "") is None


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (fanuc(config="N U T, 0, 0, 1"), "turn numbers"),
        (fanuc(config="R, 0, 0, 0"), "not of a six-joint arm"),
        (fanuc(more=",\n\tE1 = 5 mm"), "external axes"),
        (fanuc(z="******** mm"), "not taught"),
    ],
)
def test_fanuc_positions_left_alone(text: str, why: str) -> None:
    (remark,) = reader("fanuc-ls")(text, robot()).remarks
    assert why in remark.why
    assert not remark.bad


