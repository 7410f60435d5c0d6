"""The network δρ = N(q, w) (Eq. 16): one tanh layer, linear output, scaled inputs and outputs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from calibtool.equivalent.regressor import Trainable
from calibtool.robot.se3 import Array, readonly


@dataclass(frozen=True, eq=False)
class Network(Trainable):
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

    id: ClassVar[str] = "tanh"
    fields: ClassVar[dict[str, tuple[str, str, tuple[str, ...]]]] = {
        "input_centre": ("q", "middle of the training range", ("joint",)),
        "input_scale": ("q", "half of the training range", ("joint",)),
        "hidden_weights": ("1", "W1", ("hidden", "joint")),
        "hidden_bias": ("1", "b1", ("hidden",)),
        "output_weights": ("1", "W2", ("motion", "hidden")),
        "output_bias": ("1", "b2", ("motion",)),
        "output_scale": ("rho", "unit of each joint motion error", ("motion",)),
    }

    @classmethod
    def initial(cls, q: Array, output_scale: Array, hidden: int, rng: np.random.Generator) -> Self:
        """A network with normally distributed weights, scaled to the range of configurations q
        (K, n).

        The variance of the weights into a node is one over their number, so that tanh is neither
        linear nor saturated at the start.
        """
        centre, scale = input_scaling(q)
        n, p = q.shape[1], len(output_scale)
        return cls(
            input_centre=centre,
            input_scale=scale,
            hidden_weights=readonly(rng.normal(size=(hidden, n)) / np.sqrt(n)),
            hidden_bias=readonly(rng.normal(size=hidden) / np.sqrt(n)),
            output_weights=readonly(rng.normal(size=(p, hidden)) / np.sqrt(hidden)),
            output_bias=readonly(np.zeros(p)),
            output_scale=readonly(output_scale),
        )

    @classmethod
    def size_for(cls, n: int) -> int:
        """Number of hidden nodes √(6n), rounded (paper, Section III-B)."""
        return round(float(np.sqrt(6 * n)))

    @classmethod
    def averaged(cls, members: Sequence[Self]) -> Self:
        """Mean of networks with equal scalings: one network with all their hidden nodes."""
        first, count = members[0], len(members)
        return replace(
            first,
            hidden_weights=readonly(np.concatenate([member.hidden_weights for member in members])),
            hidden_bias=readonly(np.concatenate([member.hidden_bias for member in members])),
            output_weights=readonly(
                np.concatenate([member.output_weights for member in members], axis=1) / count
            ),
            output_bias=readonly(np.mean([member.output_bias for member in members], axis=0)),
        )

    def __call__(self, q: Array) -> Array:
        hidden = np.tanh(
            affine(self.hidden_weights, self.scaled_input(q).T.copy(), self.hidden_bias)
        )
        return affine(self.output_weights, hidden, self.output_bias).T * self.output_scale

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

    def through(self, R: Array, q: Array) -> tuple[Array, Array]:
        s = self.scaled_input(q)
        hidden = np.tanh(s @ self.hidden_weights.T + self.hidden_bias)
        scaled = R * self.output_scale  # (K, r, p)
        output = hidden @ self.output_weights.T + self.output_bias
        into_hidden = (scaled @ self.output_weights) * (1.0 - hidden**2)[:, None, :]  # (K, r, h)
        count, r = R.shape[:2]
        blocks = (
            (into_hidden[..., None] * s[:, None, None, :]).reshape(count, r, -1),
            into_hidden,
            (scaled[..., None] * hidden[:, None, None, :]).reshape(count, r, -1),
            scaled,
        )
        return (scaled @ output[..., None])[..., 0], np.concatenate(blocks, axis=-1)


def affine(weights: Array, inputs: Array, bias: Array) -> Array:
    """W x + b (h, N) for x (k, N), by sums whose order does not depend on the number of rows."""
    result = np.repeat(bias[:, None], inputs.shape[-1], axis=1)
    for column, values in zip(weights.T, inputs, strict=True):
        result += column[:, None] * values
    return result


def input_scaling(q: Array) -> tuple[Array, Array]:
    """Middle and half range (n,) of configurations q (K, n); 1 for a fixed joint."""
    low, high = q.min(axis=0), q.max(axis=0)
    return readonly((low + high) / 2), readonly(np.where(high - low > 1e-9, (high - low) / 2, 1.0))
