"""The plain product of exponentials (Eq. 7) by scipy's matrix exponential: an independent way to
every frame of a chain.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array


@dataclass(frozen=True, eq=False)
class PlainFrames:
    """before, after (N, n, 4, 4) each joint has moved, and the tool (N, 4, 4), in K_0."""

    before: Array
    after: Array
    tool: Array


def poe_frames(placements: Array, twists: Array, q: Array) -> PlainFrames:
    """T(q) = Π_j M_j exp(ξ_j q_j) · M_{n+1} with every frame on the way, with nothing of
    the package in it.
    """
    vx, vy, vz, wx, wy, wz = np.moveaxis(twists, -1, 0)
    o = np.zeros(len(twists))
    hats = np.array([[o, -wz, wy, vx], [wz, o, -wx, vy], [-wy, wx, o, vz], [o, o, o, o]])
    before, after = (np.empty((*q.shape, 4, 4)) for _ in range(2))
    pose = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for j in range(len(twists)):
        before[:, j] = pose @ placements[j]
        pose = after[:, j] = before[:, j] @ expm(hats[..., j] * q[:, j, None, None])
    return PlainFrames(before, after, pose @ placements[-1])


def expm_chain(placements: Array, twists: Array, q: Array) -> Array:
    """T_base_tool of the plain product: (N, 4, 4)."""
    return poe_frames(placements, twists, q).tool


def random_positions(robot: Robot, rng: np.random.Generator, count: int) -> Array:
    """Uniform joint positions within the limits, (count, n) rad or m."""
    return robot.lower + (robot.upper - robot.lower) * rng.random((count, robot.n))
