"""Harmonics of the joint motions, as of eccentric gears: Σ_h a_jh sin(h q_j) + b_jh cos(h q_j)."""

import numpy as np

from calibtool.errormodel.family import JointFunctions, Rows, Sizes
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

LOW_ORDERS = 3  # number of harmonics that eccentric gears cause
FINE_ORDERS = (8, 16, 32, 64, 128)  # orders at which each octave of the fine structure ends
_SECTIONS = 16  # more sections than a joint has
_GEAR = 2  # number of harmonics of a simulated gear


class Harmonics(JointFunctions):
    """a_j1, b_j1, a_j2, b_j2, … (n, 2H) in rad; zero for prismatic joints."""

    id, symbol, ascii, kind = "harmonics", "", "", "gear"
    words, unit, size = "harmonics of the joint motions", "rad", 0.2e-3
    expected = 0.3e-3
    meaning = "sin q, cos q, sin 2q … of δq"
    orders = tuple(range(LOW_ORDERS + 1))
    grows = False

    def shape(self, n: int, order: int = 1) -> tuple[int, ...]:
        return (n, 2 * order)

    def order(self, shape: tuple[int, ...]) -> int:
        return shape[1] // 2

    def free(self, robot: Robot, shape: tuple[int, ...]) -> np.ndarray:
        return np.repeat(~np.array(robot.prismatic)[:, None], shape[1], axis=1)

    def names(self, shape: tuple[int, ...], symbol: str) -> list[str]:
        orders = ["" if h == 0 else str(h + 1) for h in range(self.order(shape))]
        return [
            f"{f}{order}q{j + 1}"
            for j in range(shape[0])
            for order in orders
            for f in ("sin", "cos")
        ]

    def sections(self, shape: tuple[int, ...]) -> np.ndarray:
        """Each low order for all joints together; higher orders by joint and octave."""
        h = np.arange(shape[1]) // 2 + 1
        octave = np.searchsorted(FINE_ORDERS, h) + LOW_ORDERS + 1
        fine = np.add.outer(np.arange(shape[0]) * _SECTIONS, octave)
        return np.where(h > LOW_ORDERS, fine, h)

    def trimmed(self, free: np.ndarray) -> np.ndarray:
        used = np.flatnonzero(free.any(axis=0))
        return free[:, : 2 * (used[-1] // 2 + 1)] if len(used) else free[:, :0]

    def groups(self, shape: tuple[int, ...]) -> np.ndarray:
        """One scale for the low orders of all joints, and one for the higher orders of each joint,
        because the size of the low orders does not predict that of the others."""
        return np.where(self.fine(shape), 1 + np.arange(shape[0])[:, None], 0)

    def fine(self, shape: tuple[int, ...]) -> np.ndarray:
        return np.tile(np.arange(shape[1]) // 2 >= LOW_ORDERS, (shape[0], 1))

    def display(self, robot: Robot, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
        return np.full(shape, 1e3), ["mrad"] * (shape[0] * shape[1])

    def describe(self, robot: Robot, value: Array, free: np.ndarray) -> str:
        return f"{self.order(value.shape)} harmonics per joint"

    def functions(self, shape: tuple[int, ...], rows: Rows) -> Array:
        return harmonic_functions(rows.q, self.order(shape))

    def resized(self, value: Array, shape: tuple[int, ...]) -> Array:
        result = np.zeros(shape)
        kept = min(shape[1], value.shape[1])
        result[:, :kept] = value[:, :kept]
        return result

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        turning = ~np.array(robot.prismatic)[:, None]
        value: Array = rng.normal(size=(robot.n, 2 * _GEAR)) * sizes.size * turning
        return value


def harmonic_functions(q: Array, count: int) -> Array:
    """sin q, cos q, sin 2q, cos 2q, … up to `count`: q (N, n) → (N, n, 2 count)."""
    result = np.empty((*q.shape, 2 * count))
    if not count:
        return result
    first = sine, cosine = np.sin(q), np.cos(q)
    for h in range(count):
        result[..., 2 * h], result[..., 2 * h + 1] = sine, cosine
        sine, cosine = sine * first[1] + cosine * first[0], cosine * first[1] - sine * first[0]
    return result
