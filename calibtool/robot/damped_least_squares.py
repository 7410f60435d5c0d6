"""Distance of a Jacobian from singularity, and damped least-squares joint motions."""

import numpy as np

from calibtool.robot.se3 import Array

# Nearer to a singularity than this (see `singularity_distance`) 1 mrad of pose error costs up to 50
# mrad of joint motion.
MIN_SINGULARITY_DISTANCE = 0.02
# farther than this the elimination without pivoting keeps its digits, and nothing is damped
_REGULAR = 0.05
GRAM_REGULARISATION = 1e-14  # keeps J Jᵀ invertible at a singularity
_TOGETHER = 1024  # rows: their numbers stay in the processor's cache


def at_point(twists: Array, points: Array) -> Array:
    """Twists of K_0 seen at a point: v becomes the velocity of that point, v + ω × p.

    (N, 6, c), (N, 3) → (N, 6, c).
    """
    result = twists.copy()
    turning, (x, y, z) = twists[..., 3:, :], np.moveaxis(points, -1, 0)[..., None]
    result[..., 0, :] += turning[..., 1, :] * z - turning[..., 2, :] * y
    result[..., 1, :] += turning[..., 2, :] * x - turning[..., 0, :] * z
    result[..., 2, :] += turning[..., 0, :] * y - turning[..., 1, :] * x
    return result


def singularity_distance(jacobian: Array, length: float) -> Array:
    """Distance d (N,) of J from losing rank: d = (Σ 1/σ_i²)^(−1/2), between σ_min/√6 and σ_min.

    jacobian (N, 6, c) at the tool point; its translational rows are divided by `length` (m). Unlike
    σ_min, d is smooth in q and needs no SVD, so that exported code can evaluate it.
    """
    return _solved(jacobian, None, length)[1]


def damped_solution(jacobian: Array, error: Array, length: float) -> tuple[Array, Array]:
    """Joint motions x with J x ≈ e, of minimum norm, damped near singularities; and the distance d.

    jacobian (N, 6, c ≥ 6) and error (N, 6) at the tool point, translations in m → x (N, c), d (N,).
    With rows scaled by `length`: x = Jᵀ (J Jᵀ + λ² I)⁻¹ e, λ = max(0, d₀ − d) and d₀ =
    MIN_SINGULARITY_DISTANCE: not damped where d ≥ d₀, and never longer than |e| / (2 λ).
    """
    return _solved(jacobian, error, length)


def _solved(jacobian: Array, error: Array | None, length: float) -> tuple[Array, Array]:
    """`damped_solution`, of an error if there is one, and the distances: regular rows together, the
    others by LAPACK.
    """
    count, _, c = jacobian.shape
    motion, distance = np.zeros((count if error is not None else 0, c)), np.empty(count)
    for start in range(0, count, _TOGETHER):
        rows = slice(start, start + _TOGETHER)
        right = (
            None if error is None else _rows_last(scale_rows(error[rows, :, None], length)[..., 0])
        )
        with np.errstate(all="ignore"):  # singular rows are looked at again
            trace, solved = eliminated(_rows_last(regularised_gram(jacobian[rows], length)), right)
            distance[rows] = 1.0 / np.sqrt(trace)
            if solved is not None:  # Jᵀ x
                motion[rows] = np.einsum("kic,ik->kc", scale_rows(jacobian[rows], length), solved)
    again = np.flatnonzero(~(distance > _REGULAR))
    gram = regularised_gram(jacobian[again], length)
    distance[again] = _distance(gram)
    if error is not None:
        damping = np.maximum(0.0, MIN_SINGULARITY_DISTANCE - distance[again]) ** 2
        scaled_error = scale_rows(error[again, :, None], length)
        solution = np.linalg.solve(gram + damping[:, None, None] * np.eye(6), scaled_error)
        motion[again] = (np.swapaxes(scale_rows(jacobian[again], length), -1, -2) @ solution)[
            ..., 0
        ]
    return motion, distance


def _rows_last(values: Array) -> Array:
    """(N, …) → (…, N), a contiguous copy: arithmetic element by element, in which no row
    knows the others.
    """
    return np.moveaxis(values, 0, -1).copy()


def eliminated(gram: Array, right: Array | None = None) -> tuple[Array, Array | None]:
    """Trace of the inverse of G, and x of G x = right, for symmetric, positive definite
    G by G = L D Lᵀ.

    gram (k, k, N), right (k, N) → (N,), (k, N). Without pivoting: for well conditioned matrices. A
    call of LAPACK per row would take ten times as long.
    """
    reduced, size = gram.copy(), len(gram)
    unit = np.zeros_like(gram)  # becomes L⁻¹
    unit[np.arange(size), np.arange(size)] = 1.0
    for k in range(size - 1):
        factor = reduced[k + 1 :, k] / reduced[k, k]
        reduced[k + 1 :, k + 1 :] -= factor[:, None] * reduced[None, k, k + 1 :]
        unit[k + 1 :, : k + 1] -= factor[:, None] * unit[None, k, : k + 1]
    trace, solution = np.zeros(gram.shape[-1]), None if right is None else np.zeros_like(right)
    for k in range(size):
        row, pivot = unit[k, : k + 1], reduced[k, k]
        for value in row:
            trace += value * value / pivot
        if solution is not None and right is not None:
            image = np.zeros_like(trace)
            for value, known in zip(row, right, strict=False):
                image += value * known
            solution[: k + 1] += row * (image / pivot)
    return trace, solution


def _distance(gram: Array) -> Array:
    """(Σ 1/σ²)^(−1/2) from J Jᵀ.

    Rounding of large entries can undo the regularisation, and an inverse would fail.
    """
    squares: Array = np.maximum(np.linalg.eigvalsh(gram), GRAM_REGULARISATION)
    total: Array = (1.0 / squares).sum(axis=-1)
    return 1.0 / np.sqrt(total)


def regularised_gram(jacobian: Array, length: float) -> Array:
    """J (…, 6, c): J Jᵀ (c ≥ 6) or JᵀJ (c < 6) with rows scaled as in `singularity_distance`, plus
    GRAM_REGULARISATION.
    """
    scaled = scale_rows(jacobian, length)
    transposed = np.swapaxes(scaled, -1, -2)
    gram = scaled @ transposed if jacobian.shape[-1] >= 6 else transposed @ scaled
    return gram + GRAM_REGULARISATION * np.eye(gram.shape[-1])


def scale_rows(jacobian: Array, length: float) -> Array:
    """Translational rows of (…, 6, c) divided by `length`, so that all six rows are in rad."""
    scaled = jacobian.copy()
    scaled[..., :3, :] /= length
    return scaled
