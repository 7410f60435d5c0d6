"""Kinds of observation: derivatives, registration from nothing, identification, files, frames."""

import io
from dataclasses import replace

import numpy as np
import pytest
from derivatives import assert_derivative

from calibtool.calibration import identify
from calibtool.calibration.fit import BaseOptions
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.errors import InputError
from calibtool.evaluation.compare import evaluate
from calibtool.identification.complete import CompleteOptions
from calibtool.identification.partial import of_families
from calibtool.measurement.checks import check_measurements
from calibtool.measurement.instruments import unknown
from calibtool.measurement.instruments.gauge import GAUGE
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import (
    observation_matrix,
    residuals,
    target_columns,
    weighted_residuals,
    weights,
)
from calibtool.measurement.registration import register, update_setup
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array, exp6, inverse, readonly, transform_points
from calibtool.storage import read_measurements, to_bytes

ARM = load_robot("ur5")
SEEN = {
    "contact": (3, "base3.rz"),
    "distance": (2, "anchor2.z"),
    "plane": (2, "plane2.h"),
    "sphere": (2, "sphere2.radius"),
    "second-arm": (1, "secondbase.rz"),
    "board": (2, "board2.rz"),
    "camera": (2, "base2.rz"),
    "corners": (2, "lens.k3"),
    "corners-beside": (2, "lens.k3"),
}
_TURNED = 5e-4  # the noise turns the axes of measured rotations by so much
_CACHE: dict[str, Measurements] = {}


def measured(name: str) -> Measurements:
    if name not in _CACHE:
        places = SEEN[name][0]
        simulation = Simulation(
            seed=4, configurations=60, instrument=name, places=places, workspace="full"
        )
        _CACHE[name] = simulate(ARM, simulation)
    return _CACHE[name]


@pytest.fixture(params=SEEN)
def seen(request: pytest.FixtureRequest) -> Measurements:
    return measured(request.param)


def truth(seen: Measurements) -> tuple[Setup, Array]:
    """The true set-up and the actual poses."""
    assert seen.truth is not None
    return seen.truth.setup, seen.truth.actual.forward(seen.q)


def read(seen: Measurements) -> np.ndarray:
    """(N, d, 1): which coordinates were read."""
    return (weights(seen) > 0)[..., None]


def test_the_truth_leaves_the_noise(seen: Measurements) -> None:
    setup, poses = truth(seen)
    left = weighted_residuals(seen, setup, poses)
    assert left.shape == (60, setup.kind.coordinates(setup))
    assert 0.75 < np.sqrt((left**2).sum() / seen.equations) < 1.25


def test_the_matrix_is_the_derivative_by_the_pose(seen: Measurements) -> None:
    setup, poses = truth(seen)
    matrix = observation_matrix(setup, poses, seen.place) * read(seen)

    def observe(twist: Array) -> Array:
        return -residuals(seen, setup, exp6(twist) @ poses)

    assert_derivative(observe, matrix, np.zeros(6), tolerance=_TURNED)


def test_columns_are_the_derivative_by_the_free_elements(seen: Measurements) -> None:
    setup, poses = truth(seen)
    columns = target_columns(setup, poses, seen.place) * read(seen)
    assert columns.shape[-1] == len(setup.free_names)

    def observe(step: Array) -> Array:
        return -residuals(seen, setup.kind.moved(setup, step), poses)

    zero = np.zeros(columns.shape[-1])
    assert_derivative(observe, columns, zero, tolerance=_TURNED)


def test_a_twist_of_the_base_moves_predictions_as_poses_do(seen: Measurements) -> None:
    setup, poses = truth(seen)
    twist = np.array([3.0, -2.0, 1.0, 2.0, 1.0, -3.0]) * 1e-2
    moved = residuals(seen, update_setup(setup, twist, None), poses)
    other = residuals(seen, setup, exp6(twist) @ poses)
    if seen.kind in ("points", "pose"):  # residuals are in K_0, which turned
        turn = exp6(twist)[:3, :3]
        moved = (turn @ moved.reshape(60, -1, 3, 1)).reshape(60, -1)
    assert np.allclose(moved, other, atol=1e-12)


def test_predictions_do_not_depend_on_the_frames_of_base_and_tool(seen: Measurements) -> None:
    setup, poses = truth(seen)
    rng = np.random.default_rng(1)
    T_new_base, T_new_tool = (exp6(rng.normal(size=6)) for _ in range(2))
    new = setup.kind.in_base(setup.kind.in_tool(setup, T_new_tool), T_new_base)
    there = residuals(seen, new, T_new_base @ poses @ inverse(T_new_tool))
    here = residuals(seen, setup, poses)
    assert np.allclose(
        np.linalg.norm(there, axis=-1), np.linalg.norm(here, axis=-1), rtol=1e-6, atol=1e-12
    )


def test_registration_finds_the_set_up_from_nothing(seen: Measurements) -> None:
    setup, poses = truth(seen)
    found = register(replace(seen, setup=unknown(setup)), poses)
    cost = (weighted_residuals(seen, found, poses) ** 2).sum()
    assert cost <= (weighted_residuals(seen, setup, poses) ** 2).sum()
    assert found.free_names[-1] == SEEN[_name(seen)][1]
    if seen.kind == "distance":
        assert found.anchors is not None
        assert setup.anchors is not None
        assert np.abs(found.anchors - setup.anchors).max() < 1e-3


def _name(seen: Measurements) -> str:
    return next(name for name, cached in _CACHE.items() if cached is seen)


@pytest.mark.parametrize("name", SEEN)
def test_identification_beats_the_nominal_robot_on_other_poses(name: str) -> None:
    seen = measured(name)
    calibration = identify(seen)
    assert seen.truth is not None
    q = np.random.default_rng(8).uniform(-2, 2, (200, 6))
    actual = seen.truth.actual.forward(q)
    before, after = (
        _apart(actual, poses) for poses in (ARM.mechanism.forward(q), calibration.forward(q))
    )
    assert after < 0.5 * before
    assert calibration.base.posterior is not None
    assert 0.75 < calibration.base.posterior.noise_factor < 1.3
    # The file holds everything, and the readings are judged in their own coordinates.
    again = read_measurements(io.BytesIO(to_bytes(seen)), "m.h5")
    assert again.places == seen.places
    judged = evaluate([("c", calibration)], replace(again, truth=None))
    assert judged.methods[1].position_size.mean() < 0.5 * judged.methods[0].position_size.mean()


def _apart(actual: Array, poses: Array) -> float:
    """Mean distance of the tool's targets after the best base and tool frame, m."""
    points = transform_points(actual, ARM.targets)
    blank = Setup(np.eye(4), np.zeros_like(ARM.targets), frame_known=False, targets_known=False)
    q = np.zeros((len(poses), 6))
    setup = register(Measurements(ARM, q, points, None, blank, 1e-4, 1e-4), poses)
    predicted = transform_points(setup.T_instrument_base @ poses, setup.targets)
    return float(np.linalg.norm(points - predicted, axis=-1).mean())


@pytest.mark.parametrize("name", SEEN)
def test_errors_are_within_1_3_of_the_bound(name: str) -> None:
    """The error of unseen poses over that of the posterior (the Cramér–Rao bound with the
    tolerances), rms over three robots.
    """
    geometry = of_families(CompleteOptions(), only="placements,twists,q")
    ratios = []
    for seed in range(3):
        simulation = Simulation(seed, 60, "full", instrument=name, places=SEEN[name][0])
        seen = simulate(ARM, simulation)
        assert seen.truth is not None
        calibration = identify(seen, BaseOptions("complete", geometry))
        q = np.random.default_rng(100 + seed).uniform(-2, 2, (200, 6))
        error = _apart(seen.truth.actual.forward(q), calibration.forward(q))
        ratios.append(error / predicted_uncertainty(calibration, q).position.mean())
    assert np.sqrt(np.mean(np.square(ratios))) < 1.3


@pytest.mark.parametrize("name", SEEN)
def test_a_file_keeps_the_readings(name: str) -> None:
    seen = measured(name)
    again = read_measurements(io.BytesIO(to_bytes(seen)), "m.h5")
    for one, other in (
        (seen.values, again.values),
        (seen.place, again.place),
        (seen.points, again.points),
        (seen.setup.further_frames, again.setup.further_frames),
        *((seen.setup.arrays[n], again.setup.arrays[n]) for n in seen.setup.arrays),
    ):
        assert (one is None) == (other is None)
        assert one is None or np.array_equal(one, other, equal_nan=True)


def test_the_sockets_of_a_gauge_are_as_far_apart_as_it_says() -> None:
    seen = measured("contact")
    assert set(np.unique(seen.points[:, 0, 0]).tolist()) == {0.0, GAUGE}
    assert np.array_equal(np.bincount(seen.place), [20, 20, 20])


def test_readings_of_another_robot_are_far_from_the_nominal_one(seen: Measurements) -> None:
    if seen.kind in ("points", "pose", "plane", "sphere"):
        return  # tests/test_checks.py; some surface goes through a few points of any robot
    other = replace(seen, q=readonly(seen.q[::-1]))
    names = [finding.name for finding in check_measurements(other)]
    assert "nominal_robot" in names
    assert [f.name for f in check_measurements(seen) if f.severity == "warning"] == []


def test_a_plane_touched_along_a_line_is_named() -> None:
    q = np.tile([0.3, -1.2, 1.4, -1.0, -1.2, 0.2], (12, 1))
    q[:, 0] += np.linspace(0, 0.004, 12)  # a short arc: a line
    setup = Setup(
        np.eye(4),
        np.zeros((1, 3)),
        frame_known=False,
        targets_known=False,
        planes=np.array([[0.0, 0.0, 1.0, 0.0]]),
    )
    nothing = np.full((12, 1, 3), np.nan)
    touched = Measurements(ARM, q, nothing, None, setup, 1e-4, 1e-4, values=np.zeros((12, 1)))
    names = [finding.name for finding in check_measurements(touched)]
    assert "plane_of_a_line" in names


def test_a_row_without_a_length_is_refused() -> None:
    seen = measured("distance")
    assert seen.values is not None
    values = seen.values.copy()
    values[3] = np.nan
    with pytest.raises(InputError, match="no measured length at all"):
        replace(seen, values=readonly(values))
    values[3, 0] = 1.0
    assert replace(seen, values=readonly(values)).equations == 119
