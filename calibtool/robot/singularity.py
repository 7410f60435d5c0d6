"""Distance of a Jacobian from singularity."""

import numpy as np

from calibtool.robot.se3 import Array

# Nearer to a singularity than this (see `singularity_distance`) 1 mrad of pose error costs up to 50
# mrad of joint motion.
MIN_SINGULARITY_DISTANCE = 0.02
# Farther from a singularity than this the elimination without pivoting keeps its digits.
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
    count = len(jacobian)
    distance = np.empty(count)
    for start in range(0, count, _TOGETHER):
        rows = slice(start, start + _TOGETHER)
        with np.errstate(all="ignore"):  # singular rows are computed again below
            trace = inverse_trace(rows_last(regularised_gram(jacobian[rows], length)))
            distance[rows] = 1.0 / np.sqrt(trace)
    again = np.flatnonzero(~(distance > _REGULAR))
    distance[again] = _distance(regularised_gram(jacobian[again], length))
    return distance


def rows_last(values: Array) -> Array:
    """(N, …) → (…, N), a contiguous copy, so that no row depends on the others."""
    return np.moveaxis(values, 0, -1).copy()


def inverse_trace(gram: Array) -> Array:
    """Trace of the inverse of G (k, k, N), symmetric and positive definite, by G = L D Lᵀ: (N,).

    Without pivoting: for well conditioned matrices. A call of LAPACK per row would take ten times
    as long.
    """
    reduced, size = gram.copy(), len(gram)
    unit = np.zeros_like(gram)  # becomes L⁻¹
    unit[np.arange(size), np.arange(size)] = 1.0
    for k in range(size - 1):
        factor = reduced[k + 1 :, k] / reduced[k, k]
        reduced[k + 1 :, k + 1 :] -= factor[:, None] * reduced[None, k, k + 1 :]
        unit[k + 1 :, : k + 1] -= factor[:, None] * unit[None, k, : k + 1]
    trace = np.zeros(gram.shape[-1])
    for k in range(size):
        for value in unit[k, : k + 1]:
            trace += value * value / reduced[k, k]
    return trace


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


def weighted_jacobian(jacobian: Array, pose: Array, length: float) -> Array:
    """Spatial Jacobian (N, 6, c) in K_0 seen at the tool point of poses (N, 4, 4), rows scaled.

    The derivative of `pose_difference` by the joints, to first order; length in m.
    """
    return scale_rows(at_point(jacobian, pose[:, :3, 3]), length)
