"""Compensation: the corrected joints put the calibrated tool where it was asked to be, and
doubtful rows say so.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify, train
from calibtool.compensation.one_step import default_bounds, one_step
from calibtool.compensation.solve import compensate_joints, compensate_poses
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.errors import InputError
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

SIX_OR_MORE = ("fanuc-m1000ia", "panda", "ur5")
FEWER = ("gantry", "planar-3r", "scara")
BASES = ("nominal", "local-poe")
FEW = examples(8)


@cache
def calibrated(name: str, base: str, network: bool = True) -> Calibration:
    robot = load_robot(name)
    measurements = simulate(robot, Simulation(seed=1, configurations=60))
    if not network:
        return identify(measurements, base)
    return train(measurements, base, TrainingOptions(regularisation="early-stopping", restarts=1))


@cache
def zero(name: str, base: str) -> Calibration:
    """A calibration of a robot without errors: an identified model with nothing in it."""
    calibration = calibrated(name, "nominal", network=False)
    return replace(calibration, base=replace(calibration.base, model=base))


def configurations(robot: Robot, count: int = 30, seed: int = 4) -> Array:
    return sample_configurations(robot, robot.workspace(), count, np.random.default_rng(seed))


def angle(a: Array, b: Array) -> Array:
    return Rotation.from_matrix(a[:, :3, :3] @ np.swapaxes(b[:, :3, :3], -1, -2)).magnitude()


# --- exact ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("name", SIX_OR_MORE)
def test_the_calibrated_robot_arrives_at_the_commanded_pose(name: str, base: str) -> None:
    calibration = calibrated(name, base)
    q = configurations(calibration.robot)
    commanded = calibration.robot.mechanism.forward(q)
    result = compensate_joints(calibration, q)
    reached = calibration.forward(result.q)
    assert (result.status == "ok").all()
    assert np.abs(reached[:, :3, 3] - commanded[:, :3, 3]).max() < 1e-9
    assert angle(reached, commanded).max() < 1e-9
    assert (
        np.linalg.norm(calibration.forward(q)[:, :3, 3] - commanded[:, :3, 3], axis=-1).min() > 1e-5
    )


@given(seed=st.integers(0, 10_000), name=st.sampled_from(SIX_OR_MORE), base=st.sampled_from(BASES))
@FEW
def test_correcting_where_the_calibrated_robot_went_gives_the_joints_back(
    seed: int, name: str, base: str
) -> None:
    calibration = calibrated(name, base)
    q = configurations(calibration.robot, 3, seed)
    result = compensate_poses(calibration, calibration.forward(q), q)
    reached = calibration.forward(result.q)
    assert np.abs(reached - calibration.forward(q)).max() < 1e-9
    if calibration.robot.n == 6:
        assert np.abs(result.q - q).max() < 1e-7


def test_the_actual_robot_is_put_right_by_its_own_geometry() -> None:
    robot = load_robot("ur5")
    measurements = simulate(robot, Simulation(seed=2, configurations=30))
    truth = measurements.truth
    assert truth is not None
    calibration = zero("ur5", "local-poe")
    exact = replace(calibration, base=replace(calibration.base, errors=truth.actual.errors))
    q = configurations(robot)
    reached = truth.actual.forward(compensate_joints(exact, q).q)
    commanded = robot.mechanism.forward(q)
    assert np.abs(reached - commanded).max() < 1e-9
    assert np.abs(truth.actual.forward(q) - commanded).max() > 1e-4


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("name", FEWER)
def test_with_fewer_joints_no_small_motion_comes_nearer(name: str, base: str) -> None:
    """With equal weights, the remaining error is the least one: translation over the characteristic
    length, and rotation.
    """
    calibration = calibrated(name, base)
    robot = calibration.robot
    q = configurations(robot, 8)
    commanded = robot.mechanism.forward(q)
    result = compensate_joints(
        calibration, q, bounds=default_bounds(calibration, weights=(1.0,) * 6)
    )

    def error(joints: Array, k: int) -> Array:
        pose = calibration.forward(joints[None])[0]
        turn = Rotation.from_matrix(commanded[k, :3, :3] @ pose[:3, :3].T).as_rotvec()
        return np.concatenate([(commanded[k, :3, 3] - pose[:3, 3]) / robot.length, turn])

    for k in range(len(q)):
        here = float((error(result.q[k], k) ** 2).sum())
        best = least_squares(error, q[k], args=(k,), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert here <= 2 * best.cost * (1 + 2e-3)  # ∂N/∂q is left out of the steps: a thousandth
        assert here < float((error(q[k], k) ** 2).sum())
    pose = calibration.forward(result.q)
    assert np.allclose(
        result.position, np.linalg.norm(pose[:, :3, 3] - commanded[:, :3, 3], axis=-1), atol=1e-12
    )
    assert np.allclose(result.orientation, angle(pose, commanded), atol=1e-9)
    assert (result.position + result.orientation > 1e-6).all()  # something is always left


def test_a_planar_arm_corrects_its_plane_although_it_cannot_leave_it() -> None:
    calibration = calibrated("planar-3r", "local-poe", network=False)
    robot = calibration.robot
    q = configurations(robot)
    commanded = robot.mechanism.forward(q)
    before = np.linalg.norm((calibration.forward(q) - commanded)[:, :2, 3], axis=-1)
    after = np.linalg.norm(
        (calibration.forward(compensate_joints(calibration, q).q) - commanded)[:, :2, 3], axis=-1
    )
    assert after.max() < 0.05 * before.max()


# --- one step -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "panda", "scara"])
def test_one_step_on_the_nominal_base_subtracts_the_network(name: str) -> None:
    # Eq. 23, the network written out.
    calibration = calibrated(name, "nominal")
    w = calibration.network
    assert w is not None
    q = configurations(calibration.robot)
    hidden = np.tanh(((q - w.input_centre) / w.input_scale) @ w.hidden_weights.T + w.hidden_bias)
    motion = (hidden @ w.output_weights.T + w.output_bias) * w.output_scale
    n = calibration.robot.n
    assert np.allclose(
        compensate_joints(calibration, q, "one-step").q, q - motion[:, :n], atol=1e-15
    )
    assert np.abs(motion[:, :n]).max() > 1e-5


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("name", SIX_OR_MORE)
def test_one_step_comes_near_the_exact_solution(name: str, base: str) -> None:
    calibration = calibrated(name, base)
    q = configurations(calibration.robot)
    commanded = calibration.robot.mechanism.forward(q)
    before, after = (
        np.linalg.norm(calibration.forward(joints)[:, :3, 3] - commanded[:, :3, 3], axis=-1)
        for joints in (q, compensate_joints(calibration, q, "one-step").q)
    )
    assert after.max() < 0.1 * before.max()


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "panda", "scara"])
def test_one_step_on_an_identified_base_is_the_pseudo_inverse_of_the_pose_error(name: str) -> None:
    # Eq. 15: δρ of minimum norm with J_ρ δρ = δy, J_ρ of the calibrated chain by differences.
    calibration = calibrated(name, "local-poe", network=False)
    robot, n = calibration.robot, calibration.robot.n
    q = configurations(robot, 4)
    stepped = one_step(calibration, q).q
    for k in range(len(q)):
        pose, nominal = (
            calibration.forward(q[k : k + 1])[0],
            robot.mechanism.forward(q[k : k + 1])[0],
        )
        columns = []
        for j in range(n):
            e = 1e-6 * np.eye(n)[j]
            rate = (
                calibration.forward((q[k] + e)[None])[0] - calibration.forward((q[k] - e)[None])[0]
            ) / 2e-6
            W = rate[:3, :3] @ pose[:3, :3].T
            columns.append([*(rate[:3, 3] / robot.length), W[2, 1], W[0, 2], W[1, 0]])
        for joint in calibration.equivalent.virtual_joints:
            axis = pose[:3, "xyz".index(joint[-1])]
            columns.append(
                [0, 0, 0, *axis] if joint.startswith("r") else [*(axis / robot.length), 0, 0, 0]
            )
        turn = Rotation.from_matrix(pose[:3, :3] @ nominal[:3, :3].T).as_rotvec()
        error = np.concatenate([(pose[:3, 3] - nominal[:3, 3]) / robot.length, turn])
        motion = np.linalg.pinv(np.array(columns).T) @ error
        assert np.abs(q[k] - stepped[k] - motion[:n]).max() < 0.01 * np.abs(motion).max()


# --- nothing to correct ---------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["exact", "one-step"])
@pytest.mark.parametrize("base", BASES)
def test_a_calibration_without_errors_leaves_the_joints_alone(
    robot: Robot, base: str, method: str
) -> None:
    q = configurations(robot, 10)
    result = compensate_joints(zero(robot.name, base), q, method)
    assert np.abs(result.q - q).max() < 1e-9
    assert (result.status == "ok").all()
    assert result.position.max() < 1e-9
    assert result.orientation.max() < 1e-7


# --- doubtful rows --------------------------------------------------------------------------------

UR5_HOME = np.deg2rad([0.0, -80.0, 100.0, -110.0, -90.0, 0.0])


@pytest.mark.parametrize("method", ["exact", "one-step"])
@pytest.mark.parametrize("base", BASES)
def test_rows_near_a_singularity_are_marked_and_their_correction_is_bounded(
    base: str, method: str
) -> None:
    calibration = calibrated("ur5", base)
    q = np.tile(UR5_HOME, (41, 1))
    q[:, 4] = np.deg2rad(
        np.linspace(-1.0, 1.0, 41)
    )  # through the wrist singularity, joint 5 straight
    result = compensate_joints(calibration, q, method)
    assert (result.status == "near-singular").all()
    assert np.isfinite(result.q).all()
    most = default_bounds(calibration).largest_change
    assert 0 < most < np.deg2rad(30)
    assert np.abs(result.q - q).max() <= min(most, np.deg2rad(15))
    away = compensate_joints(calibration, UR5_HOME[None], method)
    assert list(away.status) == ["ok"]


def test_corrections_that_lead_over_a_joint_limit_stop_there() -> None:
    calibration = calibrated("ur5", "local-poe")
    robot = calibration.robot
    inside = np.tile(UR5_HOME, (2, 1))
    inside[:, 0] = [robot.upper[0], robot.lower[0]]
    result = compensate_joints(calibration, inside)
    assert robot.within_limits(result.q).all()
    # The correction leaves one end of the range and enters the other: one of them is
    # held at its limit.
    free = inside - [np.pi, 0, 0, 0, 0, 0] * np.sign(inside)
    wanted = compensate_joints(calibration, free).q - free
    held = (inside + wanted < robot.lower) | (inside + wanted > robot.upper)
    assert held.any(axis=-1).sum() == 1
    assert list(result.status == "out-of-limits") == list(held.any(axis=-1))
    assert list(result.status == "ok") == list(~held.any(axis=-1))
    np.testing.assert_array_equal(result.q[held], inside[held])


def test_a_pose_out_of_reach_has_no_joints_and_is_marked() -> None:
    calibration = calibrated("ur5", "local-poe")
    poses = calibration.robot.mechanism.forward(np.tile(UR5_HOME, (3, 1)))
    poses[1, :3, 3] *= 10.0
    for seed in (None, np.tile(UR5_HOME, (3, 1))):
        result = compensate_poses(calibration, poses, seed)
        assert list(result.status) == ["ok", "unreachable", "ok"]
        assert np.isnan(result.q[1]).all()
        assert np.isfinite(result.q[[0, 2]]).all()


# --- poses ----------------------------------------------------------------------------------------


def test_poses_and_their_joints_are_corrected_alike() -> None:
    calibration = calibrated("ur5", "local-poe")
    q = configurations(calibration.robot, 10)
    by_joints = compensate_joints(calibration, q)
    by_poses = compensate_poses(calibration, calibration.robot.mechanism.forward(q), q)
    assert np.abs(by_joints.q - by_poses.q).max() < 1e-7


def test_poses_along_a_path_stay_on_one_branch() -> None:
    calibration = calibrated("ur5", "local-poe")
    start = calibration.robot.mechanism.forward(UR5_HOME[None])
    path = np.repeat(start, 20, axis=0)
    path[:, 1, 3] += np.linspace(-0.2, 0.2, 20)
    result = compensate_poses(calibration, path)
    assert (result.status == "ok").all()
    assert np.abs(np.diff(result.q, axis=0)).max() < 0.2
    assert np.abs(calibration.forward(result.q) - path).max() < 1e-9


def test_the_seed_chooses_the_branch() -> None:
    calibration = calibrated("fanuc-m1000ia", "local-poe", network=False)
    robot = calibration.robot
    home = robot.workspace().home
    flipped = home * [1, 1, 1, 1, -1, 1] + [
        0,
        0,
        0,
        np.pi,
        0,
        np.pi,
    ]  # a spherical wrist, turned over
    pose = robot.mechanism.forward(home[None])
    assert np.abs(robot.mechanism.forward(flipped[None]) - pose).max() < 1e-9
    for seed in (home, flipped):
        result = compensate_poses(calibration, pose, seed[None])
        assert np.abs(result.q[0] - seed).max() < 0.02
        assert np.abs(calibration.forward(result.q) - pose).max() < 1e-9


# --- wrong input ----------------------------------------------------------------------------------


@pytest.mark.parametrize("q", [np.zeros((3, 7)), np.zeros(7), np.full((1, 6), np.inf)])
def test_joints_that_do_not_fit_the_robot_are_refused(q: Array) -> None:
    with pytest.raises(InputError, match="joint positions"):
        compensate_joints(calibrated("ur5", "local-poe"), q)


@pytest.mark.parametrize("q", [np.zeros((3, 7)), np.full(6, np.nan)])
def test_poses_and_seeds_that_are_none_are_refused(q: Array) -> None:
    calibration = calibrated("ur5", "local-poe")
    pose = calibration.robot.mechanism.forward(np.zeros((2, 6)))
    with pytest.raises(InputError, match="seeds"):
        compensate_poses(calibration, pose, q)
    with pytest.raises(InputError, match="commanded poses: row 2 is no rigid motion"):
        compensate_poses(calibration, np.stack([pose[0], 1.1 * pose[1]]))


def test_gear_errors_are_lowered_by_a_network_through_compensation() -> None:
    """End to end: the actual robot is driven to the corrected joints."""
    robot = load_robot("ur5")
    workspace = robot.workspace()
    scales = ErrorScales(kinds=("geometric", "gear"))
    measurements = simulate(robot, Simulation(seed=6, workspace=workspace, scales=scales))
    truth = measurements.truth
    assert truth is not None
    calibration = train(
        measurements, "local-poe", TrainingOptions(regularisation="early-stopping", restarts=2)
    )
    q = configurations(robot, 50)
    commanded = robot.mechanism.forward(q)
    before, after = (
        np.linalg.norm(truth.actual.forward(joints)[:, :3, 3] - commanded[:, :3, 3], axis=-1).mean()
        for joints in (q, compensate_joints(calibration, q).q)
    )
    assert after < 0.2 * before
