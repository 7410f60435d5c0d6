"""Starts of an inverse kinematics: joint positions within the limits, and those with near poses."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly

_COUNT = 2048
_SEED = 0x57A127  # of a random stream that is used for nothing else
_TOGETHER = 256  # poses: their distances to all starts stay in the processor's cache


@dataclass(frozen=True, eq=False)
class Starts:
    """Joint positions drawn once within the limits of a robot.

    The distance of two poses is |Δp|²/length² + |ΔR|²/2 (Frobenius), near the squared weighted pose
    error. It is that of the points (p/length, R/√2), and one matrix product tells which are
    nearest: the largest a·b − |b|²/2.

    q         (k, n) joint positions, rad or m
    features  (13, k) b and −|b|²/2
    length    characteristic length, m
    """

    q: Array
    features: Array
    length: float

    @classmethod
    def of(cls, robot: Robot) -> Self:
        """Starts for a robot, always the same ones."""
        q = robot.closing(drawn(robot, _COUNT, np.random.default_rng(_SEED)))
        features = _features(robot.mechanism.forward(q), robot.length)
        square = -0.5 * (features**2).sum(axis=1, keepdims=True)
        return cls(readonly(q), readonly(np.hstack([features, square]).T), robot.length)

    def nearest(self, target: Array, count: int) -> Array:
        """The `count` starts nearest to poses (N, 4, 4), nearest first: (N, count, n) rad or m."""
        wanted = np.hstack([_features(target, self.length), np.ones((len(target), 1))])
        found = np.empty((len(target), count), dtype=int)
        for first in range(0, len(target), _TOGETHER):
            rows = slice(first, first + _TOGETHER)
            closeness = wanted[rows] @ self.features
            if count == 1:
                found[rows, 0] = closeness.argmax(axis=1)
                continue
            best = np.argpartition(closeness, -count, axis=1)[:, -count:]
            order = np.take_along_axis(-closeness, best, axis=1).argsort(axis=1)
            found[rows] = np.take_along_axis(best, order, axis=1)
        return self.q[found]


@lru_cache
def starts_of(robot: Robot) -> Starts:
    """The starts of a robot, made once."""
    return Starts.of(robot)


def drawn(robot: Robot, count: int, rng: np.random.Generator) -> Array:
    """Uniform joints within the limits, (count, n) rad or m, turns within half a turn of 0."""
    several_turns = (robot.upper - robot.lower > 2 * np.pi) & ~np.array(robot.prismatic)
    low = np.where(several_turns, np.maximum(robot.lower, -np.pi), robot.lower)
    span = np.where(several_turns, 2 * np.pi, robot.upper - robot.lower)
    return np.minimum(low + span * rng.random((count, robot.n)), robot.upper)


def _features(pose: Array, length: float) -> Array:
    return np.hstack([pose[:, :3, 3] / length, pose[:, :3, :3].reshape(-1, 9) / np.sqrt(2.0)])
