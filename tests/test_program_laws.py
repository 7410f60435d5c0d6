"""Laws of corrected programs, on programs that are made up: round trips, bytes that stay, batches
and single rows.
"""

import importlib.util
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from program_reading import reader

from calibtool.calibration import Calibration, identify
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.export.as_urdf import calibration_as_urdf
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.programs.branches import Controller, solve
from calibtool.programs.compensate import compensate_program
from calibtool.programs.formats import PROGRAM_FORMATS, coupling_of
from calibtool.programs.sequential_poses import follow_forest, forest
from calibtool.robot.catalogue import load_robot
from calibtool.robot.inverse import follow_path
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

ROOT = Path(__file__).parent.parent
NUMBER = re.compile(r" *[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
COMMENTS = {
    "fanuc-ls": None,
    "kuka-krl": ";",
    "abb-rapid": "!",
    "ur-script": "#",
    "ros2-trajectory": "#",
}


@cache
def bench() -> ModuleType:
    """benchmarks/programs.py, which writes programs of any length."""
    spec = importlib.util.spec_from_file_location(
        "bench_programs", ROOT / "benchmarks" / "programs.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def robot_of(program_format: str) -> Robot:
    return load_robot(bench().ROBOTS.get(program_format, bench().OTHER_ROBOT))


@cache
def there_and_back(name: str) -> tuple[Calibration, Calibration]:
    """A calibration, and the one of the calibrated arm whose errors lead
    back to the nominal one.
    """
    robot = load_robot(name)
    simulation = Simulation(seed=3, configurations=40)
    calibration = identify(simulate(robot, simulation), "local-poe")
    errors = calibration.base.errors
    assert [family.id for family in errors.present] == ["placements"]
    text, missing = calibration_as_urdf(calibration)
    assert not missing
    tool = f"{robot.source.description.kinematics.tool_frame}_calibrated"
    kinematics = robot.source.description.kinematics
    if f'name="{tool}"' in text:
        kinematics = kinematics.model_copy(update={"tool_frame": tool})
    description = robot.source.description.model_copy(update={"kinematics": kinematics})
    other = Robot.from_source(replace(robot.source, urdf_text=text, description=description))
    undone = RobotErrors.of(other, placements=-errors["placements"])
    back = replace(calibration, robot=other, base=replace(calibration.base, errors=undone))
    q = bench().configurations(robot, 5)
    np.testing.assert_allclose(other.mechanism.forward(q), calibration.forward(q), atol=1e-9)
    np.testing.assert_allclose(back.forward(q), robot.mechanism.forward(q), atol=1e-9)
    return calibration, back


# --- round trips ----------------------------------------------------------------------------------


@pytest.mark.parametrize("program_format", PROGRAM_FORMATS)
def test_corrected_there_and_back(program_format: str) -> None:
    """With the inverse calibration the numbers are the original ones, to the digits
    that are written.
    """
    robot = robot_of(program_format)
    there, back = there_and_back(robot.name)
    text = bench().WRITERS[program_format](robot, bench().configurations(robot, 24))
    once = compensate_program(there, text.encode(), "a", program_format)
    twice = compensate_program(back, once.data, "a", program_format)
    assert once.changed == twice.changed == 24
    literals = [reader(program_format)(t, robot).literals for t in (text, twice.data.decode())]
    for old, new in zip(*literals, strict=True):
        size = (
            np.linalg.norm(old.values[3:]) if old.orientation == "quaternion-wxyz" else 1.0
        )  # of six digits
        for a, b in zip(old.numbers, new.numbers, strict=True):
            digits = {"deg": 3e-6 * np.pi / 180, "rad": 3e-8, "mm": 3e-7, "m": 3e-7, "": 3e-9}[
                a.unit
            ]
            assert abs((a.value / size if a.unit == "" else a.value) - b.value) < digits
    assert NUMBER.sub("#", text) == NUMBER.sub("#", twice.data.decode())


# --- bytes ----------------------------------------------------------------------------------------


def disguised(text: str, program_format: str, choose: st.DataObject) -> bytes:
    """The same program with other line ends, numbers of other forms, blank lines and comments in
    several encodings.
    """
    mark = COMMENTS[program_format]
    lines = []
    for line in text.splitlines():
        how = choose.draw(st.integers(0, 5))
        if how == 0 and mark:
            word = choose.draw(
                st.sampled_from(
                    ["[1, 2", "p[", "}", "Ü 7 \N{GREEK SMALL LETTER MU}m", "'", '"', "MoveL p;"]
                )
            )
            line += f"  {mark} {word}"
        if how == 1 and not line.startswith(("- ", "/", "P[")):
            line += " "
        if how == 2 and mark:
            lines.append("")
        lines.append(line)
    end = choose.draw(st.sampled_from(["\n", "\r\n"]))
    return (end.join(lines) + end).encode("utf-8")


@pytest.mark.parametrize("program_format", PROGRAM_FORMATS)
@given(choose=st.data())
@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
def test_only_numbers_of_positions_change(program_format: str, choose: st.DataObject) -> None:
    robot = robot_of(program_format)
    there, _ = there_and_back(robot.name)
    count = choose.draw(st.integers(1, 6))
    q = bench().configurations(robot, 40)[choose.draw(st.permutations(range(40)))[:count]]
    data = disguised(bench().WRITERS[program_format](robot, q), program_format, choose)
    result = compensate_program(there, data, "a", program_format)
    assert result.changed == count
    before, after = data.decode(), result.data.decode()
    spans = sorted(
        (number.start, number.end)
        for literal in reader(program_format)(data.decode("latin-1"), robot).literals
        for number in literal.numbers
    )
    text, pieces, at = data.decode("latin-1"), [], 0
    for start, end in spans:
        pieces.append(re.escape(text[at:start].rstrip(" ")) + r" *(\S+?)")
        at = end
    whole = re.compile("".join([*pieces, re.escape(text[at:])]), re.DOTALL)
    assert whole.fullmatch(result.data.decode("latin-1"))
    assert NUMBER.sub("#", before) == NUMBER.sub("#", after)


# --- batches --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["near", "everywhere"])
def test_a_row_of_poses_is_followed_as_one_after_the_other(kind: str) -> None:
    """Parts that run side by side end on the branches that following the
    row pose by pose ends on.
    """
    robot = load_robot("ur5")
    rng = np.random.default_rng(4)
    if kind == "near":
        corners = bench().configurations(robot, 12)
        q = np.array(
            [np.interp(np.linspace(0, 11, 200), np.arange(12), column) for column in corners.T]
        ).T
    else:
        q = rng.uniform(np.maximum(robot.lower, -3), np.minimum(robot.upper, 3), (200, 6))
    T = robot.mechanism.forward(q)
    controller = Controller(robot, np.eye(6))

    def answers(rows: np.ndarray, start: Array) -> Array:
        found = solve(
            controller, T[rows], start, [None] * len(rows), np.zeros(len(rows), dtype=bool)
        )
        return np.where(found.found[:, None], found.q, start)

    trees = forest([(), *((k,) for k in range(199))], [False] * 200)
    together = follow_forest(trees, np.tile(q[0], (200, 1)), answers)
    expected = [q[0]]
    for k in range(200):
        expected.append(answers(np.array([k]), expected[-1][None])[0])
    np.testing.assert_allclose(together, expected[1:], atol=1e-8)
    if kind == "near":
        np.testing.assert_allclose(together, follow_path(robot, T, q[0])[0], atol=1e-8)


def test_a_tree_of_poses() -> None:
    """Rows after others, several after one, and rows that nothing leads to."""
    before = [(), (0,), (0,), (2, 1), (5,), (4,), (3,), ()]
    trees = forest(before, [False] * 8)
    assert trees.parents[[0, 1, 2, 3, 6, 7]].tolist() == [-1, 0, 0, 1, 3, -1]
    assert sorted(trees.order.tolist()) == list(range(8))
    place = np.argsort(trees.order)
    assert all(
        place[parent] < place[row] for row, parent in enumerate(trees.parents) if parent >= 0
    )
    q = follow_forest(trees, np.zeros((8, 1)), lambda rows, start: start + 1.0)
    assert q[:, 0].tolist() == [1, 2, 2, 3, *q[4:6, 0], 4, 1]
    assert sorted(q[4:6, 0]) == [1, 2]


def test_each_answer_is_that_of_its_own_row() -> None:
    robot = load_robot("fanuc-m1000ia")
    controller = Controller(robot, coupling_of(robot, "kuka-krl", None))
    rng = np.random.default_rng(5)
    q = rng.uniform(robot.lower, robot.upper, (30, 6))
    T, near = robot.mechanism.forward(q), rng.uniform(robot.lower, robot.upper, (30, 6))
    T[7, :3, 3] += 50.0
    nothing, free = [None] * 30, np.zeros(30, dtype=bool)
    together = solve(controller, T, near, nothing, free)
    for k in range(30):
        alone = solve(controller, T[k : k + 1], near[k : k + 1], [None], free[:1])
        np.testing.assert_array_equal(alone.q[0], together.q[k])
        assert alone.why == [together.why[k]]
    assert "unreachable" in together.why[7]
