"""Backlash: a joint stays behind its last motion by half a width, −w_j d_j."""

import numpy as np

from calibtool.errormodel.family import JointFunctions, Rows, Sizes
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array


class Backlash(JointFunctions):
    """Half widths w_j (n,), rad or m; d_j: direction of the last motion, see `directions`."""

    id, symbol, ascii, kind = "backlash", "backlash", "backlash", "backlash"
    words, unit, size = "backlash", "rad or m", 0.1e-3
    expected = 0.2e-3
    meaning = "half width w, −w times the direction of motion"
    needs = "from which side the joints came"
    positive = True

    def known(self, rows: Rows) -> bool:
        return rows.conditions.direction is not None

    def describe(self, robot: Robot, value: Array, free: np.ndarray) -> str:
        return f"backlash {backlash_text(robot, value)} half width"

    def functions(self, shape: tuple[int, ...], rows: Rows) -> Array:
        """Without directions, the mean of both sides."""
        direction = rows.conditions.direction
        return np.zeros((*rows.q.shape, 1)) if direction is None else -direction[..., None]

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        return np.full(robot.n, sizes.size)


def backlash_text(robot: Robot, backlash: Array) -> str:
    """Half widths (n,) of all joints for people: `0.104, 0.098 mrad`, in mm if prismatic."""
    units = ["mm" if prismatic else "mrad" for prismatic in robot.prismatic]
    if len(set(units)) == 1:
        return ", ".join(f"{value * 1e3:.3f}" for value in backlash) + f" {units[0]}"
    return ", ".join(
        f"{value * 1e3:.3f} {unit}" for value, unit in zip(backlash, units, strict=True)
    )
