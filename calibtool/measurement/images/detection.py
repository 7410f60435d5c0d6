"""Corners of a board in images."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibtool.measurement.images.board_description import BoardDescription
from calibtool.measurement.images.opencv import opencv
from calibtool.robot.se3 import Array

_CLEAR, _WINDOWS = 2.0, (2, 12)  # px between a window and a marker, half width of the window
_LEAST = 6  # number of corners that determine a pose with some redundancy


@dataclass(frozen=True, eq=False)
class Seen:
    """The result of the detection in one image.

    size       width and height, px; 0, 0 for a file that is no image
    pixels     (m, 2) corners of the board, NaN where it was not found
    sharpness  variance of the Laplacian: small in a blurred image
    """

    name: str
    size: tuple[int, int]
    pixels: Array
    sharpness: float

    @property
    def found(self) -> int:
        """Number of corners; 0 where they are too few for a pose."""
        count = int(np.isfinite(self.pixels[:, 0]).sum())
        return count if count >= _LEAST else 0


def read_image(path: Path) -> Any:
    """A grey image (h, w) uint8 in the sensor's orientation; None for a file that is none."""
    cv2 = opencv()
    data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    if not len(data):
        return None
    try:
        return cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        return None


def detect(paths: Sequence[Path], board: BoardDescription) -> Iterator[Seen]:
    """The corners of the board in each image, in their order; several images are processed in
    parallel.

    Raises UsageError without OpenCV, InputError for an unknown dictionary.
    """
    cv2 = opencv()
    cv2.setNumThreads(1)  # images are shared out instead

    def one(path: Path) -> Seen:
        image = read_image(path)
        if image is None:
            return Seen(path.name, (0, 0), np.full((len(board.corners), 2), np.nan), 0.0)
        sharpness = float(cv2.Laplacian(image, cv2.CV_32F).var())
        size = (image.shape[1], image.shape[0])
        return Seen(path.name, size, corners_of(image, board), sharpness)

    if board.kind == "charuco":
        board.aruco()  # what is wrong with it is said once
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        yield from pool.map(one, paths)


def corners_of(image: Any, board: BoardDescription) -> Array:
    """Corners (m, 2) of the board in a grey image, px; NaN where it was not found."""
    cv2 = opencv()
    pixels = np.full((len(board.corners), 2), np.nan)
    if board.kind == "charuco":
        found, numbers, _, _ = cv2.aruco.CharucoDetector(board.aruco()).detectBoard(image)
        if numbers is not None and len(numbers):
            pixels[np.asarray(numbers).ravel()] = np.asarray(found).reshape(-1, 2)
        return _refined(image, pixels, board)
    across, down = board.squares
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
    whole, found = cv2.findChessboardCornersSB(image, (across - 1, down - 1), flags=flags)
    if whole:
        pixels[:] = np.asarray(found).reshape(-1, 2)
    return pixels


def _refined(image: Any, pixels: Array, board: BoardDescription) -> Array:
    """Corners of a ChArUco board (m, 2), detected again in windows without markers.

    OpenCV uses one window size for all corners of an image. Where the board is seen at a slant,
    markers in the window shift the corners by up to a pixel.
    """
    cv2 = opencv()
    seen = np.flatnonzero(np.isfinite(pixels[:, 0]))
    if len(seen) < _LEAST or board.marker_mm is None:
        return pixels
    flat = board.corners[:, :2] * 1e3
    H, _ = cv2.findHomography(flat[seen], pixels[seen])
    if H is None:
        return pixels
    quarter = board.square_mm / 4
    ways = quarter * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    here = _mapped(H, flat[seen])
    edges = [4 * np.linalg.norm(_mapped(H, flat[seen] + way) - here, axis=-1) for way in ways]
    gap = np.min(edges, axis=0) * (1 - board.marker_mm / board.square_mm) / 2
    windows = np.clip(np.nan_to_num(gap - _CLEAR), *_WINDOWS).astype(int)
    until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    found = pixels.copy()
    for k, window in zip(seen, windows.tolist(), strict=True):
        start = pixels[k].astype(np.float32).reshape(1, 1, 2)
        end = cv2.cornerSubPix(image, start.copy(), (window, window), (-1, -1), until)
        found[k] = np.asarray(end).ravel()
    return found


def _mapped(H: Array, points: Array) -> Array:
    """Points (k, 2) by a homography (3, 3)."""
    mapped = np.concatenate([points, np.ones((len(points), 1))], axis=-1) @ H.T
    return mapped[:, :2] / mapped[:, 2:]


def off_plane(pixels: Array, board: BoardDescription) -> float:
    """Distance of corners (m, 2) from a flat board's, px rms; infinite for fewer than six."""
    seen = np.isfinite(pixels[:, 0])
    if seen.sum() < _LEAST:
        return float("inf")
    flat = board.corners[seen, :2] * 1e3
    H, _ = opencv().findHomography(flat, pixels[seen])
    if H is None:
        return float("inf")
    apart = _mapped(H, flat) - pixels[seen]
    return float(np.sqrt((apart**2).sum(axis=-1).mean()))
