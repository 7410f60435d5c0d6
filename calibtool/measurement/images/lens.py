"""The lens from images of a board, and reprojection errors."""

from dataclasses import dataclass

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.measurement.images.opencv import opencv
from calibtool.measurement.kinds.projection import project
from calibtool.robot.se3 import Array, transform_points

FEWEST = 5  # number of images from which a lens can be calibrated
_TILT = np.deg2rad(5.0)  # between boards: below it, focal length and distance cannot be separated


@dataclass(frozen=True, eq=False)
class Lens:
    """Intrinsics (9,), see `kinds.projection`, and of every image the pose of the board in the
    camera (N, 4, 4), m, and the reprojection errors, found minus predicted corners (N, m, 2), px,
    NaN where not found.
    """

    intrinsics: Array
    T_camera_board: Array
    residual: Array

    @property
    def image_rms(self) -> Array:
        """Reprojection error of each image: (N,) px, rms of the distance."""
        found: Array = np.sqrt(np.nanmean((self.residual**2).sum(axis=-1), axis=-1))
        return found

    @property
    def pixel_noise(self) -> float:
        """Standard deviation of a coordinate, px, corrected for the six unknowns of every image."""
        count = np.isfinite(self.residual).sum()
        freedom = max(count - 6 * len(self.residual), 1)
        return float(np.sqrt(np.nansum(self.residual**2) / freedom))


def calibrated(pixels: Array, corners: Array, size: tuple[int, int]) -> Lens:
    """A lens from corners (N, m, 2) in images of a size (px) of a flat board, corners (m, 3), m.

    Raises NoSolutionError for fewer than five images, or boards that all have nearly one
    orientation.
    """
    if len(pixels) < FEWEST:
        raise NoSolutionError(
            f"{len(pixels)} images show the board; a lens needs {FEWEST}: take more, or give its "
            "--intrinsics"
        )
    cv2 = opencv()
    seen = [np.isfinite(image[:, 0]) for image in pixels]
    board = [corners[own].astype(np.float32) for own in seen]
    image = [row[own].astype(np.float32) for row, own in zip(pixels, seen, strict=True)]
    try:
        _, K, distortion, _, _ = cv2.calibrateCamera(board, image, size, None, None)
    except cv2.error:
        raise NoSolutionError("the lens cannot be calibrated from these images") from None
    found = np.asarray(distortion).ravel()
    intrinsics = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *found[:5]])
    lens = applied(pixels, corners, intrinsics)
    normals = lens.T_camera_board[:, :3, 2]
    if np.arccos(np.clip(normals @ normals.T, -1, 1)).max() < _TILT:
        raise NoSolutionError(
            "all boards look the same way: focal length and distance cannot be told apart; tilt "
            "the camera by 20° and more, or give its --intrinsics"
        )
    return lens


def applied(pixels: Array, corners: Array, intrinsics: Array) -> Lens:
    """A given lens (9,) with poses of the board from corners (N, m, 2), px, of a board (m, 3)."""
    cv2 = opencv()
    K = np.array([[intrinsics[0], 0, intrinsics[2]], [0, intrinsics[1], intrinsics[3]], [0, 0, 1]])
    poses, residual = np.tile(np.eye(4), (len(pixels), 1, 1)), np.full_like(pixels, np.nan)
    for k, image in enumerate(pixels):
        seen = np.isfinite(image[:, 0])
        found, turn, shift = cv2.solvePnP(
            corners[seen], image[seen], K, intrinsics[4:], flags=cv2.SOLVEPNP_IPPE
        )
        if not found:
            continue
        turn, shift = cv2.solvePnPRefineLM(
            corners[seen], image[seen], K, intrinsics[4:], turn, shift
        )
        poses[k, :3, :3] = cv2.Rodrigues(turn)[0]
        poses[k, :3, 3] = np.asarray(shift).ravel()
        residual[k] = image - project(transform_points(poses[k], corners), intrinsics)
    return Lens(intrinsics, poses, residual)
