"""A Gaussian process of the joint motion errors, seen through J_ρ like the network."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from calibtool.equivalent.bayesian import BayesianRun
from calibtool.equivalent.loss import Loss
from calibtool.equivalent.network import affine, input_scaling
from calibtool.equivalent.optimisers import History
from calibtool.equivalent.regressor import Regressor
from calibtool.robot.se3 import Array, readonly

# Largest number of equations (configurations times joint motion errors) of the exact solution
_EQUATIONS = 2000
_JUDGED = 100  # number of configurations on which kernels are compared
# Lengths of the kernel that are tried, in half ranges of the training
_LENGTHS = (0.3, 0.5, 0.8, 1.3, 2.0)
_SMALLEST_RANGE = 0.1  # rad or m: smallest half range by which configurations are scaled
_SIZES = np.geomspace(0.01, 3.0, 12)  # sizes that are tried, over the typical joint motion errors
# Noises that are tried, over the rms of the residuals
_NOISES = np.array([0.3, 0.5, 0.7, 0.85, 1.0])
_CLEAR = 3.0  # nats by which a Gaussian process must make the residuals more probable
_NUGGET = 1e-6  # of the kernel: keeps its matrix regular where configurations are equal


@dataclass(frozen=True, eq=False)
class GaussianProcess(Regressor):
    """N(q) = output_scale ∘ W k(s), k_i(s) = exp(−|s − points_i|² / 2), s = (q − input_centre) /
    input_scale.

    input_centre   (n,) rad or m: middle of the training range
    input_scale    (n,) rad or m: length of the kernel
    points         (h, n) of s: configurations of the training, or some of them
    output_weights (p, h): W
    output_scale   (p,) rad or m
    """

    input_centre: Array
    input_scale: Array
    points: Array
    output_weights: Array
    output_scale: Array

    id: ClassVar[str] = "gaussian-process"
    fields: ClassVar[dict[str, tuple[str, str, tuple[str, ...]]]] = {
        "input_centre": ("q", "middle of the training range", ("joint",)),
        "input_scale": ("q", "length of the kernel", ("joint",)),
        "points": ("1", "configurations that the kernel compares with", ("hidden", "joint")),
        "output_weights": ("1", "W", ("motion", "hidden")),
        "output_scale": ("rho", "unit of each joint motion error", ("motion",)),
    }

    @classmethod
    def averaged(cls, members: Sequence[Self]) -> Self:
        return replace(
            members[0],
            points=readonly(np.concatenate([member.points for member in members])),
            output_weights=readonly(
                np.concatenate([m.output_weights for m in members], axis=1) / len(members)
            ),
        )

    def __call__(self, q: Array) -> Array:
        none = np.zeros(len(self.output_scale))
        return affine(self.output_weights, self.kernel(q), none).T * self.output_scale

    @property
    def hidden(self) -> int:
        """Number of points."""
        return len(self.points)

    @property
    def hidden_bias(self) -> Array:
        """b (h,) of k_i = exp(points_i · s + b_i − |s|² / 2), the form that code evaluates."""
        result: Array = -0.5 * (self.points**2).sum(axis=-1)
        return result

    def kernel(self, q: Array) -> Array:
        """k (h, N) of the points and configurations q (N, n)."""
        s = ((q - self.input_centre) / self.input_scale).T.copy()
        squares = np.zeros((len(self.points), len(q)))
        for own, there in zip(self.points.T, s, strict=True):
            squares += (own[:, None] - there) ** 2
        return np.exp(-0.5 * squares)


def fit_gaussian_process(loss: Loss, output_scale: Array, points: int | None = None) -> BayesianRun:
    """The mean of δρ ~ GP(0, a² output_scale² k) given t = R δρ + ε; zero, with no effective
    weight, where the residuals are not clearly more probable with it.

    Length of the kernel, size a and noise are those of the largest evidence on evenly spread
    configurations. The mean is exact up to `_EQUATIONS` equations; above, so many points carry it
    (subset of regressors: Quiñonero-Candela and Rasmussen 2005, section 6): with the kernel K_zz
    of the points, W has the prior N(0, a² K_zz⁻¹) for every output.
    """
    p = loss.R.shape[-1]
    h = min(len(loss.q), max(_EQUATIONS // p, 1) if points is None else points)
    gain, length, size, noise = _most_probable(loss, output_scale)
    process = _untrained(loss.q, loss.q[_spread(len(loss.q), h)], length, output_scale)
    effective = 0.0
    if gain > _CLEAR:
        weights, effective = _mean(process, loss, size, noise)
        process = replace(process, output_weights=readonly(weights))
    values = [loss.without_network, loss.value(process)]
    reason = f"solved in one step; kernel of {length:g} half ranges, {gain:.1f} nats"
    history = History(readonly(values), readonly(np.full(2, np.nan)), 1, reason)
    return BayesianRun(process, history, effective, noise)


def _spread(count: int, chosen: int) -> np.ndarray:
    """Indices of rows, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, chosen)).round().astype(int))


def _untrained(q: Array, points: Array, length: float, output_scale: Array) -> GaussianProcess:
    centre, half = input_scaling(q)
    scale = length * np.maximum(half, _SMALLEST_RANGE)
    return GaussianProcess(
        input_centre=centre,
        input_scale=readonly(scale),
        points=readonly((points - centre) / scale),
        output_weights=readonly(np.zeros((len(output_scale), len(points)))),
        output_scale=readonly(output_scale),
    )


def _most_probable(loss: Loss, output_scale: Array) -> tuple[float, float, float, float]:
    """Log evidence over that of noise alone in nats, kernel length, size a, and noise."""
    rows = _spread(len(loss.q), _JUDGED)
    rms = max(float(np.sqrt(np.mean(loss.t**2))), 1e-300)
    R, t = loss.R[rows] * output_scale, loss.t[rows].ravel()
    seen = (R.reshape(-1, R.shape[-1]) @ R.reshape(-1, R.shape[-1]).T).reshape(
        len(rows), R.shape[1], len(rows), R.shape[1]
    )
    variance = (rms * _NOISES) ** 2
    without = float((-0.5 * (t @ t / variance + len(t) * np.log(variance))).max())
    best = (-np.inf, 1.0, 1.0, rms)
    for length in _LENGTHS:
        k = _untrained(loss.q, loss.q[rows], length, output_scale).kernel(loss.q[rows])
        covariance = (seen * k[:, None, :, None]).reshape(len(t), len(t))
        eigenvalues, vectors = np.linalg.eigh(covariance)
        along = (vectors.T @ t) ** 2
        total = _SIZES[:, None, None] ** 2 * np.maximum(eigenvalues, 0.0) + variance[:, None]
        evidence = -0.5 * (along / total + np.log(total)).sum(axis=-1) - without
        at = np.unravel_index(evidence.argmax(), evidence.shape)
        size, noise = float(_SIZES[at[0]]), rms * float(_NOISES[at[1]])
        best = max(best, (float(evidence[at]), length, size, noise))
    return best


def _mean(process: GaussianProcess, loss: Loss, size: float, noise: float) -> tuple[Array, float]:
    """W (p, h) of the posterior mean, and the effective number of weights."""
    from scipy.linalg import cho_factor, cho_solve

    p, h = process.output_weights.shape
    k, R = process.kernel(loss.q), loss.R * process.output_scale / noise
    gram = np.swapaxes(R, 1, 2) @ R
    gradient = (np.swapaxes(R, 1, 2) @ (loss.t / noise)[..., None])[..., 0]
    blocks = np.empty((p, h, p, h))
    for i in range(p):
        for j in range(i, p):
            blocks[i, :, j] = (k * gram[:, i, j]) @ k.T
            blocks[j, :, i] = blocks[i, :, j].T
    H = blocks.reshape(p * h, p * h)
    at_points = process.points * process.input_scale + process.input_centre
    prior = (process.kernel(at_points) + _NUGGET * np.eye(h)) / size**2
    factor = cho_factor(H + np.kron(np.eye(p), prior), lower=True)
    weights = cho_solve(factor, (gradient.T @ k.T).ravel())
    effective = float(np.trace(cho_solve(factor, H)))
    return weights.reshape(p, h), effective
