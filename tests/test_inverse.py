"""Inverse kinematics arrives where it was sent, inside the limits, and says so when it cannot."""

import numpy as np
import pytest
from poe import expm_chain, random_positions
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from calibtool.robot.catalogue import load_robot
from calibtool.robot.inverse import InverseResult, inverse_kinematics, solve_poses
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, translation
from calibtool.robot.singularity import at_point, scale_rows


def forward(robot: Robot, q: Array) -> Array:
    return expm_chain(robot.chain.placements, robot.chain.twists, q)


def weighted_error(robot: Robot, q: Array, target: Array) -> Array:
    """|(translation of the tool point / length, angle of rotation)|, written with traces
    and norms: (N,).
    """
    pose = forward(robot, q)
    distance = np.linalg.norm(pose[:, :3, 3] - target[:, :3, 3], axis=-1) / robot.length
    relative = target[:, :3, :3] @ np.swapaxes(pose[:, :3, :3], -1, -2)
    skewed = relative - np.swapaxes(relative, -1, -2)
    sine = np.linalg.norm(skewed, axis=(-2, -1)) / np.sqrt(8)
    angle = np.arctan2(sine, (np.trace(relative, axis1=-2, axis2=-1) - 1) / 2)
    return np.hypot(distance, angle)


def least_singular_value(robot: Robot, q: Array) -> Array:
    pose, jacobian = robot.mechanism.forward_and_jacobian(q)
    scaled = scale_rows(at_point(jacobian, pose[:, :3, 3]), robot.length)
    return np.linalg.svd(scaled, compute_uv=False).min(axis=-1)


def assert_arrived(robot: Robot, result: InverseResult, target: Array) -> None:
    assert result.reached.all()
    assert result.converged.all()
    np.testing.assert_allclose(forward(robot, result.q), target, atol=1e-7)
    assert (result.q >= robot.lower - 1e-12).all()
    assert (result.q <= robot.upper + 1e-12).all()
    assert max(result.position.max(), result.orientation.max()) < 1e-7


def test_every_pose_of_the_joint_range_is_reached_inside_the_limits(
    robot: Robot, rng: np.random.Generator
) -> None:
    target = forward(robot, random_positions(robot, rng, 60))
    assert_arrived(robot, inverse_kinematics(robot, target), target)


def test_a_seed_beside_an_answer_leads_to_this_answer(
    robot: Robot, rng: np.random.Generator
) -> None:
    q = random_positions(robot, rng, 400)
    q = q[least_singular_value(robot, q) > 0.1][:20]  # branches meet in singularities
    assert len(q) == 20
    inside = np.clip(q, robot.lower + 0.02, robot.upper - 0.02)
    seed = inside + rng.uniform(-0.01, 0.01, size=q.shape)
    result = inverse_kinematics(robot, forward(robot, inside), seed)
    assert result.reached.all()
    if robot.n <= 6:
        np.testing.assert_allclose(result.q, inside, atol=1e-6)
    else:  # one of a family of answers: that beside the seed
        assert np.abs(result.q - seed).max() < 0.1


def test_an_answer_itself_as_seed_comes_back(robot: Robot, rng: np.random.Generator) -> None:
    q = random_positions(robot, rng, 20)
    result = inverse_kinematics(robot, forward(robot, q), q)
    assert result.reached.all()
    np.testing.assert_allclose(result.q, q, atol=1e-7)


def test_several_seeds_and_one_seed_for_all_are_both_accepted(
    fanuc: Robot, rng: np.random.Generator
) -> None:
    seed = np.array([0.1, 0.2, -0.3, 0.4, -0.8, 0.2])
    target = forward(fanuc, seed + rng.uniform(-0.05, 0.05, size=(5, 6)))
    one, many = (
        inverse_kinematics(fanuc, target, seed),
        inverse_kinematics(fanuc, target, np.tile(seed, (5, 1))),
    )
    np.testing.assert_array_equal(one.q, many.q)
    assert one.reached.all()


@pytest.mark.parametrize(("angle", "turns"), [(0.5, -1), (0.5, 0), (-0.5, 0), (-0.5, 1)])
def test_an_angle_is_returned_within_half_a_turn_of_its_seed(angle: float, turns: int) -> None:
    robot = load_robot("ur5")  # joint 6 makes ±360°
    q = np.array([[0.3, -1.2, 1.0, 0.4, 0.8, angle]])
    turned = q + 2 * np.pi * turns * np.array([0, 0, 0, 0, 0, 1])
    result = inverse_kinematics(robot, forward(robot, q), turned + 0.05)
    np.testing.assert_allclose(result.q, turned, atol=1e-6)


@pytest.mark.parametrize("name", ["ur5", "fanuc-m1000ia", "xarm7"])
def test_far_answers_are_turned_to_within_half_a_turn_of_the_seed(
    name: str, rng: np.random.Generator
) -> None:
    robot = load_robot(name)
    seed = random_positions(robot, rng, 30)
    target = forward(robot, random_positions(robot, rng, 30))
    result = inverse_kinematics(robot, target, seed)
    assert_arrived(robot, result, target)
    turned = result.q + 2 * np.pi * np.arange(-2, 3)[:, None, None]
    near = (turned >= robot.lower) & (turned <= robot.upper) & (np.abs(turned - seed) <= np.pi)
    assert (np.abs(result.q - seed) <= np.pi + 1e-9)[near.any(axis=0)].all()


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "ur5", "scara"])
def test_further_starts_never_come_out_farther_away(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    target = forward(robot, random_positions(robot, rng, 5))
    target[:, :3, 3] *= 1.5
    left = np.inf
    for starts in (0, 1, 2, 5):
        result = inverse_kinematics(robot, target, starts=starts)
        farther, left = left, result.position / robot.length + result.orientation
        assert (left <= farther).all()
    assert (left > 1e-3).any()


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "ur5", "panda", "scara", "planar-3r"])
def test_a_pose_out_of_reach_is_not_reached(name: str) -> None:
    robot = load_robot(name)
    links = np.linalg.norm(robot.chain.placements[:, :3, 3], axis=1).sum()
    strokes = (robot.upper - robot.lower)[robot.prismatic].sum()
    target = translation(np.array([[links + strokes + 0.2, 0.0, 0.0]]))
    result = inverse_kinematics(robot, target, starts=3)
    assert not result.reached[0]
    assert result.position[0] / robot.length + result.orientation[0] > 0.01
    # The reported remaining error is the actual one.
    left = np.hypot(result.position / robot.length, result.orientation)
    np.testing.assert_allclose(left, weighted_error(robot, result.q, target), rtol=1e-6)
    assert robot.within_limits(result.q)[0]


def test_a_pose_beyond_a_joint_limit_is_not_reached() -> None:
    gantry = load_robot("gantry")
    target = forward(gantry, np.array([[3.5, 1.0, 0.5, 0.2, 0.7]]))  # the rail ends at 3 m
    result = inverse_kinematics(gantry, target, starts=3)
    assert not result.reached[0]
    assert gantry.within_limits(result.q)[0]
    assert result.q[0, 0] == pytest.approx(3.0)


def test_one_pose_out_of_reach_does_not_disturb_the_others(
    fanuc: Robot, rng: np.random.Generator
) -> None:
    target = forward(fanuc, random_positions(fanuc, rng, 6))
    with_outlier = np.insert(target, 3, translation(np.array([9.0, 0.0, 0.0])), axis=0)
    result = inverse_kinematics(fanuc, with_outlier, starts=15)
    assert result.reached.tolist() == [True] * 3 + [False] + [True] * 3
    np.testing.assert_allclose(forward(fanuc, np.delete(result.q, 3, axis=0)), target, atol=1e-7)


@pytest.mark.parametrize("name", ["gantry", "scara", "planar-3r"])
def test_with_too_few_joints_no_small_motion_comes_nearer(
    name: str, rng: np.random.Generator
) -> None:
    robot = load_robot(name)
    q = robot.lower + (robot.upper - robot.lower) * rng.uniform(0.2, 0.8, size=(60, robot.n))
    q = q[least_singular_value(robot, q) > 0.2][:20]
    assert len(q) == 20
    target = exp6(rng.normal(size=(20, 6)) * 0.03) @ forward(robot, q)
    result = inverse_kinematics(robot, target, q, starts=0)
    assert result.converged.all()
    assert not result.reached.any()
    assert ((result.q > robot.lower) & (result.q < robot.upper)).all()
    left = weighted_error(robot, result.q, target)
    assert (left < weighted_error(robot, q, target)).all()
    for size in (1e-4, 1e-2):
        for _ in range(10):
            step = rng.normal(size=q.shape)
            step *= size / np.linalg.norm(step, axis=1, keepdims=True)
            assert (weighted_error(robot, result.q + step, target) > left).all()


@pytest.mark.parametrize(
    ("name", "q"), [("scara", [0.3, 0.1, 0.1, 0.2]), ("planar-3r", [0.3, 0.1, 0.4])]
)
@pytest.mark.parametrize("beyond", [0.005, 0.01, 0.02])
def test_beyond_a_stretched_elbow_the_nearest_pose_is_found(
    name: str, q: list[float], beyond: float
) -> None:
    robot, seed = load_robot(name), np.array([q])
    target = forward(robot, seed)
    outwards = target[0, :2, 3] / np.linalg.norm(target[0, :2, 3])
    target[0, :2, 3] += beyond * outwards
    target[0, :3, :3] = Rotation.from_rotvec([0.05, 0.0, 0.1]).as_matrix() @ target[0, :3, :3]
    left = weighted_error(robot, inverse_kinematics(robot, target, seed, starts=2).q, target)[0]
    nearest = min(
        minimize(
            lambda x: float(weighted_error(robot, x[None], target)[0]),
            start,
            method="Nelder-Mead",
            tol=1e-9,
        ).fun
        for start in (seed[0], seed[0] * [1, -1, *[1] * (robot.n - 2)])  # either elbow
    )
    assert left <= 1.005 * nearest


def test_what_no_joint_can_turn_is_left_and_no_shift_is_given_for_it() -> None:
    # A planar arm cannot tilt: the remaining error of a rotation about x is that rotation.
    robot = load_robot("planar-3r")
    q = np.array([[0.3, 0.8, -0.4]])
    pose = forward(robot, q)
    target = pose.copy()
    target[0, :3, :3] = Rotation.from_rotvec([0.1, 0.0, 0.0]).as_matrix() @ pose[0, :3, :3]
    result = inverse_kinematics(robot, target, q, starts=0)
    assert result.position[0] < 1e-9
    assert result.orientation[0] == pytest.approx(0.1, abs=1e-9)
    assert result.converged[0]


def test_the_same_question_has_the_same_answer(robot: Robot, rng: np.random.Generator) -> None:
    target = forward(robot, random_positions(robot, rng, 10))
    first, second = (
        inverse_kinematics(robot, target, starts=4),
        inverse_kinematics(robot, target, starts=4),
    )
    np.testing.assert_array_equal(first.q, second.q)
    np.testing.assert_array_equal(first.iterations, second.iterations)


def test_the_arguments_are_left_as_they_were(fanuc: Robot, rng: np.random.Generator) -> None:
    q = random_positions(fanuc, rng, 3)
    target, seed = forward(fanuc, q), q + 0.1
    kept_target, kept_seed = target.copy(), seed.copy()
    inverse_kinematics(fanuc, target, seed)
    solve_poses(fanuc.mechanism.forward_and_jacobian, target, seed, length=fanuc.length)
    np.testing.assert_array_equal(target, kept_target)
    np.testing.assert_array_equal(seed, kept_seed)


def test_no_pose_has_no_answer(fanuc: Robot) -> None:
    result = inverse_kinematics(fanuc, np.zeros((0, 4, 4)))
    assert result.q.shape == (0, 6)
    assert result.reached.shape == (0,)


def test_newton_without_limits_may_leave_the_joint_range(fanuc: Robot) -> None:
    beyond = np.array([[0.2, 0.3, -0.2, 0.1, -2.3, 0.2]])  # J5 ends at −122° = −2.129 rad
    target = forward(fanuc, beyond)
    free = solve_poses(
        fanuc.mechanism.forward_and_jacobian, target, beyond + 0.02, length=fanuc.length
    )
    assert free.reached[0]
    np.testing.assert_allclose(free.q, beyond, atol=1e-6)
    kept = solve_poses(
        fanuc.mechanism.forward_and_jacobian,
        target,
        beyond + 0.2,
        length=fanuc.length,
        lower=fanuc.lower,
        upper=fanuc.upper,
    )
    assert not kept.reached[0]
    assert fanuc.within_limits(kept.q)[0]
