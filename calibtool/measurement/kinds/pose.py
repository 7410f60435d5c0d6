"""The pose of one 6-D sensor on the tool: its origin as a point, and its orientation."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibtool.measurement.kinds.instrument import InstrumentKind
from calibtool.measurement.kinds.kind import Readings
from calibtool.measurement.kinds.points import TargetPoints
from calibtool.measurement.rotation_search import nearest_rotation
from calibtool.robot.se3 import Array, exp6, log3, readonly

if TYPE_CHECKING:
    from calibtool.measurement.setup import Setup

_POINT = TargetPoints()


class SensorPose(InstrumentKind):
    """d = 6: x, y, z of the sensor and a rotation vector; its orientation is in the set-up."""

    id, words = "pose", "6-D pose"
    arrays: ClassVar = {"R_tool_sensor": ((3, 3), "1", "orientation of the 6-D sensor")}

    def on_tool(self, points: int) -> tuple[str, ...]:
        return (*_POINT.on_tool(points), "sensor.rx", "sensor.ry", "sensor.rz")

    def residuals(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        assert readings.rotations is not None
        predicted = T_base_tool[:, :3, :3] @ _sensor(setup)
        turned = log3(readings.rotations @ np.swapaxes(predicted, -1, -2))
        return np.concatenate([_POINT.residuals(readings, setup, T_base_tool), turned], axis=-1)

    def lengths(self, setup: Setup) -> np.ndarray:
        return np.arange(6) < 3

    def matrix(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        """The rows of a point, followed by [0, I]."""
        turns = np.broadcast_to(np.hstack([np.zeros((3, 3)), np.eye(3)]), (len(T_base_tool), 3, 6))
        return np.concatenate([_POINT.matrix(setup, T_base_tool), turns], axis=1)

    def moved_on_tool(self, setup: Setup, step: Array) -> Setup:
        turn = exp6(np.concatenate([np.zeros(3), step[-3:]]))[:3, :3]
        return replace(
            _POINT.moved_on_tool(setup, step[:-3]), R_tool_sensor=readonly(turn @ _sensor(setup))
        )

    def weights(self, readings: Readings, noise_position: float, noise_orientation: float) -> Array:
        position = _POINT.weights(readings, noise_position, noise_orientation)
        return np.concatenate(
            [position, np.full((len(position), 3), 1.0 / noise_orientation)], axis=-1
        )

    def as_points(self, readings: Readings, setup: Setup, arm: float) -> tuple[Array, Array]:
        """Four points: origin of the sensor and the tips of its axes.

        The length of the axes makes position noise and orientation noise equal.
        """
        assert readings.rotations is not None
        tips = readings.points + arm * np.swapaxes(readings.rotations, -1, -2)
        on_tool = setup.targets + arm * _sensor(setup).T
        return np.concatenate([readings.points, tips], axis=1), np.concatenate(
            [setup.targets, on_tool]
        )

    def from_points(self, setup: Setup, targets: Array) -> Setup:
        found = replace(setup, targets=readonly(targets[:1]))
        if setup.targets_known:
            return found
        return replace(
            found, R_tool_sensor=readonly(nearest_rotation((targets[1:] - targets[:1]).T))
        )

    def in_tool(self, setup: Setup, T_new_tool: Array) -> Setup:
        turned = readonly(T_new_tool[:3, :3] @ _sensor(setup))
        return replace(_POINT.in_tool(setup, T_new_tool), R_tool_sensor=turned)


def _sensor(setup: Setup) -> Array:
    assert setup.R_tool_sensor is not None
    return setup.R_tool_sensor
