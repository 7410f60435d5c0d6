"""Thermal growth: every link grows along itself by its coefficient times the temperature rise."""

import numpy as np

from calibtool.errormodel.family import Context, Family, Rows, Sizes
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

STEEL_EXPANSION = 12e-6  # per K


class Temperature(Family):
    """Expansion coefficients (n+1,) per K of the links before each joint and the tool."""

    id, symbol, ascii, kind = "temperature", "growth", "growth", "thermal"
    words, unit, size = "thermal growth of the links", "1/K", STEEL_EXPANSION
    expected = STEEL_EXPANSION
    meaning = "expansion of the link before each joint, and before the tool"
    by_row = True
    needs = "temperatures that differ"

    def shape(self, n: int, order: int = 1) -> tuple[int, ...]:
        return (n + 1,)

    def joints(self, robot: Robot) -> int:
        """All joints, and with closed loops the cut frames."""
        return len(robot.chain.placements) - 1

    def free(self, robot: Robot, shape: tuple[int, ...]) -> np.ndarray:
        long: np.ndarray = np.linalg.norm(robot.chain.placements[:, :3, 3], axis=-1) > 1e-6
        return long

    def known(self, rows: Rows) -> bool:
        """A constant temperature cannot be distinguished from a placement error."""
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
        """The links behind are shifted along the link by R_(j−1) p_j times the rise, and not
        turned."""
        rows, frames = context.rows, context.frames
        chain = rows.robot.chain
        turned = np.concatenate(
            [np.broadcast_to(np.eye(3), (len(rows.q), 1, 3, 3)), frames.after[..., :3, :3]], axis=1
        )[:, [carrier + 1 for carrier in chain.placed_on]]
        along = (turned @ rows.robot.chain.placements[:, :3, 3, None])[..., 0] * np.asarray(
            rows.warmth
        )[..., None, None]
        result = np.zeros((len(rows.q), len(chain.placements), 6, 1))
        result[:, :, :3, 0] = along
        return np.ascontiguousarray(np.swapaxes(frames.seen(result)[..., 0], 1, 2))

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        return np.full(self.joints(robot) + 1, sizes.size)
