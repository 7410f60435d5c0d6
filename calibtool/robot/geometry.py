"""Geometric errors of a chain (METHOD §2) and the mechanism that has them, exact for finite motions."""

from dataclasses import dataclass
from typing import Self

import numpy as np
import pinocchio as pin

from calibtool.robot.chain import SerialChain
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.poe import Frames, poe_frames
from calibtool.robot.se3 import Array, exp6, inverse, log6, readonly, translation

# Below this rotation per unit of motion a screw axis lies so far away that cancellation costs more than 1e-9 m.
_NEARLY_TRANSLATION = 1e-6


@dataclass(frozen=True, eq=False)
class GeometricErrors:
    """The three families of Eq. 8.

    placements  (n+1, 6) δζ_j: M_j ← M_j exp6(δζ_j); m and rad, in the frame of joint j, last row the tool
    twists      (n, 6) δξ_j: exp((ξ_j + δξ_j) q_j); per rad or m of joint motion, in the frame of joint j
    offsets     (n,) δq_j in rad or m
    """

    placements: Array
    twists: Array
    offsets: Array

    @classmethod
    def none(cls, n: int) -> Self:
        """No error at all, for n joints."""
        return cls(readonly(np.zeros((n + 1, 6))), readonly(np.zeros((n, 6))), readonly(np.zeros(n)))

    def placements_of(self, chain: SerialChain) -> Array:
        """M_j exp6(δζ_j): (n+1, 4, 4)."""
        return chain.placements @ exp6(self.placements)

    def moved_placements(self, step: Array) -> Self:
        """The errors after a further right perturbation of the placements, exp6(δζ) exp6(step): step (n+1, 6)."""
        placements = readonly(log6(exp6(self.placements) @ exp6(step)))
        return type(self)(placements, self.twists, self.offsets)

    def frames(self, chain: SerialChain, q: Array) -> Frames:
        """Frames of the chain with these errors, q (N, n) (Eq. 7)."""
        return poe_frames(self.placements_of(chain), chain.twists + self.twists, q + self.offsets)


def mechanism(chain: SerialChain, errors: GeometricErrors | None = None) -> Mechanism:
    """The Pinocchio mechanism of a chain with geometric errors, made by editing joint placements and joint types."""
    n = len(chain.twists)
    if errors is None:
        errors = GeometricErrors.none(n)
    placements = errors.placements_of(chain)
    model = pin.Model()
    model.name = chain.model.name
    model.gravity = chain.model.gravity
    rows: list[tuple[int, float]] = []  # (joint position that drives it, factor) of every model coordinate
    pending = np.eye(4)  # un-placement that the next joint has to absorb
    parent = 0
    for j in range(n):
        motion = _motion(chain.model.joints[j + 1], chain.twists[j], errors.twists[j])
        pending = pending @ placements[j] @ translation(motion.origin)
        for joint, factor in motion.joints:
            parent = model.addJoint(parent, joint, pin.SE3(pending), f"{chain.model.names[j + 1]}.{len(rows)}")
            pending = np.eye(4)
            rows.append((j, factor))
        pending = translation(-motion.origin)
        model.appendBodyToJoint(parent, chain.model.inertias[j + 1], pin.SE3(pending))
    drive = np.zeros((len(rows), n))
    for row, (j, factor) in enumerate(rows):
        drive[row, j] = factor
    tool = pending @ placements[n]
    return Mechanism(model, readonly(tool), readonly(drive), readonly(drive @ errors.offsets))


@dataclass(frozen=True)
class _Motion:
    """exp(ξ' q) as Pinocchio joints standing at `origin`: each is driven by factor · q."""

    origin: Array
    joints: list[tuple[pin.JointModel, float]]


def _motion(nominal: pin.JointModel, twist: Array, error: Array) -> _Motion:
    if not error.any():
        return _Motion(np.zeros(3), [(nominal, 1.0)])
    linear, angular = (twist + error)[:3], (twist + error)[3:]
    speed, turn = float(np.linalg.norm(linear)), float(np.linalg.norm(angular))
    if turn > _NEARLY_TRANSLATION * max(speed, 1.0):
        # Chasles: a screw of pitch h about the axis a through r.
        axis = angular / turn
        pitch = float(angular @ linear) / turn**2
        return _Motion(np.cross(angular, linear) / turn**2, [(pin.JointModelHelicalUnaligned(axis, pitch), turn)])
    slide = (pin.JointModelPrismaticUnaligned(linear / speed), speed)
    if turn == 0.0:
        return _Motion(np.zeros(3), [slide])
    # Half the turn, the slide, half the turn: differs from exp6 by the square of the (tiny) turn only.
    half = (pin.JointModelRevoluteUnaligned(angular / turn), turn / 2)
    return _Motion(np.zeros(3), [half, slide, half])


def relative_error(actual: Array, nominal: Array) -> Array:
    """Pose error δy = log6(T_actual · T_nominal⁻¹), a spatial twist in K_0 (Eqs. 9, 10): (…, 4, 4) → (…, 6)."""
    return log6(actual @ inverse(nominal))
