"""The pinhole camera with radial and tangential distortion (Brown 1971), as OpenCV writes it.

An intrinsics array (9,) holds f_x, f_y, c_x, c_y in px and the coefficients k_1, k_2, p_1, p_2,
k_3. With x = X/Z, y = Y/Z, r² = x² + y² and s = 1 + k_1 r² + k_2 r⁴ + k_3 r⁶ a point X, Y, Z of the
camera's frame is seen at

    u = f_x (x s + 2 p_1 x y + p_2 (r² + 2 x²)) + c_x
    v = f_y (y s + p_1 (r² + 2 y²) + 2 p_2 x y) + c_y
"""

import numpy as np

from calibtool.measurement.rotation_search import nearest_rotation
from calibtool.robot.se3 import Array

LENS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
_NEAREST = 1e-6  # m in front of the camera: nearer points are not seen
_ROUNDS = 20  # number of iterations of the inversion of the distortion


def project(points: Array, intrinsics: Array) -> Array:
    """Points (…, 3) of the camera's frame, m, in the image: (…, 2), px."""
    ideal, _ = _ideal(points)
    return _distorted(ideal, intrinsics) * intrinsics[:2] + intrinsics[2:4]


def by_point(points: Array, intrinsics: Array) -> Array:
    """∂(u, v)/∂(X, Y, Z): (…, 2, 3), px/m."""
    ideal, depth = _ideal(points)
    x, y = ideal[..., 0], ideal[..., 1]
    k1, k2, p1, p2, k3 = intrinsics[4:]
    r2 = x * x + y * y
    s, slope = _radial(r2, k1, k2, k3), k1 + r2 * (2 * k2 + 3 * k3 * r2)
    by_ideal = np.empty((*x.shape, 2, 2))
    by_ideal[..., 0, 0] = s + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    by_ideal[..., 0, 1] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    by_ideal[..., 1, 0] = by_ideal[..., 0, 1]
    by_ideal[..., 1, 1] = s + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    of_points = np.zeros((*x.shape, 2, 3))
    of_points[..., 0, 0] = of_points[..., 1, 1] = 1.0 / depth
    of_points[..., :2, 2] = -ideal / depth[..., None]
    found: Array = intrinsics[:2, None] * (by_ideal @ of_points)
    return found


def by_lens(points: Array, intrinsics: Array) -> Array:
    """∂(u, v)/∂(lens), (…, 2, 9), px: focal lengths and the centre as parts of the focal length,
    the coefficients as they are; what `stepped` moves.
    """
    ideal, _ = _ideal(points)
    x, y = ideal[..., 0], ideal[..., 1]
    seen = _distorted(ideal, intrinsics)
    r2 = x * x + y * y
    found = np.zeros((*x.shape, 2, 9))
    found[..., 0, 0], found[..., 1, 1] = seen[..., 0], seen[..., 1]
    found[..., 0, 2] = found[..., 1, 3] = 1.0
    for column, power in ((4, 1), (5, 2), (8, 3)):
        found[..., :, column] = ideal * (r2**power)[..., None]
    found[..., 0, 6] = found[..., 1, 7] = 2 * x * y
    found[..., 0, 7] = r2 + 2 * x * x
    found[..., 1, 6] = r2 + 2 * y * y
    return found * intrinsics[:2, None]


def stepped(intrinsics: Array, step: Array) -> Array:
    """Intrinsics after a step (9,) as in `by_lens`."""
    focal = np.concatenate([intrinsics[:2], intrinsics[:2], np.ones(5)])
    return intrinsics + focal * step


def undistorted(pixels: Array, intrinsics: Array) -> Array:
    """x and y of the rays of pixels (…, 2): (…, 2). NaN stays."""
    seen = (pixels - intrinsics[2:4]) / intrinsics[:2]
    ideal = seen.copy()
    for _ in range(_ROUNDS):
        ideal = ideal + seen - _distorted(ideal, intrinsics)
    return ideal


def planar_pose(ideal: Array, board: Array) -> Array:
    """T_camera_board (4, 4) of a flat board from at least four rays.

    ideal (k, 2): see `undistorted`; board (k, 3): the points in the board's frame with z = 0, m.
    By the homography of the plane (Zhang 2000): a start, not the least squares of the pixels.
    """
    centre, extent = board[:, :2].mean(axis=0), np.abs(board[:, :2]).max()
    flat = (board[:, :2] - centre) / extent
    A = np.zeros((len(flat), 2, 9))
    A[:, 0, 0:2] = A[:, 1, 3:5] = flat
    A[:, 0, 2] = A[:, 1, 5] = 1.0
    A[:, :, 6:8] = -ideal[:, :, None] * flat[:, None]
    A[:, :, 8] = -ideal
    H = np.linalg.svd(A.reshape(-1, 9))[2][-1].reshape(3, 3)
    H = H * np.sign(H[2, 2]) / np.linalg.norm(H[:, :2], axis=0).mean()
    T = np.eye(4)
    T[:3, :3] = nearest_rotation(np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])]))
    T[:3, 3] = extent * H[:, 2] - T[:3, :2] @ centre
    return T


def _ideal(points: Array) -> tuple[Array, Array]:
    """x, y (…, 2) and depth (…,) of points."""
    depth = np.maximum(points[..., 2], _NEAREST)
    return points[..., :2] / depth[..., None], depth


def _radial(r2: Array, k1: float, k2: float, k3: float) -> Array:
    return 1 + r2 * (k1 + r2 * (k2 + r2 * k3))


def _distorted(ideal: Array, intrinsics: Array) -> Array:
    """Where rays (…, 2) fall behind the lens: (…, 2)."""
    k1, k2, p1, p2, k3 = intrinsics[4:]
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    s = _radial(r2, k1, k2, k3)
    u = x * s + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * s + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([u, v], axis=-1)
