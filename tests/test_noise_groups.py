"""Noise by target and axis: one that is noisier is named, and none where all are alike."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify
from calibtool.calibration.noise_groups import NoiseGroup, noise_groups
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array, exp6, readonly, transform_points

NOISE = 0.05e-3
TARGETS = np.array(
    [[0.08, 0.0, 0.02], [-0.05, 0.07, 0.0], [-0.04, -0.06, 0.05], [0.02, 0.03, 0.11]]
)


@cache
def calibration() -> Calibration:
    """A calibration whose predictions the measurements below are made from."""
    return identify(simulate(load_robot("ur5"), Simulation(configurations=60)))


def points_measured(sigmas: Array, seed: int, count: int = 60, unlike: float = 0.0) -> Measurements:
    """Points with noise of standard deviations (m, 3) along the axes of an instrument that stands
    turned; `unlike`: deviations of a motion of the tool that the calibration does not know, rad
    and m.
    """
    rng = np.random.default_rng([3, seed])
    robot, targets = calibration().robot, TARGETS[: len(sigmas)]
    q = robot.lower + (robot.upper - robot.lower) * rng.random((count, robot.n))
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.4, -0.9, 1.3]).as_matrix()
    T[:3, 3] = [2.0, 1.0, 0.5]
    pose = exp6(rng.normal(size=(count, 6)) * unlike) @ calibration().forward(q)
    points = transform_points(T, transform_points(pose, targets))
    points = points + rng.normal(size=points.shape) * sigmas
    setup = Setup(readonly(T), readonly(targets))
    return Measurements(robot, readonly(q), readonly(points), None, setup, NOISE, 1e-3)


def poses_measured(position: Array, orientation: Array, seed: int) -> Measurements:
    """The same by a 6-D sensor."""
    rng = np.random.default_rng([4, seed])
    found = points_measured(np.tile(position, (1, 1)), seed)
    T = found.setup.T_instrument_base
    turned = T[:3, :3] @ calibration().forward(found.q)[:, :3, :3]
    off = Rotation.from_rotvec(rng.normal(size=(len(found), 3)) * orientation).as_matrix()
    setup = replace(found.setup, R_tool_sensor=readonly(np.eye(3)))
    return replace(found, rotations=readonly(off @ turned), setup=setup, noise_orientation=0.1e-3)


def noisier(measurements: Measurements) -> list[NoiseGroup]:
    return [group for group in noise_groups(calibration(), measurements) if group.noisier]


@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_target_that_is_three_times_as_noisy_is_named_with_its_ratio(count: int) -> None:
    sigmas = np.full((count, 3), NOISE)
    sigmas[1] *= 3
    ratios = []
    for seed in range(5):
        (group,) = noisier(points_measured(sigmas, seed, 120))
        assert (group.kind, group.name) == ("target", "2")
        assert group.separated == (count > 2)
        assert str(group).startswith("target 2 is ")
        assert ("the model leaves more" in str(group)) == (count == 2)
        ratios.append(group.ratio)
    assert np.mean(ratios) == pytest.approx(3.0, rel=0.2)


def test_what_moves_the_whole_tool_is_no_noise_of_a_target() -> None:
    """An error of the model of 0.5 mm and 0.5 mrad beside noise of 0.05 mm."""
    sigmas = np.full((3, 3), NOISE)
    still = [
        group
        for seed in range(10)
        for group in noisier(points_measured(sigmas, seed, unlike=0.5e-3))
        if group.kind == "target"
    ]
    assert still == []
    sigmas[2] *= 4
    (group,) = (
        group
        for group in noisier(points_measured(sigmas, 1, 150, unlike=0.5e-3))
        if group.kind == "target"
    )
    assert (group.name, group.separated) == ("3", True)


@pytest.mark.parametrize("axis", [0, 2])
def test_an_axis_of_the_instrument_is_named(axis: int) -> None:
    sigmas = np.full((3, 3), NOISE)
    sigmas[:, axis] *= 2
    (group,) = noisier(points_measured(sigmas, axis))
    assert (group.kind, group.name) == ("position axis", "xyz"[axis])
    assert group.ratio == pytest.approx(2.0, rel=0.25)
    assert group.rms == pytest.approx(2 * NOISE, rel=0.2)


def test_position_and_orientation_of_a_sensor_are_judged_each_for_itself() -> None:
    position, orientation = np.full(3, NOISE), np.full(3, 0.1e-3)
    orientation[1] *= 3
    (group,) = noisier(poses_measured(position, orientation, 0))
    assert (group.kind, group.name, group.unit) == ("orientation axis", "y", "mrad")
    assert group.as_json()["rms_mrad"] == pytest.approx(0.3, rel=0.2)


@pytest.mark.parametrize("kind", ["one", "two", "four", "pose", "heavy tails"])
def test_at_most_one_set_in_a_hundred_is_wrong(kind: str) -> None:
    """Of 100 sets that are alike more than three would be improbable (2 % at 1 %)."""
    wrong = 0
    for seed in range(100):
        if kind == "pose":
            found = poses_measured(np.full(3, NOISE), np.full(3, 0.1e-3), seed)
        else:
            count = {"one": 1, "two": 2, "four": 4}.get(kind, 3)
            found = points_measured(np.full((count, 3), NOISE), seed, 40)
            if kind == "heavy tails":
                rng = np.random.default_rng([9, seed])
                more = rng.standard_t(3, size=found.points.shape) * NOISE
                found = replace(found, points=readonly(found.points + more))
        wrong += bool(noisier(found))
    assert wrong <= 3


def test_one_gross_reading_makes_no_noisy_target() -> None:
    found = points_measured(np.full((3, 3), NOISE), 0)
    points = found.points.copy()
    points[7, 1] += [0.1, 0.0, 0.0]
    assert noisier(replace(found, points=readonly(points))) == []


def test_stated_deviations_are_what_noise_is_compared_with() -> None:
    sigmas = np.full((3, 3), NOISE)
    sigmas[1] *= 3
    found = points_measured(sigmas, 0, 120)
    stated = np.tile(sigmas.ravel(), (len(found), 1))
    assert noisier(replace(found, deviations=readonly(stated))) == []


def test_a_wrong_place_of_a_target_is_no_noise() -> None:
    found = points_measured(np.full((3, 3), NOISE), 2, 80)
    targets = found.setup.targets.copy()
    targets[0] += [0.4e-3, 0.0, 0.0]
    setup = replace(found.setup, targets=readonly(targets))
    groups = noisier(replace(found, setup=setup))
    assert [group for group in groups if group.kind == "target"] == []


@pytest.mark.parametrize("name", ["planar-3r", "ur5"])
def test_what_a_base_model_cannot_describe_is_no_noise_of_an_axis(name: str) -> None:
    """Local POE leaves errors of the twists, which in a planar arm are across z alone."""
    for seed in range(12):
        data = simulate(load_robot(name), Simulation(configurations=50, seed=seed))
        groups = noise_groups(identify(data, "local-poe"), data)
        assert [str(group) for group in groups if group.noisier] == []


def test_few_rows_and_other_kinds_say_nothing() -> None:
    few = points_measured(np.full((3, 3), NOISE), 0, 10)
    assert noise_groups(calibration(), few) == []
