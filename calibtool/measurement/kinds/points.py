"""Target points on the tool, of which a row may have seen some (Eqs. 18, 19)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibtool.measurement.kinds.instrument import InstrumentKind
from calibtool.measurement.kinds.kind import Readings
from calibtool.robot.se3 import Array, point_columns, readonly, transform_points

if TYPE_CHECKING:
    from calibtool.measurement.setup import Setup


class TargetPoints(InstrumentKind):
    """d = 3 m: x, y, z of each point."""

    id, words = "points", "{m} target points"

    def on_tool(self, points: int) -> tuple[str, ...]:
        return tuple(f"target{i + 1}.{c}" for i in range(points) for c in "xyz")

    def residuals(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        residual = (readings.points - transform_points(T_base_tool, setup.targets)).reshape(
            len(T_base_tool), -1
        )
        residual[~readings.seen.repeat(3, axis=-1)] = 0.0
        return residual

    def matrix(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        """P of Eq. 18, with rows [I, −[p_i]×]."""
        points = transform_points(T_base_tool, setup.targets)
        return point_columns(points).reshape(len(points), -1, 6)

    def moved_on_tool(self, setup: Setup, step: Array) -> Setup:
        return replace(setup, targets=readonly(setup.targets + step.reshape(-1, 3)))

    def as_points(self, readings: Readings, setup: Setup, arm: float) -> tuple[Array, Array]:
        return readings.points, setup.targets

    def from_points(self, setup: Setup, targets: Array) -> Setup:
        return replace(setup, targets=readonly(targets))
