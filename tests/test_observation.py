"""What an instrument sees: derivatives of the observation, residuals of exact data, and weights."""

from dataclasses import replace

import numpy as np
import pytest
from derivatives import assert_derivative
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import (
    measured_in_base,
    observation_matrix,
    residuals,
    target_columns,
    weights,
)
from calibtool.measurement.setup import Setup
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

KINDS = ("one target", "three targets", "6-D sensor")


def random_pose(rng: np.random.Generator) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.random(rng=rng).as_matrix()
    T[:3, 3] = rng.uniform(-3, 3, 3)
    return T


def random_setup(kind: str, rng: np.random.Generator) -> Setup:
    m = 3 if kind == "three targets" else 1
    sensor = Rotation.random(rng=rng).as_matrix() if kind == "6-D sensor" else None
    return Setup(random_pose(rng), rng.uniform(-0.5, 0.5, (m, 3)), sensor)


def exact_measurements(robot: Robot, setup: Setup, q: Array, poses: Array) -> Measurements:
    """What an instrument without noise reads, written out target by target."""
    N, m = len(q), len(setup.targets)
    points = np.empty((N, m, 3))
    rotations = None if setup.R_tool_sensor is None else np.empty((N, 3, 3))
    for k in range(N):
        T = setup.T_instrument_base @ poses[k]
        for i in range(m):
            points[k, i] = (T @ [*setup.targets[i], 1.0])[:3]
        if rotations is not None:
            rotations[k] = T[:3, :3] @ setup.R_tool_sensor
    return Measurements(robot, q, points, rotations, setup, 0.02e-3, 0.3e-3)


def twist_matrix(twist: Array) -> Array:
    v, (a, b, c) = twist[:3], twist[3:]
    return np.array([[0, -c, b, v[0]], [c, 0, -a, v[1]], [-b, a, 0, v[2]], [0, 0, 0, 0]])


def predicted(setup: Setup, pose: Array, turned_from: Array) -> Array:
    """Observation (d,) in K_0: target points, and the sensor's turn from
    a reference orientation.
    """
    parts = [pose[:3, :3] @ target + pose[:3, 3] for target in setup.targets]
    if setup.R_tool_sensor is not None:
        parts.append(
            Rotation.from_matrix(pose[:3, :3] @ setup.R_tool_sensor @ turned_from.T).as_rotvec()
        )
    return np.concatenate(parts)


def sensor_in_base(setup: Setup, pose: Array) -> Array:
    return np.eye(3) if setup.R_tool_sensor is None else pose[:3, :3] @ setup.R_tool_sensor


@pytest.mark.parametrize("kind", KINDS)
def test_observation_matrix_is_the_derivative_by_the_pose_error(
    kind: str, rng: np.random.Generator
) -> None:
    setup = random_setup(kind, rng)
    poses = np.stack([random_pose(rng) for _ in range(4)])
    P = observation_matrix(setup, poses)
    for pose, matrix in zip(poses, P, strict=True):
        reference = sensor_in_base(setup, pose)

        def observe(dy: Array, pose: Array = pose, reference: Array = reference) -> Array:
            return predicted(setup, expm(twist_matrix(dy)) @ pose, reference)

        assert_derivative(observe, matrix, np.zeros(6), step=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_target_columns_are_the_derivative_by_targets_and_sensor_turn(
    kind: str, rng: np.random.Generator
) -> None:
    setup = replace(random_setup(kind, rng), targets_known=False)
    m = len(setup.targets)
    poses = np.stack([random_pose(rng) for _ in range(4)])
    columns = target_columns(setup, poses)
    for pose, matrix in zip(poses, columns, strict=True):
        reference = sensor_in_base(setup, pose)

        def observe(shift: Array, pose: Array = pose, reference: Array = reference) -> Array:
            moved = replace(setup, targets=setup.targets + shift[: 3 * m].reshape(m, 3))
            if moved.R_tool_sensor is not None:
                turn = Rotation.from_rotvec(shift[3 * m :]).as_matrix()
                moved = replace(moved, R_tool_sensor=turn @ moved.R_tool_sensor)
            return predicted(moved, pose, reference)

        assert_derivative(observe, matrix, np.zeros(matrix.shape[1]), step=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_residuals_of_exact_data_are_zero_wherever_the_instrument_stands(
    kind: str, rng: np.random.Generator
) -> None:
    robot = load_robot("ur5")
    q = robot.lower + (robot.upper - robot.lower) * rng.random((7, robot.n))
    poses = robot.mechanism.forward(q)
    setup = random_setup(kind, rng)
    left = residuals(exact_measurements(robot, setup, q, poses), setup, poses)
    assert left.shape == (7, {"one target": 3, "three targets": 9, "6-D sensor": 6}[kind])
    assert np.abs(left).max() < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_residuals_are_measured_minus_predicted_along_the_axes_of_the_base(
    kind: str, rng: np.random.Generator
) -> None:
    robot = load_robot("ur5")
    q = robot.lower + (robot.upper - robot.lower) * rng.random((5, robot.n))
    poses = robot.mechanism.forward(q)
    setup = random_setup(kind, rng)
    shift, turn = np.array([1e-3, -2e-3, 3e-3]), np.array([2e-4, 1e-4, -3e-4])
    moved = poses.copy()
    moved[:, :3, 3] += shift
    left = residuals(exact_measurements(robot, setup, q, moved), setup, poses)
    m = len(setup.targets)
    assert np.allclose(left[:, : 3 * m], np.tile(shift, m), atol=1e-12)
    if kind == "6-D sensor":
        moved[:, :3, :3] = Rotation.from_rotvec(turn).as_matrix() @ poses[:, :3, :3]
        left = residuals(exact_measurements(robot, setup, q, moved), setup, poses)
        assert np.allclose(left[:, 3:], turn, atol=1e-12)


def test_measured_values_come_back_to_the_base_frame(rng: np.random.Generator) -> None:
    robot = load_robot("ur5")
    q = np.zeros((3, 6))
    poses = robot.mechanism.forward(q)
    setup = random_setup("6-D sensor", rng)
    readings = measured_in_base(exact_measurements(robot, setup, q, poses), setup)
    points, rotations = readings.points, readings.rotations
    assert rotations is not None
    assert np.allclose(
        points[:, 0], poses[:, :3, :3] @ setup.targets[0] + poses[:, :3, 3], atol=1e-12
    )
    assert np.allclose(rotations, poses[:, :3, :3] @ setup.R_tool_sensor, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_weights_turn_the_stated_noise_into_one(kind: str, rng: np.random.Generator) -> None:
    robot = load_robot("ur5")
    q = np.zeros((2, 6))
    setup = random_setup(kind, rng)
    measurements = exact_measurements(
        robot, setup, q, robot.mechanism.forward(q)
    )  # 0.02 mm, 0.3 mrad
    sigma = [0.02e-3] * (3 * len(setup.targets)) + [0.3e-3] * (3 * (kind == "6-D sensor"))
    assert np.allclose(weights(measurements) * sigma, 1.0, atol=0, rtol=1e-14)


def test_deviations_of_axes_weigh_along_the_instrument_s_axes(rng: np.random.Generator) -> None:
    """A row's squares are xᵀ C⁻¹ x with the covariance C of its points in K_0, and columns are
    weighed like residuals.
    """
    from calibtool.measurement.observation import linearised, weighted_residuals
    from calibtool.measurement.simulate import Simulation, simulate

    measurements = simulate(
        load_robot("ur5"), Simulation(configurations=5, unregistered=True, workspace="full")
    )
    deviations = rng.uniform(0.01, 0.3, (5, 9)) * 1e-3
    uneven = replace(measurements, deviations=deviations)
    pose = measurements.robot.mechanism.forward(measurements.q)
    plain = residuals(uneven, uneven.setup, pose)
    found = (weighted_residuals(uneven, uneven.setup, pose) ** 2).sum(axis=-1)
    R = uneven.setup.T_instrument_base[:3, :3]
    for k in range(5):
        C = np.zeros((9, 9))
        for i in range(3):
            block = slice(3 * i, 3 * i + 3)
            C[block, block] = R.T @ np.diag(deviations[k, block] ** 2) @ R
        assert np.isclose(found[k], plain[k] @ np.linalg.solve(C, plain[k]))
    columns, left = linearised(uneven, uneven.setup, pose, None, targets=True)
    step = rng.normal(size=9) * 1e-6
    moved = weighted_residuals(uneven, uneven.setup.kind.moved(uneven.setup, step), pose)
    np.testing.assert_allclose(left - moved, columns @ step, atol=1e-12)
    even = replace(measurements, deviations=np.full((5, 9), measurements.noise_position))
    same = (weighted_residuals(even, even.setup, pose) ** 2).sum(axis=-1)
    np.testing.assert_allclose(
        same, (weighted_residuals(measurements, measurements.setup, pose) ** 2).sum(axis=-1)
    )


def test_an_instrument_that_is_bad_along_one_axis_is_used_along_the_others(
    rng: np.random.Generator,
) -> None:
    from calibtool.calibration import identify
    from calibtool.measurement.simulate import Simulation, simulate

    robot = load_robot("ur5")
    errors = []
    for seed in range(3):
        exact = simulate(
            robot, Simulation(seed=seed, configurations=60, noise=0.0, workspace="full")
        )
        deviations = np.tile([2e-3, 0.02e-3, 0.02e-3], (60, 3))
        noisy = exact.points + rng.normal(size=exact.points.shape) * deviations.reshape(60, 3, 3)
        measurements = replace(
            exact, points=noisy, noise_position=float(np.sqrt((deviations**2).mean()))
        )
        fresh = simulate(
            robot,
            Simulation(
                seed=9, configurations=200, noise=0.0, same_robot=exact.truth, workspace="full"
            ),
        )
        for told in (replace(measurements, deviations=deviations), measurements):
            poses = identify(told, "complete").forward(fresh.q)
            truth = fresh.truth.actual.forward(fresh.q)
            errors.append(np.linalg.norm((poses - truth)[:, :3, 3], axis=-1).mean())
    told, blind = np.reshape(errors, (3, 2)).T
    assert told.mean() < 0.5 * blind.mean()
    assert (told < blind).all()
