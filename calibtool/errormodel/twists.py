"""Errors δξ of the joint twists: exp6((ξ_j + δξ_j) q_j), not linearised (Eqs. 8, 10)."""

import numpy as np

from calibtool.errormodel.family import Context, Family, Sizes, names_of_twists
from calibtool.errormodel.tolerances import Tolerances
from calibtool.robot.mechanism import Frames
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, adjoint, left_jacobian


class Twists(Family):
    """δξ_j (n, 6) per rad or m of joint motion, in the frame of joint j."""

    id, symbol, ascii, kind = "twists", "ξ", "xi", "geometric"
    words, unit = "twist errors", "per rad or m"
    meaning = "δξ of exp6((ξ_j + δξ_j) q_j)"

    def shape(self, n: int, order: int = 1) -> tuple[int, ...]:
        return (n, 6)

    def names(self, shape: tuple[int, ...], symbol: str) -> list[str]:
        return names_of_twists(shape[0], symbol)

    def tolerance(self, robot: Robot, tolerances: Tolerances, shape: tuple[int, ...]) -> Array:
        return tolerances.elements(robot.n)[: robot.n]

    def groups(self, shape: tuple[int, ...]) -> np.ndarray:
        return np.broadcast_to(np.arange(6) // 3, shape)

    def display(self, robot: Robot, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
        per = ["/m" if prismatic else "/rad" for prismatic in robot.prismatic]
        return np.full(shape, 1e3), [unit + p for p in per for unit in ["mm"] * 3 + ["mrad"] * 3]

    def twisted(self, value: Array, twists: Array) -> Array:
        n = len(value)  # passive joints have no twist errors: the loop determines their motion
        return (
            twists + value if n == len(twists) else np.concatenate([twists[:n] + value, twists[n:]])
        )

    def columns(self, shape: tuple[int, ...], context: Context) -> Array:
        return twist_columns(context.frames, context.twists, context.moved)

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        value: Array = rng.normal(size=self.shape(robot.n)) * np.repeat(
            [sizes.length, sizes.angle], 3
        )
        return value


def twist_columns(frames: Frames, twists: Array, q: Array) -> Array:
    """δξ_j, j = 1…n: Ad(F0_j) · J_l(ξ_j q_j) · q_j, of which Ad_j q_j of Song, Tian and Ma is the
    first order. (N, 6, 6n)

    twists (n, 6) ξ_j in the joint's frame, q (N, n) in rad or m; of closed loops the actuated
           joints.
    """
    count, n = q.shape
    before = frames.seen(adjoint(frames.before[:, :n]), slice(n))
    blocks = before @ left_jacobian(twists[:n], q) * q[:, :, None, None]
    return np.moveaxis(blocks, 1, 2).reshape(count, 6, 6 * n)
