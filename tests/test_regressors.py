"""Learned models: the network by its derivatives, the Gaussian process by its textbook formula;
both are trained and judged alike, stored and exported.
"""

import io
from dataclasses import replace

import numpy as np
import pytest
from derivatives import assert_derivative

from calibtool.calibration import Calibration, identify, train
from calibtool.equivalent.bayesian import train_bayesian
from calibtool.equivalent.gaussian_process import GaussianProcess, fit_gaussian_process
from calibtool.equivalent.loss import task_loss
from calibtool.equivalent.network import Network
from calibtool.equivalent.regressors import REGRESSORS
from calibtool.equivalent.training import TrainingOptions
from calibtool.errors import UsageError
from calibtool.export.as_json import calibration_as_json
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array
from calibtool.storage import read_any, to_bytes

NOISE = 0.7


def motions(q: Array) -> Array:
    """Smooth joint motion errors (K, 6) in rad."""
    return 2e-4 * np.stack([np.sin(q[:, j] + q[:, (j + 1) % 6]) for j in range(6)], axis=-1)


def data(rng: np.random.Generator, count: int = 200) -> tuple[Array, Array, Array]:
    """Configurations (K, n), matrices (K, d, p), and smooth motion errors seen through them."""
    q = rng.uniform(-1.5, 1.5, (count, 6))
    G = rng.normal(size=(count, 9, 6)) * 2e4
    return q, G, (G @ motions(q)[..., None])[..., 0]


def test_the_network_jacobian_is_the_derivative_by_the_weights(rng: np.random.Generator) -> None:
    q, R = rng.normal(size=(4, 3)), rng.normal(size=(4, 5, 6))
    start = Network.initial(rng.normal(size=(20, 3)), rng.uniform(0.5, 2, 6), 4, rng)
    seen, J = start.through(R, q)
    np.testing.assert_allclose(seen, (R @ start(q)[..., None])[..., 0], atol=1e-12)
    assert_derivative(lambda w: start.with_weights(w).through(R, q)[0], J, start.weights)


def process(rng: np.random.Generator, h: int = 5) -> GaussianProcess:
    return GaussianProcess(
        input_centre=np.zeros(6),
        input_scale=np.full(6, 0.8),
        points=rng.normal(size=(h, 6)),
        output_weights=rng.normal(size=(6, h)),
        output_scale=np.full(6, 1e-3),
    )


@pytest.mark.parametrize("kind", REGRESSORS)
def test_the_mean_of_members_is_one_of_them(kind: str, rng: np.random.Generator) -> None:
    q = rng.normal(size=(10, 6))
    members: list[Network] | list[GaussianProcess] = [process(rng) for _ in range(3)]
    if kind == "tanh":
        members = [Network.initial(q, np.full(6, 1e-3), 5, rng) for _ in range(3)]
    mean = members[0].averaged(members)  # type: ignore[arg-type]
    np.testing.assert_allclose(mean(q), np.mean([m(q) for m in members], axis=0), atol=1e-17)
    rows = np.concatenate([mean(q[k : k + 1]) for k in range(10)])
    np.testing.assert_array_equal(mean(q), rows)


def test_a_smooth_function_is_learned_and_nothing_is_not(rng: np.random.Generator) -> None:
    q, G, y = data(rng)
    fresh = rng.uniform(-1.5, 1.5, (50, 6))
    start = Network.initial(q, np.full(6, 2e-4), Network.size_for(6), rng)
    noisy, alone = (task_loss(q, G, z + rng.normal(size=y.shape)) for z in (y, 0.0 * y))
    for learn in (
        lambda loss: train_bayesian(start, loss),
        lambda loss: fit_gaussian_process(loss, np.full(6, 2e-4)),
    ):
        learned = learn(noisy)
        left = np.sqrt(np.mean((learned.network(fresh) - motions(fresh)) ** 2))
        assert left < 0.75 * np.sqrt(np.mean(motions(fresh) ** 2))
        assert learn(alone).effective < 0.5 * learned.effective


def test_the_gaussian_process_is_the_mean_of_the_textbook(rng: np.random.Generator) -> None:
    """With a point at every configuration: K_* (K + σ² I)⁻¹ y, K = a² R k Rᵀ, of Rasmussen and
    Williams (2.25), in the coordinates of y and not of the weights."""
    q, G, y = data(rng, 60)
    y = y + NOISE * rng.normal(size=y.shape)
    scale = np.full(6, 2e-4)
    learned = fit_gaussian_process(task_loss(q, G, y), scale)
    found = learned.network
    assert isinstance(found, GaussianProcess)
    assert learned.effective > 10
    fresh = rng.uniform(-1.5, 1.5, (20, 6))

    def kernel(a: Array, b: Array) -> Array:
        apart = (a[:, None] - b) / found.input_scale
        return np.asarray(np.exp(-0.5 * (apart**2).sum(axis=-1)))

    def expected(size: float) -> Array:
        prior = np.diag((size * scale) ** 2)
        seen = np.einsum("adi,ij,bej,ab->adbe", G, prior, G, kernel(q, q)).reshape(y.size, y.size)
        solved = np.linalg.solve(seen + learned.noise_factor**2 * np.eye(y.size), y.ravel())
        there = np.einsum("ij,bej,ab->aibe", prior, G, kernel(fresh, q))
        return np.asarray(there.reshape(-1, y.size) @ solved).reshape(-1, 6)

    sizes = np.geomspace(0.01, 3.0, 12)
    nearest = min(np.abs(found(fresh) - expected(float(size))).max() for size in sizes)
    assert nearest < 1e-3 * np.abs(found(fresh)).max()


def test_fewer_points_come_near(rng: np.random.Generator) -> None:
    q, G, y = data(rng, 150)
    loss = task_loss(q, G, y + NOISE * rng.normal(size=y.shape))
    whole, part = (fit_gaussian_process(loss, np.full(6, 2e-4), h).network for h in (150, 75))
    fresh = rng.uniform(-1.5, 1.5, (100, 6))
    assert np.std(part(fresh) - whole(fresh)) < 0.5 * np.std(whole(fresh))


@pytest.mark.parametrize("kind", REGRESSORS)
def test_it_is_trained_judged_and_kept_in_a_file(kind: str) -> None:
    robot = load_robot("ur5")
    measurements = simulate(robot, Simulation(configurations=60))
    options = TrainingOptions(regularisation="bayes", regressor=kind, restarts=2, folds=3)
    calibration = train(measurements, "nominal", options)
    assert calibration.validation is not None
    assert calibration.validation.helps
    assert isinstance(calibration.network, REGRESSORS[kind])
    after = read_any(io.BytesIO(to_bytes(calibration)), "c.h5")
    assert isinstance(after, Calibration)
    q = measurements.q[:5]
    np.testing.assert_array_equal(after.forward(q), calibration.forward(q))
    assert f'"kind": "{kind}"' in calibration_as_json(calibration)


def test_what_predicts_held_out_rows_better_is_used() -> None:
    """On the nominal robot, whose errors are smooth functions of the joints: whatever is chosen
    gains at least as much as either alone."""
    measurements = simulate(load_robot("ur5"), Simulation(configurations=60))
    options = TrainingOptions(regularisation="bayes", restarts=2, folds=3)
    gains = {}
    for kind in (None, *REGRESSORS):
        found = train(measurements, "nominal", replace(options, regressor=kind))
        assert found.validation is not None
        assert found.training is not None
        gains[kind] = (found.validation.gain, found.training.regressor)
    gain, chosen = gains[None]
    assert chosen == max(REGRESSORS, key=lambda kind: gains[kind][0])
    assert gain > 50


@pytest.mark.parametrize("options", [{"optimiser": "gd"}, {"regularisation": "early-stopping"}])
def test_a_gaussian_process_is_not_trained_by_steps(options: dict[str, str]) -> None:
    with pytest.raises(UsageError, match="takes bayes"):
        TrainingOptions(regressor="gaussian-process", **options)  # type: ignore[arg-type]


def test_an_unknown_model_is_refused() -> None:
    with pytest.raises(UsageError, match="did you mean tanh"):
        TrainingOptions(regressor="tan")


def test_nothing_is_learned_from_nothing() -> None:
    measurements = simulate(load_robot("ur5"), Simulation(configurations=20, workspace="full"))
    complete = identify(measurements)
    found = train(measurements, complete, TrainingOptions(regressor="gaussian-process"))
    assert found.networks == ()
