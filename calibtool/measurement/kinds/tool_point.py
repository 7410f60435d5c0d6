"""Kinds that read lengths at one point of the tool."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibtool.measurement.kinds.kind import Kind, Readings
from calibtool.robot.se3 import Array, readonly, transform_points

if TYPE_CHECKING:
    from calibtool.measurement.setup import Setup

# Where the tool's point may be when a registration starts, m.
STARTS = 0.1 * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])


class ToolPoint(Kind):
    """d lengths, m, read at the set-up's only target."""

    of_points = False

    def weights(self, readings: Readings, noise_position: float, noise_orientation: float) -> Array:
        assert readings.values is not None
        return np.isfinite(readings.values) / noise_position

    def in_tool(self, setup: Setup, T_new_tool: Array) -> Setup:
        return replace(setup, targets=readonly(transform_points(T_new_tool, setup.targets)))
