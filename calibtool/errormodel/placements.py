"""Errors δζ of the initial relative poses: M_j exp6(δζ_j) (Eqs. 8, 10)."""

import numpy as np

from calibtool.errormodel.family import Context, Family, Rows, Sizes, names_of_twists
from calibtool.errormodel.tolerances import Tolerances
from calibtool.robot.mechanism import Frames
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, adjoint, exp6, log6


class Placements(Family):
    """δζ_j (n+1, 6), m and rad in the frame of joint j, the last row the tool's."""

    id, symbol, ascii, kind = "placements", "ζ", "zeta", "geometric"
    words, unit = "placement errors", "m, rad"
    meaning = "δζ of M_j exp6(δζ_j)"
    always = True

    def shape(self, n: int, order: int = 1) -> tuple[int, ...]:
        return (n + 1, 6)

    def names(self, shape: tuple[int, ...], symbol: str) -> list[str]:
        return names_of_twists(shape[0], symbol)

    def tolerance(self, robot: Robot, tolerances: Tolerances, shape: tuple[int, ...]) -> Array:
        return tolerances.elements(robot.n)

    def groups(self, shape: tuple[int, ...]) -> np.ndarray:
        return np.broadcast_to(np.arange(6) // 3, shape)

    def display(self, robot: Robot, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
        return np.full(shape, 1e3), ["mm", "mm", "mm", "mrad", "mrad", "mrad"] * shape[0]

    def placed(self, value: Array, placements: Array, rows: Rows | None) -> Array:
        return placements @ exp6(value)

    def columns(self, shape: tuple[int, ...], context: Context) -> Array:
        return placement_columns(context.frames)

    def moved(self, value: Array, step: Array) -> Array:
        return log6(exp6(value) @ exp6(step))

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        value: Array = rng.normal(size=self.shape(robot.n)) * np.repeat(
            [sizes.length, sizes.angle], 3
        )
        return value


def placement_columns(frames: Frames) -> Array:
    """δζ_j, j = 1…n+1: Ad(F0_j), the last block Ad(T_base_tool). (N, 6, 6n+6)"""
    blocks = np.concatenate([adjoint(frames.before), adjoint(frames.tool)[:, None]], axis=1)
    count, joints = blocks.shape[:2]
    return np.moveaxis(blocks, 1, 2).reshape(count, 6, 6 * joints)
