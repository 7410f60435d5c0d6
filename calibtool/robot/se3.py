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
    return RigidTransform.from_exp_coords(flat).as_matrix().reshape(*twist.shape[:-1], 4, 4)


def log6(pose: Array) -> Array:
    """Inverse of `exp6`, rotation angle in [0, π]: (…, 4, 4) → (…, 6)."""
    pose = np.asarray(pose, dtype=float)
    flat = RigidTransform.from_matrix(pose.reshape(-1, 4, 4)).as_exp_coords()
    return flat[:, _SWAP].reshape(*pose.shape[:-2], 6)


def log3(rotation: Array) -> Array:
    """Rotation vector in rad: (…, 3, 3) → (…, 3)."""
    rotation = np.asarray(rotation, dtype=float)
    return Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec().reshape(*rotation.shape[:-2], 3)


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


def translation(offset: Array) -> Array:
    """Pose of a pure translation: (…, 3) → (…, 4, 4)."""
    offset = np.asarray(offset, dtype=float)
    result = np.broadcast_to(np.eye(4), (*offset.shape[:-1], 4, 4)).copy()
    result[..., :3, 3] = offset
    return result


def transform_points(pose: Array, points: Array) -> Array:
    """Points (m, 3) of frame b in frame a, for every T_a_b: (…, 4, 4) → (…, m, 3)."""
    return points @ np.swapaxes(pose[..., :3, :3], -1, -2) + pose[..., None, :3, 3]
