"""Arithmetic over many rows at once: every number of a frame or a matrix is a lane, an array (…, N) over the rows.

A call into a library costs more per row than the few hundred products that are asked of it. Every operation here goes
element by element, so that a row's answer does not depend on the rows beside it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
import pinocchio as pin

from calibtool.robot.se3 import Array, cross, readonly

_TOGETHER = 1024  # rows: their lanes stay in the processor's cache


def parts(count: int) -> Iterator[slice]:
    """Slices of `count` rows, few enough each for the cache."""
    return (slice(start, start + _TOGETHER) for start in range(0, count, _TOGETHER))


def lanes(values: Array) -> Array:
    """Rows first to rows last: (N, …) → (…, N), a contiguous copy."""
    return np.moveaxis(values, 0, -1).copy()


@dataclass(frozen=True, eq=False)
class Links:
    """A serial chain of one-coordinate joints, each described in a frame whose z axis is the joint's own (Eq. 7).

    placements   (m+1, 4, 4) pose of joint frame j, not yet moved, in joint frame j−1, moved; the last one is the tool's
    turned       (m, 3, 3) orientation of joint frame j in that of the Pinocchio model's joint
    turns        (m,) whether the joint turns about z
    slides       (m,) travel along z, m per unit of its coordinate: 1 for a slide, the pitch of a screw, 0
    """

    placements: Array
    turned: Array
    turns: np.ndarray
    slides: Array

    @classmethod
    def of(cls, model: pin.Model, tool: Array) -> Self:
        """The chain of a Pinocchio model with joints 1 … m in a row; tool (4, 4) in the last one's frame."""
        placements, turned, turns, slides = [], [], [], []
        before = np.eye(4)
        for joint, placement in zip(list(model.joints)[1:], list(model.jointPlacements)[1:], strict=True):
            data = joint.createData()
            joint.calc(data, np.zeros(1))
            linear, angular = np.split(np.array(data.S, dtype=float).reshape(6), 2)
            turning = bool(np.linalg.norm(angular) > 0.5)
            axis = angular if turning else linear
            after = np.eye(4)
            after[:3, :3] = _frame_about(axis)
            placements.append(before.T @ placement.homogeneous @ after)
            turned.append(after[:3, :3])
            turns.append(turning)
            slides.append(float(linear @ axis))
            before = after
        placements.append(before.T @ tool)
        return cls(readonly(placements), readonly(turned), np.array(turns), readonly(slides))

    def frames(self, coordinates: Array) -> Array:
        """Columns x, y, z, p of every joint frame, moved, and of the tool's, in K_0: (m, N) → (m+1, 4, 3, N)."""
        m, count = coordinates.shape
        sine, cosine = np.sin(coordinates), np.cos(coordinates)
        result = np.empty((m + 1, 4, 3, count))
        for j, placement in enumerate(self.placements):
            x, y, z, p = frame = result[j]
            if j == 0:
                frame[:] = placement[:3].T[:, :, None]
            else:
                factors, before = placement[:3, :, None, None], result[j - 1]
                np.multiply(factors[0], before[0], out=frame)
                frame += factors[1] * before[1]
                frame += factors[2] * before[2]
                p += before[3]
            if j < m and self.turns[j]:
                along, across = x * sine[j], y * sine[j]
                x *= cosine[j]
                x += across
                y *= cosine[j]
                y -= along
            if j < m and self.slides[j]:
                p += z * (self.slides[j] * coordinates[j])
        return result

    def columns(self, frames: Array) -> Array:
        """Spatial Jacobian in K_0, one column per coordinate, from `frames`: (m+1, 4, 3, N) → (6, m, N)."""
        axes, origins = np.swapaxes(frames[:-1, 2], 0, 1), np.swapaxes(frames[:-1, 3], 0, 1)
        result = np.empty((6, *axes.shape[1:]))
        turns, slides = self.turns[:, None], self.slides[:, None]
        result[:3] = cross(origins, axes)
        result[3:] = axes
        if not self.turns.all():
            result *= turns
        if self.slides.any():
            result[:3] += slides * axes
        return result


def _frame_about(axis: Array) -> Array:
    """A rotation (3, 3) whose z axis is the unit vector `axis`; exact for ±x, ±y and ±z."""
    x = np.zeros(3)
    x[int(np.argmin(np.abs(axis)))] = 1.0
    x -= axis * (axis @ x)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def eliminated(gram: Array, right: Array | None = None) -> tuple[Array, Array | None]:
    """Trace of the inverse of G, and x of G x = right, for symmetric, positive definite G by G = L D Lᵀ.

    gram (k, k, N), right (k, N) → (N,), (k, N). Without pivoting: for well conditioned matrices.
    """
    left, size = gram.copy(), len(gram)
    unit = np.zeros_like(gram)  # becomes L⁻¹
    unit[np.arange(size), np.arange(size)] = 1.0
    for k in range(size - 1):
        factor = left[k + 1 :, k] / left[k, k]
        left[k + 1 :, k + 1 :] -= factor[:, None] * left[None, k, k + 1 :]
        unit[k + 1 :, : k + 1] -= factor[:, None] * unit[None, k, : k + 1]
    trace, solution = np.zeros(gram.shape[-1]), None if right is None else np.zeros_like(right)
    for k in range(size):
        row, pivot = unit[k, : k + 1], left[k, k]
        for value in row:
            trace += value * value / pivot
        if solution is not None and right is not None:
            image = np.zeros_like(trace)
            for value, known in zip(row, right, strict=False):
                image += value * known
            solution[: k + 1] += row * (image / pivot)
    return trace, solution
