"""Circle fits: the axes of joints 1 and 2 in the instrument's frame, and where the
instrument stands by them.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.errormodel.actual import ErrorScales
from calibtool.measurement.circles import circle_axis, circle_start, single_joint_rows
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import register
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

EXACT = ErrorScales(length=0.0, angle=0.0)


def circles(robot: Robot) -> Array:
    """Twelve rows of joint 1, twelve of joint 2, elsewhere than joint 1's first row, and
    ten of everything.
    """
    q = np.tile(robot.workspace().home, (34, 1))
    q[:12, 0] += np.linspace(-0.8, 0.8, 12)
    q[12:24, 0] += 0.3
    q[12:24, 1] += np.linspace(-0.4, 0.4, 12)
    q[24:] += np.random.default_rng(1).uniform(-0.3, 0.3, (10, robot.n))
    return q


def measured(name: str, seed: int, *, exact: bool) -> Measurements:
    robot = load_robot(name)
    scales, noise = (EXACT, 0.0) if exact else (ErrorScales(), 0.05e-3)
    return simulate(
        robot,
        Simulation(seed=seed, at=circles(robot), unregistered=True, scales=scales, noise=noise),
    )


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "ur5", "panda"])
def test_exact_circles_give_the_true_frame(name: str) -> None:
    for seed in range(5):
        measurements = measured(name, seed, exact=True)
        assert measurements.truth is not None
        found = circle_start(measurements)
        assert found is not None
        assert np.abs(found - measurements.truth.setup.T_instrument_base).max() < 1e-8


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "ur5"])
def test_with_errors_and_noise_it_is_a_good_start(name: str) -> None:
    for seed in range(5):
        measurements = measured(name, seed, exact=False)
        assert measurements.truth is not None
        found = circle_start(measurements)
        assert found is not None
        off = np.linalg.inv(measurements.truth.setup.T_instrument_base) @ found
        assert Rotation.from_matrix(off[:3, :3]).magnitude() < 0.01
        assert np.linalg.norm(off[:3, 3]) < 0.02
        fitted = register(replace(measurements, truth=None)).T_instrument_base
        assert np.linalg.norm((np.linalg.inv(fitted) @ found)[:3, 3]) < 0.03


def test_axis_of_a_circle() -> None:
    """By hand: radius 0.5 about a line through (1, 2, 3) along a slanted axis; two targets, one of
    them not always seen.
    """
    turn = Rotation.from_rotvec([0.4, -0.7, 0.2]).as_matrix()
    angles = np.linspace(0.1, 1.2, 9)
    flat = np.stack([0.5 * np.cos(angles), 0.5 * np.sin(angles), np.full(9, 0.1)], axis=-1)
    other = np.stack([0.2 * np.sin(angles), -0.2 * np.cos(angles), np.full(9, -0.3)], axis=-1)
    points = np.stack([flat, other], axis=1) @ turn.T + [1.0, 2.0, 3.0]
    points[:4, 1] = np.nan
    axis = circle_axis(angles, points)
    assert axis is not None
    assert np.abs(axis.direction - turn[:, 2]).max() < 1e-12
    assert np.linalg.norm(np.cross(axis.point - [1.0, 2.0, 3.0], turn[:, 2])) < 1e-12
    assert circle_axis(np.linspace(0, 0.01, 9), points) is None
    assert circle_axis(angles, np.tile(np.ones((1, 2, 3)), (9, 1, 1))) is None


def test_rows_of_a_single_joint(fanuc: Robot) -> None:
    rows = single_joint_rows(circles(fanuc))
    assert {j: found.tolist() for j, found in rows.items()} == {
        0: list(range(12)),
        1: list(range(12, 24)),
    }


@pytest.mark.parametrize("name", ["gantry", "scara", "planar-3r"])
def test_no_frame_from_sliding_or_parallel_axes(name: str) -> None:
    robot = load_robot(name)
    measurements = simulate(robot, Simulation(at=circles(robot), scales=EXACT))
    assert circle_start(measurements) is None


def test_no_frame_without_such_rows(fanuc_measurements: Measurements) -> None:
    assert circle_start(fanuc_measurements) is None


def test_a_target_seen_fewer_than_four_times_does_not_count() -> None:
    angles = np.linspace(0.0, 1.0, 8)
    points = np.stack([np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)] * 2, axis=1)
    points[3:, 1] = np.nan
    points[:3, 1] = 7.0  # nonsense
    both, one = circle_axis(angles, points), circle_axis(angles, points[:, :1])
    assert both is not None
    assert one is not None
    np.testing.assert_array_equal(both.direction, one.direction)
    np.testing.assert_array_equal(both.point, one.point)
