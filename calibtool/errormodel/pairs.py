"""Functions of pairs of joints: a structure bends with two joints together, for example where the
stiffness of an arm depends on how far it reaches.
"""

import numpy as np

from calibtool.errormodel.family import (
    JointFunctions,
    Rows,
    Sizes,
    joint_list,
    sections_of_joints,
)
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

_WAVES = ("sin+", "cos+", "sin-", "cos-")  # of q_k + q_l and of q_k − q_l


class Pairs(JointFunctions):
    """δq_j = Σ_k<l a sin(q_k + q_l) + b cos(q_k + q_l) + c sin(q_k − q_l) + d cos(q_k − q_l), in
    rad, for all pairs of joints in the order (1, 2), (1, 3) … : (n, 2 n (n − 1)).

    Only residuals that need them give a joint these functions (`identification/fine_structure.py`).
    Zero for and of prismatic joints, and in closed loops.
    """

    id, symbol, ascii, kind = "pairs", "pair", "pair", "gear"
    words, unit, size = "functions of pairs of joints", "rad", 0.0
    expected = 0.3e-3
    meaning = "sin and cos of q_k + q_l and of q_k − q_l, of δq"
    orders = (0,)
    grows = False

    def shape(self, n: int, order: int = 1) -> tuple[int, ...]:
        return (n, 2 * n * (n - 1) if order else 0)

    def order(self, shape: tuple[int, ...]) -> int:
        return int(shape[1] > 0)

    def free(self, robot: Robot, shape: tuple[int, ...]) -> np.ndarray:
        turns = ~np.array(robot.prismatic) & (robot.chain.tree is None)
        first, second = _pairs(robot.n)
        both = np.repeat(turns[first] & turns[second], len(_WAVES))
        free: np.ndarray = (turns[:, None] & both)[:, : shape[1]]
        return free

    def names(self, shape: tuple[int, ...], symbol: str) -> list[str]:
        pairs = list(zip(*_pairs(shape[0]), strict=True)) if shape[1] else []
        return [
            f"{symbol}{j + 1}.{wave[:3]}(q{first + 1}{wave[3]}q{second + 1})"
            for j in range(shape[0])
            for first, second in pairs
            for wave in _WAVES
        ]

    def sections(self, shape: tuple[int, ...]) -> np.ndarray:
        return sections_of_joints(shape)

    def groups(self, shape: tuple[int, ...]) -> np.ndarray:
        return sections_of_joints(shape)

    def fine(self, shape: tuple[int, ...]) -> np.ndarray:
        return np.ones(shape, dtype=bool)

    def display(self, robot: Robot, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
        return np.full(shape, 1e3), ["mrad"] * (shape[0] * shape[1])

    def describe(self, robot: Robot, value: Array, free: np.ndarray) -> str:
        return f"functions of pairs of joints on {joint_list(free)}"

    def functions(self, shape: tuple[int, ...], rows: Rows) -> Array:
        """The same for every joint: (N, n, k)."""
        waves = pair_functions(rows.q)[:, : shape[1]]
        return np.broadcast_to(waves[:, None], (len(waves), shape[0], waves.shape[1]))

    def motion(self, value: Array, rows: Rows) -> Array | float:
        return pair_functions(rows.q) @ value.T if value.any() else 0.0

    def resized(self, value: Array, shape: tuple[int, ...]) -> Array:
        return value if value.shape == shape else np.zeros(shape)

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        """None: a simulated gear depends on its own joint."""
        return np.zeros(self.shape(robot.n, 0))


def pair_functions(q: Array) -> Array:
    """sin(q_k + q_l), cos(q_k + q_l), sin(q_k − q_l), cos(q_k − q_l) of every pair: q (N, n) →
    (N, 2 n (n − 1)).
    """
    first, second = _pairs(q.shape[1])
    both, between = q[:, first] + q[:, second], q[:, first] - q[:, second]
    waves = [np.sin(both), np.cos(both), np.sin(between), np.cos(between)]
    return np.stack(waves, axis=-1).reshape(len(q), 4 * len(first))


def _pairs(n: int) -> tuple[np.ndarray, np.ndarray]:
    """First and second joints of all pairs, from zero."""
    return np.triu_indices(n, 1)
