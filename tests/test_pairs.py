"""Functions of pairs of joints: found where joints really move so, and nowhere else."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify
from calibtool.calibration.fit import BaseOptions
from calibtool.errormodel.families import BY_ID
from calibtool.errormodel.pairs import pair_functions
from calibtool.identification.complete import CompleteOptions, identify_complete
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, observe, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, transform_points

SIZE, NOISE = 0.05e-3, 0.05e-3


@pytest.fixture(scope="module")
def fanuc() -> Robot:
    return load_robot("fanuc-m1000ia")


def waves(q: Array, coefficients: Array) -> Array:
    """Motion of a joint (N,), written out: one sine and cosine of each sum and difference."""
    motion = np.zeros(len(q))
    for (k, j), (a, b, c, d) in zip(
        combinations(range(q.shape[1]), 2), coefficients.reshape(-1, 4), strict=True
    ):
        motion += a * np.sin(q[:, k] + q[:, j]) + b * np.cos(q[:, k] + q[:, j])
        motion += c * np.sin(q[:, k] - q[:, j]) + d * np.cos(q[:, k] - q[:, j])
    return motion


def swayed(measurements: Measurements, noise: float) -> Measurements:
    """The same rows of an arm whose joints 2 and 3 also move with pairs of joints."""
    assert measurements.truth is not None
    truth, rng = measurements.truth, np.random.default_rng(4)
    q = measurements.q.copy()
    for j in (1, 2):
        q[:, j] += waves(measurements.q, rng.normal(0, SIZE, pair_functions(q).shape[1]))
    points = observe(truth.actual, truth.setup, q)
    return replace(measurements, points=points + rng.normal(0, noise, points.shape))


def error(calibration: Calibration, fresh: Measurements) -> float:
    """Mean error of the predicted target points, m."""
    predicted = transform_points(calibration.forward(fresh.q), calibration.setup.targets)
    return float(np.linalg.norm(predicted - fresh.points, axis=-1).mean())


def test_functions_are_the_sines_and_cosines_of_sums_and_differences(
    rng: np.random.Generator,
) -> None:
    q, value = rng.uniform(-3, 3, (7, 5)), rng.normal(size=40)
    np.testing.assert_allclose(pair_functions(q) @ value, waves(q, value), atol=1e-12)


@pytest.mark.parametrize(("name", "pairs"), [("scara", 3), ("planar-3r", 3), ("ur5", 15)])
def test_only_joints_that_turn_have_and_are_pairs(name: str, pairs: int) -> None:
    """A SCARA has three joints that turn."""
    robot = load_robot(name)
    turning = ~np.array(robot.prismatic)
    elements = BY_ID["pairs"].free(robot, BY_ID["pairs"].shape(robot.n))
    assert elements.sum() == turning.sum() * 4 * pairs
    assert not elements[~turning].any()


def test_motions_with_pairs_of_joints_are_found(fanuc: Robot) -> None:
    measured = simulate(fanuc, Simulation(configurations=100, workspace="full"))
    fresh = simulate(
        fanuc,
        Simulation(configurations=300, workspace="full", same_robot=measured.truth, noise=0.0),
    )
    rows, judged = swayed(measured, NOISE), swayed(fresh, 0.0)
    found = identify(rows, "complete")
    assert found.base.posterior is not None
    parts = found.base.posterior.parameters.parts
    part = next(part for part in parts if part.family.id == "pairs")
    assert {1, 2} <= set(np.flatnonzero(part.free.any(axis=1)))
    options = CompleteOptions(orders={"pairs": 0, "harmonics": 3})
    without = identify(rows, BaseOptions("complete", options))
    assert error(found, judged) < 0.5 * error(without, judged)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("count", [60, 200])
def test_an_arm_without_them_gets_none(fanuc: Robot, seed: int, count: int) -> None:
    rows = simulate(fanuc, Simulation(seed=seed, configurations=count, workspace="full"))
    posterior = identify_complete(rows).posterior
    assert posterior is not None
    assert "pairs" not in posterior.parameters.orders
