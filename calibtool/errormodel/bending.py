"""Bending of joints and links: turns across the axis, in proportion to the moment of the links'
weight there."""

from functools import lru_cache

import numpy as np

from calibtool.errormodel.family import (
    Context,
    Family,
    Rows,
    Sizes,
    sections_of_joints,
    turn_columns,
)
from calibtool.errormodel.operating_conditions import Conditions
from calibtool.errormodel.tolerances import Tolerances
from calibtool.robot.inverse_starts import drawn as configurations
from calibtool.robot.robot import Robot
from calibtool.robot.screw_joint import across
from calibtool.robot.se3 import Array, readonly

_SAMPLES = 500
_LOADED = 1e-6  # of the largest moment of any joint: smaller moments are rounding


class Bending(Family):
    """Compliances (n, 2) in rad per N m about two directions across each axis, fixed in F0_j.

    A joint's bearing and the link before it bend under the moment of the links behind them.
    """

    id, symbol, ascii, kind = "bending", "bend", "bend", "bending"
    words, unit, size = "bending under gravity", "rad/(N m)", 0.2e-3
    meaning = "turn of F0_j across the axis per moment of the links' weight"
    by_row, turns, grows = True, True, False

    def shape(self, n: int, order: int = 1) -> tuple[int, ...]:
        return (n, 2)

    def free(self, robot: Robot, shape: tuple[int, ...]) -> np.ndarray:
        largest = largest_moment(robot)
        loaded: np.ndarray = largest > _LOADED * max(largest.max(), 1e-9)
        return loaded

    def names(self, shape: tuple[int, ...], symbol: str) -> list[str]:
        return [f"{symbol}{j + 1}.{c}" for j in range(shape[0]) for c in "uv"]

    def tolerance(self, robot: Robot, tolerances: Tolerances, shape: tuple[int, ...]) -> Array:
        return tolerances.of.get(self.id, 0.5e-3) / np.maximum(largest_moment(robot), 1e-12)

    def sections(self, shape: tuple[int, ...]) -> np.ndarray:
        return sections_of_joints(shape)

    def display(self, robot: Robot, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
        return 1e3 * largest_moment(robot), ["mrad"] * (2 * robot.n)

    def turn(self, value: Array, rows: Rows) -> Array | float:
        if not value.any():
            return 0.0
        return (directions(rows.robot) @ (value * moments(rows))[..., None])[..., 0]

    def columns(self, shape: tuple[int, ...], context: Context) -> Array:
        """To first order: turns about the origin of F0_j; its other errors are neglected."""
        turns = directions(context.rows.robot) * moments(context.rows)[..., None, :]
        return turn_columns(context.frames.before, turns)

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        largest = largest_moment(robot)
        return np.where(
            self.free(robot, self.shape(robot.n)), sizes.size / np.maximum(largest, 1e-12), 0.0
        )


def moments(rows: Rows) -> Array:
    """Moments of the links' weight about both directions across each axis, N m: (N, n, 2)."""
    local = np.swapaxes(rows.nominal.before[..., :3, :3], -1, -2) @ rows.moment[..., None]
    return (np.swapaxes(directions(rows.robot), -1, -2) @ local)[..., 0]


@lru_cache
def directions(robot: Robot) -> Array:
    """Unit vectors u and v across each axis, in F0_j: (n, 3, 2)."""
    return readonly(across(robot.chain.twists))


@lru_cache
def largest_moment(robot: Robot) -> Array:
    """Largest moment about each direction over fixed configurations of the joint range: (n, 2) N
    m."""
    if robot.chain.tree is not None:  # the links of closed loops are assumed stiff
        return readonly(np.zeros((robot.n, 2)))
    q = configurations(robot, _SAMPLES, np.random.default_rng(0))
    return readonly(np.abs(moments(Rows(robot, q, Conditions()))).max(axis=0))
