"""A point of the tool on planes in the cell, or at measured heights above them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibtool.measurement.kinds.kind import Readings, of_place, places_of
from calibtool.measurement.kinds.tool_point import STARTS, ToolPoint
from calibtool.robot.se3 import Array, readonly, skew, transform_points

if TYPE_CHECKING:
    from calibtool.measurement.setup import Setup

_STEP = 5e-3  # m between readings: they tell where the normal points


class PlaneProbe(ToolPoint):
    """d = 1: the height n·p − h of the tool's point p above the plane of the row's place."""

    id, words = "plane", "heights above planes"
    arrays: ClassVar = {
        "planes": ((-1, 4), "m", "unit normals of the planes and their distances from the origin")
    }

    def coordinates(self, setup: Setup) -> int:
        return 1

    def names(self, setup: Setup) -> tuple[str, ...]:
        planes = (f"plane{g + 1}.{c}" for g in range(len(_planes(setup))) for c in _TURNS)
        return (*(f"target1.{c}" for c in "xyz"), *planes)

    def residuals(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        assert readings.values is not None
        points, planes = _seen(setup, T_base_tool, readings.place)
        heights = (points * planes[:, :3]).sum(axis=-1) - planes[:, 3]
        residual: Array = np.nan_to_num(readings.values - heights[:, None])
        return residual

    def matrix(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        points, planes = _seen(setup, T_base_tool, place)
        normal = planes[:, None, :3]
        return np.concatenate([normal, -normal @ skew(points)], axis=-1)

    def columns(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        points, planes = _seen(setup, T_base_tool, place)
        own = places_of(place, len(points))
        count = len(_planes(setup))
        of_planes = np.zeros((len(points), count, 3))
        for g in range(count):
            rows = own == g
            sideways = _sideways(_planes(setup)[g, :3])
            of_planes[rows, g, :2] = points[rows] @ sideways.T
            of_planes[rows, g, 2] = -1.0
        target = planes[:, None, :3] @ T_base_tool[:, :3, :3]
        return np.concatenate([target, of_planes.reshape(len(points), 1, -1)], axis=-1)

    def moved(self, setup: Setup, step: Array) -> Setup:
        planes = _planes(setup).copy()
        for g, (a, b, h) in enumerate(step[3:].reshape(-1, 3)):
            normal = planes[g, :3] + np.array([a, b]) @ _sideways(planes[g, :3])
            planes[g, :3] = normal / np.linalg.norm(normal)
            planes[g, 3] += h
        targets = readonly(setup.targets + step[:3])
        return replace(setup, targets=targets, planes=readonly(planes))

    def displacements(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        residual = self.residuals(readings, setup, T_base_tool)
        normals = _seen(setup, T_base_tool, readings.place)[1][:, None, :3]
        return residual[..., None] * normals

    def starts(self, readings: Readings, setup: Setup, poses: Array) -> list[Setup]:
        """With the tool's point given, each plane is fitted to its points: by their smallest
        extent, or by the direction in which the readings increase.
        """
        assert readings.values is not None
        found = []
        own = places_of(readings.place, len(poses))
        for target in setup.targets + STARTS:
            points = transform_points(poses, target[None])[:, 0]
            planes = []
            for g in range(len(_planes(setup))):
                part, heights = points[own == g], readings.values[own == g, 0]
                centre = part.mean(axis=0)
                normal = np.linalg.svd(part - centre)[2][2]
                if np.ptp(heights) > _STEP:
                    steepest = np.linalg.lstsq(part - centre, heights - heights.mean())[0]
                    normal = steepest / max(np.linalg.norm(steepest), 1e-12)
                planes.append([*normal, float(normal @ centre - heights.mean())])
            found.append(
                replace(setup, targets=readonly(target[None]), planes=readonly(np.array(planes)))
            )
        return found

    def in_base(self, setup: Setup, T_new_base: Array) -> Setup:
        normals = _planes(setup)[:, :3] @ T_new_base[:3, :3].T
        heights = _planes(setup)[:, 3:] + normals @ T_new_base[:3, 3:]
        planes = readonly(np.concatenate([normals, heights], axis=-1))
        return replace(super().in_base(setup, T_new_base), planes=planes)


_TURNS = ("rx", "ry", "h")


def _planes(setup: Setup) -> Array:
    assert setup.planes is not None
    return setup.planes


def _seen(setup: Setup, T_base_tool: Array, place: np.ndarray | None) -> tuple[Array, Array]:
    """The tool's points (N, 3) and the planes (N, 4) of the rows."""
    points = transform_points(T_base_tool, setup.targets)[:, 0]
    return points, of_place(_planes(setup), place, len(points))


def _sideways(normal: Array) -> Array:
    """Two unit vectors across a normal: (2, 3)."""
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])
