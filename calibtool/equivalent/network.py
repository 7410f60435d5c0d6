"""The network δρ = N(q, w) (Eq. 16): one tanh layer, linear output, scaled inputs and outputs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from calibtool.robot.se3 import Array, readonly


@dataclass(frozen=True, eq=False)
class Network:
    """N(q) = output_scale ∘ (W₂ tanh(W₁ s + b₁) + b₂), s = (q − input_centre) / input_scale.

    input_centre, input_scale   (n,) rad or m: the training range becomes [−1, 1]
    hidden_weights (h, n), hidden_bias (h,), output_weights (p, h), output_bias (p,): dimensionless
    output_scale                (p,) rad or m
    """

    input_centre: Array
    input_scale: Array
    hidden_weights: Array
    hidden_bias: Array
    output_weights: Array
    output_bias: Array
    output_scale: Array

    def __call__(self, q: Array) -> Array:
        """Joint motion errors δρ (N, p) in rad or m for joint positions q (N, n)."""
        hidden = np.tanh(_affine(self.hidden_weights, self.scaled_input(q).T.copy(), self.hidden_bias))
        return _affine(self.output_weights, hidden, self.output_bias).T * self.output_scale

    def scaled_input(self, q: Array) -> Array:
        """s (N, n), within [−1, 1] inside the training range."""
        return (q - self.input_centre) / self.input_scale

    @property
    def hidden(self) -> int:
        """Number of hidden nodes."""
        return len(self.hidden_bias)

    @property
    def weights(self) -> Array:
        """w, all adjustable weights in one vector (W,): W₁, b₁, W₂, b₂."""
        parts = (self.hidden_weights, self.hidden_bias, self.output_weights, self.output_bias)
        return np.concatenate([part.ravel() for part in parts])

    def with_weights(self, weights: Array) -> Self:
        """The same network with another weight vector (W,), in the order of `weights`."""
        h, n = self.hidden_weights.shape
        p = len(self.output_bias)
        w = readonly(weights)  # once: training does this at every step
        return type(self)(
            input_centre=self.input_centre,
            input_scale=self.input_scale,
            hidden_weights=w[: h * n].reshape(h, n),
            hidden_bias=w[h * n : h * n + h],
            output_weights=w[h * n + h : -p].reshape(p, h),
            output_bias=w[-p:],
            output_scale=self.output_scale,
        )


def _affine(weights: Array, inputs: Array, bias: Array) -> Array:
    """W x + b for every row, without a library whose sums depend on the number of rows: (k, N) → (h, N)."""
    result = np.repeat(bias[:, None], inputs.shape[-1], axis=1)
    for column, values in zip(weights.T, inputs, strict=True):
        result += column[:, None] * values
    return result


def averaged(networks: Sequence[Network]) -> Network:
    """The mean of networks with the same scalings, which is one network again, with all their hidden nodes."""
    first, count = networks[0], len(networks)
    return replace(
        first,
        hidden_weights=readonly(np.concatenate([network.hidden_weights for network in networks])),
        hidden_bias=readonly(np.concatenate([network.hidden_bias for network in networks])),
        output_weights=readonly(np.concatenate([network.output_weights for network in networks], axis=1) / count),
        output_bias=readonly(np.mean([network.output_bias for network in networks], axis=0)),
    )


def rule_of_thumb(n: int) -> int:
    """Number of hidden nodes √(6n), rounded (paper, Section III-B)."""
    return round(float(np.sqrt(6 * n)))


def initial_network(q: Array, output_scale: Array, hidden: int, rng: np.random.Generator) -> Network:
    """A network with normally distributed weights, scaled to the range of the training configurations q (K, n).

    Weights into a node have a variance of one over their number, so that the nodes start in the bend of the tanh.
    """
    low, high = q.min(axis=0), q.max(axis=0)
    n, p = q.shape[1], len(output_scale)
    return Network(
        input_centre=readonly((low + high) / 2),
        input_scale=readonly(np.where(high - low > 1e-9, (high - low) / 2, 1.0)),
        hidden_weights=readonly(rng.normal(size=(hidden, n)) / np.sqrt(n)),
        hidden_bias=readonly(rng.normal(size=hidden) / np.sqrt(n)),
        output_weights=readonly(rng.normal(size=(p, hidden)) / np.sqrt(hidden)),
        output_bias=readonly(np.zeros(p)),
        output_scale=readonly(output_scale),
    )
