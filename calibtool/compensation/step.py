"""A damped least-squares step of the joints inside a box, in closed form."""

import numpy as np

from calibtool.robot.se3 import Array
from calibtool.robot.singularity import GRAM_REGULARISATION, MIN_SINGULARITY_DISTANCE, rows_last

DAMPED_BELOW = MIN_SINGULARITY_DISTANCE  # 1 mrad of pose error moves no joint by more than 77 mrad
# Number of times that a joint outside the box is held at its face and the others solved again
_PASSES = 3
_FEW = 1e-6  # λ² where fewer than six joints are free and G is singular
_SMALLEST_PIVOT = 1e-30  # rounding can push the last pivots of a singular matrix below zero
_TOGETHER = 1024  # number of rows whose matrices stay in the processor's cache


def bounded_step(
    jacobian: Array,
    error: Array,
    lower: Array,
    upper: Array,
    proposed: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Joint changes Δ (N, n) that reduce |e + A Δ| in a box; singularity distance d and damping λ².

    jacobian A (N, k, n) and error e (N, k), weighted; lower ≤ 0 ≤ upper (N, n), rad or m;
    d and λ² (N,).

    1. G = A Aᵀ for n ≥ 6 (where k = 6), Aᵀ A for n < 6, plus GRAM_REGULARISATION I: (m, m) with m =
       min(n, 6). G = L Lᵀ, with no squared pivot of L below 1e-30; d = 1/sqrt(trace(G⁻¹)) =
       1/|L⁻¹|.
    2. λ = max(0, d₀ − d), d₀ = DAMPED_BELOW: there is no damping where d ≥ d₀, and it begins
       continuously.
    3. S(e) = −Aᵀ (G + λ² I)⁻¹ e for n ≥ 6, the least motion; −(G + λ² I)⁻¹ Aᵀ e for n < 6.
       Δ = S(e), and where λ > 0 Δ = S(e) + S(e + A S(e)): solving again for the remaining error
       removes the effect of the damping where it is not needed. If `proposed` (N, n) is given, it
       is used as Δ.
    4. Up to three times, while a joint is outside the box: the one that is farthest outside (in rad
       or m, the first of equals) is held at the face, as those before: Δ_h, 0 for the others. The
       others are solved again by items 1 to 3, with e + A Δ_h for e, F for A, and λ no smaller than
       before. F is A with the columns of held joints set to zero (for n < 6 they get 1 on the
       diagonal of G). Δ = Δ_h + Δ_f.
    5. Joints that are still outside are moved onto the face of the box. d is that of A, λ² the
       last.

    Rows are computed independently: no sum runs over the rows or depends on their number.
    """
    change, distance, squares = np.empty(lower.shape), np.empty(len(lower)), np.empty(len(lower))
    for rows in _parts(len(lower)):
        A, e, low, high = (rows_last(part[rows]) for part in (jacobian, error, lower, upper))
        inverse, distance[rows], damped = _damped(A)
        found = _solution(A, inverse, damped, e) if proposed is None else rows_last(proposed[rows])
        found, squares[rows] = _inside(A, e, damped, found, low, high)
        change[rows] = found.T
    return change, distance, squares


def damped_step(
    jacobian: Array,
    error: Array,
    squares: Array,
    lower: Array,
    upper: Array,
) -> Array:
    """Δ (N, n) of `bounded_step`, S once, by a given λ² = squares (N,), beside held joints too."""
    change = np.empty(lower.shape)
    for rows in _parts(len(lower)):
        A, e, low, high = (rows_last(part[rows]) for part in (jacobian, error, lower, upper))
        found = _once(A, _inverse_factor(A, squares[rows]), e)
        change[rows] = _inside(A, e, squares[rows], found, low, high, given=True)[0].T
    return change


def times(matrices: Array, vectors: Array) -> Array:
    """(N, k, n) times (N, n): (N, k), with the same sums for any number of rows."""
    product: Array = matrices[:, :, 0] * vectors[:, :1]
    for j in range(1, vectors.shape[1]):
        product += matrices[:, :, j] * vectors[:, j, None]
    return product


# In what follows the rows are the last axis: A (k, n, N), e (k, N), Δ and the box (n, N), λ² (N,).


def _inside(
    A: Array,
    e: Array,
    squares: Array,
    change: Array,
    lower: Array,
    upper: Array,
    given: bool = False,
) -> tuple[Array, Array]:
    """Items 4 and 5 of `bounded_step`: Δ and λ², from those of item 3; given: as `damped_step`."""
    held = np.zeros(change.shape, dtype=bool)
    change, squares = change.copy(), squares.copy()
    for _ in range(_PASSES):
        outside = np.maximum(lower - change, change - upper)
        rows = np.flatnonzero(outside.max(axis=0) > 0.0)
        if not len(rows):
            return change, squares
        held[outside[:, rows].argmax(axis=0), rows] = True
        stays, some = held[:, rows], A[..., rows]
        stopped = np.where(stays, np.clip(change[:, rows], lower[:, rows], upper[:, rows]), 0.0)
        free = np.where(stays, 0.0, some)
        remaining = e[:, rows] + _product(some, stopped)
        if given:
            few = (len(change) >= 6) & (len(change) - stays.sum(axis=0) < 6)
            solved = _once(
                free, _inverse_factor(free, squares[rows] + _FEW * few, stays), remaining
            )
        else:
            inverse, _, squares[rows] = _damped(free, stays, squares[rows])
            solved = _solution(free, inverse, squares[rows], remaining)
        change[:, rows] = stopped + solved
    return np.clip(change, lower, upper), squares


def _damped(
    A: Array, held: np.ndarray | None = None, least: Array | None = None
) -> tuple[Array, Array, Array]:
    """W = L⁻¹ (m, m, N) of G + λ² I, d of A (N,), λ² (N,) no less than `least`; held (n, N)."""
    inverse = _inverse_factor(A, np.zeros(A.shape[-1]), held)
    distance = 1.0 / np.sqrt((inverse * inverse).sum(axis=0).sum(axis=0))
    squares = np.maximum(0.0, DAMPED_BELOW - distance) ** 2
    squares = squares if least is None else np.maximum(squares, least)
    near = np.flatnonzero(squares)
    if len(near):
        some = None if held is None else held[:, near]
        inverse[..., near] = _inverse_factor(A[..., near], squares[near], some)
    return inverse, distance, squares


def _inverse_factor(A: Array, squares: Array, held: np.ndarray | None = None) -> Array:
    """W = L⁻¹ (m, m, N), lower triangular, of L Lᵀ = G + squares I (`bounded_step`, items 1, 4)."""
    n, m = A.shape[1], min(A.shape[1], 6)
    factor = _gram(A if n < 6 else A.swapaxes(0, 1))
    factor[np.arange(m), np.arange(m)] += GRAM_REGULARISATION + squares
    if held is not None and n < 6:
        factor[np.arange(m), np.arange(m)] += held
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


def _gram(columns: Array) -> Array:
    """Σ c cᵀ of columns c (m, N) of (k, m, N): (m, m, N)."""
    m = columns.shape[1]
    gram = np.empty((m, m, columns.shape[2]))
    for r in range(m):
        row = gram[r, : r + 1]
        np.multiply(columns[0, r], columns[0, : r + 1], out=row)
        for column in columns[1:]:
            row += column[r] * column[: r + 1]
    return gram


def _solution(A: Array, inverse: Array, squares: Array, e: Array) -> Array:
    """Item 3 of `bounded_step`: S(e), and S of the remaining error where λ² is not zero."""
    change = _once(A, inverse, e)
    near = np.flatnonzero(squares)
    if len(near):
        remaining = e[:, near] + _product(A[..., near], change[:, near])
        change[:, near] += _once(A[..., near], inverse[..., near], remaining)
    return change


def _once(A: Array, W: Array, e: Array) -> Array:
    """S(e) of `bounded_step`, with (G + λ² I)⁻¹ = Wᵀ W."""
    transposed = A.swapaxes(0, 1)
    if A.shape[1] < 6:
        return -_product(W.swapaxes(0, 1), _product(W, _product(transposed, e)))
    return -_product(transposed, _product(W.swapaxes(0, 1), _product(W, e)))


def _product(matrices: Array, vectors: Array) -> Array:
    """(k, n, N) times (n, N): (k, N)."""
    product: Array = matrices[:, 0] * vectors[0]
    for j in range(1, len(vectors)):
        product += matrices[:, j] * vectors[j]
    return product


def _parts(count: int) -> list[slice]:
    return [slice(start, start + _TOGETHER) for start in range(0, count, _TOGETHER)]
