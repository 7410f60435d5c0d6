"""Error columns are the derivatives of the pose error, at the nominal robot and away from it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from derivatives import assert_derivative
from poe import random_positions

from calibtool.identification.columns import offset_columns, placement_columns, twist_columns
from calibtool.robot.geometry import GeometricErrors, relative_error
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array


@pytest.fixture(params=[0.0, 0.1], ids=["nominal", "perturbed"])
def errors(request: pytest.FixtureRequest, robot: Robot, rng: np.random.Generator) -> GeometricErrors:
    """The state at which the derivative is taken."""
    n = robot.n
    return GeometricErrors(*(rng.normal(size=shape) * request.param for shape in ((n + 1, 6), (n, 6), n)))


def assert_columns(
    robot: Robot, errors: GeometricErrors, moved: Callable[[Array], GeometricErrors], columns: Array, q: Array
) -> None:
    """`columns` (6, k) are the derivative of log6(T(moved(x)) · T(errors)⁻¹) by x (k,), at q (1, n)."""
    start = errors.frames(robot.chain, q).tool
    assert_derivative(
        lambda x: relative_error(moved(x).frames(robot.chain, q).tool, start)[0], columns, np.zeros(columns.shape[1])
    )


def test_placement_columns(robot: Robot, errors: GeometricErrors, rng: np.random.Generator) -> None:
    q = random_positions(robot, rng, 1)
    columns = placement_columns(errors.frames(robot.chain, q))[0]
    assert columns.shape == (6, 6 * robot.n + 6)
    assert_columns(robot, errors, lambda x: errors.moved_placements(x.reshape(-1, 6)), columns, q)


def test_twist_columns(robot: Robot, errors: GeometricErrors, rng: np.random.Generator) -> None:
    q = random_positions(robot, rng, 1)
    columns = twist_columns(errors.frames(robot.chain, q), robot.chain.twists + errors.twists, q + errors.offsets)[0]
    assert columns.shape == (6, 6 * robot.n)

    def moved(x: Array) -> GeometricErrors:
        return replace(errors, twists=errors.twists + x.reshape(-1, 6))

    assert_columns(robot, errors, moved, columns, q)


def test_offset_columns(robot: Robot, errors: GeometricErrors, rng: np.random.Generator) -> None:
    q = random_positions(robot, rng, 1)
    columns = offset_columns(errors.frames(robot.chain, q), robot.chain.twists + errors.twists)[0]
    assert columns.shape == (6, robot.n)
    assert_columns(robot, errors, lambda x: replace(errors, offsets=errors.offsets + x), columns, q)


def test_offset_columns_are_the_jacobian_of_pinocchio(robot: Robot, rng: np.random.Generator) -> None:
    q = random_positions(robot, rng, 10)
    frames = GeometricErrors.none(robot.n).frames(robot.chain, q)
    jacobian = robot.mechanism.forward_and_jacobian(q)[1]
    np.testing.assert_allclose(offset_columns(frames, robot.chain.twists), jacobian, atol=1e-12)


def test_columns_of_several_configurations_are_those_of_each(fanuc: Robot, rng: np.random.Generator) -> None:
    q = random_positions(fanuc, rng, 3)
    none, twists = GeometricErrors.none(6), fanuc.chain.twists

    def all_columns(rows: Array) -> Array:
        frames = none.frames(fanuc.chain, rows)
        blocks = [placement_columns(frames), twist_columns(frames, twists, rows), offset_columns(frames, twists)]
        return np.concatenate(blocks, axis=-1)

    together = all_columns(q)
    assert together.shape == (3, 6, 42 + 36 + 6)
    for k in range(3):
        np.testing.assert_allclose(together[k], all_columns(q[k : k + 1])[0], atol=1e-14)


def test_a_joint_at_zero_does_not_show_its_twist_error(fanuc: Robot, rng: np.random.Generator) -> None:
    q = random_positions(fanuc, rng, 1)
    q[0, 2] = 0.0
    columns = twist_columns(GeometricErrors.none(6).frames(fanuc.chain, q), fanuc.chain.twists, q)[0].reshape(6, 6, 6)
    assert np.abs(columns[:, 2]).max() == 0.0
    assert (np.abs(np.delete(columns, 2, axis=1)).max(axis=(0, 2)) > 1e-3).all()
