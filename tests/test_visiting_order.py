"""The order of a plan: a permutation, short against every other order of few configurations."""

from itertools import pairwise, permutations

import numpy as np
import pytest

from calibtool.planning.visiting_order import short_order, travel
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot


def test_every_configuration_is_visited_once(robot: Robot) -> None:
    rng = np.random.default_rng(0)
    q = robot.lower + (robot.upper - robot.lower) * rng.random((30, robot.n))
    order = short_order(robot, q, robot.workspace("full").home)
    assert sorted(order) == list(range(30))
    assert travel(robot, q[order]) < 0.8 * travel(robot, q)


def test_it_is_near_the_shortest_of_all_orders() -> None:
    robot = load_robot("planar-3r")
    ratios = []
    for seed in range(5):
        q = np.random.default_rng(seed).uniform(-2, 2, (6, 3))
        start = np.zeros(3)

        def way(order: tuple[int, ...], q: np.ndarray = q, start: np.ndarray = start) -> float:
            points = np.concatenate([start[None], q[list(order)]])
            return float(sum(np.abs(b - a).max() for a, b in pairwise(points)))

        shortest = min(way(order) for order in permutations(range(6)))
        ratios.append(way(tuple(short_order(robot, q, start))) / shortest)
    assert max(ratios) < 1.25
    assert min(ratios) == pytest.approx(1.0)


def test_a_line_is_walked_along_it() -> None:
    robot = load_robot("planar-3r")
    q = np.array([3.0, 1.0, 5.0, 2.0, 4.0])[:, None] * [0.1, 0.2, 0.1]
    assert short_order(robot, q, np.zeros(3)).tolist() == [1, 3, 0, 4, 2]


def test_one_configuration() -> None:
    robot = load_robot("planar-3r")
    assert short_order(robot, np.ones((1, 3)), np.zeros(3)).tolist() == [0]
    assert travel(robot, np.ones((1, 3))) == 0.0
