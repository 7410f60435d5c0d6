"""The equivalent robot (Eqs. 12–17): actuated and virtual joints, and its Jacobian J_ρ."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.description import VirtualJoint
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, adjoint
from calibtool.robot.singularity import at_point, singularity_distance

ELEMENTARY: tuple[VirtualJoint, ...] = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class EquivalentRobot:
    """A robot whose only errors are joint motion errors δρ = (actuated, virtual), p = max(n, 6) of
    them.

    virtual_joints   elementary twists fixed in the tool frame, 6 − n of them (none for n ≥ 6);
                     their nominal value is zero
    loops            the robot has closed loops
    """

    n: int
    virtual_joints: tuple[VirtualJoint, ...]
    loops: bool = False

    @property
    def p(self) -> int:
        """Number of joint motion errors."""
        return self.n + len(self.virtual_joints)

    @property
    def virtual_columns(self) -> list[int]:
        """Indices of the columns of Ad(T_base_tool) that belong to the virtual joints."""
        return [ELEMENTARY.index(name) for name in self.virtual_joints]

    def forward_and_jacobian(self, mechanism: Mechanism, q: Array) -> tuple[Array, Array]:
        """T_base_tool (N, 4, 4) and J_ρ (N, 6, p) in K_0 (Eq. 14) for q (N, n), rad or m."""
        pose, jacobian = mechanism.forward_and_jacobian(q)
        if not self.virtual_joints:
            return pose, jacobian
        return pose, np.concatenate([jacobian, adjoint(pose)[:, :, self.virtual_columns]], axis=-1)


@lru_cache(maxsize=16)  # a robot does not change; it is hashed by identity
def equivalent_robot(robot: Robot) -> EquivalentRobot:
    """Equivalent robot of a description, with the virtual joints that it names or the best ones.

    The best ones maximise the smallest `singularity_distance` of J_ρ over 200 fixed configurations
    of the default workspace.
    """
    loops = robot.chain.tree is not None
    if robot.n >= 6:
        return EquivalentRobot(robot.n, (), loops)
    override = robot.source.description.equivalent
    if override is not None:
        return EquivalentRobot(robot.n, tuple(override.virtual_joints), loops)
    workspace = robot.workspace()
    q = sample_configurations(robot, workspace, 200, np.random.default_rng(0))

    def worst(names: tuple[VirtualJoint, ...]) -> float:
        pose, jacobian = EquivalentRobot(robot.n, names).forward_and_jacobian(robot.mechanism, q)
        return float(singularity_distance(at_point(jacobian, pose[:, :3, 3]), robot.length).min())

    return EquivalentRobot(robot.n, max(combinations(ELEMENTARY, 6 - robot.n), key=worst), loops)
