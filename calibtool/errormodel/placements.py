"""Errors δζ of the initial relative poses: M_j exp6(δζ_j) (Eqs. 8, 10)."""

from dataclasses import replace

import numpy as np

from calibtool.errormodel.family import COMPONENTS, Context, Family, Rows, Sizes, names_of_twists
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

    def joints(self, robot: Robot) -> int:
        """All joints, and with closed loops the cut frames."""
        return len(robot.chain.placements) - 1

    def free(self, robot: Robot, shape: tuple[int, ...]) -> np.ndarray:
        """Rotations of the frames of a ball joint have no effect."""
        free, tree = np.ones(shape, dtype=bool), robot.chain.tree
        for k, loop in enumerate(() if tree is None else tree.loops):
            if loop.joint == "spherical":
                start = robot.chain.n_all + 2 * k
                free[start : start + 2, 3:] = False
        return free

    def names_of(self, robot: Robot, shape: tuple[int, ...], symbol: str) -> list[str]:
        if robot.chain.tree is None:
            return self.names(shape, symbol)
        return [f"{symbol}({label}).{c}" for label in robot.chain.labels for c in COMPONENTS]

    def names(self, shape: tuple[int, ...], symbol: str) -> list[str]:
        return names_of_twists(shape[0], symbol)

    def tolerance(self, robot: Robot, tolerances: Tolerances, shape: tuple[int, ...]) -> Array:
        count = self.joints(robot)  # with closed loops the tool is behind passive joints and frames
        own = tuple(
            (count if joint == robot.n else joint, length, angle)
            for joint, length, angle in tolerances.joints
        )
        return replace(tolerances, joints=own).elements(count)

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
        value: Array = rng.normal(size=self.shape(self.joints(robot))) * np.repeat(
            [sizes.length, sizes.angle], 3
        )
        value[~self.free(robot, value.shape)] = 0.0
        return value


def placement_columns(frames: Frames) -> Array:
    """δζ_j, j = 1…n+1: Ad(F0_j), the last block Ad(T_base_tool). (N, 6, 6n+6)

    With closed loops H_j Ad(F0_j), and the cut frames' ±K Ad(T_A), Ad(T_B) before the last block.
    """
    blocks = frames.seen(adjoint(frames.placed))
    count, joints = blocks.shape[:2]
    return np.moveaxis(blocks, 1, 2).reshape(count, 6, 6 * joints)
