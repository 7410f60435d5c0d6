"""Drift: false alarms come at their rate, changes are recovered within their uncertainty, and the
history grows by whole lines.
"""

import json
import threading
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify, moved_instrument
from calibtool.calibration.fit import BaseOptions
from calibtool.cli.history import append, entries
from calibtool.errors import InputError
from calibtool.evaluation.compare import evaluate
from calibtool.evaluation.drift import check_drift
from calibtool.evaluation.plots.history_figure import draw_history
from calibtool.identification.complete import CompleteOptions
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import register
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, inverse, readonly, transform_points


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot("ur10")


@pytest.fixture(scope="module")
def first(arm: Robot) -> Measurements:
    space = arm.workspace(None)
    return simulate(arm, Simulation(seed=3, configurations=50, workspace=space, unregistered=True))


@pytest.fixture(scope="module")
def calibration(first: Measurements) -> Calibration:
    return identify(first)


def later(first: Measurements, seed: int, rows: int = 5, off: Array | float = 0.0) -> Measurements:
    """Rows of the same arm and tracker; joints moved by `off`, which nobody knows."""
    robot, rng = first.robot, np.random.default_rng(seed)
    q = sample_configurations(robot, robot.workspace(None), rows, rng)
    again = Simulation(seed=seed, same_robot=first.truth, at=q + off, unregistered=True)
    return replace(simulate(robot, again), q=readonly(q), setup=first.setup, truth=None)


def test_an_unchanged_arm_gives_alarm_at_the_stated_rate(
    first: Measurements, calibration: Calibration
) -> None:
    """At 20 % of 150 checks: a binomial number, within four standard deviations, or fewer: several
    causes that are looked at share the rate.
    """
    rows = [later(first, seed) for seed in range(150)]
    alarms = sum(check_drift(calibration, each, false_alarm=0.2).alarm for each in rows)
    assert 3 <= alarms <= 30 + 4 * np.sqrt(150 * 0.2 * 0.8)


def test_a_joint_that_has_slipped_is_named_and_its_angle_recovered(
    first: Measurements, calibration: Calibration
) -> None:
    slip = np.deg2rad(0.05)
    for joint in range(6):
        found = check_drift(calibration, later(first, joint, 8, slip * np.eye(6)[joint]))
        assert found.alarm
        causes = {cause.name: cause for cause in found.causes[: found.likely]}
        cause = causes[f"joint {joint + 1}"]
        assert abs(cause.change[0] - slip) < 4 * cause.std[0]
        assert found.named.count("joint") >= 1


def test_a_moved_base_is_named_and_recovered(first: Measurements, calibration: Calibration) -> None:
    twist = np.array([2e-4, -1e-4, 1.5e-4, 3e-4, -2e-4, 1e-4])
    steady = later(first, 11, 10)
    truth = first.truth
    assert truth is not None
    T = truth.setup.T_instrument_base
    moved = transform_points(T @ exp6(twist) @ inverse(T), steady.points)
    found = check_drift(calibration, replace(steady, points=readonly(moved)))
    assert found.alarm
    assert "base" in [cause.name for cause in found.causes[: found.likely]]
    base = next(cause for cause in found.causes if cause.name == "base")
    # The base of the calibration is not that of the truth: what is the same is where points move.
    assert np.linalg.norm(base.change[3:]) == pytest.approx(np.linalg.norm(twist[3:]), rel=0.4)
    again = check_drift(calibration, replace(steady, points=readonly(moved)), refit_setup=True)
    assert not again.alarm
    assert "base" not in [cause.name for cause in again.causes]


def test_the_expected_residual_is_that_of_an_unchanged_arm(
    first: Measurements, calibration: Calibration
) -> None:
    found = [check_drift(calibration, later(first, seed)) for seed in range(30)]
    residual = np.sqrt(np.mean([each.residual**2 for each in found]))
    expected = np.sqrt(np.mean([each.expected**2 for each in found]))
    assert residual == pytest.approx(expected, rel=0.15)


# --- an instrument that was moved ---

FAST = BaseOptions(
    "complete", CompleteOptions(orders={"harmonics": 0, "gravity": 0, "backlash": 0})
)
OTHERS = [("distance", 3), ("board", 1), ("contact", 2), ("corners", 1)]


@cache
def seen_by(instrument: str, places: int) -> tuple[Measurements, Calibration]:
    """Measurements of an arm, with a tracker at an unknown place or by others, and their fit."""
    by = Simulation(
        seed=1, configurations=40, instrument=instrument, places=places, unregistered=True
    )
    first = simulate(load_robot("ur5"), by)
    return first, identify(first, FAST)


def elsewhere(instrument: str, places: int, slip: float = 0.0) -> Measurements:
    """Rows of the same arm with the instrument in another place; joint 3 slipped, unknown."""
    first, _ = seen_by(instrument, places)
    by = Simulation(
        seed=4,
        configurations=15,
        instrument=instrument,
        places=places,
        same_robot=first.truth,
        unregistered=True,
    )
    rows = simulate(first.robot, by)
    if instrument == "points":
        moved = exp6(np.array([0.6, -0.4, 0.2, 0.1, -0.3, 0.9]))
        rows = replace(rows, points=readonly(transform_points(moved, rows.points)))
    shown = rows.q - slip * np.eye(6)[2]
    found = replace(rows, q=readonly(shown), truth=None)
    return replace(found, setup=register(found))


@pytest.mark.parametrize(("instrument", "places"), [("points", 1), *OTHERS])
def test_an_instrument_elsewhere_is_no_drift_with_its_place_refitted(
    instrument: str, places: int
) -> None:
    """And a joint that has slipped by 1 mrad is seen all the same."""
    _, calibration = seen_by(instrument, places)
    same = check_drift(calibration, elsewhere(instrument, places), refit_setup=True)
    assert not same.alarm
    assert 0.5 < same.residual / same.expected < 1.5
    slipped = check_drift(calibration, elsewhere(instrument, places, 1e-3), refit_setup=True)
    assert slipped.alarm


@pytest.mark.parametrize(("instrument", "places"), [("points", 1), *OTHERS])
def test_an_instrument_elsewhere_is_noticed(instrument: str, places: int) -> None:
    """Rows of the calibration itself, and of an arm whose joint has slipped, are not elsewhere."""
    first, calibration = seen_by(instrument, places)
    line = moved_instrument(calibration, elsewhere(instrument, places))
    assert line is not None
    assert "--refit-setup" in line
    assert moved_instrument(calibration, replace(first, truth=None)) is None
    slipped = replace(first, q=readonly(first.q - 1e-3 * np.eye(6)[2]), truth=None)
    assert moved_instrument(calibration, slipped) is None


def test_what_a_camera_would_have_behind_it_is_no_number() -> None:
    _, calibration = seen_by("corners", 1)
    rows = elsewhere("corners", 1)
    with pytest.raises(InputError, match="cannot be seen in the set-up"):
        check_drift(calibration, rows)
    with pytest.raises(InputError, match="cannot be seen in the set-up"):
        evaluate([("c", calibration)], rows)


def test_poses_of_a_second_arm_belong_to_the_rows() -> None:
    """Its rows need no new set-up: nominal and corrected errors are those of the same place."""
    first, calibration = seen_by("second-arm", 1)
    by = Simulation(seed=4, configurations=15, instrument="second-arm", same_robot=first.truth)
    rows = simulate(first.robot, by)
    there, again = (
        evaluate([("c", calibration)], rows, refit_setup=refit) for refit in (False, True)
    )
    assert there["c"].position.mean < 0.3 * there["nominal"].position.mean
    assert there["nominal"].position.mean < 3 * again["nominal"].position.mean
    assert not check_drift(calibration, rows).alarm


def test_a_model_without_uncertainty_is_refused(first: Measurements) -> None:
    with pytest.raises(InputError, match="does not know its uncertainty"):
        check_drift(identify(first, "local-poe"), later(first, 1))


def test_a_history_grows_by_whole_lines_from_several_writers(tmp_path: Path) -> None:
    path = str(tmp_path / "h.ndjson")
    Path(path).write_text('{"schema": "s", "n": 0}\n{"schema": "s", "n"')  # the end was cut off

    def write(start: int) -> None:
        for n in range(start, start + 25):
            append(path, {"schema": "s", "n": n, "padding": "x" * 500})

    writers = [threading.Thread(target=write, args=(25 * k,)) for k in range(4)]
    for each in writers:
        each.start()
    for each in writers:
        each.join()
    found, cut = entries(path, "s")
    assert cut == 1
    assert sorted(entry["n"] for entry in found[1:]) == list(range(100))
    with pytest.raises(InputError, match=r"h.ndjson:1: is no line of a t history"):
        entries(path, "t")
    assert entries(str(tmp_path / "none"), "s") == ([], 0)


def test_the_chart_shows_every_check(first: Measurements, calibration: Calibration) -> None:
    rows = [later(first, 1), later(first, 2, 5, 2e-3)]
    lines = [
        json.loads(json.dumps({**check_drift(calibration, each).as_json(), "date": day}))
        for each, day in zip(rows, ("monday", "tuesday"), strict=True)
    ]
    picture = draw_history(lines, "svg")
    assert picture == draw_history(lines, "svg")
    assert picture.startswith(b"<?xml")
