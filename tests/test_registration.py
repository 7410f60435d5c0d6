"""Registration finds instrument and targets from any distance and angle, or says why it cannot."""

from dataclasses import replace

import numpy as np
import pytest
from cases import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibtool.errors import NoSolutionError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import residuals, weights
from calibtool.measurement.registration import (
    frames_of_least_squares,
    register,
    rigid_fit,
    update_setup,
)
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

FULLY_MOVING = (
    "fanuc-m1000ia",
    "gantry",
    "panda",
    "ur5",
)  # the tool turns about more than one direction


def random_truth(rng: np.random.Generator, kind: str, turn: Rotation | None = None) -> Setup:
    """Instrument anywhere within 5 m, targets anywhere within 1 m of the tool."""
    T = np.eye(4)
    T[:3, :3] = (Rotation.random(rng=rng) if turn is None else turn).as_matrix()
    T[:3, 3] = rng.uniform(-5, 5, 3)
    m = 3 if kind == "three targets" else 1
    sensor = Rotation.random(rng=rng).as_matrix() if kind == "6-D sensor" else None
    return Setup(T, rng.uniform(-1, 1, (m, 3)), sensor, frame_known=False, targets_known=False)


def configurations(robot: Robot, count: int, rng: np.random.Generator) -> Array:
    return sample_configurations(robot, robot.workspace(), count, rng)


def seen(robot: Robot, truth: Setup, q: Array) -> tuple[Array, Array | None]:
    """Exact readings of the nominal robot in the instrument's frame, by hand."""
    T = truth.T_instrument_base @ robot.mechanism.forward(q)
    points = np.stack([T[:, :3, :3] @ target + T[:, :3, 3] for target in truth.targets], axis=1)
    return points, None if truth.R_tool_sensor is None else T[:, :3, :3] @ truth.R_tool_sensor


def measured(
    robot: Robot, truth: Setup, q: Array, frame_known: bool = False, targets_known: bool = False
) -> Measurements:
    """Measurements that know only the parts of the truth which are said to be known."""
    points, rotations = seen(robot, truth, q)
    sensor = truth.R_tool_sensor
    setup = Setup(
        truth.T_instrument_base if frame_known else np.eye(4),
        truth.targets if targets_known else np.zeros_like(truth.targets),
        sensor if targets_known or sensor is None else np.eye(3),
        frame_known,
        targets_known,
    )
    return Measurements(robot, q, points, rotations, setup, 0.05e-3, 0.1e-3)


def assert_same_setup(found: Setup, truth: Setup, tolerance: float = 1e-9) -> None:
    assert np.abs(found.T_instrument_base - truth.T_instrument_base).max() < tolerance
    assert np.abs(found.targets - truth.targets).max() < tolerance
    if truth.R_tool_sensor is not None:
        assert found.R_tool_sensor is not None
        assert np.abs(found.R_tool_sensor - truth.R_tool_sensor).max() < tolerance


@pytest.mark.parametrize("kind", ["one target", "three targets", "6-D sensor"])
@pytest.mark.parametrize("name", FULLY_MOVING)
def test_exact_data_give_the_truth_from_anywhere(name: str, kind: str) -> None:
    robot = load_robot(name)
    q = configurations(robot, 20, np.random.default_rng(1))
    for seed in range(8):
        truth = random_truth(np.random.default_rng(seed), kind)
        assert_same_setup(register(measured(robot, truth, q)), truth)


@pytest.mark.parametrize("kind", ["three targets", "6-D sensor"])
def test_half_turns_of_the_instrument_are_found_like_any_other(fanuc: Robot, kind: str) -> None:
    q = configurations(fanuc, 12, np.random.default_rng(2))
    rng = np.random.default_rng(3)
    axes = [*np.eye(3), *(axis / np.linalg.norm(axis) for axis in rng.normal(size=(27, 3)))]
    for axis in axes:
        truth = random_truth(rng, kind, Rotation.from_rotvec(np.pi * np.asarray(axis)))
        assert_same_setup(register(measured(fanuc, truth, q)), truth)


@pytest.mark.parametrize("kind", ["one target", "three targets", "6-D sensor"])
@pytest.mark.parametrize(("frame_known", "targets_known"), [(True, False), (False, True)])
def test_one_known_half_is_kept_and_the_other_found(
    fanuc: Robot, kind: str, frame_known: bool, targets_known: bool, rng: np.random.Generator
) -> None:
    q = configurations(fanuc, 12, rng)
    truth = random_truth(rng, kind)
    found = register(measured(fanuc, truth, q, frame_known, targets_known))
    assert_same_setup(found, truth)
    assert (found.frame_known, found.targets_known) == (frame_known, targets_known)
    if frame_known:
        assert np.array_equal(found.T_instrument_base, truth.T_instrument_base)
    else:
        assert np.array_equal(found.targets, truth.targets)


def test_a_known_setup_is_returned_as_it_is(fanuc: Robot, rng: np.random.Generator) -> None:
    q = configurations(fanuc, 5, rng)
    measurements = measured(fanuc, random_truth(rng, "three targets"), q, True, True)
    assert register(measurements) is measurements.setup


@pytest.mark.parametrize("kind", ["one target", "three targets", "6-D sensor"])
@pytest.mark.parametrize("name", ["planar-3r", "scara"])
def test_a_robot_with_parallel_axes_is_registered_up_to_what_no_measurement_shows(
    name: str, kind: str
) -> None:
    robot = load_robot(name)
    rng = np.random.default_rng(4)
    q, fresh = configurations(robot, 20, rng), configurations(robot, 20, rng)
    for seed in range(5):
        truth = random_truth(np.random.default_rng(seed), kind)
        found = register(measured(robot, truth, q))
        for expected, got in zip(seen(robot, truth, fresh), seen(robot, found, fresh), strict=True):
            assert (expected is None) == (got is None)
            if expected is not None and got is not None:
                assert np.abs(got - expected).max() < 1e-9


def test_poses_of_another_model_replace_those_of_the_nominal_robot(
    fanuc: Robot, rng: np.random.Generator
) -> None:
    q = configurations(fanuc, 12, rng)
    truth = random_truth(rng, "three targets")
    shifted = q + 0.01  # a robot whose encoders are off
    points, _ = seen(fanuc, truth, shifted)
    measurements = replace(measured(fanuc, truth, q), points=points)
    assert_same_setup(register(measurements, fanuc.mechanism.forward(shifted)), truth)


@pytest.mark.parametrize("kind", ["three targets", "6-D sensor"])
def test_with_noise_no_small_step_lowers_the_weighted_squares(fanuc: Robot, kind: str) -> None:
    rng = np.random.default_rng(5)
    q = configurations(fanuc, 15, rng)
    exact = measured(fanuc, random_truth(rng, kind), q)
    noisy = replace(exact, points=exact.points + rng.normal(size=exact.points.shape) * 0.05e-3)
    found = register(noisy)
    poses = fanuc.mechanism.forward(q)

    def cost(setup: Setup) -> float:
        return float(((residuals(noisy, setup, poses) * weights(noisy)) ** 2).sum())

    d = 9 if kind == "three targets" else 6
    for _ in range(20):
        step = rng.normal(size=6 + d) * 1e-5
        for signed in (step, -step):
            assert cost(update_setup(found, signed[:6], signed[6:])) > cost(found)


@pytest.mark.parametrize(
    ("kind", "too_few"), [("one target", 3), ("three targets", 1), ("6-D sensor", 2)]
)
def test_too_few_configurations_are_refused_with_the_count(
    fanuc: Robot, kind: str, too_few: int
) -> None:
    rng = np.random.default_rng(6)
    measurements = measured(fanuc, random_truth(rng, kind), configurations(fanuc, too_few, rng))
    with pytest.raises(
        NoSolutionError, match=rf"{too_few} configurations? gives? \d+ equations for \d+ unknowns"
    ):
        register(measurements)


@pytest.mark.parametrize("kind", ["one target", "three targets", "6-D sensor"])
@pytest.mark.parametrize("name", ["fanuc-m1000ia", "ur5"])
def test_thirty_random_starts_end_in_one_answer(name: str, kind: str) -> None:
    """With errors and noise.

    No start alone, of 300, ends in a lower sum of squares than the program's own.
    """
    robot, rng = load_robot(name), np.random.default_rng(7)
    q = configurations(robot, 20, rng)
    actual = replace(measured(robot, random_truth(rng, kind), q + rng.normal(size=6) * 1e-3), q=q)
    noisy = replace(actual, points=actual.points + rng.normal(size=actual.points.shape) * 0.05e-3)
    answer = register(noisy)
    for _ in range(30):
        assert_same_setup(register(noisy, start=random_truth(rng, kind)), answer, 1e-6)
    if kind != "6-D sensor":
        guesses = [random_truth(rng, kind).T_instrument_base for _ in range(300)]
        poses = robot.mechanism.forward(q)
        lowest = frames_of_least_squares(poses, noisy.points, guesses, only_guesses=True)[0]
        assert np.abs(lowest - answer.T_instrument_base).max() < 1e-6


@given(seed=st.integers(0, 10_000), count=st.integers(3, 6))
@examples(15)
def test_rigid_fit_recovers_a_motion(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(4, count, 3))
    T = np.tile(np.eye(4), (4, 1, 1))
    T[:, :3, :3] = Rotation.random(4, rng=rng).as_matrix()
    T[:, :3, 3] = rng.uniform(-3, 3, (4, 3))
    target = np.einsum("kab,kmb->kma", T[:, :3, :3], source) + T[:, None, :3, 3]
    assert np.abs(rigid_fit(source, target) - T).max() < 1e-9


@given(seed=st.integers(0, 10_000), count=st.integers(3, 6))
@examples(15)
def test_rigid_fit_is_never_a_reflection(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(count, 3))
    for target in (source * [1, 1, -1], -source, rng.normal(size=(count, 3))):
        R = rigid_fit(source, target)[:3, :3]
        assert abs(np.linalg.det(R) - 1.0) < 1e-9
        assert np.abs(R @ R.T - np.eye(3)).max() < 1e-9


def test_rigid_fit_is_the_least_squares_motion(rng: np.random.Generator) -> None:
    source, target = rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    T = rigid_fit(source, target)
    fitted, _ = Rotation.align_vectors(target - target.mean(axis=0), source - source.mean(axis=0))
    assert np.abs(T[:3, :3] - fitted.as_matrix()).max() < 1e-9
    assert np.abs(T[:3, :3] @ source.mean(axis=0) + T[:3, 3] - target.mean(axis=0)).max() < 1e-12


@pytest.mark.parametrize("target", [0, 2])
@pytest.mark.parametrize("name", ["ur10", "scara"])
def test_a_target_that_is_never_seen_is_named(name: str, target: int) -> None:
    measurements = simulate(
        load_robot(name), Simulation(configurations=30, unregistered=True, workspace="full")
    )
    points = measurements.points.copy()
    points[:, target] = np.nan
    with pytest.raises(NoSolutionError, match=f"target {target + 1} is seen in none of the 30"):
        register(replace(measurements, points=points))


def test_rows_of_which_none_sees_all_targets_register_all_the_same() -> None:
    whole = simulate(
        load_robot("ur10"), Simulation(configurations=30, unregistered=True, workspace="full")
    )
    points = whole.points.copy()
    points[np.arange(30), np.arange(30) % 3] = np.nan
    found = register(replace(whole, points=points))
    np.testing.assert_allclose(found.targets, register(whole).targets, atol=2e-3)
