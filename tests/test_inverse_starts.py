"""Starts lie within the limits, and the nearest ones are those a direct comparison of
all poses finds.
"""

import numpy as np
import pytest
from poe import expm_chain, random_positions
from scipy.spatial.transform import Rotation

from calibtool.robot.catalogue import load_robot
from calibtool.robot.inverse_starts import Starts, drawn, starts_of
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array


def distances(robot: Robot, a: Array, b: Array) -> Array:
    """|Δp|²/length² + |ΔR|²/2 of two sets of poses, pair by pair: 4 sin²(angle/2) is
    the second term.
    """
    turned = (
        Rotation.from_matrix(a[:, None, :3, :3]) * Rotation.from_matrix(b[None, :, :3, :3]).inv()
    )
    shift = np.linalg.norm(a[:, None, :3, 3] - b[None, :, :3, 3], axis=-1) / robot.length
    result: Array = shift**2 + 4.0 * np.sin(turned.magnitude() / 2.0) ** 2
    return result


def test_starts_are_within_the_limits_and_within_one_turn(robot: Robot) -> None:
    q = starts_of(robot).q
    assert robot.within_limits(q).all()
    assert (np.ptp(q, axis=0)[~np.array(robot.prismatic)] <= 2 * np.pi).all()
    assert (np.ptp(q, axis=0) > 0.95 * np.minimum(robot.upper - robot.lower, 2 * np.pi)).all()


@pytest.mark.parametrize("name", ["ur5", "panda", "scara"])
@pytest.mark.parametrize("count", [1, 2, 24])
def test_the_nearest_are_those_of_a_direct_comparison(
    name: str, count: int, rng: np.random.Generator
) -> None:
    robot, starts = load_robot(name), starts_of(load_robot(name))
    target = robot.mechanism.forward(random_positions(robot, rng, 20))
    every = distances(
        robot, target, expm_chain(robot.chain.placements, robot.chain.twists, starts.q)
    )
    expected = np.sort(every, axis=1)[:, :count]
    found = starts.nearest(target, count)
    assert found.shape == (20, count, robot.n)
    poses = expm_chain(
        robot.chain.placements, robot.chain.twists, found.reshape(-1, robot.n)
    ).reshape(20, count, 4, 4)
    for k in range(20):
        np.testing.assert_allclose(
            distances(robot, target[k : k + 1], poses[k])[0], expected[k], atol=1e-9
        )


def test_a_start_is_the_nearest_to_its_own_pose(robot: Robot) -> None:
    starts = Starts.of(robot)
    own = robot.mechanism.forward(starts.q[:300])
    pose = robot.mechanism.forward(starts.nearest(own, 1)[:, 0])
    np.testing.assert_allclose(pose, own, atol=1e-7)


def test_drawn_positions_fill_the_limits_evenly(robot: Robot, rng: np.random.Generator) -> None:
    q = drawn(robot, 20_000, rng)
    assert robot.within_limits(q).all()
    share = (q - q.min(axis=0)) / np.ptp(q, axis=0)
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=0.015)
    np.testing.assert_allclose(share.std(axis=0), 12**-0.5, atol=0.015)


def test_no_pose_has_no_start() -> None:
    assert starts_of(load_robot("ur5")).nearest(np.zeros((0, 4, 4)), 3).shape == (0, 3, 6)
