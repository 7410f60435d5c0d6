"""The standard DH parameters of a robot whose frames permit them."""

import numpy as np

from calibtool.robot.denavit_hartenberg import DhRow
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.se3 import Array

_PARALLEL = 1e-6  # rad between two axes, m between two lines


def standard_rows(mechanism: Mechanism, n: int) -> list[DhRow]:
    """Standard DH parameters of a chain of n revolute joints, in the form of Universal Robots.

    The frame before axis 1 is the base, the one after axis n the tool; θ is between −90 and 90 deg
    at q = 0, and d = 0 where axes are parallel. Chains with other frames are not described by them:
    compare before use.
    """
    pose, jacobian = mechanism.forward_and_jacobian(np.zeros((1, n)))
    directions = jacobian[0, 3:].T
    points = np.cross(
        directions, jacobian[0, :3].T
    )  # of each axis, the one nearest to the base's origin
    x, z, origin = np.eye(3)[0], np.eye(3)[2], np.zeros(3)
    rows = []
    for j in range(1, n + 1):
        if j < n:
            z_next = directions[j]
            x_next, d, a = _common_normal(origin, x, z, points[j], z_next)
        else:
            x_next, z_next, a = pose[0, :3, 0], pose[0, :3, 2], 0.0
            d = float((pose[0, :3, 3] - origin) @ z)
        alpha = float(np.arctan2(x_next @ np.cross(z, z_next), z @ z_next))
        theta = float(np.arctan2(z @ np.cross(x, x_next), x @ x_next))
        rows.append(DhRow(a, alpha, d, theta))
        x, z, origin = x_next, z_next, origin + d * z + a * x_next
    return rows


def _common_normal(
    origin: Array, x: Array, z: Array, point: Array, z_next: Array
) -> tuple[Array, float, float]:
    """The common normal of two axes: its direction, the nearer to x; d to it along z; length a."""
    away, across = point - origin, np.cross(z, z_next)
    parallel = bool(np.linalg.norm(across) < _PARALLEL)
    if parallel:
        across = away - (away @ z) * z
        if np.linalg.norm(across) < _PARALLEL:  # one line
            across = x
    normal = across / np.linalg.norm(across)
    normal = -normal if normal @ x < 0 else normal
    if parallel:
        return normal, 0.0, float(away @ normal)
    d, a, _ = np.linalg.solve(np.column_stack([z, normal, -z_next]), away).tolist()
    return normal, d, a
