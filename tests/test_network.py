"""The network: its formula, its scaling, its weights as one vector."""

import numpy as np
import pytest
from cases import examples
from hypothesis import given
from hypothesis import strategies as st

from calibtool.equivalent.network import Network


@given(seed=st.integers(0, 10_000), n=st.integers(1, 7), hidden=st.integers(1, 8))
@examples(15)
def test_the_output_is_the_sum_over_nodes_written_out(seed: int, n: int, hidden: int) -> None:
    rng = np.random.default_rng(seed)
    p = max(n, 6)
    q = rng.normal(size=(4, n))
    network = Network.initial(q, rng.uniform(1e-4, 1e-3, p), hidden, rng)
    network = network.with_weights(rng.normal(size=network.weights.size))
    w = network
    for row, output in zip(q, network(q), strict=True):
        for i in range(p):
            total = w.output_bias[i]
            for h in range(hidden):
                inner = w.hidden_bias[h]
                for j in range(n):
                    inner += (
                        w.hidden_weights[h, j] * (row[j] - w.input_centre[j]) / w.input_scale[j]
                    )
                total += w.output_weights[i, h] * np.tanh(inner)
            assert np.isclose(output[i], total * w.output_scale[i], rtol=1e-10, atol=1e-18)


@given(seed=st.integers(0, 10_000), n=st.integers(1, 7), hidden=st.integers(1, 8))
@examples(15)
def test_weights_make_a_round_trip_and_each_one_matters(seed: int, n: int, hidden: int) -> None:
    rng = np.random.default_rng(seed)
    p = max(n, 6)
    network = Network.initial(rng.normal(size=(5, n)), np.ones(p), hidden, rng)
    assert network.weights.size == hidden * n + hidden + p * hidden + p
    other = rng.normal(size=network.weights.size)
    assert np.array_equal(network.with_weights(other).weights, other)
    assert np.array_equal(
        network.with_weights(network.weights)(np.ones((1, n))), network(np.ones((1, n)))
    )
    assert not np.array_equal(
        network.with_weights(other)(np.ones((1, n))), network(np.ones((1, n)))
    )


def test_weights_are_stacked_layer_by_layer(rng: np.random.Generator) -> None:
    # Part of the exported format: W₁ row by row, b₁, W₂ row by row, b₂.
    network = Network.initial(rng.normal(size=(5, 2)), np.ones(6), 3, rng).with_weights(
        np.arange(33.0)
    )
    assert network.hidden_weights.tolist() == [[0, 1], [2, 3], [4, 5]]
    assert network.hidden_bias.tolist() == [6, 7, 8]
    assert network.output_weights[1].tolist() == [12, 13, 14]
    assert network.output_bias.tolist() == [27, 28, 29, 30, 31, 32]


def test_the_training_range_becomes_minus_one_to_one(rng: np.random.Generator) -> None:
    q = rng.uniform([-3, 0.2, 5], [1, 0.3, 5.1], (30, 3))
    scaled = Network.initial(q, np.ones(6), 4, rng).scaled_input(q)
    assert np.allclose(scaled.min(axis=0), -1, atol=1e-9)
    assert np.allclose(scaled.max(axis=0), 1, atol=1e-9)


def test_a_joint_that_never_moves_does_not_blow_up(rng: np.random.Generator) -> None:
    q = rng.normal(size=(10, 3))
    q[:, 1] = 0.7
    network = Network.initial(q, np.ones(6), 4, rng)
    assert np.isfinite(network(q)).all()
    assert np.array_equal(network.scaled_input(q)[:, 1], np.zeros(10))


@pytest.mark.parametrize("n", range(1, 9))
def test_the_number_of_hidden_nodes_is_the_root_of_six_n(n: int) -> None:
    hidden = Network.size_for(n)
    assert abs(hidden - (6 * n) ** 0.5) <= 0.5


def test_the_same_generator_makes_the_same_network(rng: np.random.Generator) -> None:
    q = rng.normal(size=(10, 6))
    a, b, c = (
        Network.initial(q, np.ones(6), 6, np.random.default_rng(seed)).weights for seed in (1, 1, 2)
    )
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


def test_arrays_are_read_only(rng: np.random.Generator) -> None:
    network = Network.initial(rng.normal(size=(10, 6)), np.ones(6), 6, rng)
    with pytest.raises(ValueError, match="read-only"):
        network.output_bias[0] = 1.0
