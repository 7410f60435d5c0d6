"""Held-out configurations without a second fit: what the others say about each, by the quadratic
model of one fit.

Rows that repeat a configuration are held out together: each would tell the others.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibtool.identification.equations import linearised_rows
from calibtool.identification.fitting import Fit
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import weights
from calibtool.robot.se3 import Array

_JUDGED = 500  # configurations that are held out
_REPEATS = 2e-3  # rad or m of any joint: nearer rows are one configuration
TYPICAL = 4.0  # times the mean squared residual: a larger one counts as that


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Rows (M,) held out in G groups of g rows, and what a fit says of them over its noise.

    theta, covariance  of the fit: (p,), (p, p)
    blocks             of groups of one size: rows (G, g), C Aᵀ (p, G, g d), A C Aᵀ (G, g d, g d),
    residuals (G, g d)
    d                  coordinates seen in every row (M,)
    """

    theta: Array
    covariance: Array
    blocks: list[tuple[np.ndarray, Array, Array, Array]]
    d: np.ndarray

    @classmethod
    def of(cls, measurements: Measurements, fit: Fit) -> Self:
        """For a fit, and for what it would be with less parameters."""
        groups = _groups(measurements.q)
        rows = np.sort(np.concatenate(groups))
        part = measurements.rows(rows)
        columns, residual = linearised_rows(part, fit.parameters, fit.state)
        scale = np.sqrt(fit.row_weight[rows])[:, None] / fit.noise_factor
        columns, residual = columns * scale[..., None], residual * scale
        blocks = []
        for size in sorted({len(group) for group in groups}):
            index = np.searchsorted(rows, np.stack([g for g in groups if len(g) == size]))
            A = columns[index].reshape(len(index), -1, columns.shape[-1])
            flat = A.reshape(-1, A.shape[-1])
            CA = (fit.covariance @ flat.T).reshape(-1, *A.shape[:2])
            hat = np.moveaxis(CA, 0, 2) @ np.swapaxes(A, 1, 2)
            blocks.append((index, CA, hat, residual[index].reshape(A.shape[:2])))
        return cls(fit.theta, fit.covariance, blocks, (weights(part) > 0).sum(axis=-1))

    def squares(self, dropped: np.ndarray | None = None) -> Array:
        """Squared residuals per coordinate (M,) over the fit's noise, each group predicted by the
        others.

        Without the group k, r_k is (1 − A_k C A_kᵀ)⁻¹ r_k, exact for the quadratic model. dropped
        (k,): parameters that are
        zero; the Gaussian is conditioned on that.
        """
        s = np.zeros(0, dtype=int) if dropped is None else dropped
        own = self.covariance[np.ix_(s, s)]
        squares = np.empty(len(self.d))
        for index, CA, hat, residual in self.blocks:
            part = CA[s]
            gain = np.linalg.solve(own, part.reshape(len(s), residual.size)).reshape(part.shape)
            there = residual + np.tensordot(self.theta[s], gain, 1)
            less = hat - np.moveaxis(part, 0, 2) @ np.moveaxis(gain, 0, 1)
            alone = np.linalg.solve(np.eye(residual.shape[1]) - less, there[..., None])
            squares[index] = (alone.reshape(*index.shape, -1) ** 2).sum(axis=-1)
        return np.asarray(squares / self.d)


def _groups(q: Array) -> list[np.ndarray]:
    """Up to `_JUDGED` rows, evenly spread, and all that repeat their configuration."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(q).query_pairs(_REPEATS, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(q), len(q)))
    count, label = connected_components(links, directed=False)
    order = np.argsort(label, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(label, minlength=count))[:-1])
    share = min(1.0, _JUDGED / len(q))
    chosen = np.unique(np.linspace(0, count - 1, max(1, round(share * count))).astype(int))
    return [groups[k] for k in chosen]


def typical(squares: Array, reference: Array) -> float:
    """Mean of squared residuals (M,) in which no row counts for more than a few times the mean of
    the reference."""
    return float(np.minimum(squares, TYPICAL * reference.mean()).mean())


def better(squares: Array, than: Array, errors: float, most: float = TYPICAL) -> bool:
    """Whether squared residuals (M,) of held-out rows are less than others (M,) by more than some
    standard errors. No row counts for more than `most` times the mean of the others; what is not
    finite is not better.
    """
    if not np.isfinite(squares).all():
        return False
    than = np.minimum(than, 1e300 / len(than))
    limit = most * than.mean()
    gain = np.minimum(than, limit) - np.minimum(squares, limit)
    return bool(gain.mean() > errors * gain.std() / np.sqrt(len(gain)))
