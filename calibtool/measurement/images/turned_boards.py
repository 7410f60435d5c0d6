"""Which images show a checkerboard turned by half a turn; it looks the same."""

import numpy as np

from calibtool.robot.se3 import Array

_HALF = np.diag([-1.0, -1.0, 1.0])


def turned(R_camera_board: Array, R_base_tool: Array) -> np.ndarray:
    """Which images show the board turned by half a turn relative to the first one: (N,) bool.

    Between two images the board turns in the camera by the angle by which the tool turns, whether
    the camera or the board is on the tool. R (N, 3, 3). Every pair of images votes; the signs with
    the most votes are those of the largest eigenvector of the votes.
    """
    tool = _angles(R_base_tool, np.eye(3))
    same = np.abs(_angles(R_camera_board, np.eye(3)) - tool)
    other = np.abs(_angles(R_camera_board, _HALF) - tool)
    _, vectors = np.linalg.eigh(np.tanh(10 * (other - same)))
    signs = np.sign(vectors[:, -1])
    found: np.ndarray = signs != signs[0]
    return found


def _angles(R: Array, between: Array) -> Array:
    """Angles (N, N) of R_i B R_jᵀ or, which is the same, between board and board."""
    turned = R @ between
    trace = np.einsum("iab,jab->ij", turned, R)
    angles: Array = np.arccos(np.clip((trace - 1) / 2, -1, 1))
    return angles
