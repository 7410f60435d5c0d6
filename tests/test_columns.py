"""Error columns are the derivatives of the pose error, at the nominal robot and away from it."""

from collections.abc import Callable

import numpy as np
import pytest
from derivatives import assert_derivative
from poe import random_positions

from calibtool.errormodel.family import offset_columns
from calibtool.errormodel.placements import placement_columns
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errormodel.twists import twist_columns
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, relative_error


@pytest.fixture(params=[0.0, 0.1], ids=["nominal", "perturbed"])
def errors(request: pytest.FixtureRequest, robot: Robot, rng: np.random.Generator) -> RobotErrors:
    """The state at which the derivative is taken."""
    shapes = {"placements": (robot.n + 1, 6), "twists": (robot.n, 6), "offsets": robot.n}
    return RobotErrors.of(
        robot, **{name: rng.normal(size=shape) * request.param for name, shape in shapes.items()}
    )


def assert_columns(
    robot: Robot,
    errors: RobotErrors,
    moved: Callable[[Array], RobotErrors],
    columns: Array,
    q: Array,
) -> None:
    """`columns` (6, k) are the derivative of log6(T(moved(x)) · T(errors)⁻¹) by x
    (k,), at q (1, n).
    """
    start = errors.frames(q).tool
    assert_derivative(
        lambda x: relative_error(moved(x).frames(q).tool, start)[0],
        columns,
        np.zeros(columns.shape[1]),
    )


def test_placement_columns(robot: Robot, errors: RobotErrors, rng: np.random.Generator) -> None:
    q = random_positions(robot, rng, 1)
    columns = placement_columns(errors.frames(q))[0]
    assert columns.shape == (6, 6 * robot.n + 6)
    assert_columns(robot, errors, lambda x: errors.moved(placements=x.reshape(-1, 6)), columns, q)


def test_twist_columns(robot: Robot, errors: RobotErrors, rng: np.random.Generator) -> None:
    q = random_positions(robot, rng, 1)
    columns = twist_columns(
        errors.frames(q), robot.chain.twists + errors["twists"], q + errors["offsets"]
    )[0]
    assert columns.shape == (6, 6 * robot.n)

    assert_columns(robot, errors, lambda x: errors.moved(twists=x.reshape(-1, 6)), columns, q)


def test_offset_columns(robot: Robot, errors: RobotErrors, rng: np.random.Generator) -> None:
    q = random_positions(robot, rng, 1)
    columns = offset_columns(errors.frames(q), robot.chain.twists + errors["twists"])[0]
    assert columns.shape == (6, robot.n)
    assert_columns(robot, errors, lambda x: errors.moved(offsets=x), columns, q)


def test_offset_columns_are_the_jacobian_of_pinocchio(
    robot: Robot, rng: np.random.Generator
) -> None:
    q = random_positions(robot, rng, 10)
    frames = RobotErrors.of(robot).frames(q)
    jacobian = robot.mechanism.forward_and_jacobian(q)[1]
    np.testing.assert_allclose(offset_columns(frames, robot.chain.twists), jacobian, atol=1e-12)


def test_columns_of_several_configurations_are_those_of_each(
    fanuc: Robot, rng: np.random.Generator
) -> None:
    q = random_positions(fanuc, rng, 3)
    none, twists = RobotErrors.of(fanuc), fanuc.chain.twists

    def all_columns(rows: Array) -> Array:
        frames = none.frames(rows)
        blocks = [
            placement_columns(frames),
            twist_columns(frames, twists, rows),
            offset_columns(frames, twists),
        ]
        return np.concatenate(blocks, axis=-1)

    together = all_columns(q)
    assert together.shape == (3, 6, 42 + 36 + 6)
    for k in range(3):
        np.testing.assert_allclose(together[k], all_columns(q[k : k + 1])[0], atol=1e-14)


def test_a_joint_at_zero_does_not_show_its_twist_error(
    fanuc: Robot, rng: np.random.Generator
) -> None:
    q = random_positions(fanuc, rng, 1)
    q[0, 2] = 0.0
    columns = twist_columns(RobotErrors.of(fanuc).frames(q), fanuc.chain.twists, q)[0].reshape(
        6, 6, 6
    )
    assert np.abs(columns[:, 2]).max() == 0.0
    assert (np.abs(np.delete(columns, 2, axis=1)).max(axis=(0, 2)) > 1e-3).all()
