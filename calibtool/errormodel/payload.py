"""Payload: joints wind up about their axes and bend across them, in proportion to its moment.

A joint is a spring: a moment m turns the links behind it by c m about its axis and by b m across
it. The mass is at the origin of the tool frame, and the moments are those of the nominal robot.
"""

from functools import lru_cache

import numpy as np

from calibtool.errormodel.family import Context, Family, Rows, Sizes, turn_columns
from calibtool.errormodel.tolerances import Tolerances
from calibtool.robot.inverse_starts import drawn as configurations
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly
from calibtool.robot.singularity import at_point

_FULL = 10.0  # kg: the mass for which sizes and tolerances are stated
# A joint counts as loaded when its moment reaches this part of the largest joint's
_CARRIES_LOAD = 0.02
_SAMPLES = 500


class Payload(Family):
    """c_j, b_j (n, 2) in rad per N m; no wind-up of prismatic joints."""

    id, symbol, ascii, kind = "payload", "payload", "payload", "payload"
    words, unit, size = "wind-up and bending under the payload", "rad/(N m)", 0.5e-3
    meaning = "turn about and across the joint axis per moment of the mass"
    needs = "a mass at the tool"
    by_row, turns, grows = True, True, False

    def shape(self, n: int, order: int = 1) -> tuple[int, ...]:
        return (n, 2)

    def free(self, robot: Robot, shape: tuple[int, ...]) -> np.ndarray:
        largest = largest_moment(robot)
        carrying: np.ndarray = largest > _CARRIES_LOAD * largest.max()
        return carrying

    def names(self, shape: tuple[int, ...], symbol: str) -> list[str]:
        return [f"{symbol}{j + 1}.{c}" for j in range(shape[0]) for c in ("wind", "bend")]

    def tolerance(self, robot: Robot, tolerances: Tolerances, shape: tuple[int, ...]) -> Array:
        """An angle in rad at the largest moment of the full mass, over that moment."""
        return tolerances.of.get(self.id, 1e-3) / np.maximum(_FULL * largest_moment(robot), 1e-12)

    def known(self, rows: Rows) -> bool:
        return bool(np.any(rows.payload))

    def display(self, robot: Robot, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
        return 1e3 * _FULL * largest_moment(robot), ["mrad"] * (2 * robot.n)

    def turn(self, value: Array, rows: Rows) -> Array | float:
        if not (value[:, 1].any() and np.any(rows.payload)):
            return 0.0
        return np.asarray(value[:, 1, None] * moments(rows)[1])

    def motion(self, value: Array, rows: Rows) -> Array | float:
        if not (value[:, 0].any() and np.any(rows.payload)):
            return 0.0
        return value[:, 0] * moments(rows)[0]

    def columns(self, shape: tuple[int, ...], context: Context) -> Array:
        """The bending to first order: a turn about the origin of F0_j, without its other errors."""
        along, across = moments(context.rows)
        before = context.frames.before[:, : context.rows.robot.n]  # closed loops have no bending
        bend = turn_columns(before, across[..., None])
        wind = context.offset_columns * along[:, None]
        return np.stack([wind, bend], axis=-1).reshape(len(along), 6, 2 * along.shape[1])

    def drawn(self, robot: Robot, sizes: Sizes, rng: np.random.Generator) -> Array:
        free = self.free(robot, self.shape(robot.n))
        return np.where(free, sizes.size / np.maximum(_FULL * largest_moment(robot), 1e-12), 0.0)


def moments(rows: Rows) -> tuple[Array, Array]:
    """Moments of the payload's weight, N m: along each axis (N, n), across it in F0_j (N, n, 3)."""
    frames, robot = rows.nominal, rows.robot
    if frames.jacobian is not None:
        return _work(rows, frames.jacobian), np.zeros((*rows.q.shape, 3))
    arm = frames.tool[:, None, :3, 3] - frames.before[..., :3, 3]
    weight = np.asarray(rows.payload)[..., None] * np.array(robot.chain.model.gravity.linear)
    moment = np.cross(arm, np.broadcast_to(weight, (len(rows.q), 3))[:, None])
    local = (np.swapaxes(frames.before[..., :3, :3], -1, -2) @ moment[..., None])[..., 0]
    axes = robot.chain.twists[:, 3:]  # zero for prismatic joints
    along = (local * axes).sum(axis=-1)
    return along, local - along[..., None] * axes


def _work(rows: Rows, jacobian: Array) -> Array:
    """Moments about the actuated joints of closed loops by virtual work: the derivative of the
    potential energy by the joint positions (N, n).
    """
    robot, tool = rows.robot, rows.nominal.tool[:, :3, 3]
    weight = np.asarray(rows.payload)[..., None] * np.array(robot.chain.model.gravity.linear)
    weight = np.broadcast_to(weight, tool.shape)
    gained = np.einsum("nki,nk->ni", at_point(jacobian, tool)[:, :3], weight)
    return np.where(robot.prismatic, 0.0, gained)


@lru_cache
def largest_moment(robot: Robot) -> Array:
    """Largest moments of 1 kg along and across each joint, over fixed configurations: (n, 2) N
    m.
    """
    from calibtool.errormodel.operating_conditions import Conditions

    q = robot.closing(configurations(robot, _SAMPLES, np.random.default_rng(0)))
    along, across = moments(Rows(robot, q, Conditions(payload_kg=readonly(1.0))))
    return readonly(
        np.stack([np.abs(along).max(axis=0), np.linalg.norm(across, axis=-1).max(axis=0)], axis=-1)
    )
