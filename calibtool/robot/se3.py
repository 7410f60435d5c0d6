"""Batched rigid motions.

Twists are (v, ω), linear first; poses are homogeneous matrices; any leading shape (…,).
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibtool.errors import InputError

Array = NDArray[np.float64]

# rad: below it the first terms of the series are exact, and quotients of small numbers are not
_SMALL = 1e-5


def readonly(values: Any, shape: tuple[int, ...] | None = None) -> Array:
    """A read-only float copy; ValueError unless of `shape`, in which -1 is any length."""
    array = np.array(values, dtype=float)
    if shape is not None and (
        array.ndim != len(shape)
        or any(want not in (-1, have) for want, have in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"expected shape {shape}, got {array.shape}")
    array.flags.writeable = False
    return array


def skew(vector: Array) -> Array:
    """[a]× with [a]× b = a × b: (…, 3) → (…, 3, 3)."""
    x, y, z = np.moveaxis(np.asarray(vector, dtype=float), -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def point_columns(points: Array) -> Array:
    """[I, −[p]×], the derivative of a point by a spatial twist: (…, 3) → (…, 3, 6)."""
    identity = np.broadcast_to(np.eye(3), (*points.shape, 3))
    return np.concatenate([identity, -skew(points)], axis=-1)


def cross(a: Array, b: Array) -> Array:
    """a × b of vectors (3, …), components first."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def exp6(twist: Array) -> Array:
    """Pose reached by following a twist for unit time (paper, Eq. 3): (…, 6) → (…, 4, 4)."""
    twist = np.asarray(twist, dtype=float)
    v, w = np.ascontiguousarray(np.moveaxis(twist, -1, 0)).reshape(2, 3, -1)
    x, y, z = w
    turn = np.sqrt(x * x + y * y + z * z)
    t = np.maximum(turn, _SMALL)
    sine, half = np.sin(t) / t, np.sin(t / 2) / t
    a = np.where(turn < _SMALL, 1.0 - turn**2 / 6, sine)
    b = np.where(turn < _SMALL, 0.5, 2 * half**2)
    c = np.where(turn < _SMALL, 1 / 6, (1.0 - sine) / t**2)
    result = np.zeros((v.shape[-1], 4, 4))
    xy, xz, yz = b * x * y, b * x * z, b * y * z
    result[:, 0, 0] = 1.0 - b * (y * y + z * z)
    result[:, 1, 1] = 1.0 - b * (x * x + z * z)
    result[:, 2, 2] = 1.0 - b * (x * x + y * y)
    result[:, 0, 1], result[:, 1, 0] = xy - a * z, xy + a * z
    result[:, 0, 2], result[:, 2, 0] = xz + a * y, xz - a * y
    result[:, 1, 2], result[:, 2, 1] = yz - a * x, yz + a * x
    across = cross(w, v)
    result[:, :3, 3] = (v + b * across + c * cross(w, across)).T
    result[:, 3, 3] = 1.0
    return result.reshape(*twist.shape[:-1], 4, 4)


def log6(pose: Array) -> Array:
    """Inverse of `exp6`, rotation angle in [0, π]: (…, 4, 4) → (…, 6)."""
    pose = np.asarray(pose, dtype=float)
    w = _rotation_vector(pose[..., :3, :3])
    p = np.moveaxis(pose[..., :3, 3], -1, 0).reshape(3, -1)
    turn = np.sqrt((w * w).sum(axis=0))
    t = np.maximum(turn, _SMALL)
    k = np.where(turn < _SMALL, 1 / 12, (1.0 - t / 2 / np.tan(t / 2)) / t**2)
    across = cross(w, p)
    v = p - 0.5 * across + k * cross(w, across)
    return np.concatenate([v, w]).T.reshape(*pose.shape[:-2], 6)


def log3(rotation: Array) -> Array:
    """Rotation vector in rad: (…, 3, 3) → (…, 3)."""
    rotation = np.asarray(rotation, dtype=float)
    return _rotation_vector(rotation).T.reshape(*rotation.shape[:-2], 3)


def _rotation_vector(rotation: Array) -> Array:
    """(…, 3, 3) → (3, N), through the unit quaternion, by its largest component (Shepperd 1978)."""
    r = np.ascontiguousarray(np.moveaxis(rotation, (-2, -1), (0, 1))).reshape(3, 3, -1)
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    products = np.empty((4, 4, r.shape[-1]))  # 4 q qᵀ, q = (x, y, z, w)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        products[i, i] = 1.0 - trace + 2.0 * r[i, i]
        products[i, j] = products[j, i] = r[i, j] + r[j, i]
        products[i, 3] = products[3, i] = r[k, j] - r[j, k]
    products[3, 3] = 1.0 + trace
    largest = np.argmax([r[0, 0], r[1, 1], r[2, 2], trace], axis=0)
    q = np.take_along_axis(products, largest[None, None], axis=0)[0]
    q = np.where(q[3] < 0, -q, q)
    sine = np.sqrt((q[:3] * q[:3]).sum(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where(sine > 0, 2.0 * np.arctan2(sine, q[3]) / sine, 0.0)
    result: Array = factor * q[:3]
    return result


def inverse(pose: Array) -> Array:
    """Inverse of rigid motions: (…, 4, 4) → (…, 4, 4)."""
    result = np.zeros_like(pose)
    rotation_t = np.swapaxes(pose[..., :3, :3], -1, -2)
    result[..., :3, :3] = rotation_t
    result[..., :3, 3] = -(rotation_t @ pose[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def relative_error(actual: Array, nominal: Array) -> Array:
    """Pose error δy = log6(T_actual · T_nominal⁻¹), a spatial twist in K_0 (Eqs. 9, 10):
    (…, 4, 4) → (…, 6).
    """
    return log6(actual @ inverse(nominal))


def pose_difference(pose: Array, reference: Array, length: float = 1.0) -> Array:
    """((p − p_r) / length, log3(R R_rᵀ)): displacement of the tool point, rotation; both in K_0.

    pose and reference (N, 4, 4) T_base_tool: (N, 6), in m and rad. With the robot's characteristic
    length (m) it is the weighted pose error, all in rad.
    """
    turn = log3(pose[:, :3, :3] @ np.swapaxes(reference[:, :3, :3], -1, -2))
    return np.concatenate([(pose[:, :3, 3] - reference[:, :3, 3]) / length, turn], axis=-1)


def pose_distances(pose: Array, reference: Array) -> tuple[Array, Array]:
    """Distances of the tool points (N,) in m and angles (N,) in rad between poses (N, 4, 4)."""
    difference = pose_difference(pose, reference)
    return np.linalg.norm(difference[:, :3], axis=-1), np.linalg.norm(difference[:, 3:], axis=-1)


def check_poses(pose: Array, place: str) -> None:
    """InputError unless these are finite rigid motions (N, 4, 4), rotations to the six digits
    that people write.
    """
    if pose.ndim != 3 or pose.shape[1:] != (4, 4):
        raise InputError(f"{place}: poses have shape {pose.shape}; expected (N, 4, 4)")
    rotation = pose[:, :3, :3]
    with np.errstate(invalid="ignore"):
        rigid = np.abs(rotation @ np.swapaxes(rotation, -1, -2) - np.eye(3)).max(axis=(1, 2)) < 1e-5
        rigid &= (np.linalg.det(rotation) > 0) & (
            np.abs(pose[:, 3] - [0, 0, 0, 1]).max(axis=1) < 1e-5
        )
    wrong = np.flatnonzero(~(rigid & np.isfinite(pose).all(axis=(1, 2))))
    if len(wrong):
        raise InputError(
            f"{place}: row {wrong[0] + 1} is no rigid motion: a finite translation and a "
            "rotation matrix"
        )


def adjoint(pose: Array) -> Array:
    """Ad(T) = [[R, [p]× R], [0, R]], maps twists of frame b to frame a for T = T_a_b:
    (…, 4, 4) → (…, 6, 6).
    """
    rotation = pose[..., :3, :3]
    result = np.zeros((*pose.shape[:-2], 6, 6))
    result[..., :3, :3] = result[..., 3:, 3:] = rotation
    result[..., :3, 3:] = skew(pose[..., :3, 3]) @ rotation
    return result


def left_jacobian(twists: Array, q: Array) -> Array:
    """J_l(x) of SE(3) at x = ξ_j q_j, with exp6(x + dx) ≈ exp6(J_l(x) dx) exp6(x): (n, 6),
    (N, n) → (N, n, 6, 6).

    J_l(x) = Σ_k ad(x)^k / (k+1)!; as ad (ad² + θ²)² = 0, θ = |ω|, four powers of ad(ξ_j) are enough
    (Selig 2005, §7.5). Below 0.5 rad, where the closed forms of their factors cancel, the series
    itself is summed.
    """
    ad = np.zeros((len(twists), 6, 6))
    ad[:, :3, :3] = ad[:, 3:, 3:] = skew(twists[:, 3:])
    ad[:, :3, 3:] = skew(twists[:, :3])
    terms = [np.broadcast_to(np.eye(6), ad.shape)]  # ad^k / (k+1)!
    for k in range(1, _TERMS):
        terms.append(terms[-1] @ ad / (k + 1))
    theta = np.linalg.norm(twists[:, 3:], axis=-1) * np.abs(q)
    factors = np.ones((*q.shape, _TERMS))
    large = theta >= 0.5
    factors[large, 1:] = 0.0
    factors[large, 1:5] = _closed_factors(theta[large])
    scaled = factors * q[..., None] ** np.arange(_TERMS)
    result: Array = np.einsum("Njk,jkab->Njab", scaled, np.stack(terms, axis=1), optimize=True)
    return result


_TERMS = 14  # of the series: 0.5^14 / 15! is below the last digit


def _closed_factors(t: Array) -> Array:
    """What four powers ad^k / (k+1)!, k = 1 … 4, are multiplied by for the whole series: angles
    (M,) in rad → (M, 4).
    """
    sine, cosine = np.sin(t), np.cos(t)
    closed = [
        (4.0 - t * sine - 4.0 * cosine) / t**2,
        (4.0 * t - 5.0 * sine + t * cosine) * 3.0 / t**3,
        (2.0 - t * sine - 2.0 * cosine) * 12.0 / t**4,
        (2.0 * t - 3.0 * sine + t * cosine) * 60.0 / t**5,
    ]
    return np.stack(closed, axis=-1)


def translation(offset: ArrayLike) -> Array:
    """Pose of a pure translation: (…, 3) → (…, 4, 4)."""
    offset = np.asarray(offset, dtype=float)
    result = np.broadcast_to(np.eye(4), (*offset.shape[:-1], 4, 4)).copy()
    result[..., :3, 3] = offset
    return result


def transform_points(pose: Array, points: Array) -> Array:
    """Points (m, 3) of frame b in frame a, for every T_a_b: (…, 4, 4) → (…, m, 3)."""
    return points @ np.swapaxes(pose[..., :3, :3], -1, -2) + pose[..., None, :3, 3]
