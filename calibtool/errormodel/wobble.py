"""Wobble of the axes: a bearing that runs out tilts its axis once per turn of the joint."""

import numpy as np

from calibtool.errormodel.family import (
    Context,
    Family,
    Rows,
    Sizes,
    sections_of_joints,
    turn_columns,
)
from calibtool.robot.robot import Robot
from calibtool.robot.screw_joint import across
from calibtool.robot.se3 import Array


class Wobble(Family):
    """Tilts (n, 4) in rad: of each axis about u and v across it, sin q_j and cos q_j parts, in
    F0_j.

    A tilt that turns with the joint has the same effect as an error of the next placement; the
    prior divides it between both.
    """

    id, symbol, ascii, kind = "wobble", "wobble", "wobble", "wobble"
    words, unit, size = "wobble of the axes", "rad", 0.1e-3
    expected = 0.3e-3
    meaning = "turn of F0_j across the axis: u sin q, u cos q, v sin q, v cos q"
    by_row, turns, grows = True, True, False

    def shape(self, n: int, order: int = 1) -> tuple[int, ...]:
        return (n, 4)

    def free(self, robot: Robot, shape: tuple[int, ...]) -> np.ndarray:
        turning = ~np.array(robot.prismatic) & (robot.chain.tree is None)  # none in closed loops
        return np.repeat(turning[:, None], shape[1], axis=1)

    def names(self, shape: tuple[int, ...], symbol: str) -> list[str]:
        parts = ("u.sin", "u.cos", "v.sin", "v.cos")
        return [f"{symbol}{j + 1}.{part}" for j in range(shape[0]) for part in parts]

    def sections(self, shape: tuple[int, ...]) -> np.ndarray:
        return sections_of_joints(shape)

    def display(self, robot: Robot, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
        return np.full(shape, 1e3), ["mrad"] * (shape[0] * shape[1])

    def turn(self, value: Array, rows: Rows) -> Array | float:
        return (_turns(rows) @ value[..., None])[..., 0] if value.any() else 0.0

    def columns(self, shape: tuple[int, ...], context: Context) -> Array:
        """To first order: turns about the origin of F0_j; its other errors are neglected."""
        return turn_columns(context.frames.before, _turns(context.rows))

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        shape = self.shape(robot.n)
        value: Array = rng.normal(size=shape) * sizes.size * self.free(robot, shape)
        return value


def _turns(rows: Rows) -> Array:
    """Rotation vectors in F0_j per parameter: (N, n, 3, 4)."""
    waves = np.stack([np.sin(rows.q), np.cos(rows.q)], axis=-1)  # (N, n, 2)
    turns: Array = across(rows.robot.chain.twists)[..., :, None] * waves[..., None, None, :]
    return np.asarray(turns.reshape(*rows.q.shape, 3, 4))
