"""Structure of a mechanism with closed loops: a tree, the cut frames that join it to loops, mimic
joints.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from calibtool.robot.se3 import Array

# Components of the relative twist of frame B against A, in the axes of A, that a cut joint forbids.
FORBIDDEN: dict[str, tuple[int, ...]] = {
    "weld": (0, 1, 2, 3, 4, 5),
    "revolute": (0, 1, 2, 3, 4),  # about z of A
    "prismatic": (0, 1, 3, 4, 5),  # along z of A
    "cylindrical": (0, 1, 3, 4),
    "spherical": (0, 1, 2),
    "planar": (0, 1),  # a revolute joint of a planar loop, of which the plane sees x and y of A
}


@dataclass(frozen=True)
class Loop:
    """Two frames, A and B, that a cut joint joins.

    rows   components of `FORBIDDEN` that are kept as equations, see `closed_chain.reduced`
    """

    name: str
    joint: str
    rows: tuple[int, ...]


@dataclass(frozen=True)
class Follower:
    """A mimic joint: θ_joint = factor · θ_leader + offset, rad or m. Joints by their number in the
    chain, from 0.
    """

    joint: int
    leader: int
    factor: float
    offset: float


@dataclass(frozen=True, eq=False)
class Tree:
    """J joints, numbered: n actuated ones in the order of q, p passive ones, then idle ones that do
    not move.

    parents      (J,) the previous joint, −1 for the base
    carriers     (2L,) the joint of each cut frame: A and B of the first loop, of the second …
    tool         the joint of the tool
    n, p         numbers of actuated and of passive joints; p is the number of equations
    loops        (L) the cut joints
    followers    mimic joints, which are passive
    closed_at    (J,) a closed configuration, rad or m: the assembly mode
    lower, upper (J,) limits of the joints, rad or m
    slides       (J,) prismatic joints
    length       characteristic length, m
    """

    parents: tuple[int, ...]
    carriers: tuple[int, ...]
    tool: int
    n: int
    p: int
    loops: tuple[Loop, ...]
    followers: tuple[Follower, ...]
    closed_at: Array
    lower: Array
    upper: Array
    slides: np.ndarray
    length: float

    @property
    def joints(self) -> int:
        """J."""
        return len(self.parents)

    @property
    def passive(self) -> slice:
        """The passive joints among all."""
        return slice(self.n, self.n + self.p)

    @cached_property
    def order(self) -> list[int]:
        """The joints, each after its parent."""
        order: list[int] = []
        waiting = list(range(self.joints))
        while waiting:
            ready = [j for j in waiting if self.parents[j] < 0 or self.parents[j] in order]
            order += ready
            waiting = [j for j in waiting if j not in ready]
        return order

    def support(self, joint: int) -> Array:
        """Which joints move the frame of a joint: (J,) of 0 and 1."""
        moves = np.zeros(self.joints)
        while joint >= 0:
            moves[joint] = 1.0
            joint = self.parents[joint]
        return moves

    @cached_property
    def tool_support(self) -> Array:
        """Which joints move the tool as a tree: (J,)."""
        return self.support(self.tool)

    @cached_property
    def signs(self) -> Array:
        """σ_ℓ(i) (L, J) of loop ℓ: 1 where joint i moves frame B alone, −1 where A alone."""
        pairs = zip(self.carriers[::2], self.carriers[1::2], strict=True)
        return np.array([self.support(b) - self.support(a) for a, b in pairs]).reshape(
            -1, self.joints
        )

    @cached_property
    def row_signs(self) -> Array:
        """The signs of the loop of every geometric equation: (m, J)."""
        return np.repeat(self.signs, [len(loop.rows) for loop in self.loops], axis=0)

    @cached_property
    def row_blocks(self) -> list[slice]:
        """The equations of every loop."""
        ends = np.cumsum([0, *(len(loop.rows) for loop in self.loops)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    @cached_property
    def row_scale(self) -> Array:
        """Factor that converts an equation to rad: 1/length for a translation (p,)."""
        rows = [1.0 / self.length if row < 3 else 1.0 for loop in self.loops for row in loop.rows]
        rows += [1.0 / self.length if self.slides[f.joint] else 1.0 for f in self.followers]
        return np.array(rows)

    @cached_property
    def joint_scale(self) -> Array:
        """A motion of one rad in the unit of each joint: the length for a slide, 1 for a rotation
        (J,).
        """
        return np.where(self.slides, self.length, 1.0)

    @property
    def placed_on(self) -> tuple[int, ...]:
        """The joint of each placement: of the joints, of the cut frames, of the tool; −1 for the
        base.
        """
        return (*self.parents, *self.carriers, self.tool)
