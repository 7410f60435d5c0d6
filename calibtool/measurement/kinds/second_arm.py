"""Points of the tool seen by a sensor on a second arm, whose own poses are known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibtool.errormodel.family import COMPONENTS
from calibtool.measurement.kinds.kind import Kind, Readings, array_of, of_place
from calibtool.measurement.rotation_search import nearest_rotation
from calibtool.robot.se3 import (
    Array,
    adjoint,
    exp6,
    inverse,
    point_columns,
    readonly,
    transform_points,
)

if TYPE_CHECKING:
    from calibtool.measurement.setup import Setup


class SeenFromArm(Kind):
    """d = 3 m: x, y, z of each point in the sensor, along whose axes the noise is stated.

    A place is a pose of the second arm: the sensor is at T_base_base2 T_base2_flange2
    T_flange2_sensor, of which the first and the last are free and the middle one is given.
    """

    id, words = "second-arm", "points of the tool ({m}) in a sensor on a second arm"
    given: ClassVar = ("T_base2_flange2",)
    arrays: ClassVar = {
        "T_base2_flange2": ((-1, 4, 4), "m", "poses of the second arm's flange in its base"),
        "T_flange2_sensor": ((4, 4), "m", "pose of the sensor on that flange"),
        "T_base_base2": ((4, 4), "m", "pose of the second arm's base in K_0"),
    }

    def coordinates(self, setup: Setup) -> int:
        return 3 * len(setup.targets)

    def names(self, setup: Setup) -> tuple[str, ...]:
        targets = (f"target{i + 1}.{c}" for i in range(len(setup.targets)) for c in "xyz")
        return (
            *targets,
            *(f"sensor.{c}" for c in COMPONENTS),
            *(f"secondbase.{c}" for c in COMPONENTS),
        )

    def residuals(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        seen = self._seen(setup, T_base_tool, readings.place)
        return np.nan_to_num(readings.points - seen).reshape(len(seen), -1)

    def matrix(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        sensor = self._sensor(setup, place, len(T_base_tool))
        return self._by_twist(setup, T_base_tool, place) @ adjoint(inverse(sensor))

    def columns(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        count, m = len(T_base_tool), len(setup.targets)
        sensor = self._sensor(setup, place, count)
        turned = np.swapaxes(sensor[:, :3, :3], -1, -2) @ T_base_tool[:, :3, :3]
        targets = np.zeros((count, m, 3, m, 3))
        for i in range(m):
            targets[:, i, :, i] = turned
        moving = -self._by_twist(setup, T_base_tool, place)
        in_base2 = inverse(array_of(setup, "T_base_base2")) @ sensor
        return np.concatenate(
            [
                targets.reshape(count, 3 * m, 3 * m),
                moving,
                moving @ adjoint(inverse(in_base2)),
            ],
            axis=-1,
        )

    def moved(self, setup: Setup, step: Array) -> Setup:
        steps = exp6(step[-12:].reshape(2, 6))
        return replace(
            setup,
            targets=readonly(setup.targets + step[:-12].reshape(-1, 3)),
            T_flange2_sensor=readonly(array_of(setup, "T_flange2_sensor") @ steps[0]),
            T_base_base2=readonly(array_of(setup, "T_base_base2") @ steps[1]),
        )

    def displacements(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        residual = self.residuals(readings, setup, T_base_tool).reshape(len(T_base_tool), -1, 3)
        sensor = self._sensor(setup, readings.place, len(residual))
        return residual @ np.swapaxes(sensor[:, :3, :3], -1, -2)

    def starts(self, readings: Readings, setup: Setup, poses: Array) -> list[Setup]:
        """With B = T_base_base2⁻¹ and S = T_flange2_sensor the points z of the sensor fulfil

            R_B (R t + p) + p_B = R_F (R_S z + p_S) + p_F

        for the tool's pose R, p and the flange's R_F, p_F: linear in R_B, R_B ⊗ t, p_B, R_S, p_S.
        """
        flange = of_place(array_of(setup, "T_base2_flange2"), readings.place, len(poses))
        m = readings.points.shape[1]
        blocks, right = [], []
        for i in range(m):
            seen = readings.seen[:, i]
            R, p, F = poses[seen, :3, :3], poses[seen, :3, 3], flange[seen]
            count = len(R)
            row = np.zeros((count, 3, 24 + 27 * m))
            for a in range(3):
                row[:, a, 3 * a : 3 * a + 3] = p
                row[:, a, 24 + 27 * i + 9 * a : 33 + 27 * i + 9 * a] = R.reshape(count, 9)
            row[:, :, 9:12] = np.eye(3)
            z = readings.points[seen, i]
            turned = F[:, :3, :3, None] * z[:, None, None]
            row[:, :, 12:21] = -turned.reshape(count, 3, 9)
            row[:, :, 21:24] = -F[:, :3, :3]
            blocks.append(row.reshape(-1, row.shape[-1]))
            right.append(F[:, :3, 3].ravel())
        solved = np.linalg.lstsq(np.concatenate(blocks), np.concatenate(right), rcond=1e-9)[0]
        found_base, sensor = np.eye(4), np.eye(4)
        found_base[:3, :3] = nearest_rotation(solved[:9].reshape(3, 3))
        found_base[:3, 3] = solved[9:12]
        sensor[:3, :3] = nearest_rotation(solved[12:21].reshape(3, 3))
        sensor[:3, 3] = solved[21:24]
        # R_B ⊗ t, projected on the rotation found.
        tensors = solved[24:].reshape(m, 3, 3, 3)
        targets = np.einsum("ab,iabc->ic", found_base[:3, :3], tensors) / 3.0
        return [
            replace(
                setup,
                targets=readonly(targets),
                T_flange2_sensor=readonly(sensor),
                T_base_base2=readonly(inverse(found_base)),
            )
        ]

    def in_base(self, setup: Setup, T_new_base: Array) -> Setup:
        moved = readonly(T_new_base @ array_of(setup, "T_base_base2"))
        return replace(super().in_base(setup, T_new_base), T_base_base2=moved)

    def _sensor(self, setup: Setup, place: np.ndarray | None, count: int) -> Array:
        """Poses of the sensor in K_0 (N, 4, 4)."""
        flange = of_place(array_of(setup, "T_base2_flange2"), place, count)
        return array_of(setup, "T_base_base2") @ flange @ array_of(setup, "T_flange2_sensor")

    def _seen(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None) -> Array:
        """Predicted points (N, m, 3) in the sensor."""
        sensor = self._sensor(setup, place, len(T_base_tool))
        return transform_points(inverse(sensor) @ T_base_tool, setup.targets)

    def _by_twist(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None) -> Array:
        """∂(points)/∂(twist of the tool in the sensor's frame): (N, 3 m, 6)."""
        points = self._seen(setup, T_base_tool, place)
        return point_columns(points).reshape(len(points), -1, 6)
