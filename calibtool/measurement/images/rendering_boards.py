"""Images of a board as a camera would take them, for tests and trials."""

from collections.abc import Iterator

import numpy as np

from calibtool.measurement.images.board_description import BoardDescription
from calibtool.measurement.images.opencv import opencv
from calibtool.measurement.kinds.projection import undistorted
from calibtool.robot.se3 import Array

_FINE = 40  # px of a square in the drawing
_SAMPLES = 2  # number of rays per px and axis
_GREY, _NOISE, _BLUR = 110.0, 1.5, 0.6  # of the background; of the sensor; of the lens, px


def drawn_board(board: BoardDescription) -> Array:
    """The board as it is printed, grey, `_FINE` px per square: (h, w) uint8."""
    across, down = board.squares
    if board.kind == "charuco":
        drawing: Array = board.aruco().generateImage((across * _FINE, down * _FINE), marginSize=0)
        return drawing
    x, y = np.meshgrid(np.arange(across * _FINE) // _FINE, np.arange(down * _FINE) // _FINE)
    return np.where((x + y) % 2 == 0, 0, 255).astype(np.uint8)


def rendered(
    board: BoardDescription,
    T_camera_board: Array,
    intrinsics: Array,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> Iterator[Array]:
    """Grey images (h, w) uint8 of the board at poses in the camera (N, 4, 4), m.

    Rays through every part of a pixel meet the plane of the board; outside of it is grey.
    """
    cv2 = opencv()
    width, height = (_SAMPLES * edge for edge in size)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    pixels = (np.stack([u, v], axis=-1) + 0.5) / _SAMPLES - 0.5
    rays = np.concatenate([undistorted(pixels, intrinsics), np.ones((height, width, 1))], axis=-1)
    rays = rays.astype(np.float32)
    margin = _FINE // 2  # of white round the board, for the markers at its edge
    drawing = np.pad(drawn_board(board), margin, constant_values=255)
    drawing = cv2.GaussianBlur(drawing, (0, 0), 1.0)
    per_metre = _FINE / (board.square_mm * 1e-3)
    for pose in T_camera_board:
        # Where a ray meets the plane: homogeneous x, y of the board.
        to_board = np.linalg.inv(pose[:3, [0, 1, 3]]).astype(np.float32)
        on_board = rays @ to_board.T
        at = (on_board[..., :2] / on_board[..., 2:] * per_metre + (margin - 0.5)).astype(np.float32)
        fine = cv2.remap(
            drawing,
            at[..., 0],
            at[..., 1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=_GREY,
        )
        image = cv2.resize(fine, size, interpolation=cv2.INTER_AREA).astype(float)
        image = cv2.GaussianBlur(0.8 * image + 20.0, (0, 0), _BLUR)
        image += rng.normal(size=image.shape) * _NOISE
        yield np.clip(np.round(image), 0, 255).astype(np.uint8)
