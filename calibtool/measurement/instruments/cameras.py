"""Cameras that see boards, on the tool and beside the arm."""

from collections.abc import Sequence

import numpy as np

from calibtool.measurement.instruments.cell import Cell, Observed, labels, shares
from calibtool.measurement.kinds import Readings
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array, exp6, inverse, readonly

CAMERA_NOISE = (0.04e-3, 0.04e-3, 0.07e-3, 0.21e-3, 0.21e-3, 0.21e-3)  # m, rad: found boards
_VIEW = (0.3, 0.7)  # m between camera and board
_MIDDLE = 0.5


def camera_on_tool(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A camera on the tool that looks at boards fixed in the cell."""
    T_tool_camera = exp6(np.array([0.05, 0.0, 0.05, 0.1, -0.2, 0.4]))
    q, poses, boards = [], [], []
    for rows in shares(count, places):
        start = cell.sampled(1, rng)[0]
        first = cell.robot.mechanism.forward(start[None])[0] @ T_tool_camera
        T_base_board = first @ _ahead(_MIDDLE) @ _half_turn()

        def drawn(k: int, board: Array = T_base_board) -> Array:
            seen = _views(k, rng)  # the board in the camera
            return board @ inverse(seen) @ inverse(T_tool_camera)

        own = cell.driven(rows, rng, start, drawn)
        seen = inverse(cell.actual.forward(own) @ T_tool_camera) @ T_base_board
        q.append(own)
        poses.append(_noisy(seen, rng))
        boards.append(T_base_board)
    setup = Setup.unknown(
        np.zeros((1, 3)), T_tool_camera=T_tool_camera, T_base_boards=np.array(boards)
    )
    return _board_poses(setup, q, poses, labels("board", places))


def camera_beside(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A camera beside the arm, in several places, that sees a board on the tool: 6-D poses."""
    T_tool_board = exp6(np.array([0.02, 0.03, 0.05, 0.3, 0.1, -0.2]))
    q, poses, frames = [], [], []
    for rows in shares(count, places):
        start = cell.sampled(1, rng)[0]
        first = cell.robot.mechanism.forward(start[None])[0] @ T_tool_board
        T_base_camera = first @ _half_turn() @ inverse(_ahead(_MIDDLE + 0.3))

        def drawn(k: int, camera: Array = T_base_camera) -> Array:
            seen = _views(k, rng)
            seen[:, :3, 3] *= 1.6
            return camera @ seen @ inverse(T_tool_board)

        own = cell.driven(rows, rng, start, drawn)
        seen = inverse(T_base_camera) @ cell.actual.forward(own) @ T_tool_board
        q.append(own)
        poses.append(_noisy(seen, rng))
        frames.append(inverse(T_base_camera))
    setup = Setup(
        readonly(frames[0]),
        readonly(T_tool_board[None, :3, 3]),
        readonly(T_tool_board[:3, :3]),
        frame_known=False,
        targets_known=False,
        further_frames=readonly(np.array(frames[1:])) if places > 1 else None,
    )
    return _board_poses(setup, q, poses, labels("station", places))


def _board_poses(
    setup: Setup, q: Sequence[Array], poses: Sequence[Array], labels: tuple[str, ...]
) -> Observed:
    """Poses of a board as a camera finds them, (k, 4, 4) per place, at joint positions (k, n)."""
    found = np.concatenate(poses)
    place = np.repeat(np.arange(len(q)), [len(part) for part in q])
    readings = Readings(
        found[:, None, :3, 3], found[:, :3, :3], place=place if len(q) > 1 else None
    )
    deviations = readonly(np.tile(CAMERA_NOISE, (len(found), 1)))
    return Observed(np.concatenate(q), setup, readings, labels, deviations)


def _views(count: int, rng: np.random.Generator) -> Array:
    """Poses (count, 4, 4) of a board in a camera that sees it, tilted."""
    turn = np.zeros((count, 6))
    turn[:, 3:5] = rng.uniform(-0.7, 0.7, (count, 2))
    roll = np.zeros((count, 6))
    roll[:, 5] = rng.uniform(-np.pi, np.pi, count)
    seen = _half_turn() @ exp6(turn) @ exp6(roll)
    seen[:, :2, 3] = rng.uniform(-0.12, 0.12, (count, 2))
    seen[:, 2, 3] = rng.uniform(*_VIEW, count)
    return seen


def _half_turn() -> Array:
    """A board that faces the camera."""
    return exp6(np.array([0.0, 0.0, 0.0, np.pi, 0.0, 0.0]))


def _ahead(distance: float) -> Array:
    moved = np.eye(4)
    moved[2, 3] = distance
    return moved


def _noisy(poses: Array, rng: np.random.Generator) -> Array:
    """Poses (N, 4, 4) with a camera's noise: position, and rotation in the camera's axes."""
    noise = rng.normal(size=(len(poses), 6)) * CAMERA_NOISE
    turned = exp6(np.concatenate([np.zeros((len(poses), 3)), noise[:, 3:]], axis=-1))
    noisy = poses.copy()
    noisy[:, :3, :3] = turned[:, :3, :3] @ poses[:, :3, :3]
    noisy[:, :3, 3] += noise[:, :3]
    return noisy
