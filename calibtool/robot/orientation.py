"""Orientations as numbers: rotation vectors, quaternions and Euler angles."""

import re

import numpy as np

from calibtool.robot.se3 import Array, exp6, log3

QUATERNION = "quaternion-wxyz"
ROTATION_VECTOR = "rotation-vector"
FIXED_ANGLES = "extrinsic-xyz"  # roll, pitch, yaw; FANUC's W, P, R
TURNED_ANGLES = "intrinsic-zyx"  # KUKA's A, B, C
MATRICES = ("matrix", "matrix-columns")  # nine numbers, row by row or column by column
UNIT_TOLERANCE = 1e-3  # how far a quaternion's length may be from 1; four decimals make 1e-4
_ORTHOGONAL = 5e-3  # how far R Rᵀ of a written matrix may be from 1; three decimals make 1e-3
_EULER = re.compile("(intrinsic|extrinsic|fixed)-([xyz])(?!\\2)([xyz])(?!\\3)([xyz])")


def numbers_in(convention: str) -> int:
    """How many numbers an orientation of a convention has; 0 for an unknown convention.

    Conventions: rotation-vector (rad); quaternion-wxyz, quaternion-xyzw; intrinsic-abc: R = R_a(α)
    R_b(β) R_c(γ), the axes turn along; extrinsic-abc or fixed-abc: R = R_c(γ) R_b(β) R_a(α);
    matrix, matrix-columns: the nine of R row by row, or column by column.
    """
    if convention in (QUATERNION, "quaternion-xyzw"):
        return 4
    if convention in MATRICES:
        return 9
    return 3 if convention == ROTATION_VECTOR or _EULER.fullmatch(convention) else 0


def rotation_matrices(values: Array, convention: str) -> Array:
    """Rotation matrices (N, 3, 3) of orientations (N, 3, 4 or 9), rad; see `numbers_in`.

    Quaternions may have any length but zero (`wrong_length`); of written matrices the nearest
    rotation is taken (`orthogonal`).
    """
    if convention in MATRICES:
        left, _, right = np.linalg.svd(_nine(values, convention))
        nearest: Array = left @ right
        return nearest
    if convention.startswith("quaternion"):
        return _of_quaternions(values if convention == QUATERNION else np.roll(values, 1, axis=1))
    if convention == ROTATION_VECTOR:
        R: Array = exp6(np.concatenate([np.zeros_like(values), values], axis=1))[:, :3, :3]
        return R
    if convention == FIXED_ANGLES:
        return of_fixed_angles(values)
    kind, axes = convention.split("-")
    order = range(3) if kind == "intrinsic" else range(2, -1, -1)
    first, second, third = (_about(axes[k], values[:, k]) for k in order)
    return first @ second @ third


def orientation_numbers(R: Array, convention: str, near: Array) -> Array:
    """Numbers of rotation matrices R (N, 3, 3), rad; of several answers that nearest to `near`
    (N, 3 or 4). For rotation vectors, quaternion-wxyz, extrinsic-xyz and intrinsic-zyx.
    """
    if convention == QUATERNION:
        turn = _quaternions(R)
        turn = np.where((turn * near).sum(axis=1, keepdims=True) < 0, -turn, turn)
        return turn
    if convention == ROTATION_VECTOR:
        return _rotation_vectors(log3(R), near)
    if convention == TURNED_ANGLES:
        return _fixed_angles(R, near[:, ::-1])[:, ::-1]
    assert convention == FIXED_ANGLES
    return _fixed_angles(R, near)


def wrong_length(quaternions: Array) -> tuple[int, float] | None:
    """The first of (N, 4) whose length is not 1, within UNIT_TOLERANCE, and its length."""
    lengths = np.linalg.norm(quaternions, axis=1)
    wrong = np.flatnonzero(~(np.abs(lengths - 1.0) <= UNIT_TOLERANCE))
    return (int(wrong[0]), float(lengths[wrong[0]])) if len(wrong) else None


def orthogonal(values: Array) -> np.ndarray:
    """Whether nine numbers (N, 9) are an orthogonal matrix, to their rounding: (N,) bool."""
    R = values.reshape(-1, 3, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(axis=(-2, -1))
    found: np.ndarray = off <= _ORTHOGONAL
    return found


def _nine(values: Array, convention: str) -> Array:
    R = values.reshape(-1, 3, 3)
    return np.swapaxes(R, -1, -2) if convention == "matrix-columns" else R


def _about(axis: str, angles: Array) -> Array:
    """Rotation matrices (N, 3, 3) about the axis x, y or z."""
    turns = np.zeros((len(angles), 3))
    turns[:, "xyz".index(axis)] = angles
    return of_fixed_angles(turns)


def _of_quaternions(q: Array) -> Array:
    """Rotation matrices (N, 3, 3) of quaternions (N, 4), scalar first, of any length."""
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def of_fixed_angles(angles: Array) -> Array:
    """Rotation matrices (N, 3, 3) of turns about the fixed axes x, then y, then z, (N, 3)."""
    (a, b, c), (s, t, u) = np.cos(angles).T, np.sin(angles).T
    rows = [
        [c * b, c * t * s - u * a, c * t * a + u * s],
        [u * b, u * t * s + c * a, u * t * a - c * s],
        [-t, b * s, b * a],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _quaternions(R: Array) -> Array:
    """Unit quaternions (N, 4), scalar first, of rotation matrices (N, 3, 3)."""
    vector = log3(R)
    half = np.linalg.norm(vector, axis=1, keepdims=True) / 2
    return np.concatenate([np.cos(half), vector / 2 * np.sinc(half / np.pi)], axis=1)


def _rotation_vectors(vectors: Array, old: Array) -> Array:
    """Rotation vectors (N, 3) of the same rotations nearest to `old`, up to two turns away."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    size = np.linalg.norm(old, axis=1, keepdims=True)
    axis = np.where(
        angle > 1e-12, vectors / np.maximum(angle, 1e-300), old / np.maximum(size, 1e-12)
    )
    choices = axis * (angle + 2 * np.pi * np.arange(-2, 3)[:, None, None])
    nearest = np.linalg.norm(choices - old, axis=-1).argmin(axis=0)
    result: Array = choices[nearest, np.arange(len(old))]
    return result


def _fixed_angles(R: Array, old: Array) -> Array:
    """Angles about fixed x, y, z (N, 3) nearest to `old`; the first is kept at ±90 deg."""
    horizontal = np.hypot(R[:, 0, 0], R[:, 1, 0])
    pitch = np.arctan2(-R[:, 2, 0], horizontal)
    roll, yaw = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arctan2(R[:, 1, 0], R[:, 0, 0])
    choices = np.array([[roll, pitch, yaw], [roll + np.pi, np.pi - pitch, yaw + np.pi]])
    choices = choices.transpose(0, 2, 1)
    locked = np.flatnonzero(horizontal < 1e-9)
    if len(locked):
        kept = np.stack([old[locked, 0], pitch[locked], np.zeros(len(locked))], axis=1)
        turn = of_fixed_angles(kept)
        remaining = R[locked] @ np.swapaxes(turn, -1, -2)
        kept[:, 2] = np.arctan2(remaining[:, 1, 0], remaining[:, 0, 0])
        choices[:, locked] = kept
    near = choices - 2 * np.pi * np.round((choices - old) / (2 * np.pi))
    nearest = np.linalg.norm(near - old, axis=-1).argmin(axis=0)
    result: Array = near[nearest, np.arange(len(old))]
    return result
