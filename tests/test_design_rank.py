"""Ranks of designs: against counting by hand, and with targets or joints that hide something."""

import numpy as np
import pytest

from calibtool.identification.design_rank import observability
from calibtool.measurement.setup import Setup
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly


def anywhere(robot: Robot, count: int = 60) -> Array:
    rng = np.random.default_rng(3)
    return robot.lower + (robot.upper - robot.lower) * rng.random((count, robot.n))


def seen_by(targets: Array) -> Setup:
    return Setup(readonly(np.eye(4)), readonly(targets))


def test_local_poe_leaves_four_parameters_of_a_turn_and_two_of_a_slide(robot: Robot) -> None:
    q = anywhere(robot)
    found = observability(robot, seen_by(robot.targets), q, q, "local-poe")
    slides = sum(robot.prismatic)
    assert found.rank == found.possible == 4 * (robot.n - slides) + 2 * slides + 6
    assert found.parameters == 6 * robot.n + 6
    assert found.unobservable == ()


@pytest.mark.parametrize("model", ["local-poe", "complete"])
def test_one_target_hides_three_turns_of_the_tool(model: str) -> None:
    robot = load_robot("ur5")
    q = anywhere(robot)
    found = observability(robot, seen_by(robot.targets[:1]), q, q, model)
    assert found.possible - found.rank == len(found.unobservable) == 3
    assert all("ζ7.r" in text for text in found.unobservable[:2])


@pytest.mark.parametrize("name", ["gantry", "tiago-arm"])
def test_the_complete_model_sees_more_than_local_poe_where_everything_moves(name: str) -> None:
    robot = load_robot(name)
    q = anywhere(robot)
    setup = seen_by(robot.targets)
    geometric, complete = (
        observability(robot, setup, q, q, model) for model in ("local-poe", "complete")
    )
    assert geometric.rank < complete.rank == complete.possible


def test_a_joint_that_stands_still_is_named() -> None:
    robot = load_robot("planar-3r")
    q = anywhere(robot)
    still = q.copy()
    still[:, 1] = 0.4
    found = observability(robot, seen_by(robot.targets), still, q, "local-poe")
    assert found.rank < found.possible
    assert any("ζ2" in text or "ζ3" in text for text in found.unobservable)
