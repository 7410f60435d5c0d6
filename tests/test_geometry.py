"""The mechanism with geometric errors is the product of exponentials with these errors in it,
for finite motions.
"""

import numpy as np
import pytest
from derivatives import assert_derivative
from poe import expm_chain, random_positions

from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, relative_error


def random_errors(robot: Robot, rng: np.random.Generator, size: float) -> RobotErrors:
    return RobotErrors.of(
        robot,
        placements=rng.normal(size=(robot.n + 1, 6)) * size,
        twists=rng.normal(size=(robot.n, 6)) * size,
        offsets=rng.normal(size=robot.n) * size,
    )


def single_exponential(twist: Array) -> Array:
    return expm_chain(np.array([np.eye(4)] * 2), twist[None], np.ones((1, 1)))[0]


def by_definition(robot: Robot, errors: RobotErrors, q: Array) -> Array:
    """The model of the paper (Eq. 8) as written: M_j exp(δζ_j), exp((ξ_j + δξ_j)(q_j + δq_j)),
    with scipy's
    matrix exponential.
    """
    placements = np.array(
        [
            M @ single_exponential(x)
            for M, x in zip(robot.chain.placements, errors["placements"], strict=True)
        ]
    )
    return expm_chain(placements, robot.chain.twists + errors["twists"], q + errors["offsets"])


@pytest.mark.parametrize("size", [1e-3, 0.1])
def test_errors_of_any_size_are_followed_exactly(
    robot: Robot, size: float, rng: np.random.Generator
) -> None:
    errors, q = random_errors(robot, rng, size), random_positions(robot, rng, 5)
    pose = errors.mechanism.forward(q)
    np.testing.assert_allclose(pose, by_definition(robot, errors, q), atol=1e-12)
    np.testing.assert_allclose(pose, errors.frames(q).tool, atol=1e-12)


@pytest.mark.parametrize("family", ["placements", "twists", "offsets"])
def test_each_family_alone_is_followed_exactly(
    robot: Robot, family: str, rng: np.random.Generator
) -> None:
    drawn = random_errors(robot, rng, 0.05)
    errors, q = RobotErrors.of(robot, **{family: drawn[family]}), random_positions(robot, rng, 3)
    pose = errors.mechanism.forward(q)
    np.testing.assert_allclose(pose, by_definition(robot, errors, q), atol=1e-12)
    assert np.abs(pose - robot.mechanism.forward(q)).max() > 1e-3


@pytest.mark.parametrize("name", ["gantry", "scara"])
@pytest.mark.parametrize("turn", [0.0, 1e-300, 1e-30, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
def test_a_slide_that_turns_a_little_keeps_every_digit(
    name: str, turn: float, rng: np.random.Generator
) -> None:
    robot = load_robot(name)
    q = random_positions(robot, rng, 20)
    for _ in range(3):
        errors = random_errors(robot, rng, 1e-3)
        axes = rng.normal(size=(robot.n, 3))
        turns = turn * axes / np.linalg.norm(axes, axis=1, keepdims=True)
        twists = errors["twists"].copy()
        twists[robot.prismatic, 3:] = turns[robot.prismatic]
        errors = errors.having(twists=twists)
        pose = errors.mechanism.forward(q)
        np.testing.assert_allclose(
            pose, by_definition(robot, errors, q), atol=1e-12
        )  # scipy's expm keeps 1e-13
        np.testing.assert_allclose(pose, errors.frames(q).tool, atol=1e-14)


@pytest.mark.parametrize("name", ["gantry", "ur5"])
@pytest.mark.parametrize("part", [slice(0, 3), slice(3, 6)])
def test_a_twist_error_of_slide_or_turn_alone_is_followed_exactly(
    name: str, part: slice, rng: np.random.Generator
) -> None:
    robot = load_robot(name)
    twists = np.zeros((robot.n, 6))
    twists[:, part] = rng.normal(size=(robot.n, 3)) * 1e-2
    errors = RobotErrors.of(robot, twists=twists)
    q = random_positions(robot, rng, 5)
    np.testing.assert_allclose(
        errors.mechanism.forward(q), by_definition(robot, errors, q), atol=1e-12
    )


@pytest.mark.parametrize("slide_turn", [None, 1e-7])
def test_the_jacobian_is_the_derivative_of_the_spatial_twist(
    robot: Robot, slide_turn: float | None, rng: np.random.Generator
) -> None:
    errors, q = random_errors(robot, rng, 0.05), random_positions(robot, rng, 1)
    if slide_turn is not None:
        twists = errors["twists"].copy()
        twists[robot.prismatic, 3:] *= slide_turn / 0.05
        errors = errors.having(twists=twists)
    pose, jacobian = errors.mechanism.forward_and_jacobian(q)
    start = by_definition(robot, errors, q)
    np.testing.assert_allclose(pose, start, atol=1e-12)
    assert_derivative(
        lambda x: relative_error(errors.frames(x[None]).tool, start)[0], jacobian[0], q[0]
    )


def test_without_errors_the_mechanism_is_the_nominal_one(
    robot: Robot, rng: np.random.Generator
) -> None:
    q = random_positions(robot, rng, 5)
    pose = RobotErrors.of(robot).mechanism.forward(q)
    np.testing.assert_allclose(
        pose, expm_chain(robot.chain.placements, robot.chain.twists, q), atol=1e-12
    )


def test_moved_placements_are_followed_by_the_step(fanuc: Robot, rng: np.random.Generator) -> None:
    errors, step = random_errors(fanuc, rng, 0.3), rng.normal(size=(7, 6)) * 0.3
    moved = errors.moved(placements=step)
    for before, added, after in zip(errors["placements"], step, moved["placements"], strict=True):
        np.testing.assert_allclose(
            single_exponential(after),
            single_exponential(before) @ single_exponential(added),
            atol=1e-12,
        )
    assert np.array_equal(moved["twists"], errors["twists"])
    assert np.array_equal(moved["offsets"], errors["offsets"])


def test_steps_that_undo_each_other_leave_the_placements(
    fanuc: Robot, rng: np.random.Generator
) -> None:
    errors, step = random_errors(fanuc, rng, 0.3), rng.normal(size=(7, 6))
    back = errors.moved(placements=step).moved(placements=-step)
    np.testing.assert_allclose(back["placements"], errors["placements"], atol=1e-12)
