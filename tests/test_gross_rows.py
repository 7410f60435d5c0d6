"""Rows that are plain mistakes: they do not move the result, and they are named."""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify
from calibtool.calibration.fit import BaseOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.identification.complete import CompleteOptions
from calibtool.identification.robust import row_weights
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import readonly

SCALES = ErrorScales(kinds=("geometric", "gear", "gravity"))


@pytest.fixture(scope="module")
def clean() -> Measurements:
    robot = load_robot("ur5")
    return simulate(robot, Simulation(seed=3, configurations=500, scales=SCALES))


def spoilt(rows: Measurements, bad: np.ndarray, size: float) -> Measurements:
    """Some rows (k,) shifted by a size in m, all targets alike, to different sides."""
    points = rows.points.copy()
    points[bad] += size * np.random.default_rng(0).normal(size=(len(bad), 1, 3))
    return replace(rows, points=readonly(points))


def apart(first: Calibration, second: Calibration, robot: Robot) -> float:
    """Mean distance of predicted tool points, m."""
    q = simulate(robot, Simulation(seed=99, configurations=200)).q
    shift = first.forward(q)[:, :3, 3] - second.forward(q)[:, :3, 3]
    return float(np.linalg.norm(shift, axis=-1).mean())


@pytest.mark.parametrize(
    ("count", "size"), [(1, 0.1), (1, 10.0), (5, 3e-3), (15, 0.1), (15, 1.0)], ids=str
)
def test_gross_rows_do_not_move_the_result_and_are_listed(
    clean: Measurements, count: int, size: float
) -> None:
    """Of 500 rows, up to 3 %: a twentieth of the noise at most; they are said in the summary."""
    bad = np.random.default_rng(count).choice(500, count, replace=False)
    found = identify(spoilt(clean, bad, size))
    assert apart(found, identify(clean), clean.robot) < 0.05 * clean.noise_position
    assert found.base.flagged is not None
    assert set(bad) <= set(found.base.flagged.rows)
    assert len(found.base.flagged.rows) <= count + 1
    assert found.base.posterior is not None
    assert found.base.posterior.noise_factor == pytest.approx(1.0, abs=0.05)
    worst = int(found.base.flagged.rows[np.argmax(found.base.flagged.deviation)])
    assert f"configuration {worst + 1}:" in found.summary()


def test_one_of_thirty_is_found_as_well() -> None:
    rows = simulate(load_robot("ur5"), Simulation(seed=3, configurations=30, scales=SCALES))
    found = identify(spoilt(rows, np.array([7]), 0.1))
    assert found.base.flagged is not None
    assert found.base.flagged.rows.tolist() == [7]
    assert apart(found, identify(rows), rows.robot) < 1.0 * rows.noise_position


def test_with_equal_weights_it_would_move(clean: Measurements) -> None:
    options = BaseOptions("complete", CompleteOptions(loss_function="squared"))
    found = identify(spoilt(clean, np.array([7]), 0.1), options)
    assert apart(found, identify(clean), clean.robot) > 1.0 * clean.noise_position


def test_clean_rows_keep_their_weight(clean: Measurements) -> None:
    """Chance flags a row in one set of a hundred."""
    squares = np.random.default_rng(0).chisquare(9, size=(300, 500))
    weight = np.array([row_weights(s, np.full(500, 9), "isolated") for s in squares])
    assert (weight == 1.0).all(axis=-1).mean() > 0.97
    flagged = identify(clean).base.flagged
    assert flagged is not None
    assert len(flagged.rows) == 0


def test_rows_that_are_fitted_too_well_make_no_others_bad() -> None:
    """Half of the residuals are next to nothing where as much is fitted as was measured; what the
    noise explains weighs like any other row all the same."""
    squares = np.array([0.01] * 6 + [9.0, 12.0])
    assert (row_weights(squares, np.full(8, 9), "isolated", noise_factor=1.0) == 1.0).all()
    assert row_weights(squares * 100, np.full(8, 9), "isolated", noise_factor=1.0)[-1] < 1e-2
