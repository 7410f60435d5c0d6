"""The order in which configurations are visited: short travel in joint space."""

import numpy as np

from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

_GAIN = 1e-9


def short_order(robot: Robot, q: Array, start: Array) -> np.ndarray:
    """An order of configurations q (N, n) with a short path from `start` (n,): nearest neighbour,
    then 2-opt.

    The distance of two configurations is that of the joint that moves farthest, in rad, or in
    characteristic lengths if prismatic: joints move together, and the slowest decides. The path may
    end anywhere.
    """
    points = np.concatenate([start[None], q]) / np.where(robot.prismatic, robot.length, 1.0)
    ways = np.abs(points[:, None] - points).max(axis=-1)
    order = [0]
    unvisited = set(range(1, len(points)))
    while unvisited:
        nearest = min(unvisited, key=lambda k: (ways[order[-1], k], k))
        order.append(nearest)
        unvisited.remove(nearest)
    return np.array(_two_opt(order, ways)[1:]) - 1


def travel(robot: Robot, q: Array) -> float:
    """Sum of the distances between successive configurations q (N, n), as in `short_order`."""
    points = q / np.where(robot.prismatic, robot.length, 1.0)
    return float(np.abs(np.diff(points, axis=0)).max(axis=-1).sum())


def _two_opt(order: list[int], ways: Array) -> list[int]:
    """Reverse parts of the path while that shortens it; the first configuration stays."""
    count = len(order)
    improved = True
    while improved:
        improved = False
        for i in range(1, count - 1):
            for j in range(i + 1, count):
                before, first, last = order[i - 1], order[i], order[j]
                gain = ways[before, first] - ways[before, last]
                if j + 1 < count:
                    gain += ways[last, order[j + 1]] - ways[first, order[j + 1]]
                if gain > _GAIN:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    improved = True
    return order
