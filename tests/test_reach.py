"""What a chain can never reach is told without a search, and nothing that it can reach is."""

import numpy as np
import pytest
from drawn import DrawnChain
from poe import expm_chain, random_positions
from scipy.spatial.transform import Rotation
from test_mechanism import SLIDE, TARGETS, TOOL

from calibtool.robot.catalogue import load_robot
from calibtool.robot.inverse import inverse_kinematics
from calibtool.robot.reach import Reach, angle_between, excluded
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import translation


def test_no_pose_of_the_joint_range_is_excluded(robot: Robot, rng: np.random.Generator) -> None:
    q = random_positions(robot, rng, 300)
    q[:100] = np.where(rng.random((100, robot.n)) < 0.7, robot.workspace().home, q[:100])
    q[100:200] = np.where(rng.random((100, robot.n)) < 0.5, robot.lower, robot.upper)
    assert not excluded(
        robot, expm_chain(robot.chain.placements, robot.chain.twists, q), 1e-8
    ).any()


def test_what_is_excluded_is_found_by_no_search(robot: Robot, rng: np.random.Generator) -> None:
    target = robot.mechanism.forward(random_positions(robot, rng, 40))
    target[:20, :3, 3] *= 1.3
    target[20:, :3, :3] = Rotation.random(20, rng=rng).as_matrix()
    reached = inverse_kinematics(robot, target, starts=4).reached
    assert not (reached & excluded(robot, target, 1e-8)).any()


@pytest.mark.parametrize(("name", "length"), [("planar-3r", 0.9), ("scara", 0.75)])
def test_bounds_of_known_arms(name: str, length: float) -> None:
    bounds = Reach.of(load_robot(name))
    assert bounds is not None
    assert bounds.distance[1] == pytest.approx(length, abs=1e-6)
    assert bounds.angle == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("name", ["ur5", "fanuc-m1000ia", "panda"])
def test_the_greatest_distance_is_nearly_taken(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    bounds = Reach.of(robot)
    assert bounds is not None
    pose = robot.mechanism.forward(random_positions(robot, rng, 20_000))
    distance = np.linalg.norm(
        pose[:, :3, :3] @ bounds.p_tool + pose[:, :3, 3] - bounds.p_base, axis=1
    )
    assert 0.99 * bounds.distance[1] < distance.max() <= bounds.distance[1] + 1e-12


@pytest.mark.parametrize("tilt", [1e-4, 0.1, 3.0])
def test_an_arm_with_parallel_axes_cannot_tilt_its_tool(
    tilt: float, rng: np.random.Generator
) -> None:
    robot = load_robot("scara")
    target = robot.mechanism.forward(random_positions(robot, rng, 10))
    assert not excluded(robot, target, 1e-5).any()
    target[:, :3, :3] = Rotation.from_rotvec([tilt, 0.0, 0.0]).as_matrix() @ target[:, :3, :3]
    assert excluded(robot, target, 1e-5).all()
    assert not excluded(robot, target, 2 * tilt).any()  # asked for no better, it may be reached


def test_what_is_excluded_is_not_started_again() -> None:
    robot = load_robot("ur5")
    target = translation(np.array([[3.0, 0.0, 0.0]]))
    once, often = inverse_kinematics(robot, target, starts=0), inverse_kinematics(robot, target)
    np.testing.assert_array_equal(once.q, often.q)
    assert not often.reached[0]


def test_slides_alone_exclude_nothing() -> None:
    robot = DrawnChain((SLIDE,), TOOL, TARGETS).robot()
    assert Reach.of(robot) is None
    assert not excluded(robot, translation(np.array([[9.0, 0.0, 0.0]])), 1e-8).any()


def test_angles_keep_their_digits_where_vectors_are_parallel() -> None:
    tilt = np.array([0.0, 1e-9, 1e-3, 1.0, np.pi])
    a = np.stack([np.cos(tilt), np.sin(tilt), 0 * tilt], axis=-1)
    np.testing.assert_allclose(
        angle_between(a, np.array([1.0, 0.0, 0.0])), tilt, rtol=1e-12, atol=1e-15
    )
