"""Arithmetic over many rows at once: every number of a frame or a matrix is a lane, an array (…, N) over the rows.

A call into a library costs more per row than the few hundred products that are asked of it. Every operation here goes
element by element, so that a row's answer does not depend on the rows beside it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibtool.robot.se3 import Array, cross, inverse, readonly

_TOGETHER = 1024  # rows: their lanes stay in the processor's cache


def parts(count: int) -> Iterator[slice]:
    """Slices of `count` rows, few enough each for the cache."""
    return (slice(start, start + _TOGETHER) for start in range(0, count, _TOGETHER))


def lanes(values: Array) -> Array:
    """Rows first to rows last: (N, …) → (…, N), a contiguous copy."""
    return np.moveaxis(values, 0, -1).copy()


@dataclass(frozen=True, eq=False)
class Links:
    """A serial chain of screws exp(ξ_j q_j) (Eq. 7), each described in a frame whose z axis is parallel to its own.

    There a screw turns about z by θ = `turns` q while its origin drifts along x and y and slides along z. The axis itself
    is taken for z where it passes near: no origin drifts then. The axis of a slide that turns a little is a kilometre away,
    and a frame there would cost three digits.

    placements   (n+1, 4, 4) pose of joint frame j, not yet moved, in joint frame j−1, moved; the last one is the tool's
    turned       (n, 3, 3) orientation of joint frame j in that of the chain's joint
    turns        (n,) rad per unit of the joint position, not negative: 1 for a nominal revolute joint, 0 for a slide
    drifts       (n, 2) velocity of the origin along x and y at q = 0, m per unit: 0 where z is the joint's axis
    slides       (n,) velocity along z, m per unit: 1 for a nominal slide
    """

    placements: Array
    turned: Array
    turns: Array
    drifts: Array
    slides: Array

    @classmethod
    def of(cls, placements: Array, twists: Array) -> Self:
        """The chain Π M_j exp(ξ_j q_j) · M_{n+1}: placements (n+1, 4, 4) and twists (n, 6) of any pitch and size."""
        changed, turned, turns, velocities = [], [], [], []
        before = np.eye(4)  # the joint frame of the chain in that of this description
        for placement, (linear, angular) in zip(placements, twists.reshape(-1, 2, 3), strict=False):
            turn, speed = float(np.linalg.norm(angular)), float(np.linalg.norm(linear))
            after = np.eye(4)
            after[:3, :3] = _frame_about(angular / turn if turn > 0.0 else linear / speed)
            velocity = after[:3, :3].T @ linear if turn > 0.0 else np.array([0.0, 0.0, speed])
            if np.hypot(velocity[0], velocity[1]) < turn:  # nearer than 1 m
                after[:3, 3] = np.cross(angular, linear) / turn**2
                velocity[:2] = 0.0
            changed.append(before @ placement @ after)
            turned.append(after[:3, :3])
            turns.append(turn)
            velocities.append(velocity)
            before = inverse(after)
        changed.append(before @ placements[-1])
        velocity = readonly(velocities, (-1, 3))
        return cls(readonly(changed), readonly(turned), readonly(turns), velocity[:, :2], velocity[:, 2])

    def frames(self, q: Array) -> Array:
        """Columns x, y, z, p of every joint frame, moved, and of the tool's, in K_0: (n, N) → (n+1, 4, 3, N)."""
        n, count = q.shape
        angles = self.turns[:, None] * q
        sine, cosine = np.sin(angles), np.cos(angles)
        result = np.empty((n + 1, 4, 3, count))
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
            if j == n:
                break
            if self.drifts[j].any():
                ahead, aside = self._drift(j, q[j], angles[j], sine[j])
                p += x * ahead
                p += y * aside
            if self.slides[j]:
                p += z * (self.slides[j] * q[j])
            if self.turns[j]:
                along, across = x * sine[j], y * sine[j]
                x *= cosine[j]
                x += across
                y *= cosine[j]
                y -= along
        return result

    def _drift(self, j: int, q: Array, angle: Array, sine: Array) -> tuple[Array, Array]:
        """Way of the origin along x and y, before the turn: the integral of the drift turned by 0 … θ."""
        u, v = self.drifts[j]
        if not self.turns[j]:
            return u * q, v * q
        straight, bent = sine / self.turns[j], 2.0 * np.sin(angle / 2.0) ** 2 / self.turns[j]
        return u * straight - v * bent, u * bent + v * straight

    def columns(self, frames: Array) -> Array:
        """Spatial Jacobian in K_0, one column per joint, from `frames`: (n+1, 4, 3, N) → (6, n, N)."""
        axes, origins = np.swapaxes(frames[:-1, 2], 0, 1), np.swapaxes(frames[:-1, 3], 0, 1)
        result = np.empty((6, *axes.shape[1:]))
        result[:3] = cross(origins, axes)
        result[3:] = axes
        if (self.turns != 1.0).any():
            result *= self.turns[:, None]
        if self.slides.any():
            result[:3] += self.slides[:, None] * axes
        for j in np.flatnonzero(self.drifts.any(axis=1)):
            result[:3, j] += self.drifts[j, 0] * frames[j, 0] + self.drifts[j, 1] * frames[j, 1]
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
