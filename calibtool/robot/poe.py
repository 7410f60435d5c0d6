"""The product of exponentials itself (paper, Eq. 7), in numpy batches: the frames from which error columns are built."""

from dataclasses import dataclass

import numpy as np

from calibtool.robot.se3 import Array, exp6


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of a chain in K_0 for N configurations.

    before  (N, n, 4, 4) F0_j, after M_j and before joint j moves
    after   (N, n, 4, 4) F_j, after joint j has moved
    tool    (N, 4, 4) T_base_tool
    """

    before: Array
    after: Array
    tool: Array


def poe_frames(placements: Array, twists: Array, q: Array) -> Frames:
    """T(q) = Π_j M_j exp(ξ_j q_j) · M_{n+1} with every frame on the way.

    placements (n+1, 4, 4), twists (n, 6) in local frames, q (N, n) in rad or m.
    """
    count, n = q.shape
    before, after = np.empty((count, n, 4, 4)), np.empty((count, n, 4, 4))
    pose = np.broadcast_to(np.eye(4), (count, 4, 4))
    motions = exp6(twists * q[:, :, None])
    for j in range(n):
        before[:, j] = pose @ placements[j]
        pose = after[:, j] = before[:, j] @ motions[:, j]
    return Frames(before, after, pose @ placements[n])
