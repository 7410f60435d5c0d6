"""How large errors are expected to be: the prior of the complete model."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations that the errors are expected to have, SI; those of single joints
    override the rest.

    length, angle  elements of δζ, δξ, δq: m and rad
    of             by family id, where the family's own default does not hold; in the family's unit
                   for people over 1000
    joints         (joint from 0, length, angle)
    """

    length: float = 1e-3
    angle: float = 1e-3
    of: dict[str, float] = field(default_factory=dict)
    joints: tuple[tuple[int, float, float], ...] = ()

    @classmethod
    def of_robot(cls, robot: Robot) -> Self:
        """The tolerances in a robot's description."""
        table = robot.source.description.tolerances
        return cls(
            length=table.length_mm * 1e-3,
            angle=table.angle_mrad * 1e-3,
            of={
                "harmonics": table.harmonic_mrad * 1e-3,
                "gravity": table.gravity_mrad * 1e-3,
                "backlash": table.backlash_mrad * 1e-3,
            },
            joints=tuple(
                (int(j[1:]) - 1, t.length_mm * 1e-3, t.angle_mrad * 1e-3)
                for j, t in table.joints.items()
            ),
        )

    def elements(self, n: int) -> Array:
        """Six elements of a geometric error per joint and tool: (n+1, 6), m and rad."""
        length, angle = np.full(n + 1, self.length), np.full(n + 1, self.angle)
        for joint, joint_length, joint_angle in self.joints:
            length[joint], angle[joint] = joint_length, joint_angle
        return np.repeat(np.stack([length, angle], axis=-1), 3, axis=-1)

    def offsets(self, robot: Robot) -> Array:
        """Of the joint offsets (n,), rad or m."""
        elements = self.elements(robot.n)[: robot.n]
        return np.where(robot.prismatic, elements[:, 0], elements[:, 3])
