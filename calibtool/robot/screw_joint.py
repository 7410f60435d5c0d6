"""The motion exp(ξ q) of one joint as a Pinocchio joint, exact for any twist ξ."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
import pinocchio as pin

from calibtool.robot.se3 import Array, exp6, readonly

# m: an axis k metres away costs a pose k · 1e-16 m, and that of a slide is a kilometre away
_FARTHEST_AXIS = 10.0


@dataclass(frozen=True, eq=False)
class Screw:
    """exp(ξ q), ξ = (v, ω), with one coordinate per unit of q, or all six of a free joint.

    By Chasles' theorem it is a rotation by |ω| q about the axis ω/|ω| through r = ω × v/|ω|² with a
    translation of h = ω · v/|ω|² along it per rad: a revolute or a helical joint, placed at r.
    Without ω it is a slide. The axis of a slide with a small rotation is so far away that digits
    would be lost: it is a free joint whose coordinates are exp(ξ q) themselves.

    joint   the joint of Pinocchio
    shift   (3,) r, position of the model's joint frame in that of the chain, m; axes are parallel
    rates   (1,) or (6,) velocity of the model's coordinates per unit of q
    twist   (6,) ξ per rad or m, in the frame of the joint
    """

    joint: pin.JointModel
    shift: Array
    rates: Array
    twist: Array

    @classmethod
    def of(cls, twist: Array) -> Self:
        """The joint of a twist (6,), of any pitch and size but zero."""
        linear, angular = twist[:3], twist[3:]
        turn, speed = _length(angular), _length(linear)
        here, twist = readonly(np.zeros(3)), readonly(twist)
        if not turn:
            return cls(
                pin.JointModelPrismaticUnaligned(linear / speed), here, readonly([speed]), twist
            )
        across = np.cross(angular, linear) / turn**2
        if np.linalg.norm(across) > _FARTHEST_AXIS:
            return cls(pin.JointModelFreeFlyer(), here, twist, twist)
        pitch = float(angular @ linear) / turn**2
        return cls(_turning(angular / turn, pitch), readonly(across), readonly([turn]), twist)

    def __reduce__(self) -> tuple[Callable[[Array], "Screw"], tuple[Array]]:
        return Screw.of, (self.twist,)  # Pinocchio's joint cannot be pickled

    def coordinates(self, q: Array) -> Array:
        """The model's coordinates for joint positions q (N,), rad or m: (N, 1), or position and
        quaternion (N, 7).
        """
        if len(self.rates) == 1:
            return q[:, None] * self.rates
        position = exp6(self.twist * q[:, None])[:, :3, 3]
        turn = self.twist[3:] * q[:, None]
        half = np.linalg.norm(turn, axis=-1, keepdims=True) / 2
        return np.concatenate([position, turn * np.sinc(half / np.pi) / 2, np.cos(half)], axis=-1)


def _turning(axis: Array, pitch: float) -> pin.JointModel:
    """The Pinocchio joint about a unit vector (3,) with a pitch in m per rad."""
    if pitch:
        return pin.JointModelHelicalUnaligned(axis, pitch)
    for unit, model in zip(
        np.eye(3), (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ), strict=True
    ):
        if np.array_equal(axis, unit):
            return model()
    return pin.JointModelRevoluteUnaligned(axis)


def across(twists: Array) -> Array:
    """Two unit vectors across the axis of each twist (n, 6), in its frame: x and y for z. (n, 3,
    2)"""
    lines = np.where(twists[:, 3:].any(axis=-1, keepdims=True), twists[:, 3:], twists[:, :3])
    lines = lines / np.linalg.norm(lines, axis=-1, keepdims=True)
    # The next axis of the frame but one, cyclically, so that z gives x and then y.
    first = np.eye(3)[(np.abs(lines).argmax(axis=-1) + 1) % 3]
    first = first - (first * lines).sum(axis=-1, keepdims=True) * lines
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(lines, first)], axis=-1)


def _length(vector: Array) -> float:
    """|v| of (3,), exactly 1 for a unit vector that is rounded."""
    length = float(np.linalg.norm(vector))
    return 1.0 if abs(length - 1.0) < 1e-15 else length
