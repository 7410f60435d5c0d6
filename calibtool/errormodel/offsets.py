"""Joint offsets δq: errors of the joints' zero positions (Eqs. 8, 10)."""

import numpy as np

from calibtool.errormodel.family import Context, Family, Sizes
from calibtool.errormodel.tolerances import Tolerances
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array


class Offsets(Family):
    """δq_j (n,) in rad or m."""

    id, symbol, ascii, kind = "offsets", "q", "q", "geometric"
    words, unit = "joint offsets", "rad or m"
    meaning = "δq added to the joint position"
    always = True

    def tolerance(self, robot: Robot, tolerances: Tolerances, shape: tuple[int, ...]) -> Array:
        return tolerances.offsets(robot)

    def offset(self, value: Array) -> Array | float:
        return value

    def columns(self, shape: tuple[int, ...], context: Context) -> Array:
        return context.offset_columns

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        return rng.normal(size=robot.n) * np.where(robot.prismatic, sizes.length, sizes.angle)
