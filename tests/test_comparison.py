"""The default against registration alone and local POE: never worse on rows that no fit has seen,
and said where it was in doubt."""

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify, train
from calibtool.calibration.fit import BaseOptions
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.identification.complete import CompleteOptions
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import readonly
from calibtool.storage import read_calibration, to_bytes
from calibtool.summary import calibration_summary


def measured(
    name: str, seed: int, count: int, noise: float, size: float, unregistered: bool = False
) -> Measurements:
    scales = ErrorScales(length=size, angle=size)
    options = Simulation(seed=seed, configurations=count, noise=noise, scales=scales)
    return simulate(load_robot(name), replace(options, unregistered=unregistered))


def left(calibration: Calibration, measurements: Measurements) -> float:
    """Mean position error at fresh configurations, m, in the frames of the simulation."""
    assert measurements.truth is not None
    q = simulate(measurements.robot, Simulation(seed=99, configurations=200)).q
    actual = measurements.truth.actual.forward(q)[:, :3, 3]
    return float(np.linalg.norm(calibration.forward(q)[:, :3, 3] - actual, axis=-1).mean())


@pytest.mark.parametrize("name", ["ur5", "scara"])
def test_tiny_errors_and_few_noisy_rows_are_left_to_the_nominal_robot(name: str) -> None:
    """Errors of a hundredth of the noise: nothing can be learned from ten rows, and mostly the
    held-out ones say so."""
    every = BaseOptions("complete", CompleteOptions(compared=False))
    shipped, errors = [], []
    for seed in range(6):
        rows = measured(name, seed, 10, 0.5e-3, 0.005e-3)
        default, nominal = identify(rows), identify(rows, "nominal")
        shipped.append(default.base.model)
        errors.append([left(c, rows) for c in (default, identify(rows, every), nominal)])
        if shipped[-1] == "nominal":
            assert errors[-1][0] == errors[-1][2]
            assert "registration alone is used" in default.summary()
    assert shipped.count("nominal") >= 4
    mine, complete, _ = np.mean(errors, axis=0)
    assert mine < 0.7 * complete


@pytest.mark.parametrize("name", ["ur5", "scara", "panda"])
def test_ordinary_errors_are_not(name: str) -> None:
    rows = measured(name, 0, 12, 0.05e-3, 0.5e-3)
    default = identify(rows)
    assert default.base.model == "complete"
    assert default.base.posterior is not None
    assert left(default, rows) < 0.2 * left(identify(rows, "nominal"), rows)


def test_where_it_is_clear_nothing_else_is_fitted() -> None:
    default = identify(measured("ur5", 0, 100, 0.05e-3, 0.5e-3))
    assert default.base.held_out == {}
    assert "is used" not in default.summary()


def test_what_was_asked_for_is_what_comes() -> None:
    rows = measured("ur5", 0, 10, 0.5e-3, 0.005e-3)
    for options in (CompleteOptions(orders={"harmonics": 0}), CompleteOptions(compared=False)):
        assert identify(rows, BaseOptions("complete", options)).base.model == "complete"


def test_unknown_set_ups_are_registered_again_for_it() -> None:
    """The set-up of the result is the best fit of the nominal robot, whatever the order of rows."""
    shipped = 0
    for seed in range(3):
        rows = measured("ur5", seed, 12, 0.5e-3, 0.005e-3, unregistered=True)
        plain = identify(rows, "nominal").base.residual_rms[0]
        for order in (np.arange(12), np.arange(11, -1, -1)):
            default = identify(rows.rows(order)).base
            if default.model == "nominal":
                shipped += 1
                assert default.residual_rms[0] == pytest.approx(plain, rel=1e-3)
    assert shipped >= 3


def test_the_comparison_stays_in_the_file() -> None:
    default = identify(measured("ur5", 0, 10, 0.5e-3, 0.005e-3))
    again = read_calibration(BytesIO(to_bytes(default)), "c.h5")
    assert again.base.held_out == default.base.held_out
    assert {"nominal", "complete"} <= set(default.base.held_out)
    summary = calibration_summary(again)["base"]
    assert isinstance(summary, dict)
    assert summary["held_out_rms_in_stated_noises"] == default.base.held_out


def test_a_network_on_it_has_to_show_its_worth_like_any_other() -> None:
    rows = measured("ur5", 0, 12, 0.5e-3, 0.005e-3)
    trained = train(rows, options=TrainingOptions(restarts=1, folds=3))
    assert trained.training is not None
    assert trained.training.regularisation == "bayes"
    assert trained.networks == ()


def test_one_bad_row_does_not_decide() -> None:
    rows = measured("ur5", 0, 60, 0.05e-3, 0.5e-3)
    points = rows.points.copy()
    points[7] += 0.1
    default = identify(replace(rows, points=readonly(points)))
    assert default.base.model == "complete"
    assert left(default, rows) < 1.5 * left(identify(rows), rows)
