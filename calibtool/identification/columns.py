"""Error columns: the derivatives of the pose error by every geometric error (Eq. 10), exact for finite joint motions.

Every block is ∂δy/∂(errors) with δy the spatial twist of `relative_error` in K_0; rows are (v, ω) in m and rad. Blocks are
taken at the frames given, so that an iteration can linearise where it stands.
"""

import numpy as np

from calibtool.robot.mechanism import Frames
from calibtool.robot.se3 import Array, adjoint, left_jacobian


def placement_columns(frames: Frames) -> Array:
    """δζ_j, j = 1…n+1: Ad(F0_j), the last block Ad(T_base_tool). (N, 6, 6n+6)"""
    blocks = np.concatenate([adjoint(frames.before), adjoint(frames.tool)[:, None]], axis=1)
    count, joints = blocks.shape[:2]
    return np.moveaxis(blocks, 1, 2).reshape(count, 6, 6 * joints)


def twist_columns(frames: Frames, twists: Array, q: Array) -> Array:
    """δξ_j, j = 1…n: Ad(F0_j) · J_l(ξ_j q_j) · q_j, of which the paper's Ad_j q_j is the first order. (N, 6, 6n)

    twists (n, 6) ξ_j in the joint's frame, q (N, n) in rad or m.
    """
    count, n = q.shape
    blocks = adjoint(frames.before) @ left_jacobian(twists, q) * q[:, :, None, None]
    return np.moveaxis(blocks, 1, 2).reshape(count, 6, 6 * n)


def offset_columns(frames: Frames, twists: Array) -> Array:
    """δq_j, j = 1…n: Ad(F_j) ξ_j, which is also the spatial Jacobian. (N, 6, n)"""
    return np.moveaxis((adjoint(frames.after) @ twists[:, :, None])[..., 0], 1, 2)
