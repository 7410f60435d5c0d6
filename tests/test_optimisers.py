"""The optimisers go downhill, arrive where they can, and hand back the iteration with the lowest
validation loss.
"""

from collections.abc import Iterator

import numpy as np
import pytest

from calibtool.equivalent.bayesian import train_bayesian
from calibtool.equivalent.loss import Loss, task_loss
from calibtool.equivalent.network import Network
from calibtool.equivalent.optimisers import (
    GD_STOPPING,
    LM_STOPPING,
    Stopping,
    gradient_descent,
    levenberg_marquardt,
    run,
)
from calibtool.robot.se3 import Array

OPTIMISERS = {"lm": levenberg_marquardt, "gd": gradient_descent}


def taught(seed: int, K: int = 80, noise: float = 0.0) -> tuple[Loss, Network, Network]:
    """A loss whose data come from a network (the teacher), and another network of the same
    size to start from.
    """
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1, 1, (K, 3))
    G = rng.normal(size=(K, 6, 6))
    teacher = Network.initial(q, np.ones(6), 3, rng)
    teacher = teacher.with_weights(rng.normal(size=teacher.weights.size))
    y = (G @ teacher(q)[..., None])[..., 0] + noise * rng.normal(size=(K, 6))
    return task_loss(q, G, y), Network.initial(q, np.ones(6), 3, rng), teacher


def constant(network: Network, value: float) -> Network:
    """A network whose output is `value` everywhere."""
    weights = np.zeros_like(network.weights)
    weights[-len(network.output_bias) :] = value
    return network.with_weights(weights)


@pytest.mark.parametrize("name", OPTIMISERS)
def test_the_loss_never_rises(name: str) -> None:
    for seed in range(3):
        loss, network, _ = taught(seed, noise=0.1)
        before = loss.value(network)
        for iteration, (candidate, value) in enumerate(OPTIMISERS[name](network, loss)):
            assert np.isclose(value, loss.value(candidate), rtol=1e-9)
            assert value <= before
            before = value
            if iteration == 60:
                break
        assert before < 0.9 * loss.value(network)


def test_levenberg_marquardt_solves_what_a_network_of_the_same_size_has_made() -> None:
    for seed in range(3):
        loss, _, teacher = taught(seed)
        rng = np.random.default_rng(seed)
        start = teacher.with_weights(teacher.weights + 0.3 * rng.normal(size=teacher.weights.size))
        best, history = run(levenberg_marquardt, start, loss, None, LM_STOPPING)
        assert loss.value(best) < 1e-12 * loss.without_network
        assert history.training[-1] < 1e-9 * history.training[0]


def test_levenberg_marquardt_ends_at_a_stationary_point() -> None:
    loss, network, _ = taught(5, noise=0.3)
    stopping = Stopping(max_iterations=500, patience=500, change=0.0)
    best, _ = run(levenberg_marquardt, network, loss, None, stopping)

    def slope(at: Network) -> float:
        residual, J = loss.residual_and_jacobian(at)
        return float(np.linalg.norm(J.T @ residual) / np.linalg.norm(residual))

    assert slope(best) < 1e-3 * slope(network)


def test_gradient_descent_follows_the_gradient() -> None:
    loss, network, _ = taught(1)
    step = next(gradient_descent(network, loss, rate=1e-9))[0].weights - network.weights
    residual, J = loss.residual_and_jacobian(network)
    downhill = J.T @ residual
    assert step @ downhill > (1 - 1e-6) * np.linalg.norm(step) * np.linalg.norm(downhill)


def test_gradient_descent_shortens_a_step_that_would_go_uphill() -> None:
    loss, network, _ = taught(1)
    before = loss.value(network)
    for (candidate, _), _ in zip(
        gradient_descent(network, loss, rate=1e4), range(20), strict=False
    ):
        assert loss.value(candidate) <= before
        before = loss.value(candidate)
    assert before < loss.value(network)


def test_gradient_descent_does_not_depend_on_the_units_of_the_loss() -> None:
    loss, network, _ = taught(1)
    scaled = Loss(loss.q, loss.R * 1000.0, loss.t * 1000.0)
    for (a, _), (b, _), _ in zip(
        gradient_descent(network, loss), gradient_descent(network, scaled), range(5), strict=False
    ):
        assert np.allclose(a.weights, b.weights, rtol=1e-9, atol=1e-12)


def test_gradient_descent_gets_near_the_solution_with_patience() -> None:
    loss, _, teacher = taught(0)
    start = teacher.with_weights(
        teacher.weights + 0.05 * np.random.default_rng(0).normal(size=teacher.weights.size)
    )
    best, _ = run(gradient_descent, start, loss, None, Stopping(1500, 1500, 0.0))
    assert loss.value(best) < 0.05 * loss.value(start)
    assert GD_STOPPING.max_iterations > 1500


def scripted(values: list[float]) -> tuple[Loss, Network, object]:
    """Steps that visit constant networks, whose validation losses are therefore known: value² · 6
    for a zero target.
    """
    rng = np.random.default_rng(0)
    q = rng.normal(size=(4, 2))
    network = Network.initial(q, np.ones(6), 2, rng)
    loss = Loss(q, np.broadcast_to(np.eye(6), (4, 6, 6)), np.zeros((4, 6)))

    def steps(_: Network, training: Loss) -> Iterator[tuple[Network, float]]:
        for i, value in enumerate(values):
            yield constant(network, value), 1.0 / (i + 2)  # a training loss that always falls

    return loss, network, steps


@pytest.mark.parametrize(
    ("values", "lowest"),
    [
        ([5.0, 3.0, 2.0, 4.0, 6.0], 3),
        ([1.0, 2.0, 3.0], 1),
        ([4.0, 3.0, 2.0, 1.0], 4),
        ([5.0, 1.0, 4.0, 0.5, 9.0], 4),
    ],
)
def test_early_stopping_hands_back_the_lowest_validation_loss(
    values: list[float], lowest: int
) -> None:
    loss, network, steps = scripted(values)
    best, history = run(steps, constant(network, 10.0), loss, loss, Stopping(100, 100, 1e-7))
    assert history.chosen == lowest
    assert np.allclose(best(loss.q), values[lowest - 1])
    assert np.allclose(history.validation, [6 * v**2 for v in (10.0, *values)])
    assert np.allclose(history.training[1:], [1.0 / (i + 2) for i in range(len(values))])


def test_the_first_network_is_kept_where_no_step_validates_better() -> None:
    loss, network, steps = scripted([2.0, 3.0, 4.0])
    best, history = run(steps, constant(network, 1.0), loss, loss, Stopping(100, 100, 1e-7))
    assert history.chosen == 0
    assert np.allclose(best(loss.q), 1.0)


def test_patience_ends_a_run_that_no_longer_validates_better() -> None:
    loss, network, steps = scripted([2.0, 1.0, *[3.0] * 50])
    _, history = run(steps, constant(network, 9.0), loss, loss, Stopping(100, 7, 1e-7))
    assert history.chosen == 2
    assert len(history.training) == 1 + 2 + 7
    assert "no better validation loss in 7 iterations" in history.reason


def test_a_run_has_a_largest_number_of_iterations() -> None:
    loss, network, steps = scripted([float(100 - i) for i in range(50)])
    _, history = run(steps, constant(network, 200.0), loss, loss, Stopping(12, 100, 1e-7))
    assert len(history.training) == 1 + 12
    assert history.reason == "12 iterations"


def test_a_training_loss_that_no_longer_changes_has_settled() -> None:
    loss, network, _ = scripted([])

    def steps(_: Network, training: Loss) -> Iterator[tuple[Network, float]]:
        for value in (1.0, 0.5, 0.5 * (1 - 1e-9), 0.1):
            yield constant(network, 1.0), value

    _, history = run(steps, constant(network, 2.0), loss, loss, Stopping(100, 100, 1e-7))
    assert len(history.training) == 4
    assert "settled" in history.reason


def test_without_validation_rows_the_lowest_training_loss_is_kept() -> None:
    loss, network, _ = taught(2, noise=0.1)
    best, history = run(levenberg_marquardt, network, loss, None, LM_STOPPING)
    assert np.isnan(history.validation).all()
    assert np.isclose(loss.value(best), history.training.min(), rtol=1e-9)


def test_without_a_finite_loss_levenberg_marquardt_takes_no_step() -> None:
    loss, network, _ = taught(0)
    endless = Loss(loss.q, loss.R, np.full_like(loss.t, 1e200))
    with np.errstate(over="ignore", invalid="ignore"):
        assert list(levenberg_marquardt(network, endless)) == []


class Uphill(Loss):
    """A loss whose derivative has the wrong sign."""

    def residual_and_jacobian(self, network: Network) -> tuple[Array, Array]:
        residual, J = super().residual_and_jacobian(network)
        return residual, -J


@pytest.mark.parametrize("name", OPTIMISERS)
def test_an_optimiser_gives_up_where_every_step_goes_uphill(name: str) -> None:
    loss, network, _ = taught(0)
    assert list(OPTIMISERS[name](network, Uphill(loss.q, loss.R, loss.t))) == []


def test_bayesian_training_gives_up_where_every_step_goes_uphill() -> None:
    loss, network, _ = taught(0)
    found = train_bayesian(network, Uphill(loss.q, loss.R, loss.t))
    assert found.network is network
    assert found.history.reason == "the regularised loss cannot be lowered further"


def test_bayesian_training_has_a_largest_number_of_iterations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loss, network, _ = taught(0)
    monkeypatch.setattr("calibtool.equivalent.bayesian._MAX_ITERATIONS", 2)
    found = train_bayesian(network, loss)
    assert found.history.reason == "2 iterations"
    assert loss.value(found.network) == found.history.training[2] < loss.value(network)
