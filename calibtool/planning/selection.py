"""Optimal design by greedy choice and exchange, from a finite set of candidates (Fedorov 1972)."""

from typing import Literal

import numpy as np

from calibtool.identification.evidence import inverse
from calibtool.progress import Progress, silent
from calibtool.robot.se3 import Array

Criterion = Literal["d", "i"]
CRITERIA = ("d", "i")
_PASSES = 4  # exchanges settle after two or three
_EXCHANGED = 500  # the most useful candidates beside the chosen ones take part in exchanges
_WORTHWHILE = 1e-4  # relative gain below which an exchange is a tie


def select(
    rows: Array,
    covariance: Array,
    count: int,
    criterion: Criterion = "d",
    reference: Array | None = None,
    progress: Progress = silent,
) -> np.ndarray:
    """Indices of `count` candidates that leave the least uncertainty, in the order of
    the greedy choice.

    rows        (N, r, p) of every candidate, over the noise
    covariance  (p, p) of the parameters before, in units in which its entries are comparable
    criterion   `d`: the determinant of the covariance; `i`: the mean variance of observations over
                `reference` rows (M, r, p), the candidates' own unless given

    No candidate is chosen twice. A step costs a product with all rows and no factorisation beyond
    r × r and p × p.
    """
    moments = _moments(criterion, rows if reference is None else reference)
    information = inverse(covariance)
    design = _Design(rows, information, moments)
    chosen: list[int] = []
    for _ in progress(range(count), "configurations chosen"):
        chosen.append(design.best(chosen))
        design.move(chosen[-1], +1)
    useful = np.argsort(-design.gains(), kind="stable")[:_EXCHANGED]
    kept: np.ndarray = np.concatenate([chosen, np.setdiff1d(useful, chosen)])
    chosen_best: np.ndarray = kept[_exchanged(rows[kept], information, moments, count)]
    return chosen_best


def improve(
    rows: Array,
    covariance: Array,
    count: int,
    criterion: Criterion = "d",
    reference: Array | None = None,
) -> np.ndarray:
    """Indices of the first `count` candidates, each replaced by a better one if there is one.

    Arguments as in `select`.
    """
    moments = _moments(criterion, rows if reference is None else reference)
    return _exchanged(rows, inverse(covariance), moments, count)


def _exchanged(rows: Array, information: Array, moments: Array | None, count: int) -> np.ndarray:
    chosen = list(range(count))
    for _ in range(_PASSES):
        # afresh: rounding does not pile up
        design = _Design(rows, information + _information(rows[chosen]), moments)
        exchanged = False
        for position, old in enumerate(chosen):
            design.move(old, -1)
            gains = design.gains()
            new = design.best(chosen[:position] + chosen[position + 1 :])
            if gains[new] > gains[old] + _WORTHWHILE * abs(gains[old]):
                chosen[position], exchanged = new, True
            design.move(chosen[position], +1)
        if not exchanged:
            break
    return np.array(chosen)


class _Design:
    """Covariance C = Λ⁻¹ of chosen configurations and, per candidate k, G_k = A_k C A_kᵀ and (`i`)
    H_k = A_k C M C A_kᵀ.

    With C that of the design without a configuration of rows A, K = C Aᵀ and T = (I + A K)⁻¹, the
    one with it is C − K T Kᵀ; G and H follow by r products per candidate. T is well conditioned for
    removals, too, as C is always that without, and C itself is never updated but computed from Λ.
    """

    def __init__(self, rows: Array, information: Array, moments: Array | None) -> None:
        self.rows = rows
        self.flat = rows.reshape(-1, rows.shape[-1])
        self.information = information.copy()
        self.covariance = inverse(information)
        self.moments = moments
        self.identity = np.eye(rows.shape[1])
        self.G = self._product(self.covariance)
        if moments is not None:
            self.H = self._product(self.covariance @ moments @ self.covariance)

    def gains(self) -> Array:
        """What every candidate would add: ln det(C)/det(C'), or tr M(C − C')."""
        gains: Array
        if self.moments is None:
            gains = np.linalg.slogdet(self.identity + self.G)[1]
        else:
            gains = np.trace(np.linalg.solve(self.identity + self.G, self.H), axis1=1, axis2=2)
        return gains

    def best(self, taken: list[int]) -> int:
        """The most useful candidate that is not taken."""
        gains = self.gains()
        gains[taken] = -np.inf
        return int(gains.argmax())

    def move(self, index: int, sign: int) -> None:
        """Add (+1) or remove (−1) a candidate."""
        A = self.rows[index]
        before = self.covariance
        self.information += sign * (A.T @ A)
        self.covariance = inverse(self.information)
        without = before if sign > 0 else self.covariance
        K = without @ A.T
        U = self._times(K)
        UT = U @ np.linalg.inv(self.identity + A @ K)
        if self.moments is not None:
            MK = self.moments @ K
            cross = UT @ np.swapaxes(self._times(without @ MK), 1, 2)
            self.H -= sign * (
                cross + np.swapaxes(cross, 1, 2) - UT @ (K.T @ MK) @ np.swapaxes(UT, 1, 2)
            )
        self.G -= sign * (UT @ np.swapaxes(U, 1, 2))

    def _times(self, matrix: Array) -> Array:
        result: Array = (self.flat @ matrix).reshape(*self.rows.shape[:2], -1)
        return result

    def _product(self, matrix: Array) -> Array:
        return self._times(matrix) @ np.swapaxes(self.rows, 1, 2)


def _moments(criterion: Criterion, reference: Array) -> Array | None:
    """M of tr(M C), the mean variance of an observation; None for the determinant."""
    return _information(reference) / reference[..., 0].size if criterion == "i" else None


def _information(rows: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[-1])
    return flat.T @ flat
