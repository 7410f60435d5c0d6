"""A serial chain between frames whose z axes are the joints' axes."""

import numpy as np

from calibtool.robot.se3 import Array, inverse

_SMALL = 1e-12


def placements_between_z(placements: Array, twists: Array) -> Array:
    """P (n+1, 4, 4) of Π_j P_j J_j(q_j) · P_{n+1}, J_j a turn about z or a slide along it.

    placements, twists as `SerialChain` has them, of unit pitch-free twists. A turning joint's frame
    stands on its axis, at the point nearest to the frame of the chain.
    """
    result, before = [], np.eye(4)
    for placement, twist in zip(placements, twists, strict=False):
        turns = bool(np.linalg.norm(twist[3:]) > 0.5)
        at = np.eye(4)
        at[:3, :3] = turn_z_to(twist[3:] if turns else twist[:3])
        at[:3, 3] = np.cross(twist[3:], twist[:3]) if turns else 0.0
        result.append(inverse(before) @ placement @ at)
        before = at
    result.append(inverse(before) @ placements[-1])
    return np.array(result)


def turn_z_to(axis: Array) -> Array:
    """The smallest rotation that takes z to a unit vector; about x where that is −z. (3, 3)"""
    x, y, z = axis
    if z < -1.0 + _SMALL:
        return np.diag([1.0, -1.0, -1.0])
    return np.array(
        [
            [1.0 - x * x / (1.0 + z), -x * y / (1.0 + z), x],
            [-x * y / (1.0 + z), 1.0 - y * y / (1.0 + z), y],
            [-x, -y, z],
        ]
    )
