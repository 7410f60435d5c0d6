"""A robot with geometric errors as a Pinocchio model: a second way to its poses and Jacobians."""

import numpy as np
import pinocchio as pin

from calibtool.robot.chain import SerialChain
from calibtool.robot.geometry import GeometricErrors
from calibtool.robot.se3 import Array, translation


class PinocchioChain:
    """Chasles: exp(ξ' q), ξ' = (v, ω), is a helical joint about the axis ω/|ω| through r = ω × v/|ω|², driven by |ω| q.

    `farthest` (m) is |r| of the farthest axis: some 1e-16 of it is lost in every pose.
    """

    def __init__(self, chain: SerialChain, errors: GeometricErrors) -> None:
        self.model, self.offsets, self.farthest = pin.Model(), errors.offsets, 0.0
        self.factors = np.ones(len(chain.twists))
        pending = np.eye(4)  # what the next joint has to take back
        placements = errors.placements_of(chain)
        for j, (linear, angular) in enumerate((chain.twists + errors.twists).reshape(-1, 2, 3)):
            turn, r = float(np.linalg.norm(angular)), np.zeros(3)
            if turn > 0.0:
                r = np.cross(angular, linear) / turn**2
                joint = pin.JointModelHelicalUnaligned(angular / turn, float(angular @ linear) / turn**2)
            else:
                joint = pin.JointModelPrismaticUnaligned(linear / np.linalg.norm(linear))
            self.factors[j] = turn if turn > 0.0 else np.linalg.norm(linear)
            self.model.addJoint(j, joint, pin.SE3(pending @ placements[j] @ translation(r)), f"joint_{j}")
            pending = translation(-r)
            self.farthest = max(self.farthest, float(np.linalg.norm(r)))
        self.tool = pending @ placements[-1]
        self.data = self.model.createData()

    def forward_and_jacobian(self, q: Array) -> tuple[Array, Array]:
        """T_base_tool (4, 4) and the spatial Jacobian (6, n) for q (n,)."""
        J = pin.computeJointJacobians(self.model, self.data, self.factors * (q + self.offsets)).reshape(6, -1)
        pose = self.data.oMi[self.model.njoints - 1].homogeneous @ self.tool
        return pose, J * self.factors
