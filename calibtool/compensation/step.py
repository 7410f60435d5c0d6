"""A damped least-squares step of the joints inside a box, in closed form."""

import numpy as np

from calibtool.robot.mechanism import GRAM_REGULARISATION
from calibtool.robot.se3 import Array

# Nearer to a singularity than this a step is damped. 1 mrad of pose error moves no joint by more than
# 40 mrad then, and the correction changes slowly enough along a path.
DAMPED_BELOW = 0.03
_PASSES = 2  # how often joints that would leave the box are held and the others solved again
_SMALLEST_PIVOT = 1e-30  # rounding can push the last pivots of a singular matrix below zero
_TOGETHER = 1024  # rows: their matrices stay in the processor's cache


def bounded_step(
    jacobian: Array,
    error: Array,
    lower: Array,
    upper: Array,
    proposed: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Joint changes Δ (N, n) that lower |e + A Δ| in a box; singularity distance d and damping λ².

    jacobian A (N, k, n) and error e (N, k), weighted; lower ≤ 0 ≤ upper (N, n), rad or m; d, λ² (N,).

    1. G = A Aᵀ for n ≥ 6 (where k = 6), Aᵀ A for n < 6, plus GRAM_REGULARISATION I: (m, m) with
       m = min(n, 6). G = L Lᵀ, no squared pivot of L below 1e-30; d = 1/sqrt(trace(G⁻¹)) = 1/|L⁻¹|.
    2. λ = max(0, d₀ − d), d₀ = DAMPED_BELOW: nothing is damped where d ≥ d₀, and the damping sets in
       without a jump.
    3. Δ = −Aᵀ (G + λ² I)⁻¹ e for n ≥ 6, the least motion; −(G + λ² I)⁻¹ Aᵀ e for n < 6. Where
       `proposed` (N, n) is given, Δ is that.
    4. Up to twice, while a joint is outside the box: all joints that were outside so far are held
       at its faces, Δ_h (0 for the others). The others solve the rest, items 1 to 3 with e + A Δ_h
       for e and F for A, F being A with the columns of held joints set to zero (for n < 6 they get 1
       on the diagonal of G). Δ = Δ_h + Δ_f, and λ² is that of F where it is larger.
    5. What is still outside is moved onto the face of the box. d is that of A, from item 1.

    Every row by itself: no sum runs over the rows.
    """
    change, distance, squares = np.empty(lower.shape), np.empty(len(lower)), np.empty(len(lower))
    for start in range(0, len(lower), _TOGETHER):
        rows = slice(start, start + _TOGETHER)
        A, e = jacobian[rows], error[rows]
        inverse, distance[rows], squares[rows] = _damped(A)
        found = _solution(A, inverse, e) if proposed is None else proposed[rows]
        change[rows], squares[rows] = _inside(A, e, squares[rows], found, lower[rows], upper[rows])
    return change, distance, squares


def damped_step(jacobian: Array, error: Array, squares: Array, lower: Array, upper: Array) -> Array:
    """Δ of `bounded_step`, items 3 to 5, with a given damping λ² = squares (N,)."""
    change = np.empty(lower.shape)
    for start in range(0, len(lower), _TOGETHER):
        rows = slice(start, start + _TOGETHER)
        A, e = jacobian[rows], error[rows]
        found = _solution(A, _inverse_factor(A, squares[rows]), e)
        change[rows], _ = _inside(A, e, squares[rows], found, lower[rows], upper[rows])
    return change


def _inside(
    A: Array, e: Array, squares: Array, change: Array, lower: Array, upper: Array
) -> tuple[Array, Array]:
    """Items 4 and 5 of `bounded_step`: Δ and λ², from λ² of A (N,)."""
    held = np.zeros(change.shape, dtype=bool)
    change, squares = change.copy(), squares.copy()
    for _ in range(_PASSES):
        beyond = (change < lower) | (change > upper)
        rows = np.flatnonzero(beyond.any(axis=-1))
        if not len(rows):
            return change, squares
        held[rows] |= beyond[rows]
        stopped = np.where(held[rows], np.clip(change[rows], lower[rows], upper[rows]), 0.0)
        free = np.where(held[rows][:, None, :], 0.0, A[rows])
        left = e[rows] + times(A[rows], stopped)
        inverse, _, more = _damped(free, held[rows], squares[rows])
        change[rows], squares[rows] = stopped + _solution(free, inverse, left), more
    return np.clip(change, lower, upper), squares


def _damped(
    A: Array, held: np.ndarray | None = None, least: Array | None = None
) -> tuple[Array, Array, Array]:
    """W = L⁻¹ of G + λ² I, d of A, and λ² of `bounded_step`, at least `least` (N,)."""
    inverse = _inverse_factor(A, np.zeros(len(A)), held)
    distance = 1.0 / np.sqrt((inverse**2).sum(axis=(0, 1)))
    squares = np.maximum(0.0, DAMPED_BELOW - distance) ** 2
    squares = squares if least is None else np.maximum(squares, least)
    near = np.flatnonzero(squares)
    if len(near):
        some = None if held is None else held[near]
        inverse[..., near] = _inverse_factor(A[near], squares[near], some)
    return inverse, distance, squares


def _inverse_factor(A: Array, squares: Array, held: np.ndarray | None = None) -> Array:
    """W = L⁻¹ (m, m, N), lower triangular, of L Lᵀ = G + squares I (`bounded_step`, item 1).

    A (N, k, n), squares (N,), held (N, n).
    """
    transposed = np.swapaxes(A, -1, -2)
    primal = A.shape[-1] < 6
    product = transposed @ A if primal else A @ transposed
    factor = np.moveaxis(product, 0, -1).copy()
    m = len(factor)
    factor[np.arange(m), np.arange(m)] += GRAM_REGULARISATION + squares
    if primal and held is not None:
        factor[np.arange(m), np.arange(m)] += held.T
    for c in range(m):
        for j in range(c):
            factor[c:, c] -= factor[c:, j] * factor[c, j]
        factor[c, c] = 1.0 / np.sqrt(np.maximum(factor[c, c], _SMALLEST_PIVOT))
        factor[c + 1 :, c] *= factor[c, c]
    inverse = np.zeros_like(factor)
    for r in range(m):
        inverse[r, r] = factor[r, r]
        for j in range(r):
            inverse[r, :r] -= factor[r, j] * inverse[j, :r]
        inverse[r, :r] *= factor[r, r]
    return inverse


def _solution(A: Array, inverse: Array, e: Array) -> Array:
    """Item 3 of `bounded_step`: A (N, k, n), W (m, m, N), e (N, k) → (N, n)."""
    transposed = np.swapaxes(A, -1, -2)
    W = np.moveaxis(inverse, -1, 0)
    right = e[..., None] if A.shape[-1] >= 6 else transposed @ e[..., None]
    solved = np.swapaxes(W, -1, -2) @ (W @ right)
    change: Array = -(transposed @ solved if A.shape[-1] >= 6 else solved)[..., 0]
    return change


def times(matrices: Array, vectors: Array) -> Array:
    """(N, k, n) times (N, n): (N, k)."""
    product: Array = (matrices @ vectors[..., None])[..., 0]
    return product
