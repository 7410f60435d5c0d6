"""Poses of boards fixed in the cell, with residuals in the frame of a camera on the tool."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibtool.errormodel.family import COMPONENTS
from calibtool.measurement.kinds.kind import (
    Kind,
    Readings,
    of_place,
    places_of,
    pose_of_tripod,
    tripod,
)
from calibtool.robot.se3 import Array, adjoint, exp6, inverse, log3, readonly, skew, translation

if TYPE_CHECKING:
    from calibtool.measurement.setup import Setup


class BoardPose(Kind):
    """d = 6: x, y, z of the board's origin in the camera, and a rotation vector there."""

    id, words = "board", "poses of a board in a camera on the tool"
    arrays: ClassVar = {
        "T_tool_camera": ((4, 4), "m", "pose of the camera on the tool"),
        "T_base_boards": ((-1, 4, 4), "m", "poses of the boards in K_0"),
    }

    def coordinates(self, setup: Setup) -> int:
        return 6

    def lengths(self, setup: Setup) -> np.ndarray:
        return np.arange(6) < 3

    def names(self, setup: Setup) -> tuple[str, ...]:
        boards = range(1, len(_boards(setup)) + 1)
        return (
            *(f"camera.{c}" for c in COMPONENTS),
            *(f"board{g}.{c}" for g in boards for c in COMPONENTS),
        )

    def residuals(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        assert readings.rotations is not None
        board = self._board(setup, T_base_tool, readings.place)
        turned = log3(readings.rotations @ np.swapaxes(board[:, :3, :3], -1, -2))
        return np.concatenate([readings.points[:, 0] - board[:, :3, 3], turned], axis=-1)

    def matrix(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        camera = inverse(T_base_tool @ _camera(setup))
        return -_at(self._board(setup, T_base_tool, place)) @ adjoint(camera)

    def columns(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        board = self._board(setup, T_base_tool, place)
        own = places_of(place, len(board))
        moving = _at(board) @ adjoint(board)
        boards = [moving * (own == g)[:, None, None] for g in range(len(_boards(setup)))]
        return np.concatenate([-_at(board), *boards], axis=-1)

    def moved(self, setup: Setup, step: Array) -> Setup:
        steps = exp6(step.reshape(-1, 6))
        return replace(
            setup,
            T_tool_camera=readonly(_camera(setup) @ steps[0]),
            T_base_boards=readonly(_boards(setup) @ steps[1:]),
        )

    def weights(self, readings: Readings, noise_position: float, noise_orientation: float) -> Array:
        sigma = np.repeat([noise_position, noise_orientation], 3)
        return np.broadcast_to(1.0 / sigma, (len(readings.points), 6)).copy()

    def displacements(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        residual = self.residuals(readings, setup, T_base_tool)[:, :3]
        turns = (T_base_tool @ _camera(setup))[:, :3, :3]
        return -(turns @ residual[..., None])[..., 0][:, None]

    def as_points(self, readings: Readings, setup: Setup, arm: float) -> tuple[Array, Array]:
        """The camera's origin and the tips of its axes in the board's frame: four points."""
        assert readings.rotations is not None
        seen = translation(readings.points[:, 0])
        seen[:, :3, :3] = readings.rotations
        return tripod(inverse(seen), arm), tripod(_camera(setup)[None], arm)[0]

    def from_points(self, setup: Setup, targets: Array) -> Setup:
        return replace(
            setup,
            T_tool_camera=readonly(pose_of_tripod(targets)),
            T_base_boards=readonly(inverse(setup.frames)),
            T_instrument_base=readonly(np.eye(4)),
            further_frames=None,
        )

    def in_tool(self, setup: Setup, T_new_tool: Array) -> Setup:
        return replace(setup, T_tool_camera=readonly(T_new_tool @ _camera(setup)))

    def in_base(self, setup: Setup, T_new_base: Array) -> Setup:
        boards = readonly(T_new_base @ _boards(setup))
        return replace(super().in_base(setup, T_new_base), T_base_boards=boards)

    def _board(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None) -> Array:
        """Predicted poses of the rows' boards in the camera (N, 4, 4)."""
        boards = of_place(_boards(setup), place, len(T_base_tool))
        return inverse(T_base_tool @ _camera(setup)) @ boards


def _camera(setup: Setup) -> Array:
    assert setup.T_tool_camera is not None
    return setup.T_tool_camera


def _boards(setup: Setup) -> Array:
    assert setup.T_base_boards is not None
    return setup.T_base_boards


def _at(board: Array) -> Array:
    """Effect of a twist of the camera's frame on a pose (N, 4, 4): (N, 6, 6)."""
    moved = np.tile(np.eye(6), (len(board), 1, 1))
    moved[:, :3, 3:] = -skew(board[:, :3, 3])
    return moved
