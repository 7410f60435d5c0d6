"""Geometric errors of a chain (METHOD §2) and the mechanism that has them, exact for finite motions."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibtool.robot.chain import SerialChain
from calibtool.robot.mechanism import Frames, Mechanism
from calibtool.robot.se3 import Array, exp6, inverse, log6, readonly


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
        return mechanism(chain, self).frames(q)


def mechanism(chain: SerialChain, errors: GeometricErrors) -> Mechanism:
    """The mechanism of a chain with geometric errors: placements edited, helical joints for twist errors, offsets."""
    return Mechanism.of(chain.bodies, errors.placements_of(chain), chain.twists + errors.twists, errors.offsets)


def relative_error(actual: Array, nominal: Array) -> Array:
    """Pose error δy = log6(T_actual · T_nominal⁻¹), a spatial twist in K_0 (Eqs. 9, 10): (…, 4, 4) → (…, 6)."""
    return log6(actual @ inverse(nominal))
