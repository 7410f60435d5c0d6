"""Thermal growth: every link grows along itself by its coefficient times the temperature rise."""

import numpy as np

from calibtool.errormodel.family import Context, Family, Rows, Sizes
from calibtool.errormodel.tolerances import Tolerances
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

STEEL_EXPANSION = 12e-6  # per K


class Temperature(Family):
    """Expansion coefficients (n+1,) per K of the links before each joint and the tool."""

    id, symbol, ascii, kind = "temperature", "growth", "growth", "thermal"
    words, unit, size = "thermal growth of the links", "1/K", STEEL_EXPANSION
    meaning = "expansion of the link before each joint, and before the tool"
    by_row = True
    needs = "temperatures that differ"

    def shape(self, n: int, order: int = 1) -> tuple[int, ...]:
        return (n + 1,)

    def free(self, robot: Robot, shape: tuple[int, ...]) -> np.ndarray:
        long: np.ndarray = np.linalg.norm(robot.chain.placements[:, :3, 3], axis=-1) > 1e-6
        return long

    def names(self, shape: tuple[int, ...], symbol: str) -> list[str]:
        return [f"{symbol}{j + 1}" for j in range(shape[0])]

    def tolerance(self, robot: Robot, tolerances: Tolerances, shape: tuple[int, ...]) -> Array:
        return np.full(shape, tolerances.of.get(self.id, STEEL_EXPANSION))

    def known(self, rows: Rows) -> bool:
        """A constant temperature cannot be told from a placement error."""
        return bool(np.ptp(rows.warmth) > 0)

    def display(self, robot: Robot, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
        return np.full(shape, 1e6), ["µm/m/K"] * shape[0]

    def placed(self, value: Array, placements: Array, rows: Rows | None) -> Array:
        if rows is None or not (value.any() and np.any(rows.warmth)):
            return placements
        grown = np.broadcast_to(placements, (len(rows.q), *placements.shape[-3:])).copy()
        grown[..., :3, 3] *= 1.0 + (value * np.asarray(rows.warmth)[..., None])[..., None]
        return grown

    def columns(self, shape: tuple[int, ...], context: Context) -> Array:
        """What follows a link is shifted along it: R_(j−1) p_j times the rise, without a turn."""
        rows, frames = context.rows, context.frames
        n = rows.robot.n
        turned = np.concatenate(
            [np.broadcast_to(np.eye(3), (len(rows.q), 1, 3, 3)), frames.after[..., :3, :3]], axis=1
        )
        along = (turned @ rows.robot.chain.placements[:, :3, 3, None])[..., 0] * np.asarray(
            rows.warmth
        )[..., None, None]
        result = np.zeros((len(rows.q), 6, n + 1))
        result[:, :3] = np.swapaxes(along, 1, 2)
        return result

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        return np.full(robot.n + 1, sizes.size)
