"""Arguments of the library: what is no choice, no row or no whole number is refused."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

import calibtool as ct
from calibtool.errors import InputError, UsageError
from calibtool.robot.se3 import Array

PROGRAM = (ct.shipped("data") / "sample" / "seam.ls").read_bytes()


@cache
def calibration(name: str = "fanuc-m1000ia") -> ct.Calibration:
    robot = ct.load_robot(name)
    return ct.identify(ct.simulate(robot, ct.Simulation(configurations=20)), "nominal")


def corrected(word: str, option: str) -> object:
    options = ct.ProgramOptions(**{option: word})
    return ct.compensate_program(calibration(), PROGRAM, "seam.ls", "fanuc-ls", options)


@pytest.mark.parametrize("word", ["Controller", "axis", ""])
@pytest.mark.parametrize(
    "call",
    [
        lambda word: ct.calibration_as_c(calibration(), "c", joint_values=word),
        lambda word: ct.calibration_as_c(calibration(), "c", word),
        lambda word: ct.calibration_as_json(calibration(), word),
        lambda word: corrected(word, "joint_values"),
        lambda word: corrected(word, "on_error"),
        lambda word: corrected(word, "outside"),
        lambda word: calibration().robot.serial_from(word, np.zeros((1, 6))),
        lambda word: calibration().in_frame(word),
        lambda word: ct.compensate_program(calibration(), PROGRAM, "seam.ls", word),
    ],
)
def test_a_word_that_is_no_choice_is_refused(call: Callable[[str], object], word: str) -> None:
    """On this robot the kinds of joint values differ by 10 deg and more."""
    with pytest.raises(UsageError, match=f"unknown '{word}'"):
        call(word)


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "scara", "fivebar"])
@pytest.mark.parametrize("shape", ["row", "one column", "a column more", "block"])
def test_joint_positions_of_another_shape_are_refused(name: str, shape: str) -> None:
    """One column would be taken as every joint's, by the rules of numpy."""
    robot = ct.load_robot(name)
    q: Array = {
        "row": np.zeros(robot.n),
        "one column": np.zeros((3, 1)),
        "a column more": np.zeros((3, robot.n + 1)),
        "block": np.zeros((2, 3, robot.n)),
    }[shape]
    with pytest.raises(InputError, match="joint positions have shape"):
        robot.mechanism.forward(q)
    with pytest.raises(InputError, match="joint positions have shape"):
        robot.mechanism.forward_and_jacobian(q)
    if shape != "row":
        with pytest.raises(InputError, match="joint positions have shape"):
            calibration(name).forward(q)


@pytest.mark.parametrize("name", ["ur5", "fivebar"])
def test_lists_are_arrays(name: str) -> None:
    robot = ct.load_robot(name)
    q = np.tile((robot.lower + robot.upper) / 2 + 0.1, (2, 1))
    np.testing.assert_array_equal(robot.mechanism.forward(q.tolist()), robot.mechanism.forward(q))
    at = ct.simulate(robot, ct.Simulation(at=q.tolist())).points
    np.testing.assert_array_equal(at, ct.simulate(robot, ct.Simulation(at=q)).points)


@pytest.mark.parametrize("value", [1.5, "3", None])
@pytest.mark.parametrize("name", ["seed", "configurations", "places"])
def test_counts_and_seeds_are_whole_numbers(name: str, value: object) -> None:
    with pytest.raises(UsageError, match=f"{name}: .* is no whole number"):
        ct.Simulation(**{name: value})
    assert ct.Simulation(**{name: np.int64(3)}) is not None


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_targets_are_finite(value: float) -> None:
    robot = ct.load_robot("ur5")
    seen = ct.simulate(robot, ct.Simulation(configurations=5))
    targets = robot.targets.copy()
    targets[1, 2] = value
    with pytest.raises(InputError, match="targets on the tool is not finite"):
        ct.Measurements.from_points(robot, seen.q, seen.points, targets=targets)


def test_a_program_is_bytes() -> None:
    with pytest.raises(UsageError, match="a program is bytes"):
        ct.compensate_program(calibration(), PROGRAM.decode(), "seam.ls", "fanuc-ls")
