"""The two losses: compressed or not they are the paper's sums, and their derivatives are right."""

import numpy as np
import pytest
from cases import examples
from derivatives import assert_derivative
from hypothesis import given
from hypothesis import strategies as st

from calibtool.equivalent.loss import Loss, joint_loss, task_loss
from calibtool.equivalent.network import Network

Array = np.ndarray
LOSSES = {"task": task_loss, "joint": joint_loss}


def problem(
    rng: np.random.Generator, n: int, d: int, K: int = 12
) -> tuple[Array, Array, Array, Network]:
    """Configurations, weighted matrices of very unlike columns, weighted
    residuals, and a network.
    """
    p = max(n, 6)
    q = rng.normal(size=(K, n))
    G = rng.normal(size=(K, d, p)) * 10.0 ** rng.uniform(2, 4, p)
    network = Network.initial(q, rng.uniform(1e-4, 1e-3, p), 4, rng)
    return (
        q,
        G,
        rng.normal(size=(K, d)),
        network.with_weights(rng.normal(size=network.weights.size)),
    )


def weighted_task_error(q: Array, G: Array, y: Array, network: Network) -> float:
    """1/K Σ |y_k − G_k N(q_k)|², one configuration after the other (Eq. 20)."""
    total = 0.0
    for k in range(len(q)):
        left = y[k] - G[k] @ network(q[k : k + 1])[0]
        total += float(left @ left)
    return total / len(q)


@given(seed=st.integers(0, 10_000), n=st.integers(3, 7), d=st.sampled_from([3, 6, 9]))
@examples(25)
def test_the_task_loss_and_a_constant_are_the_weighted_error_of_the_targets(
    seed: int, n: int, d: int
) -> None:
    rng = np.random.default_rng(seed)
    q, G, y, network = problem(rng, n, d)
    other = network.with_weights(rng.normal(size=network.weights.size))
    loss = task_loss(q, G, y)
    none = float((y**2).sum() / len(q))
    for given_network in (network, other):
        direct = weighted_task_error(q, G, y, given_network)
        assert np.isclose(
            loss.value(given_network) + (none - loss.without_network), direct, rtol=1e-10, atol=0
        )
    assert none - loss.without_network >= -1e-9  # what no joint motion can explain


def test_the_task_loss_is_compressed_to_six_rows(rng: np.random.Generator) -> None:
    q, G, y, _ = problem(rng, 6, 9)
    assert task_loss(q, G, y).R.shape == (12, 6, 6)
    q, G, y, _ = problem(rng, 6, 3)  # one target
    assert task_loss(q, G, y).R.shape == (12, 3, 6)


def test_with_one_target_nothing_is_left_unexplained(rng: np.random.Generator) -> None:
    q, G, y, _ = problem(rng, 6, 3)
    assert np.isclose(task_loss(q, G, y).without_network, (y**2).sum() / len(q), rtol=1e-12)


@given(seed=st.integers(0, 10_000), n=st.integers(3, 7), d=st.sampled_from([3, 6, 9]))
@examples(15)
def test_the_joint_loss_is_the_distance_from_the_pseudo_inverse_solution(
    seed: int, n: int, d: int
) -> None:
    rng = np.random.default_rng(seed)
    q, G, y, network = problem(rng, n, d)
    loss = joint_loss(q, G, y)
    total = 0.0
    for k in range(len(q)):
        solution = np.linalg.lstsq(G[k], y[k], rcond=1e-9)[0]  # minimum norm, Eq. 21
        total += float(((solution - network(q[k : k + 1])[0]) ** 2).sum())
    assert np.isclose(loss.value(network), total / len(q), rtol=1e-8)


def test_the_joint_target_of_minimum_norm_explains_the_data(rng: np.random.Generator) -> None:
    for n, d in ((7, 6), (6, 3)):
        q, G, y, _ = problem(rng, n, d)
        t = joint_loss(q, G, y).t
        assert np.allclose((G @ t[..., None])[..., 0], y, atol=1e-8)
        null = np.linalg.svd(G)[2][:, d:]
        assert np.abs(null @ t[..., None]).max() < 1e-9 * np.abs(t).max()


@pytest.mark.parametrize("d", [3, 9])
@pytest.mark.parametrize("n", [4, 6, 7])
@pytest.mark.parametrize("kind", LOSSES)
def test_the_jacobian_is_the_derivative_by_the_weights(
    kind: str, n: int, d: int, rng: np.random.Generator
) -> None:
    q, G, y, network = problem(rng, n, d, K=5)
    loss = LOSSES[kind](q, G / 1e3, y / 1e3)
    residual, J = loss.residual_and_jacobian(network)
    assert np.allclose(residual, loss.residual(network).ravel(), rtol=1e-13, atol=1e-15)
    assert_derivative(
        lambda w: -loss.residual(network.with_weights(w)).ravel(),
        J,
        network.weights,
        tolerance=1e-8,
        step=1e-3,
    )


def test_the_value_is_the_mean_square_of_the_residual(rng: np.random.Generator) -> None:
    q, G, y, network = problem(rng, 6, 9)
    loss = task_loss(q, G, y)
    left = [loss.t[k] - loss.R[k] @ network(q[k : k + 1])[0] for k in range(len(q))]
    assert np.isclose(loss.value(network), sum(float(v @ v) for v in left) / len(q), rtol=1e-12)


@pytest.mark.parametrize("kind", LOSSES)
def test_losses_of_parts_weighted_by_their_rows_are_the_loss_of_the_whole(
    kind: str, rng: np.random.Generator
) -> None:
    q, G, y, network = problem(rng, 6, 9)
    loss: Loss = LOSSES[kind](q, G, y)
    part, rest = loss.rows(np.arange(4)), loss.rows(np.arange(4, 12))
    assert np.isclose(
        (4 * part.value(network) + 8 * rest.value(network)) / 12, loss.value(network), rtol=1e-12
    )
