"""The mechanism with geometric errors is the product of exponentials with these errors in it, for finite motions."""

import numpy as np
import pytest
from derivatives import assert_derivative
from poe import expm_chain, random_positions

from calibtool.robot.catalogue import load_robot
from calibtool.robot.geometry import GeometricErrors, mechanism, relative_error
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array, adjoint, exp6


def random_errors(robot: Robot, rng: np.random.Generator, size: float) -> GeometricErrors:
    return GeometricErrors(
        rng.normal(size=(robot.n + 1, 6)) * size,
        rng.normal(size=(robot.n, 6)) * size,
        rng.normal(size=robot.n) * size,
    )


def single_exponential(twist: Array) -> Array:
    return expm_chain(np.array([np.eye(4)] * 2), twist[None], np.ones((1, 1)))[0]


def by_definition(robot: Robot, errors: GeometricErrors, q: Array) -> Array:
    """METHOD §2 as it stands: M_j exp(δζ_j), exp((ξ_j + δξ_j)(q_j + δq_j)), with scipy's matrix exponential."""
    placements = np.array(
        [M @ single_exponential(x) for M, x in zip(robot.chain.placements, errors.placements, strict=True)]
    )
    return expm_chain(placements, robot.chain.twists + errors.twists, q + errors.offsets)


@pytest.mark.parametrize("size", [1e-3, 0.1])
def test_errors_of_any_size_are_followed_exactly(robot: Robot, size: float, rng: np.random.Generator) -> None:
    errors, q = random_errors(robot, rng, size), random_positions(robot, rng, 5)
    pose = mechanism(robot.chain, errors).forward(q)
    np.testing.assert_allclose(pose, by_definition(robot, errors, q), atol=1e-12)
    np.testing.assert_allclose(pose, errors.frames(robot.chain, q).tool, atol=1e-12)


@pytest.mark.parametrize("family", ["placements", "twists", "offsets"])
def test_each_family_alone_is_followed_exactly(robot: Robot, family: str, rng: np.random.Generator) -> None:
    none, drawn = GeometricErrors.none(robot.n), random_errors(robot, rng, 0.05)
    parts = {name: getattr(drawn if name == family else none, name) for name in ("placements", "twists", "offsets")}
    errors, q = GeometricErrors(**parts), random_positions(robot, rng, 3)
    pose = mechanism(robot.chain, errors).forward(q)
    np.testing.assert_allclose(pose, by_definition(robot, errors, q), atol=1e-12)
    assert np.abs(pose - robot.mechanism.forward(q)).max() > 1e-3


@pytest.mark.parametrize("name", ["gantry", "scara"])
@pytest.mark.parametrize("turn", [0.0, 1e-300, 1e-30, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
def test_a_slide_that_turns_a_little_keeps_every_digit(name: str, turn: float, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    q = random_positions(robot, rng, 20)
    for _ in range(3):
        errors = random_errors(robot, rng, 1e-3)
        axes = rng.normal(size=(robot.n, 3))
        turns = turn * axes / np.linalg.norm(axes, axis=1, keepdims=True)
        errors.twists[robot.prismatic, 3:] = turns[robot.prismatic]
        pose = mechanism(robot.chain, errors).forward(q)
        np.testing.assert_allclose(pose, by_definition(robot, errors, q), atol=1e-12)  # scipy's expm keeps 1e-13
        np.testing.assert_allclose(pose, errors.frames(robot.chain, q).tool, atol=1e-14)


@pytest.mark.parametrize("name", ["gantry", "ur5"])
@pytest.mark.parametrize("part", [slice(0, 3), slice(3, 6)])
def test_a_twist_error_of_slide_or_turn_alone_is_followed_exactly(
    name: str, part: slice, rng: np.random.Generator
) -> None:
    robot = load_robot(name)
    errors = random_errors(robot, rng, 0.0)
    errors.twists[:, part] = rng.normal(size=(robot.n, 3)) * 1e-2
    q = random_positions(robot, rng, 5)
    np.testing.assert_allclose(mechanism(robot.chain, errors).forward(q), by_definition(robot, errors, q), atol=1e-12)


@pytest.mark.parametrize("slide_turn", [None, 1e-7])
def test_the_jacobian_is_the_derivative_of_the_spatial_twist(
    robot: Robot, slide_turn: float | None, rng: np.random.Generator
) -> None:
    errors, q = random_errors(robot, rng, 0.05), random_positions(robot, rng, 1)
    if slide_turn is not None:
        errors.twists[robot.prismatic, 3:] *= slide_turn / 0.05
    pose, jacobian = mechanism(robot.chain, errors).forward_and_jacobian(q)
    start = by_definition(robot, errors, q)
    np.testing.assert_allclose(pose, start, atol=1e-12)
    assert_derivative(lambda x: relative_error(errors.frames(robot.chain, x[None]).tool, start)[0], jacobian[0], q[0])


def test_without_errors_the_mechanism_is_the_nominal_one(robot: Robot, rng: np.random.Generator) -> None:
    q = random_positions(robot, rng, 5)
    pose = mechanism(robot.chain, GeometricErrors.none(robot.n)).forward(q)
    np.testing.assert_allclose(pose, expm_chain(robot.chain.placements, robot.chain.twists, q), atol=1e-12)


def test_moved_placements_are_followed_by_the_step(rng: np.random.Generator) -> None:
    errors = GeometricErrors(rng.normal(size=(4, 6)) * 0.3, rng.normal(size=(3, 6)), rng.normal(size=3))
    step = rng.normal(size=(4, 6)) * 0.3
    moved = errors.moved_placements(step)
    for before, added, after in zip(errors.placements, step, moved.placements, strict=True):
        np.testing.assert_allclose(
            single_exponential(after), single_exponential(before) @ single_exponential(added), atol=1e-12
        )
    assert moved.twists is errors.twists
    assert moved.offsets is errors.offsets


def test_steps_that_undo_each_other_leave_the_placements(rng: np.random.Generator) -> None:
    errors = GeometricErrors(rng.normal(size=(4, 6)) * 0.3, np.zeros((3, 6)), np.zeros(3))
    step = rng.normal(size=(4, 6))
    back = errors.moved_placements(step).moved_placements(-step)
    np.testing.assert_allclose(back.placements, errors.placements, atol=1e-12)


def test_a_relative_error_leads_from_the_nominal_to_the_actual_pose_in_the_base_frame(rng: np.random.Generator) -> None:
    nominal, actual, base = exp6(rng.normal(size=(3, 5, 6)))
    error = relative_error(actual, nominal)
    np.testing.assert_allclose(exp6(error) @ nominal, actual, atol=1e-12)
    # Seen from another base frame it is the same twist in other coordinates.
    np.testing.assert_allclose(
        exp6(relative_error(base @ actual, base @ nominal)),
        exp6((adjoint(base) @ error[..., None])[..., 0]),
        atol=1e-11,
    )
