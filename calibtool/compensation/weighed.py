"""The weighted pose error: what corrections lower, and what they are judged by."""

from dataclasses import dataclass

import numpy as np

from calibtool.equivalent.joints import ELEMENTARY, EquivalentRobot
from calibtool.robot.mechanism import at_point
from calibtool.robot.se3 import Array, log3


def weighted_error(pose: Array, commanded: Array, length: float) -> Array:
    """e = ((p − p_c) / length, log3(R R_cᵀ)) in K_0, rad: displacement of the tool point, rotation.

    pose and commanded (N, 4, 4) T_base_tool, length (m) the robot's characteristic one: (N, 6).
    """
    turn = log3(pose[:, :3, :3] @ np.swapaxes(commanded[:, :3, :3], -1, -2))
    return np.concatenate([(pose[:, :3, 3] - commanded[:, :3, 3]) / length, turn], axis=-1)


def weighted_jacobian(jacobian: Array, pose: Array, length: float) -> Array:
    """∂e/∂q to first order: a spatial Jacobian in K_0 (N, 6, c) seen at the tool point of `pose`.

    pose (N, 4, 4), length in m as for `weighted_error`.
    """
    result = at_point(jacobian, pose[:, :3, 3])
    result[:, :3] /= length
    return result


@dataclass(frozen=True)
class Task:
    """The k = min(n, 6) components of a pose error that n joints can correct.

    All six for n ≥ 6, in K_0. For fewer joints those along the axes of the commanded tool that are
    no virtual joints of the equivalent robot.

    components   their indices among x, y, z, rx, ry, rz; None for all six
    """

    components: tuple[int, ...] | None

    @classmethod
    def of(cls, equivalent: EquivalentRobot) -> "Task":
        """The task of an equivalent robot."""
        if not equivalent.virtual_joints:
            return cls(None)
        return cls(tuple(i for i, name in enumerate(ELEMENTARY) if name not in equivalent.virtual_joints))

    def of_jacobian(self, jacobian: Array, commanded: Array) -> Array:
        """Rows of a weighted Jacobian (N, 6, c) in K_0 for commanded poses (N, 4, 4): (N, k, c)."""
        if self.components is None:
            return jacobian
        R_tool_base = np.swapaxes(commanded[:, :3, :3], -1, -2)
        turned = np.concatenate([R_tool_base @ jacobian[:, :3], R_tool_base @ jacobian[:, 3:]], axis=1)
        return turned[:, self.components]

    def of_error(self, error: Array, commanded: Array) -> Array:
        """Components of weighted errors (N, 6) in K_0 for commanded poses (N, 4, 4): (N, k)."""
        return error if self.components is None else self.of_jacobian(error[..., None], commanded)[..., 0]
