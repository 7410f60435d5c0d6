"""A point of the tool on spheres in the cell, or at measured distances from their surfaces."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibtool.measurement.kinds.kind import Readings, of_place, places_of
from calibtool.measurement.kinds.tool_point import STARTS, ToolPoint
from calibtool.robot.se3 import Array, readonly, skew, transform_points

if TYPE_CHECKING:
    from calibtool.measurement.setup import Setup

_REFINED = 3  # number of starts that are refined


class SphereProbe(ToolPoint):
    """d = 1: |p − c| − r, p the tool's point, c and r centre and radius of the row's sphere.

    The radius is that of the sphere plus that of the tip. A radius of 0 is not estimated: the
    readings are then distances from the centre. A known radius is stated in this way.
    """

    id, words = "sphere", "distances from spheres"
    arrays: ClassVar = {"spheres": ((-1, 4), "m", "centres and radii of the probed spheres")}

    def coordinates(self, setup: Setup) -> int:
        return 1

    def names(self, setup: Setup) -> tuple[str, ...]:
        spheres = (f"sphere{g + 1}.{c}" for g in range(len(_spheres(setup))) for c in "xyz")
        radii = (f"sphere{g + 1}.radius" for g in np.flatnonzero(_round(setup)))
        return (*(f"target1.{c}" for c in "xyz"), *spheres, *radii)

    def residuals(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        assert readings.values is not None
        _, distance, _, radius = _seen(setup, T_base_tool, readings.place)
        return np.nan_to_num(readings.values - (distance - radius)[:, None])

    def matrix(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        points, _, away, _ = _seen(setup, T_base_tool, place)
        return np.concatenate([away[:, None], -away[:, None] @ skew(points)], axis=-1)

    def columns(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        points, _, away, _ = _seen(setup, T_base_tool, place)
        own = places_of(place, len(points))
        belongs = own[:, None] == np.arange(len(_spheres(setup)))
        centres = -away[:, None] * belongs[..., None]
        radii = -belongs[:, _round(setup)].astype(float)
        target = away[:, None] @ T_base_tool[:, :3, :3]
        free = np.concatenate([centres.reshape(len(points), -1), radii], axis=-1)
        return np.concatenate([target, free[:, None]], axis=-1)

    def moved(self, setup: Setup, step: Array) -> Setup:
        spheres = _spheres(setup).copy()
        count = len(spheres)
        spheres[:, :3] += step[3 : 3 + 3 * count].reshape(-1, 3)
        spheres[_round(setup), 3] += step[3 + 3 * count :]
        targets = readonly(setup.targets + step[:3])
        return replace(setup, targets=targets, spheres=readonly(spheres))

    def displacements(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        residual = self.residuals(readings, setup, T_base_tool)
        return residual[..., None] * _seen(setup, T_base_tool, readings.place)[2][:, None]

    def starts(self, readings: Readings, setup: Setup, poses: Array) -> list[Setup]:
        """With the tool's point t given, |p|² − l² = 2 p·c − (|c|² − r²) is linear in c and the
        bracket, for readings l of points near the surface. Tried are the t of a linear system,
        and some round the tool's origin.
        """
        assert readings.values is not None
        own = places_of(readings.place, len(poses))
        parts = [(poses[own == g], readings.values[own == g, 0]) for g in range(1 + own.max())]
        known = ~_round(setup)
        found = []
        for target in np.concatenate([_linear_target(parts), setup.targets + STARTS]):
            spheres = np.zeros_like(_spheres(setup))
            for g, (part, lengths) in enumerate(parts):
                points = transform_points(part, target[None])[:, 0]
                A = np.concatenate([2 * points, -np.ones((len(points), 1))], axis=-1)
                b = (points**2).sum(axis=-1) - (lengths**2 if known[g] else 0.0)
                centre = np.linalg.lstsq(A, b, rcond=1e-9)[0][:3]
                radius = np.linalg.norm(points - centre, axis=-1) - lengths
                spheres[g] = [*centre, 0.0 if known[g] else max(float(radius.mean()), 1e-6)]
            targets = readonly(target[None])
            start = replace(setup, targets=targets, spheres=readonly(spheres))
            found.append((float((self.residuals(readings, start, poses) ** 2).sum()), start))
        return [start for _, start in sorted(found, key=lambda item: item[0])[:_REFINED]]

    def blank(self, name: str, array: Array) -> Array:
        """Whether a radius is estimated stays known."""
        value = np.zeros_like(array)
        value[:, 3] = array[:, 3] != 0.0
        return value

    def in_base(self, setup: Setup, T_new_base: Array) -> Setup:
        spheres = _spheres(setup).copy()
        spheres[:, :3] = transform_points(T_new_base, spheres[:, :3])
        return replace(super().in_base(setup, T_new_base), spheres=readonly(spheres))


def _linear_target(parts: list[tuple[Array, Array]]) -> Array:
    """The tool's point t (1, 3) by |R t + p − c|² = (r + l)², which is linear in t and, of every
    sphere, in t ⊗ c, c, r and |t|² + |c|² − r².

    parts: poses (k, 4, 4) and readings (k,) on every sphere.
    """
    from scipy.linalg import block_diag

    shared, blocks, right = [], [], []
    for poses, lengths in parts:
        R, p = poses[:, :3, :3], poses[:, :3, 3]
        shared.append(2 * (p[:, None] @ R)[:, 0])
        one = np.ones((len(p), 1))
        own = [-2 * R.reshape(len(R), 9), -2 * p, one, -2 * lengths[:, None]]
        blocks.append(np.concatenate(own, axis=-1))
        right.append(lengths**2 - (p**2).sum(axis=-1))
    A = np.concatenate([np.concatenate(shared), block_diag(*blocks)], axis=-1)
    solved: Array = np.linalg.lstsq(A, np.concatenate(right), rcond=1e-9)[0]
    return solved[None, :3]


def _spheres(setup: Setup) -> Array:
    assert setup.spheres is not None
    return setup.spheres


def _round(setup: Setup) -> np.ndarray:
    """Which spheres have a radius that is estimated: (G,) bool."""
    has: np.ndarray = _spheres(setup)[:, 3] != 0.0
    return has


def _seen(
    setup: Setup, T_base_tool: Array, place: np.ndarray | None
) -> tuple[Array, Array, Array, Array]:
    """Tool's points (N, 3), distances (N,) and unit vectors (N, 3) from centres, radii (N,)."""
    points = transform_points(T_base_tool, setup.targets)[:, 0]
    spheres = of_place(_spheres(setup), place, len(points))
    apart = points - spheres[:, :3]
    distance = np.maximum(np.linalg.norm(apart, axis=-1), 1e-12)
    return points, distance, apart / distance[:, None], spheres[:, 3]
