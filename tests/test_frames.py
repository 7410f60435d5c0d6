"""Frames on the way to the tool, against the product of exponentials written with scipy's
matrix exponential.
"""

import numpy as np
import pytest
from poe import expm_chain, poe_frames, random_positions

from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.robot.robot import Robot


@pytest.mark.parametrize("size", [0.0, 1e-3, 0.1])
def test_every_frame_is_where_the_matrix_exponentials_put_it(
    robot: Robot, size: float, rng: np.random.Generator
) -> None:
    chain, q = robot.chain, random_positions(robot, rng, 5)
    shapes = (robot.n + 1, 6), (robot.n, 6), (robot.n,)
    families = ("placements", "twists", "offsets")
    drawn = {
        family: rng.normal(size=shape) * size
        for family, shape in zip(families, shapes, strict=True)
    }
    errors = RobotErrors.of(robot, **drawn)
    found = errors.mechanism.frames(q)
    identity = np.array([np.eye(4)] * 2)
    placements = np.array(
        [
            M @ expm_chain(identity, x[None], np.ones((1, 1)))[0]
            for M, x in zip(chain.placements, errors["placements"], strict=True)
        ]
    )
    expected = poe_frames(placements, chain.twists + errors["twists"], q + errors["offsets"])
    np.testing.assert_allclose(found.tool, expected.tool, atol=1e-12)
    np.testing.assert_allclose(found.before, expected.before, atol=1e-12)
    np.testing.assert_allclose(found.after, expected.after, atol=1e-12)


def test_at_zero_only_the_placements_are_left(robot: Robot) -> None:
    chain = robot.chain
    frames = robot.mechanism.frames(np.zeros((1, robot.n)))
    np.testing.assert_allclose(
        frames.tool[0], np.linalg.multi_dot(list(chain.placements)), atol=1e-14
    )
    np.testing.assert_allclose(frames.before, frames.after, atol=1e-15)


def test_the_tool_frame_is_the_forward_kinematics(robot: Robot, rng: np.random.Generator) -> None:
    q = random_positions(robot, rng, 3)
    np.testing.assert_array_equal(robot.mechanism.frames(q).tool, robot.mechanism.forward(q))


def test_no_configuration_gives_no_frame(fanuc: Robot) -> None:
    frames = fanuc.mechanism.frames(np.zeros((0, 6)))
    assert frames.tool.shape == (0, 4, 4)
    assert frames.before.shape == (0, 6, 4, 4)
