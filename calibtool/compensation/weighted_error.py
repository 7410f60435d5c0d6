"""The components of the weighted pose error that corrections reduce."""

from dataclasses import dataclass

import numpy as np

from calibtool.equivalent.joints import ELEMENTARY, EquivalentRobot
from calibtool.errors import UsageError
from calibtool.robot.se3 import Array

Weights = tuple[float, ...]


@dataclass(frozen=True)
class Task:
    """The components of a pose error that a correction removes.

    All six for n ≥ 6, in K_0. For fewer joints n components along the axes of the commanded tool:
    those that are not virtual joints of the equivalent robot, or those with a weight.

    With closed loops the components that are not virtual joints are solved alone, so that a tilt
    that no joint can correct does not affect the others.

    components   their indices among x, y, z, rx, ry, rz; None for all six
    weights      their weights; None for 1 each
    alone        the other components are ignored
    """

    components: tuple[int, ...] | None
    weights: Weights | None = None
    alone: bool = False

    @classmethod
    def of(cls, equivalent: EquivalentRobot, weights: Weights | None = None) -> "Task":
        """The task of an equivalent robot; weights of x, y, z, rx, ry, rz make another one.

        Raises UsageError for weights that are not six finite ones ≥ 0, n or more of them positive,
        and for weights where six joints or more can correct all components.
        """
        if weights is None:
            if not equivalent.virtual_joints:
                return cls(None)
            virtual = equivalent.virtual_joints
            components = tuple(i for i, name in enumerate(ELEMENTARY) if name not in virtual)
            return cls(components, alone=equivalent.loops)
        n = equivalent.n
        if n >= 6:
            raise UsageError(f"weights are for robots with fewer than six joints; this one has {n}")
        if len(weights) != 6 or not all(0.0 <= weight < np.inf for weight in weights):
            raise UsageError(
                "weights are six numbers, not negative, for x, y, z, rx, ry, rz of the tool, "
                "for example 1,1,1,0,0,1"
            )
        components = tuple(i for i, weight in enumerate(weights) if weight > 0.0)
        if len(components) < n:
            raise UsageError(
                f"{len(components)} weights are positive, but {n} joints need {n} or more"
            )
        return cls(components, tuple(weights[i] for i in components))

    @property
    def is_part(self) -> bool:
        """Whether the pose error has more components than the task, and these count."""
        return self.components is not None and self.weights is None and not self.alone

    def of_jacobian(self, jacobian: Array, commanded: Array) -> Array:
        """Rows of a weighted Jacobian (N, 6, c) in K_0 for commanded poses (N, 4, 4): (N, k, c)."""
        if self.components is None:
            return jacobian
        R_tool_base = np.swapaxes(commanded[:, :3, :3], -1, -2)
        turned = np.concatenate(
            [R_tool_base @ jacobian[:, :3], R_tool_base @ jacobian[:, 3:]], axis=1
        )
        rows: Array = turned[:, self.components]
        return rows if self.weights is None else rows * np.array(self.weights)[:, None]

    def of_error(self, error: Array, commanded: Array) -> Array:
        """Components of weighted errors (N, 6) in K_0 for commanded poses (N, 4, 4): (N, k)."""
        if self.components is None:
            return error
        return self.of_jacobian(error[..., None], commanded)[..., 0]

    def products(self, a: Array, b: Array, commanded: Array) -> Array:
        """a·b of weighted errors (N, 6): of the task and, where it is a part, of all; (1|2, N)."""
        of_task = (self.of_error(a, commanded) * self.of_error(b, commanded)).sum(axis=-1)
        return np.stack([of_task, (a * b).sum(axis=-1)]) if self.is_part else of_task[None]
