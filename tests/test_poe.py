"""The product of exponentials, against the same product written with scipy's matrix exponential."""

import numpy as np
from scipy.linalg import expm

from calibtool.robot.model import Robot
from calibtool.robot.poe import poe_frames
from calibtool.robot.se3 import Array


def expm_chain(placements: Array, twists: Array, q: Array) -> Array:
    """Eq. 7 as it stands, T(q) = Π_j M_j exp(ξ_j q_j) · M_{n+1}, with nothing of the package in it: (N, 4, 4)."""
    vx, vy, vz, wx, wy, wz = np.moveaxis(twists, -1, 0)
    o = np.zeros(len(twists))
    hats = np.array([[o, -wz, wy, vx], [wz, o, -wx, vy], [-wy, wx, o, vz], [o, o, o, o]])
    pose = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for j in range(len(twists)):
        pose = pose @ placements[j] @ expm(hats[..., j] * q[:, j, None, None])
    return pose @ placements[-1]


def random_positions(robot: Robot, rng: np.random.Generator, count: int) -> Array:
    return robot.lower + (robot.upper - robot.lower) * rng.random((count, robot.n))


def test_the_tool_is_where_the_matrix_exponentials_put_it(robot: Robot, rng: np.random.Generator) -> None:
    chain, q = robot.chain, random_positions(robot, rng, 5)
    tool = poe_frames(chain.placements, chain.twists, q).tool
    np.testing.assert_allclose(tool, expm_chain(chain.placements, chain.twists, q), atol=1e-12)


def test_twists_of_any_screw_are_followed(rng: np.random.Generator) -> None:
    q = rng.normal(size=(4, 3))
    placements = np.array([expm_chain(np.array([np.eye(4)] * 2), rng.normal(size=(1, 6)), np.ones((1, 1)))[0]] * 4)
    twists = rng.normal(size=(3, 6))
    np.testing.assert_allclose(
        poe_frames(placements, twists, q).tool, expm_chain(placements, twists, q), rtol=1e-10, atol=1e-10
    )


def test_a_joint_frame_is_where_a_chain_that_ends_there_has_its_tool(robot: Robot, rng: np.random.Generator) -> None:
    chain, q = robot.chain, random_positions(robot, rng, 2)
    frames = poe_frames(chain.placements, chain.twists, q)
    assert frames.before.shape == frames.after.shape == (2, robot.n, 4, 4)
    for j in range(robot.n):
        before = expm_chain(chain.placements[: j + 1], chain.twists[:j], q[:, :j])
        np.testing.assert_allclose(frames.before[:, j], before, atol=1e-12)
        still = np.concatenate([chain.placements[: j + 1], np.eye(4)[None]])
        np.testing.assert_allclose(
            frames.after[:, j], expm_chain(still, chain.twists[: j + 1], q[:, : j + 1]), atol=1e-12
        )


def test_at_zero_only_the_placements_are_left(robot: Robot) -> None:
    chain = robot.chain
    frames = poe_frames(chain.placements, chain.twists, np.zeros((1, robot.n)))
    np.testing.assert_allclose(frames.tool[0], np.linalg.multi_dot(list(chain.placements)), atol=1e-14)
    np.testing.assert_array_equal(frames.before, frames.after)


def test_no_configuration_gives_no_frame(fanuc: Robot) -> None:
    frames = poe_frames(fanuc.chain.placements, fanuc.chain.twists, np.zeros((0, 6)))
    assert frames.tool.shape == (0, 4, 4)
    assert frames.before.shape == (0, 6, 4, 4)
