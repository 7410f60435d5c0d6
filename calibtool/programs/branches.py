"""Joint positions for the poses of a program: inverse kinematics on the branch that is meant, for many at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from calibtool.programs.configurations import Configuration, Posture, has_postures, postures
from calibtool.robot.inverse import inverse_kinematics, solve_poses
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.starts import Starts, starts_of

_NEAR = 6  # starts on the branch that is asked for, near the pose
_RANDOM = 96  # random starts that find the branches of a pose where those do not
_TOGETHER = 64  # poses that get random starts at once
_SAME = 1e-6  # rad or m: nearer joint positions are one answer


@dataclass(frozen=True, eq=False)
class Controller:
    """The nominal robot as its controller counts joints: q_serial = coupling @ q_controller, coupling (n, n)."""

    robot: Robot
    coupling: Array

    @cached_property
    def zero(self) -> Posture:
        """The branch with all of the controller's joint values at zero. For six-joint arms."""
        zero = np.zeros((1, self.robot.n))
        return Posture(*map(bool, postures(self.robot, zero, zero)[0]))

    @cached_property
    def home(self) -> Array:
        """Where the robot is taken to stand if nothing is known: the home of its default workspace, (n,)."""
        return self.robot.home(self.robot.workspace(None)[1])

    def to_serial(self, q: Array) -> Array:
        """Joint positions of the serial chain for the controller's joint values, (…, n) both."""
        return q @ self.coupling.T

    def to_controller(self, q: Array) -> Array:
        """The controller's joint values for joint positions of the serial chain, (…, n) both."""
        values: Array = q @ self._inverse.T
        return values

    @cached_property
    def _inverse(self) -> Array:
        result: Array = np.linalg.inv(self.coupling).astype(float)
        return result

    @cached_property
    def start_branches(self) -> np.ndarray:
        """The branches of the robot's starts, (k, 3) bool."""
        q = starts_of(self.robot).q
        return postures(self.robot, q, self.to_controller(q))


@dataclass(frozen=True, eq=False)
class Answers:
    """Joint positions q (N, n), and why a row has none, "" where it has; obeyed (N,): on the configuration's branch."""

    q: Array
    why: list[str]
    obeyed: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """Which rows have an answer, (N,)."""
        return np.array([not why for why in self.why], dtype=bool)


def solve(
    controller: Controller,
    T_base_tool: Array,
    near: Array,
    configurations: Sequence[Configuration | None],
    strict: np.ndarray,
) -> Answers:
    """Joint positions of the nominal robot within its limits for poses (N, 4, 4), each row by itself.

    near (N, n): of several answers the one that Newton's method reaches from there. configurations: the branch and
    turns that are asked for; then the answer from `near` if it is one of those, otherwise the nearest that is. strict
    (N,): a row without such an answer has none; otherwise it gets the one from `near`.
    """
    robot = controller.robot
    solved = inverse_kinematics(robot, T_base_tool, near)
    q = solved.q.copy()
    why = [""] * len(q)
    for k in np.flatnonzero(~solved.reached).tolist():
        why[k] = f"the pose is unreachable ({solved.position[k] * 1e3:.3g} mm are missing)"
    obeyed = np.zeros(len(q), dtype=bool)
    reached = np.flatnonzero(solved.reached).tolist()
    asked = [k for k in reached if configurations[k] is not None]
    if asked and not has_postures(robot):
        for k in asked:
            configuration = configurations[k]
            if strict[k] and configuration is not None:
                why[k] = (
                    f"the configuration {configuration.text} is that of a six-joint arm, "
                    f"and {robot.name} is none"
                )
        return Answers(q, why, obeyed)
    rows = np.array(asked, dtype=int)
    for search in (_here, _from_starts, _from_random):
        if search is _from_random:
            rows = rows[strict[rows]]
        if not len(rows):
            break
        found, answers = search(controller, T_base_tool[rows], near[rows], q[rows],
                                [configurations[k] for k in rows])  # fmt: skip
        q[rows[found]], obeyed[rows[found]] = answers[found], True
        rows = rows[~found]
    for k in rows[strict[rows]].tolist():
        configuration = configurations[k]
        assert configuration is not None
        why[k] = f"the pose cannot be reached with the configuration {configuration.text}"
    return Answers(q, why, obeyed)


def solve_pose(
    controller: Controller,
    T_base_tool: Array,
    configuration: Configuration | None,
    q_near: Array | None,
) -> Array | str:
    """`solve` for one pose (4, 4): joint positions (n,), or why there are none."""
    near = controller.home if q_near is None else q_near
    strict = np.ones(1, dtype=bool)
    answers = solve(controller, T_base_tool[None], near[None], [configuration], strict)
    row: Array = answers.q[0]
    return answers.why[0] or row


_Found = tuple[np.ndarray, Array]
_Asked = Sequence[Configuration | None]


def _here(controller: Controller, T: Array, near: Array, q: Array, asked: _Asked) -> _Found:
    """Rows whose answer is already what is asked for, perhaps in another turn."""
    return _meant(controller, q, asked)


def _from_starts(controller: Controller, T: Array, near: Array, q: Array, asked: _Asked) -> _Found:
    """The same from starts near the pose that are on the branch."""
    robot, every = controller.robot, starts_of(controller.robot)
    seeds = np.empty((len(T), _NEAR, robot.n))
    groups: dict[tuple[bool, ...], list[int]] = {}
    choices = [Posture(*bits) for bits in product((False, True), repeat=3)]
    for k, configuration in enumerate(asked):
        assert configuration is not None
        allowed = tuple(configuration.branch(choice, controller.zero) for choice in choices)
        groups.setdefault(allowed, []).append(k)
    number = controller.start_branches @ np.array([4, 2, 1])
    for allowed, rows in groups.items():
        there = np.array(allowed)[number]
        if not there.any():
            there = np.ones(len(number), dtype=bool)
        some = Starts(every.q[there], every.features[:, there], every.length)
        count = min(_NEAR, int(there.sum()))
        seeds[rows] = np.resize(some.nearest(T[rows], count), (len(rows), _NEAR, robot.n))
    return _nearest(controller, T, near, seeds, asked)


def _from_random(controller: Controller, T: Array, near: Array, q: Array, asked: _Asked) -> _Found:
    """The same from random starts, few rows at a time."""
    robot = controller.robot
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    drawn = low + (high - low) * np.random.default_rng(0).random((_RANDOM, robot.n))
    found, answers = np.zeros(len(T), dtype=bool), q.copy()
    for first in range(0, len(T), _TOGETHER):
        rows = slice(first, first + _TOGETHER)
        seeds = np.broadcast_to(drawn, (len(T[rows]), *drawn.shape))
        found[rows], answers[rows] = _nearest(controller, T[rows], near[rows], seeds, asked[rows])
    return found, answers


def _nearest(controller: Controller, T: Array, near: Array, seeds: Array, asked: _Asked) -> _Found:
    """Of the answers from seeds (N, k, n) the one nearest to `near` that is what is asked for."""
    robot, (count, tries) = controller.robot, seeds.shape[:2]
    solved = solve_poses(
        robot.mechanism.forward_and_jacobian,
        np.repeat(T, tries, axis=0),
        seeds.reshape(-1, robot.n),
        length=robot.length,
        lower=robot.lower,
        upper=robot.upper,
        tolerance=1e-8,
    )
    distinct = solved.reached & ~_repeated(solved.q.reshape(seeds.shape)).ravel()
    rows = np.flatnonzero(distinct)
    meant, turned = _meant(controller, solved.q[rows], [asked[k // tries] for k in rows])
    found, best = np.zeros(count, dtype=bool), near.copy()
    distance = np.full(count, np.inf)
    for k, q in zip(rows[meant] // tries, turned[meant], strict=True):
        away = float(np.linalg.norm(q - near[k]))
        if away < distance[k] - _SAME:
            found[k], best[k], distance[k] = True, q, away
    return found, best


def _repeated(q: Array) -> np.ndarray:
    """Which of the answers (N, k, n) are there already among those before them, (N, k)."""
    result = np.zeros(q.shape[:2], dtype=bool)
    for j in range(1, q.shape[1]):
        result[:, j] = (np.abs(q[:, :j] - q[:, j : j + 1]).max(axis=-1) < _SAME).any(axis=1)
    return result


def _meant(controller: Controller, q: Array, asked: _Asked) -> _Found:
    """Which rows q (N, n) are on the branch that is asked for, in a turn that is, and that turn (N, n)."""
    robot = controller.robot
    q_controller = controller.to_controller(q)
    branches = postures(robot, q, q_controller).tolist()
    meant, turned = np.zeros(len(q), dtype=bool), q.copy()
    for k, configuration in enumerate(asked):
        assert configuration is not None
        if not configuration.branch(Posture(*branches[k]), controller.zero):
            continue
        if configuration.turns(q_controller[k]):
            meant[k] = True
            continue
        for answer in _turns(robot, q[k]):
            if configuration.turns(controller.to_controller(answer)):
                meant[k], turned[k] = True, answer
                break
    return meant, turned


def _turns(robot: Robot, q: Array) -> list[Array]:
    """The same pose with whole turns added where the limits allow it, nearest first."""
    choices = []
    for j, (angle, low, high) in enumerate(zip(q, robot.lower, robot.upper, strict=True)):
        turns = [angle + 2 * np.pi * k for k in ((0,) if robot.prismatic[j] else (0, -1, 1, -2, 2))]
        choices.append([t for t in turns if low - 1e-9 <= t <= high + 1e-9] or [angle])
    answers = [np.array(combination) for combination in product(*choices)]
    return sorted(answers, key=lambda answer: float(np.abs(answer - q).sum()))
