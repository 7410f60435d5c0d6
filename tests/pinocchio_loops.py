"""Closed loops by Pinocchio alone: the URDF as it is read, its frames, and the anchors of its
constraint models.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array


@dataclass(frozen=True)
class Anchored:
    """The tree of a robot and an anchor for every loop; joints by the names of the chain."""

    robot: Robot
    model: pin.Model
    anchors: list
    rows: list[tuple[int, ...]]

    @classmethod
    def of(cls, robot: Robot) -> "Anchored":
        model = pin.buildModelFromXML(robot.source.urdf_text)
        anchors, rows = [], []
        for loop, kept in zip(
            robot.source.description.kinematics.loops, robot.chain.tree.loops, strict=True
        ):
            a, b = (model.frames[model.getFrameId(name)] for name in loop.frames)
            kind = (
                pin.PointAnchorConstraintModel
                if loop.joint == "spherical"
                else pin.FrameAnchorConstraintModel
            )
            anchors.append(kind(model, a.parentJoint, a.placement, b.parentJoint, b.placement))
            rows.append(kept.rows)
        return cls(robot, model, anchors, rows)

    def coordinates(self, theta: Array) -> Array:
        """Coordinates (nq,) of the URDF's model from positions of the chain's joints (J,)."""
        q = np.zeros(self.model.nq)
        for name, value in zip(self.robot.chain.bodies.joints, theta, strict=True):
            q[self.model.joints[self.model.getJointId(name)].idx_q] = value
        return q

    @property
    def columns(self) -> list[int]:
        """Columns of the model for the joints of the chain."""
        ids = [self.model.getJointId(name) for name in self.robot.chain.bodies.joints]
        return [self.model.joints[j].idx_v for j in ids]

    def at(self, theta: Array) -> tuple[Array, Array, Array, Array]:
        """Tool pose, residuals, constraint Jacobian (m, J) of the kept rows, spatial tool Jacobian
        (6, J) in K_0.
        """
        data, q = self.model.createData(), self.coordinates(theta)
        pin.computeJointJacobians(self.model, data, q)
        pin.updateFramePlacements(self.model, data)
        residuals, jacobians = [], []
        for anchor, rows in zip(self.anchors, self.rows, strict=True):
            own = anchor.createData()
            anchor.calc(self.model, data, own)
            jacobian = pin.getConstraintJacobian(self.model, data, anchor, own)
            size = len(jacobian)
            kept = [row for row in rows if row < size]
            residuals.append(np.array(own.constraint_position_error)[kept])
            jacobians.append(jacobian[kept])
        tool = self.model.getFrameId(self.robot.source.description.kinematics.tool_frame)
        at_tool = pin.getFrameJacobian(self.model, data, tool, pin.WORLD)
        pose = data.oMf[tool].homogeneous
        return (
            pose,
            np.concatenate(residuals),
            np.concatenate(jacobians)[:, self.columns],
            at_tool[:, self.columns],
        )
