"""Learned models beside the tanh network: one protocol, derivatives by finite differences, trained
and judged alike.
"""

import io
from dataclasses import replace

import numpy as np
import pytest
from derivatives import assert_derivative

from calibtool.calibration import Calibration, identify, train
from calibtool.equivalent.bayesian import train_bayesian
from calibtool.equivalent.loss import task_loss
from calibtool.equivalent.regressor import Regressor
from calibtool.equivalent.regressors import REGRESSORS
from calibtool.equivalent.training import TrainingOptions
from calibtool.errors import UsageError
from calibtool.export.as_json import calibration_as_json
from calibtool.export.c_code import calibration_as_c
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array
from calibtool.storage import read_any, to_bytes

KINDS = pytest.mark.parametrize("kind", REGRESSORS.values(), ids=REGRESSORS)


def data(rng: np.random.Generator, count: int = 200) -> tuple[Array, Array, Array]:
    """Configurations (K, n), matrices (K, d, p), and smooth motion errors seen through them."""
    q = rng.uniform(-1.5, 1.5, (count, 6))
    G = rng.normal(size=(count, 9, 6)) * 2e4
    motions = 2e-4 * np.stack([np.sin(q[:, j] + q[:, (j + 1) % 6]) for j in range(6)], axis=-1)
    return q, G, (G @ motions[..., None])[..., 0]


@KINDS
def test_the_jacobian_is_the_derivative_by_the_weights(
    kind: type[Regressor], rng: np.random.Generator
) -> None:
    q, R = rng.normal(size=(4, 3)), rng.normal(size=(4, 5, 6))
    start = kind.initial(rng.normal(size=(20, 3)), rng.uniform(0.5, 2, 6), 4, rng)
    seen, J = start.through(R, q)
    np.testing.assert_allclose(seen, (R @ start(q)[..., None])[..., 0], atol=1e-12)
    assert_derivative(lambda w: start.with_weights(w).through(R, q)[0], J, start.weights)


@KINDS
def test_the_mean_of_members_is_one_of_them(
    kind: type[Regressor], rng: np.random.Generator
) -> None:
    q = rng.normal(size=(10, 6))
    members = [kind.initial(q, np.full(6, 1e-3), 5, rng) for _ in range(3)]
    mean = members[0].averaged(members)
    np.testing.assert_allclose(
        mean(q), np.mean([member(q) for member in members], axis=0), atol=1e-17
    )
    rows = np.concatenate([mean(q[k : k + 1]) for k in range(10)])
    np.testing.assert_array_equal(mean(q), rows)


@KINDS
def test_a_smooth_function_is_learned_and_nothing_is_not(
    kind: type[Regressor], rng: np.random.Generator
) -> None:
    q, G, y = data(rng)
    fresh, _, _ = data(rng, 50)
    start = kind.initial(q, np.full(6, 2e-4), kind.size_for(6), rng)
    learned = train_bayesian(start, task_loss(q, G, y + rng.normal(size=y.shape)))
    expected = 2e-4 * np.stack(
        [np.sin(fresh[:, j] + fresh[:, (j + 1) % 6]) for j in range(6)], axis=-1
    )
    left = np.sqrt(np.mean((learned.network(fresh) - expected) ** 2))
    assert left < 0.75 * np.sqrt(np.mean(expected**2))
    nothing = train_bayesian(start, task_loss(q, G, rng.normal(size=y.shape)))
    assert nothing.effective < 0.5 * learned.effective


@KINDS
def test_it_is_trained_judged_and_kept_in_a_file(kind: type[Regressor]) -> None:
    robot = load_robot("ur5")
    measurements = simulate(robot, Simulation(configurations=60))
    options = TrainingOptions(regularisation="bayes", regressor=kind.id, restarts=2, folds=3)
    calibration = train(measurements, "nominal", options)
    assert calibration.validation is not None
    assert calibration.validation.helps
    assert isinstance(calibration.network, kind)
    after = read_any(io.BytesIO(to_bytes(calibration)), "c.h5")
    assert isinstance(after, Calibration)
    q = measurements.q[:5]
    np.testing.assert_array_equal(after.forward(q), calibration.forward(q))
    assert f'"kind": "{kind.id}"' in calibration_as_json(calibration)


def test_c_code_of_another_model_is_refused(rng: np.random.Generator) -> None:
    calibration = identify(
        simulate(load_robot("ur5"), Simulation(configurations=20, workspace="full")), "nominal"
    )
    other = REGRESSORS["random-features"].initial(calibration.q, np.full(6, 1e-4), 4, rng)
    with pytest.raises(UsageError, match="export JSON"):
        calibration_as_c(replace(calibration, networks=(other,)))


def test_an_unknown_model_is_refused() -> None:
    with pytest.raises(UsageError, match="did you mean tanh"):
        TrainingOptions(regressor="tan")
