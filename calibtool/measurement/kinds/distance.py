"""Distances from a point of the tool to fixed points: wires, ball-bars, spheres."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibtool.measurement.kinds.kind import Readings
from calibtool.measurement.kinds.tool_point import STARTS, ToolPoint
from calibtool.robot.se3 import Array, point_columns, readonly, transform_points

if TYPE_CHECKING:
    from calibtool.measurement.setup import Setup


class Distances(ToolPoint):
    """d = w lengths |p − a_k|, p the point of the tool and a_k the fixed points in K_0."""

    id, words = "distance", "distances to fixed points"
    arrays: ClassVar = {"anchors": ((-1, 3), "m", "fixed points that distances are measured to")}

    def coordinates(self, setup: Setup) -> int:
        return len(_anchors(setup))

    def names(self, setup: Setup) -> tuple[str, ...]:
        wires = (f"anchor{k + 1}.{c}" for k in range(len(_anchors(setup))) for c in "xyz")
        return (*(f"target1.{c}" for c in "xyz"), *wires)

    def residuals(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        assert readings.values is not None
        _, lengths, _ = _along(setup, T_base_tool)
        return np.nan_to_num(readings.values - lengths)

    def matrix(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        points, _, units = _along(setup, T_base_tool)
        return units @ point_columns(points)

    def columns(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        _, _, units = _along(setup, T_base_tool)
        count, w = units.shape[:2]
        anchors = np.zeros((count, w, w, 3))
        anchors[:, np.arange(w), np.arange(w)] = -units
        return np.concatenate(
            [units @ T_base_tool[:, :3, :3], anchors.reshape(count, w, -1)], axis=-1
        )

    def moved(self, setup: Setup, step: Array) -> Setup:
        return replace(
            setup,
            targets=readonly(setup.targets + step[:3]),
            anchors=readonly(_anchors(setup) + step[3:].reshape(-1, 3)),
        )

    def displacements(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        residual = self.residuals(readings, setup, T_base_tool)
        return residual[..., None] * _along(setup, T_base_tool)[2]

    def starts(self, readings: Readings, setup: Setup, poses: Array) -> list[Setup]:
        """With the tool's point given, |p|² − l² = 2 p·a − |a|² is linear in a and |a|²."""
        assert readings.values is not None
        found = []
        for target in setup.targets + STARTS:
            points = transform_points(poses, target[None])[:, 0]
            anchors = []
            for lengths in readings.values.T:
                seen = np.isfinite(lengths)
                A = np.concatenate([2 * points[seen], -np.ones((int(seen.sum()), 1))], axis=-1)
                b = (points[seen] ** 2).sum(axis=-1) - lengths[seen] ** 2
                anchors.append(np.linalg.lstsq(A, b, rcond=1e-9)[0][:3])
            found.append(
                replace(setup, targets=readonly(target[None]), anchors=readonly(np.array(anchors)))
            )
        return found

    def in_base(self, setup: Setup, T_new_base: Array) -> Setup:
        anchors = readonly(transform_points(T_new_base, _anchors(setup)))
        return replace(super().in_base(setup, T_new_base), anchors=anchors)


def _anchors(setup: Setup) -> Array:
    assert setup.anchors is not None
    return setup.anchors


def _along(setup: Setup, T_base_tool: Array) -> tuple[Array, Array, Array]:
    """The tool's points (N, 3), distances (N, w) and unit vectors (N, w, 3) from the anchors."""
    points = transform_points(T_base_tool, setup.targets)[:, 0]
    apart = points[:, None] - _anchors(setup)
    lengths = np.maximum(np.linalg.norm(apart, axis=-1), 1e-12)
    return points, lengths, apart / lengths[..., None]
