"""Cameras with image coordinates of the corners of a board, on the tool and beside the arm."""

import numpy as np

from calibtool.measurement.images.board_description import BoardDescription
from calibtool.measurement.instruments.cell import Cell, Observed, labels, shares
from calibtool.measurement.kinds import Readings
from calibtool.measurement.kinds.projection import project
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array, exp6, inverse, transform_points

LENS = np.array([1400.0, 1400.0, 800.0, 600.0, -0.11, 0.08, 4e-4, -3e-4, -0.02])  # px and 1
SIZE = (1600, 1200)  # px
BOARD = BoardDescription(
    kind="charuco", squares=(9, 7), square_mm=25.0, marker_mm=18.0, dictionary="5x5_100"
)
PIXEL_NOISE = 0.1  # px, stated noise of a corner
_MIDDLE = 0.45  # m between camera and board
_LEAST = 6  # number of corners in a usable image
_DRAWN = 3  # number of drawn configurations over those that are taken


def corners_on_tool(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A camera on the tool that looks at boards fixed in the cell."""
    T_tool_camera = exp6(np.array([0.05, 0.0, 0.05, 0.1, -0.2, 0.4]))
    q, seen, boards = [], [], []
    for rows in shares(count, places):
        start = cell.sampled(1, rng)[0]
        first = cell.robot.mechanism.forward(start[None])[0] @ T_tool_camera
        T_base_board = first @ _centred(np.eye(4)[None], np.array([[0.0, 0.0, _MIDDLE]]))[0]

        def drawn(k: int, board: Array = T_base_board) -> Array:
            return board @ inverse(_views(k, rng)) @ inverse(T_tool_camera)

        own = cell.driven(_DRAWN * rows, rng, start, drawn)
        pixels = _images(inverse(cell.actual.forward(own) @ T_tool_camera) @ T_base_board)
        useful = _useful(pixels)[:rows]
        q.append(own[useful])
        seen.append(pixels[useful])
        boards.append(T_base_board)
    arrays = {"T_tool_camera": T_tool_camera, "T_base_boards": np.array(boards)}
    return _observed(arrays, q, seen, labels("board", places), rng)


def corners_beside(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A camera beside the arm, in several places, that looks at a board on the tool."""
    T_tool_board = exp6(np.array([0.02, 0.03, 0.05, 0.3, 0.1, -0.2]))
    q, seen, cameras = [], [], []
    for rows in shares(count, places):
        start = cell.sampled(1, rng)[0]
        first = cell.robot.mechanism.forward(start[None])[0] @ T_tool_board
        middle = _centred(np.eye(4)[None], np.array([[0.0, 0.0, 1.6 * _MIDDLE]]))[0]
        T_base_camera = first @ inverse(middle)

        def drawn(k: int, camera: Array = T_base_camera) -> Array:
            return camera @ _views(k, rng, 1.6) @ inverse(T_tool_board)

        own = cell.driven(_DRAWN * rows, rng, start, drawn)
        pixels = _images(inverse(T_base_camera) @ cell.actual.forward(own) @ T_tool_board)
        useful = _useful(pixels)[:rows]
        q.append(own[useful])
        seen.append(pixels[useful])
        cameras.append(T_base_camera)
    arrays = {"T_tool_board": T_tool_board, "T_base_cameras": np.array(cameras)}
    return _observed(arrays, q, seen, labels("station", places), rng)


def _observed(
    arrays: dict[str, Array],
    q: list[Array],
    seen: list[Array],
    names: tuple[str, ...],
    rng: np.random.Generator,
) -> Observed:
    """Corners (k, m, 2) per place at joint positions (k, n), with noise."""
    pixels = np.concatenate(seen)
    pixels = pixels + rng.normal(size=pixels.shape) * PIXEL_NOISE
    place = np.repeat(np.arange(len(q)), [len(part) for part in q])
    scale = _MIDDLE / LENS[0]
    setup = Setup.unknown(
        np.zeros((1, 3)),
        intrinsics=LENS,
        corners=BOARD.corners,
        image_scale=np.array([scale]),
        **arrays,
    )
    readings = Readings(
        np.full((len(pixels), 1, 3), np.nan),
        None,
        pixels.reshape(len(pixels), -1),
        place if len(q) > 1 else None,
    )
    return Observed(np.concatenate(q), setup, readings, names, noise=PIXEL_NOISE * scale)


def _images(board: Array) -> Array:
    """Corners in the image for poses of the board (N, 4, 4): (N, m, 2), NaN outside of it."""
    corners = transform_points(board, BOARD.corners)
    pixels = project(corners, LENS)
    margin = 10.0
    inside = ((pixels > margin) & (pixels < np.array(SIZE) - margin)).all(axis=-1)
    pixels[~(inside & (corners[..., 2] > 0))] = np.nan
    return pixels


def _useful(pixels: Array) -> np.ndarray:
    """Rows (k,) of images with enough corners."""
    return np.flatnonzero(np.isfinite(pixels[..., 0]).sum(axis=-1) >= _LEAST)


def _views(count: int, rng: np.random.Generator, scale: float = 1.0) -> Array:
    """Poses (count, 4, 4) of a board in a camera that sees it, tilted, its middle in view."""
    turn, roll = np.zeros((count, 6)), np.zeros((count, 6))
    turn[:, 3:5] = rng.uniform(-0.7, 0.7, (count, 2))
    roll[:, 5] = rng.uniform(-np.pi, np.pi, count)
    middle = np.concatenate(
        [rng.uniform(-0.08, 0.08, (count, 2)), rng.uniform(0.3, 0.6, (count, 1))], axis=-1
    )
    return _centred(exp6(turn) @ exp6(roll), scale * middle)


def _centred(turned: Array, middle: Array) -> Array:
    """Poses with these rotations (N, 4, 4) and the middle of the board at points (N, 3)."""
    poses = turned.copy()
    centre = BOARD.corners.mean(axis=0)
    poses[:, :3, 3] = middle - turned[:, :3, :3] @ centre
    return poses
