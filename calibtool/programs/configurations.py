"""Configuration data of controllers: the branch of the inverse kinematics and the turns of a pose.

Posture and joint values are those of the nominal robot, as the controller defines them:

- front    the wrist centre is on the side of axis 1 to which the base's x axis has turned
- bent     joint 3 is up to half a turn beyond the stretched arm, in its positive direction
- flexed   joint 5 is positive
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6

_BORDER = np.deg2rad(0.01)  # a joint so near to the border of two turns may be called either


@dataclass(frozen=True)
class Posture:
    """The branch of a six-joint arm with a wrist, see above."""

    front: bool
    bent: bool
    flexed: bool


@dataclass(frozen=True, slots=True)
class Digit:
    """An integer of the configuration data and its place in the text."""

    start: int
    end: int
    value: int


class Configuration(Protocol):
    """The branch and turns that configuration data require of joint positions.

    q (n,) are the controller's joint values in rad. `zero` is the posture with all of them zero.
    """

    @property
    def text(self) -> str:
        """As the program writes it."""

    def branch(self, posture: Posture, zero: Posture) -> bool:
        """Whether this is the branch that is meant."""

    def turns(self, q: Array) -> bool:
        """Whether the joints are in the turns that are meant."""

    def digits(self, q: Array) -> list[tuple[Digit, int]]:
        """Integers that have to change, with new values, after a correction to another turn."""


@dataclass(frozen=True, slots=True)
class Fanuc:
    """`N U T, 0, 0, 0`: wrist no-flip or flip, elbow up or down, top (front) or bottom (back), and
    the turns of three joints.

    N: the wrist is bent as with J5 = −90 deg; U: the elbow as at the zero position; T: the wrist is
    in front of axis 1. Turn k of a joint is the range from 360 k − 180 to 360 k + 180 deg; a
    missing number is 0. axes: the joints that the turns count, from 0, see $TURN_AXIS.
    """

    flip: str
    elbow: str
    side: str
    numbers: tuple[Digit, ...] = ()
    axes: tuple[int, ...] = (0, 3, 5)

    @property
    def text(self) -> str:
        return f"{self.flip} {self.elbow} {self.side}, {', '.join(map(str, self._turns))}"

    @property
    def _turns(self) -> list[int]:
        written = [number.value for number in self.numbers[: len(self.axes)]]
        return written + [0] * (len(self.axes) - len(written))

    def branch(self, posture: Posture, zero: Posture) -> bool:
        return (
            (self.flip == "N") == (not posture.flexed)
            and (self.elbow == "U") == (posture.bent == zero.bent)
            and (self.side == "T") == posture.front
        )

    def turns(self, q: Array) -> bool:
        away = q[list(self.axes)] - 2 * np.pi * np.array(self._turns)
        return bool((np.abs(away) <= np.pi + _BORDER).all())

    def digits(self, q: Array) -> list[tuple[Digit, int]]:
        here = np.floor((q[list(self.axes)] + np.pi) / (2 * np.pi)).astype(int).tolist()
        pairs = zip(self.numbers, here, strict=False)
        return [(number, turn) for number, turn in pairs if turn != number.value]


@dataclass(frozen=True, slots=True)
class Kuka:
    """`S` and `T` of a POS or E6POS. Either may be missing.

    S: bit 0 overhead area, bit 1 axis 3 beyond the stretched arm, bit 2 A5 < 0. T: bit k − 1 is set
    where axis k is negative.
    """

    status: int | None
    turn: Digit | None

    @property
    def text(self) -> str:
        parts = [] if self.status is None else [f"S {self.status}"]
        return ", ".join(parts if self.turn is None else [*parts, f"T {self.turn.value}"])

    def branch(self, posture: Posture, zero: Posture) -> bool:
        if self.status is None:
            return True
        bits = (not posture.front) | posture.bent << 1 | (not posture.flexed) << 2
        return (self.status & 7) == bits

    def turns(self, q: Array) -> bool:
        if self.turn is None:
            return True
        negative = np.array([bool(self.turn.value >> k & 1) for k in range(len(q))])
        return bool(np.all(np.where(negative, q <= _BORDER, q >= -_BORDER)))

    def digits(self, q: Array) -> list[tuple[Digit, int]]:
        if self.turn is None:
            return []
        kept = self.turn.value >> len(q) << len(q)
        value = kept | sum(1 << k for k, angle in enumerate(q) if angle < 0)
        return [] if value == self.turn.value else [(self.turn, value)]


@dataclass(frozen=True, slots=True)
class Abb:
    """`[cf1,cf4,cf6,cfx]`: quadrants of axes 1, 4 and 6; cfx: 4 behind axis 1, 2 behind the lower
    arm, 1 axis 5 negative.

    Robots for which the quadrants decide keep cfx at 0; it is compared only where it is not zero.
    """

    quadrants: tuple[Digit, Digit, Digit]
    cfx: int

    @property
    def text(self) -> str:
        return f"[{','.join(str(digit.value) for digit in self.quadrants)},{self.cfx}]"

    def branch(self, posture: Posture, zero: Posture) -> bool:
        behind_arm = posture.bent != zero.bent
        number = (not posture.front) << 2 | behind_arm << 1 | (not posture.flexed)
        return self.cfx == 0 or self.cfx == number

    def turns(self, q: Array) -> bool:
        return all(_in_quadrant(q[k], digit.value) for k, digit in self._axes())

    def digits(self, q: Array) -> list[tuple[Digit, int]]:
        here = [(digit, int(np.floor(q[k] / (np.pi / 2)))) for k, digit in self._axes()]
        return [(digit, quadrant) for digit, quadrant in here if quadrant != digit.value]

    def _axes(self) -> list[tuple[int, Digit]]:
        return list(zip((0, 3, 5), self.quadrants, strict=True))


def _in_quadrant(angle: float, quadrant: int) -> bool:
    low = quadrant * np.pi / 2
    return bool(low - _BORDER <= angle <= low + np.pi / 2 + _BORDER)


def postures(robot: Robot, q: Array, q_controller: Array) -> np.ndarray:
    """The branches of joint positions q (N, n) of a six-joint arm: (N, 3) bool, front, bent and
    flexed.

    q_controller (N, n): the controller's joint values. The wrist centre is the origin of joint 5 of
    the arm. Where the arm stands on a track or a turntable, its base's x axis turns with that.
    """
    frames, here = [], np.broadcast_to(np.eye(4), (len(q), 4, 4))
    before_arm = here
    for j in range(robot.arm[4] + 1):
        here = here @ robot.chain.placements[j]
        if j in robot.arm:
            frames.append(here)
        here = here @ exp6(robot.chain.twists[j] * q[:, j, None])
        if j < robot.arm[0]:
            before_arm = here
    points = [frame[:, :3, 3] for frame in frames]
    first, third = robot.arm[0], robot.arm[2]
    axis_1 = frames[0][:, :3, :3] @ robot.chain.twists[first][3:]
    axis_3 = frames[2][:, :3, :3] @ robot.chain.twists[third][3:]
    turned = exp6(np.concatenate([np.zeros_like(axis_1), axis_1 * q[:, first, None]], axis=-1))
    turned_x = (turned[:, :3, :3] @ before_arm[:, :3, :1])[..., 0]
    wrist = points[4]
    normal = np.cross(points[2] - points[1], wrist - points[2])
    front = ((wrist - points[0]) * turned_x).sum(axis=-1) >= 0.0
    bent = (axis_3 * normal).sum(axis=-1) >= 0.0
    flexed: np.ndarray = np.sin(q_controller[:, robot.arm[4]]) >= 0.0
    return np.stack([front, bent, flexed], axis=-1)


def posture(robot: Robot, q: Array, q_controller: Array) -> Posture:
    """The branch of joint positions q (n,), see `postures`."""
    front, bent, flexed = postures(robot, q[None], q_controller[None])[0]
    return Posture(bool(front), bool(bent), bool(flexed))


def has_postures(robot: Robot) -> bool:
    """Whether configuration data of six-joint arms can be read for this robot."""
    serial = robot.chain.tree is None
    return serial and len(robot.arm) == 6 and not any(robot.prismatic[j] for j in robot.arm)
