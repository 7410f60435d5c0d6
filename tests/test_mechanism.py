"""Forward kinematics, Jacobians, the distance from a singularity and the damped solution
of joint motions.
"""

import numpy as np
import pytest
from derivatives import assert_derivative
from drawn import DrawnChain, DrawnJoint
from poe import expm_chain, poe_frames, random_positions

from calibtool.robot.catalogue import load_robot
from calibtool.robot.inverse import solve_poses
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, relative_error
from calibtool.robot.singularity import (
    at_point,
    regularised_gram,
    scale_rows,
    singularity_distance,
)


def tool_jacobian(robot: Robot, q: Array) -> Array:
    """Jacobian at the tool point, in K_0."""
    pose, jacobian = robot.mechanism.forward_and_jacobian(q)
    return at_point(jacobian, pose[:, :3, 3])


def test_the_tool_is_where_the_matrix_exponentials_put_it(
    robot: Robot, rng: np.random.Generator
) -> None:
    chain, q = robot.chain, random_positions(robot, rng, 5)
    pose = robot.mechanism.forward(q)
    np.testing.assert_allclose(pose, expm_chain(chain.placements, chain.twists, q), atol=1e-12)
    np.testing.assert_allclose(pose, poe_frames(chain.placements, chain.twists, q).tool, atol=1e-12)


def test_the_jacobian_is_the_derivative_of_the_spatial_twist(
    robot: Robot, rng: np.random.Generator
) -> None:
    for q in random_positions(robot, rng, 3):
        pose, jacobian = robot.mechanism.forward_and_jacobian(q[None])
        np.testing.assert_array_equal(pose, robot.mechanism.forward(q[None]))

        def twist(x: Array, start: Array = pose[0]) -> Array:
            return relative_error(robot.mechanism.forward(x[None])[0], start)

        assert_derivative(twist, jacobian[0], q)


def test_at_the_tool_point_the_jacobian_gives_its_velocity(
    robot: Robot, rng: np.random.Generator
) -> None:
    q = random_positions(robot, rng, 1)
    assert_derivative(
        lambda x: robot.mechanism.forward(x[None])[0, :3, 3], tool_jacobian(robot, q)[0, :3], q[0]
    )


def test_seen_at_a_point_a_twist_keeps_its_rotation_and_moves_that_point(
    rng: np.random.Generator,
) -> None:
    twists, points = rng.normal(size=(3, 6, 2)), rng.normal(size=(3, 3))
    original = twists.copy()
    seen = at_point(twists, points)
    np.testing.assert_array_equal(seen[:, 3:], twists[:, 3:])
    for k in range(3):
        for c in range(2):
            velocity = twists[k, :3, c] + np.cross(twists[k, 3:, c], points[k])
            np.testing.assert_allclose(seen[k, :3, c], velocity, atol=1e-14)
    np.testing.assert_array_equal(twists, original)


def test_singularity_distance_lies_between_a_sixth_root_and_the_least_singular_value(
    robot: Robot, rng: np.random.Generator
) -> None:
    jacobian = tool_jacobian(robot, random_positions(robot, rng, 50))
    by_length = jacobian / np.array([robot.length] * 3 + [1.0] * 3)[:, None]
    least = np.linalg.svd(by_length)[1][:, : min(robot.n, 6)].min(axis=-1)
    distance = singularity_distance(jacobian, robot.length)
    assert (distance <= least + 1e-9).all()
    assert (distance >= least / np.sqrt(6) - 1e-9).all()


def test_singularity_distance_is_the_harmonic_sum_of_the_singular_values() -> None:
    # 1/d² = 1/1² + 5 · 1/0.5² for rows of 2 m over a length of 2 m, and halves
    jacobian = np.diag([2.0, 1.0, 1.0, 0.5, 0.5, 0.5])[None]
    assert singularity_distance(jacobian, 2.0)[0] == pytest.approx(21**-0.5, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "q"),
    [
        ("fanuc-m1000ia", [0.1, 0.2, -0.3, 0.4, 0.0, 0.5]),  # axes 4 and 6 in line
        ("ur5", [0.1, -1.0, 1.2, 0.4, 0.0, 0.5]),  # axes 4 and 6 parallel
        ("planar-3r", [0.1, 0.0, 0.0]),  # the elbow stretched: det J = a1 a2 sin q2
    ],
)
def test_singularity_distance_vanishes_at_a_known_singularity(name: str, q: list[float]) -> None:
    assert load_robot(name).singularity_distance(np.array([q]))[0] < 1e-6


def test_the_gram_matrix_takes_the_smaller_side(rng: np.random.Generator) -> None:
    for joints, side in ((4, 4), (6, 6), (7, 6)):
        assert regularised_gram(rng.normal(size=(2, 6, joints)), 0.5).shape == (2, side, side)


def test_scaling_rows_leaves_rotations_and_the_argument_alone(rng: np.random.Generator) -> None:
    jacobian = rng.normal(size=(2, 6, 5))
    original = jacobian.copy()
    scaled = scale_rows(jacobian, 0.25)
    np.testing.assert_array_equal(jacobian, original)
    np.testing.assert_allclose(scaled[:, :3], 4 * original[:, :3])
    np.testing.assert_array_equal(scaled[:, 3:], original[:, 3:])


def test_no_configuration_gives_no_pose(fanuc: Robot) -> None:
    pose, jacobian = fanuc.mechanism.forward_and_jacobian(np.zeros((0, 6)))
    assert pose.shape == (0, 4, 4)
    assert jacobian.shape == (0, 6, 6)


SLIDE = DrawnJoint("prismatic", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.3, 0.4, 0.0), 0.0)
TOOL = DrawnJoint("fixed", (0.1, 0.0, 0.05), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.0)
TARGETS = ((100.0, 0.0, 0.0), (-50.0, 86.6, 0.0), (-50.0, -86.6, 0.0))


def test_a_robot_of_one_joint_has_a_jacobian_of_one_column() -> None:
    robot = DrawnChain((SLIDE,), TOOL, TARGETS).robot()
    _, jacobian = robot.mechanism.forward_and_jacobian(np.zeros((2, 1)))
    np.testing.assert_allclose(jacobian[:, :, 0], np.tile([0.6, 0.8, 0, 0, 0, 0], (2, 1)))


@pytest.mark.parametrize("count", range(2, 9))
def test_slides_side_by_side_are_singular_and_can_be_solved_all_the_same(count: int) -> None:
    robot = DrawnChain((SLIDE,) * count, TOOL, TARGETS).robot(
        scale=1e-3
    )  # short: large entries, much rounding
    q = np.full((1, count), 1e-4)
    assert robot.singularity_distance(q)[0] < 1e-3
    pose = robot.mechanism.forward(q)
    solved = solve_poses(robot.mechanism.forward_and_jacobian, pose, q, length=robot.length)
    assert solved.reached.all()
