"""Batched rigid motions. Twists are (v, ω), linear first; poses are homogeneous matrices; any leading shape (…,)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

Array = NDArray[np.float64]

_SWAP = [3, 4, 5, 0, 1, 2]  # scipy writes exponential coordinates as (ω, v)


def readonly(values: Any, shape: tuple[int, ...] | None = None) -> Array:
    """A read-only float copy of `values`; with `shape`, -1 stands for any length (ValueError otherwise)."""
    array = np.array(values, dtype=float)
    if shape is not None and (
        array.ndim != len(shape) or any(want not in (-1, have) for want, have in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"expected shape {shape}, got {array.shape}")
    array.flags.writeable = False
    return array


def skew(vector: Array) -> Array:
    """[a]× with [a]× b = a × b: (…, 3) → (…, 3, 3)."""
    x, y, z = np.moveaxis(np.asarray(vector, dtype=float), -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def exp6(twist: Array) -> Array:
    """Pose reached by following a twist for unit time (paper, Eq. 3): (…, 6) → (…, 4, 4)."""
    twist = np.asarray(twist, dtype=float)
    flat = np.ascontiguousarray(twist.reshape(-1, 6)[:, _SWAP])
    pose: Array = RigidTransform.from_exp_coords(flat).as_matrix()
    return pose.reshape(*twist.shape[:-1], 4, 4)


def log6(pose: Array) -> Array:
    """Inverse of `exp6`, rotation angle in [0, π]: (…, 4, 4) → (…, 6)."""
    pose = np.asarray(pose, dtype=float)
    flat: Array = RigidTransform.from_matrix(pose.reshape(-1, 4, 4)).as_exp_coords()
    return flat[:, _SWAP].reshape(*pose.shape[:-2], 6)


def log3(rotation: Array) -> Array:
    """Rotation vector in rad: (…, 3, 3) → (…, 3)."""
    rotation = np.asarray(rotation, dtype=float)
    flat: Array = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec()
    return flat.reshape(*rotation.shape[:-2], 3)


def inverse(pose: Array) -> Array:
    """Inverse of rigid motions: (…, 4, 4) → (…, 4, 4)."""
    result = np.zeros_like(pose)
    rotation_t = np.swapaxes(pose[..., :3, :3], -1, -2)
    result[..., :3, :3] = rotation_t
    result[..., :3, 3] = -(rotation_t @ pose[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def adjoint(pose: Array) -> Array:
    """Ad(T) = [[R, [p]× R], [0, R]], maps twists of frame b to frame a for T = T_a_b: (…, 4, 4) → (…, 6, 6)."""
    rotation = pose[..., :3, :3]
    result = np.zeros((*pose.shape[:-2], 6, 6))
    result[..., :3, :3] = result[..., 3:, 3:] = rotation
    result[..., :3, 3:] = skew(pose[..., :3, 3]) @ rotation
    return result


def left_jacobian(twists: Array, q: Array) -> Array:
    """J_l(x) of SE(3) at x = ξ_j q_j, with exp6(x + dx) ≈ exp6(J_l(x) dx) exp6(x): (n, 6), (N, n) → (N, n, 6, 6).

    J_l(x) = Σ_k ad(x)^k / (k+1)!; as ad (ad² + θ²)² = 0, θ = |ω|, four powers of ad(ξ_j) are enough (Selig 2005, §7.5).
    """
    linear, angular = skew(twists[:, :3]), skew(twists[:, 3:])
    ad = np.zeros((len(twists), 6, 6))
    ad[:, :3, :3] = ad[:, 3:, 3:] = angular
    ad[:, :3, 3:] = linear
    squared = ad @ ad
    powers = np.stack([np.broadcast_to(np.eye(6), ad.shape), ad, squared, squared @ ad, squared @ squared], axis=1)
    theta = np.linalg.norm(twists[:, 3:], axis=-1) * np.abs(q)
    scaled = _left_jacobian_coefficients(theta) * q[..., None] ** np.arange(5)
    jacobian: Array = np.einsum("Njk,jkab->Njab", scaled, powers, optimize=True)
    return jacobian


def _left_jacobian_coefficients(theta: Array) -> Array:
    """Factors of ad⁰ … ad⁴ in J_l: (…,) → (…, 5); by series below 0.5 rad, where the closed forms cancel."""
    t = np.where(theta < 0.5, 1.0, theta)
    sine, cosine = np.sin(t), np.cos(t)
    closed = np.stack(
        [
            np.ones_like(t),
            (4.0 - t * sine - 4.0 * cosine) / (2.0 * t**2),
            (4.0 * t - 5.0 * sine + t * cosine) / (2.0 * t**3),
            (2.0 - t * sine - 2.0 * cosine) / (2.0 * t**4),
            (2.0 * t - 3.0 * sine + t * cosine) / (2.0 * t**5),
        ],
        axis=-1,
    )
    # Reduce ad^k / (k+1)! with ad⁵ = −2θ² ad³ − θ⁴ ad until only four powers are left.
    powers = np.minimum(theta, 0.5)[..., None] ** (2 * np.arange(len(_SERIES)))
    series = np.concatenate([np.ones_like(theta)[..., None], powers @ _SERIES], axis=-1)
    return np.where(theta[..., None] < 0.5, series, closed)


def _left_jacobian_series(terms: int = 9) -> Array:
    """Taylor coefficients in θ² of the factors of ad¹ … ad⁴: (terms, 4)."""
    result = np.zeros((terms, 4))
    odd, even = np.array([1.0, 0.0]), np.array([1.0, 0.0])  # ad^k = θ^m (a ad^i + b ad^{i+2}), i = 1 (odd k) or 2
    factorial = 1.0
    for k in range(1, 2 * terms + 1):
        factorial *= k + 1
        half = (k - 1) // 2
        lower, upper = odd if k % 2 else even
        first = 0 if k % 2 else 1
        result[half, first] += lower / factorial
        if half >= 1:
            result[half - 1, first + 2] += upper / factorial
        # ad^{k+2}: a ad^i becomes a ad^{i+2}; b ad^{i+4} = −2θ² b ad^{i+2} − θ⁴ b ad^i
        following = np.array([-upper, lower - 2.0 * upper])
        if k % 2:
            odd = following
        else:
            even = following
    return result


_SERIES = _left_jacobian_series()


def translation(offset: Array) -> Array:
    """Pose of a pure translation: (…, 3) → (…, 4, 4)."""
    offset = np.asarray(offset, dtype=float)
    result = np.broadcast_to(np.eye(4), (*offset.shape[:-1], 4, 4)).copy()
    result[..., :3, 3] = offset
    return result


def transform_points(pose: Array, points: Array) -> Array:
    """Points (m, 3) of frame b in frame a, for every T_a_b: (…, 4, 4) → (…, m, 3)."""
    return points @ np.swapaxes(pose[..., :3, :3], -1, -2) + pose[..., None, :3, 3]
