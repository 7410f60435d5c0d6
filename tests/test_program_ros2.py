"""ROS 2 trajectories: points in order, joints by name, what is left and
what is refused, by line.
"""

from functools import cache
from pathlib import Path

import pytest
from program_reading import reader

from calibtool.programs.formats import detected
from calibtool.programs.motions import Program
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

TEXT = (Path(__file__).parent / "programs" / "path.yaml").read_text(encoding="utf-8")


@cache
def robot() -> Robot:
    return load_robot("ur5")


def read(text: str) -> Program:
    return reader("ros2-trajectory")(text, robot())


EXPECTED = [
    [0.0, -1.396263, 1.745329, -1.919862, -1.570796, 0.0],
    [0.174533, -1.48353, 1.832596, -1.745329, -1.396263, 0.349066],
]


def test_joints_by_name_in_both_list_styles() -> None:
    program = read(TEXT)
    assert [list(target.values) for target in program.literals] == EXPECTED
    assert [target.line for target in program.literals] == [4, 8]
    (remark,) = program.remarks
    assert (remark.name, remark.why) == ("gripper", "external axes: not joints of the calibration")
    assert program.notes == ("velocities and accelerations are left as they are",)


def test_json() -> None:
    names = ", ".join(f'"{n}"' for n in robot().chain.model.names[1:])
    points = ", ".join(
        f'{{"positions": {row}, "time_from_start": {{"sec": 1}}}}' for row in EXPECTED
    )
    for text in (
        f'{{"joint_names": [{names}], "points": [{points}]}}',
        f'{{"points": [{points}],\n "joint_names": [{names}]}}',
    ):
        assert detected(text, "a.json") == "ros2-trajectory"
        assert [list(t.values) for t in read(text).literals] == EXPECTED


@pytest.mark.parametrize(
    ("before", "after", "why"),
    [
        ("elbow_joint,", "elbow,", "no 'elbow_joint' of ur5; did you mean elbow"),
        ("0.0, 0.04]", "0.04]", "holds 6 positions for 7 joint_names"),
        ("[1.745329", "[.nan", "elbow_joint holds '.nan', which is not finite"),
        ("0.0, 0.04]", "0.0, 0.04", "a bracket is not closed"),
        ("[1.745329", "[up", "elbow_joint holds 'up', which is not a number"),
    ],
)
def test_errors(before: str, after: str, why: str) -> None:
    program = read(TEXT.replace(before, after, 1))
    errors = {r.line: r.why for r in program.remarks if r.bad}
    errors |= {literal.line: literal.not_corrected for literal in program.literals if literal.bad}
    assert why in errors[4]


@pytest.mark.parametrize("value", ["[]", "[ ]"])
def test_an_empty_list_is_not_a_target(value: str) -> None:
    text = TEXT
    first = text.index("[", text.index("positions:"))
    changed = text[:first] + value + text[text.index("]", first) + 1 :]
    program = read(changed)
    assert [list(target.values) for target in program.literals] == EXPECTED[1:]
    assert not any(found.bad for found in (*program.remarks, *program.literals))


@pytest.mark.parametrize(
    ("plain", "commented"),
    [
        ("0.0, 0.04]", "0.0, 0.04] # the last one"),
        ("[1.745329,", "[1.745329, # elbow\n   "),
        ("positions: ", "positions:  # seven of them\n  "),
    ],
)
def test_comments_change_nothing(plain: str, commented: str) -> None:
    assert plain in TEXT
    program = read(TEXT.replace(plain, commented, 1))
    assert [list(target.values) for target in program.literals] == EXPECTED


@pytest.mark.parametrize("end", ["", "   ", "  # flange", "\t#[1, 2]"])
def test_one_element_per_line(end: str) -> None:
    names = [str(name) for name in robot().chain.model.names[1:]]
    rows = "".join(f"  - {value}{end}\n" for value in (0.1, -0.0, 0.3, -1e-3, +0.5, 6))
    text = f"joint_names: {names}\npoints:\n- positions:\n{rows}  time_from_start: {{sec: 1}}\n"
    (literal,) = read(text).literals
    assert list(literal.values) == [0.1, 0.0, 0.3, -1e-3, 0.5, 6.0]
    assert [text[n.start : n.end] for n in literal.numbers] == [
        "0.1",
        "-0.0",
        "0.3",
        "-0.001",
        "0.5",
        "6",
    ]


def test_points_take_the_names_above_them() -> None:
    names = [str(name) for name in robot().chain.model.names[1:]]
    text = "".join(
        f"- joint_names: {order}\n  points:\n  - positions: [1, 2, 3, 4, 5, 6]\n"
        for order in (names, names[::-1])
    )
    assert [list(literal.values) for literal in read(text).literals] == [
        [1, 2, 3, 4, 5, 6],
        [6, 5, 4, 3, 2, 1],
    ]


NAMES = "[" + ", ".join(robot().chain.model.names[1:]) + "]"


def test_an_alias_is_the_point_that_it_repeats() -> None:
    text = (
        f"a:\n joint_names: &n {NAMES}\n points:\n - positions: &first {EXPECTED[0]}\n"
        f" - positions: {EXPECTED[1]}\n - positions: *first\nb:\n joint_names: *n\n points:\n"
        f" - positions: &b\n" + "".join(f"   - {value}\n" for value in EXPECTED[1])
    )
    program = read(text)
    assert [list(t.values) for t in program.literals] == [EXPECTED[0], EXPECTED[1], EXPECTED[1]]
    moves = [move.aims[0].value for move in program.routines[0].body]
    assert moves == [0, 1, 0, 2]


@pytest.mark.parametrize("value", ["*home", "1.0", "high"])
def test_positions_that_are_no_list_are_not_passed_over(value: str) -> None:
    text = f"home: &home {EXPECTED[0]}\njoint_names: {NAMES}\npoints:\n"
    program = read(f"{text}- positions: {EXPECTED[1]}\n- positions: {value}\n")
    good, bad = program.literals
    assert list(good.values) == EXPECTED[1]
    assert (bad.line, bad.bad) == (5, True)
    assert f"'{value.lstrip('*')}' is no list of positions" in bad.not_corrected


@pytest.mark.parametrize("word", ["actual", "feedback", "error"])
def test_what_a_controller_measured_is_left(word: str) -> None:
    points = f'"positions": {EXPECTED[0]}'
    for text in (
        f"joint_names: {NAMES}\nreference:\n  {points}\n{word}:\n  {points}\n",
        f"{{joint_names: {NAMES}, reference: {{{points}}}, {word}: {{{points}}}}}",
    ):
        program = read(text)
        asked, measured = program.literals[1], program.literals[0]
        if asked.not_corrected:
            asked, measured = measured, asked
        assert (list(asked.values), asked.not_corrected) == (EXPECTED[0], "")
        assert measured.not_corrected == f"was measured ({word}), not asked for"
        assert len(program.routines[0].body) == 1
