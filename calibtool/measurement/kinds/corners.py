"""Corners of boards in images; residuals are in the image, like their noise, and the lens is free.

There are two kinds: a camera on the tool with boards in the cell, and cameras beside the arm with a
board on the tool. Coordinates are pixels times `image_scale`, the length on the board of one pixel
at its mean distance, so that they are lengths as for all other kinds.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibtool.errormodel.family import COMPONENTS
from calibtool.measurement.kinds.kind import (
    Kind,
    Readings,
    array_of,
    of_place,
    places_of,
    pose_of_tripod,
    tripod,
)
from calibtool.measurement.kinds.projection import (
    LENS,
    by_lens,
    by_point,
    planar_pose,
    project,
    stepped,
    undistorted,
)
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

_LENS_ARRAYS = {
    "intrinsics": ((9,), "px", "focal lengths, centre and distortion of the camera"),
    "corners": ((-1, 3), "m", "corners in the frame of the board"),
    "image_scale": ((1,), "m", "length on the board that a pixel has"),
}


class Corners(Kind):
    """d = 2 m: u, v of each corner of the board; values (N, 2 m) are pixels, NaN where unseen."""

    of_points, unit, sees_all = False, "px", False
    given: ClassVar = tuple(_LENS_ARRAYS)
    on_tool: ClassVar[str]  # array of what the tool carries, T_tool_…
    in_cell: ClassVar[str]  # array of what stands in the cell, T_base_…
    moving_name: ClassVar[str]  # names of the two in parameters
    fixed_name: ClassVar[str]

    def coordinates(self, setup: Setup) -> int:
        return 2 * len(array_of(setup, "corners"))

    def names(self, setup: Setup) -> tuple[str, ...]:
        places = range(1, len(array_of(setup, self.in_cell)) + 1)
        return (
            *(f"{self.moving_name}.{c}" for c in COMPONENTS),
            *(f"{self.fixed_name}{g}.{c}" for g in places for c in COMPONENTS),
            *(f"lens.{c}" for c in LENS),
        )

    def residuals(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        assert readings.values is not None
        _, _, corners = self._in_camera(setup, T_base_tool, readings.place)
        pixels = project(corners, array_of(setup, "intrinsics")).reshape(len(corners), -1)
        return np.nan_to_num((readings.values - pixels) * _scale(setup))

    def matrix(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        camera, _, corners = self._in_camera(setup, T_base_tool, place)
        sign = -1.0 if self.moving_name == "camera" else 1.0
        return sign * self._by_twist(setup, corners) @ adjoint(inverse(camera))

    def columns(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        camera, board, corners = self._in_camera(setup, T_base_tool, place)
        by_twist = self._by_twist(setup, corners)
        of = {"camera": -by_twist, "board": by_twist @ adjoint(inverse(camera) @ board)}
        own = places_of(place, len(corners))
        places = range(len(array_of(setup, self.in_cell)))
        fixed = [of[self.fixed_name] * (own == g)[:, None, None] for g in places]
        lens = by_lens(corners, array_of(setup, "intrinsics")) * _scale(setup)
        return np.concatenate(
            [of[self.moving_name], *fixed, lens.reshape(len(corners), -1, len(LENS))], axis=-1
        )

    def moved(self, setup: Setup, step: Array) -> Setup:
        steps = exp6(step[: -len(LENS)].reshape(-1, 6))
        return replace(
            self._placed(
                setup,
                array_of(setup, self.on_tool) @ steps[0],
                array_of(setup, self.in_cell) @ steps[1:],
            ),
            intrinsics=readonly(stepped(array_of(setup, "intrinsics"), step[-len(LENS) :])),
        )

    def registered(self, setup: Setup) -> np.ndarray:
        """All but the lens, which would take up errors of the robot."""
        return np.array([not name.startswith("lens.") for name in self.names(setup)])

    def sees(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> np.ndarray:
        """Whether the whole board is in the image, assumed to be twice its centre in size."""
        _, _, corners = self._in_camera(setup, T_base_tool, place)
        intrinsics = array_of(setup, "intrinsics")
        pixels = project(corners, intrinsics)
        inside = (pixels > 0) & (pixels < 2 * intrinsics[2:4])
        rays = np.abs(corners[..., :2] / np.maximum(corners[..., 2:], 1e-9))
        in_cone = (corners[..., 2] > 0) & (rays < 2 * intrinsics[2:4] / intrinsics[:2]).all(axis=-1)
        seen: np.ndarray = np.concatenate([inside.all(axis=-1), in_cone], axis=-1)
        return np.asarray(seen.all(axis=-1))

    def displacements(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        """Across the ray of every corner, at its distance; 0 for a corner that was not seen."""
        assert readings.values is not None
        camera, _, corners = self._in_camera(setup, T_base_tool, readings.place)
        intrinsics = array_of(setup, "intrinsics")
        residual = readings.values.reshape(len(corners), -1, 2) - project(corners, intrinsics)
        across = np.zeros_like(corners)
        across[..., :2] = np.nan_to_num(residual) / intrinsics[:2] * corners[..., 2:]
        found: Array = across @ np.swapaxes(camera[:, :3, :3], -1, -2)
        return found if self.fixed_name == "camera" else -found

    def as_points(self, readings: Readings, setup: Setup, arm: float) -> tuple[Array, Array]:
        """The object on the tool, seen from the object in the cell: origin and tips of the axes."""
        seen = self.poses(readings, setup)
        if self.fixed_name == "board":
            seen = inverse(seen)
        return tripod(seen, arm), tripod(array_of(setup, self.on_tool)[None], arm)[0]

    def from_points(self, setup: Setup, targets: Array) -> Setup:
        placed = self._placed(setup, pose_of_tripod(targets), inverse(setup.frames))
        return replace(placed, T_instrument_base=readonly(np.eye(4)), further_frames=None)

    def in_tool(self, setup: Setup, T_new_tool: Array) -> Setup:
        moved = T_new_tool @ array_of(setup, self.on_tool)
        return self._placed(setup, moved, array_of(setup, self.in_cell))

    def in_base(self, setup: Setup, T_new_base: Array) -> Setup:
        moved = T_new_base @ array_of(setup, self.in_cell)
        return self._placed(
            super().in_base(setup, T_new_base), array_of(setup, self.on_tool), moved
        )

    def poses(self, readings: Readings, setup: Setup) -> Array:
        """Poses of the board in the camera from each image alone: (N, 4, 4), m."""
        assert readings.values is not None
        corners = array_of(setup, "corners")
        pixels = readings.values.reshape(len(readings.values), -1, 2)
        rays = undistorted(pixels, array_of(setup, "intrinsics"))
        found = []
        for row in rays:
            seen = np.isfinite(row).all(axis=-1)
            found.append(planar_pose(row[seen], corners[seen]))
        return np.array(found)

    def _placed(self, setup: Setup, on_tool: Array, in_cell: Array) -> Setup:
        """The set-up with poses of the object on the tool (4, 4) and of those in the cell (G, 4,
        4).
        """
        changed = {self.on_tool: readonly(on_tool), self.in_cell: readonly(in_cell)}
        return replace(setup, **changed)  # type: ignore[arg-type]

    def _in_camera(
        self, setup: Setup, T_base_tool: Array, place: np.ndarray | None
    ) -> tuple[Array, Array, Array]:
        """T_base_camera and T_base_board (N, 4, 4), and the corners in the camera (N, m, 3)."""
        moving = T_base_tool @ array_of(setup, self.on_tool)
        fixed = of_place(array_of(setup, self.in_cell), place, len(T_base_tool))
        camera, board = (moving, fixed) if self.moving_name == "camera" else (fixed, moving)
        return camera, board, transform_points(inverse(camera) @ board, array_of(setup, "corners"))

    def _by_twist(self, setup: Setup, corners: Array) -> Array:
        """∂(observation)/∂(twist of the board in the camera's frame): (N, d, 6)."""
        by_point_of_camera = by_point(corners, array_of(setup, "intrinsics"))
        by_twist = by_point_of_camera @ point_columns(corners) * _scale(setup)
        return by_twist.reshape(len(corners), -1, 6)


class CornersFromTool(Corners):
    """A camera on the tool and boards in the cell."""

    id, words = "corners", "corners of a board in images of a camera on the tool"
    on_tool, in_cell, moving_name, fixed_name = "T_tool_camera", "T_base_boards", "camera", "board"
    arrays: ClassVar = {
        "T_tool_camera": ((4, 4), "m", "pose of the camera on the tool"),
        "T_base_boards": ((-1, 4, 4), "m", "poses of the boards in K_0"),
        **_LENS_ARRAYS,
    }


class CornersFromBeside(Corners):
    """Cameras beside the arm, in several places, and a board on the tool."""

    id, words = "corners-beside", "corners of a board on the tool in images"
    on_tool, in_cell, moving_name, fixed_name = "T_tool_board", "T_base_cameras", "board", "camera"
    arrays: ClassVar = {
        "T_tool_board": ((4, 4), "m", "pose of the board on the tool"),
        "T_base_cameras": ((-1, 4, 4), "m", "poses of the cameras in K_0"),
        **_LENS_ARRAYS,
    }


def _scale(setup: Setup) -> float:
    return float(array_of(setup, "image_scale")[0])
