"""Joint positions for the poses of a program: inverse kinematics by branch, in batches."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from calibtool.programs.configurations import Configuration, Posture, has_postures, postures
from calibtool.robot.inverse import InverseResult, nearest_turn, solve_poses
from calibtool.robot.inverse_starts import Starts, drawn, starts_of
from calibtool.robot.reach import excluded
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

_NEAR = 8  # number of starts near the pose, on the required branch
_RANDOM = 96  # number of random starts, used where those near the pose do not find the branches
_ROWS = 4096  # poses that are solved at once
_TOGETHER = 128  # poses that get several starts at once
_SAME = 1e-6  # rad or m: joint positions that differ by less are one answer


@dataclass(frozen=True, eq=False)
class Controller:
    """The nominal robot in controller joints: q_serial = coupling @ q_controller, (n, n)."""

    robot: Robot
    coupling: Array

    @cached_property
    def zero(self) -> Posture:
        """The branch with all of the controller's joint values at zero. For six-joint arms."""
        zero = np.zeros((1, self.robot.n))
        return Posture(*map(bool, postures(self.robot, zero, zero)[0]))

    @cached_property
    def home(self) -> Array:
        """Assumed joint positions (n,) where nothing is known: home of the default workspace."""
        return self.robot.workspace().home

    def to_serial(self, q: Array) -> Array:
        """Joint positions of the serial chain for the controller's joint values, (…, n) both."""
        return q @ self.coupling.T

    def to_controller(self, q: Array) -> Array:
        """The controller's joint values for joint positions of the serial chain, (…, n) both."""
        return q @ self._inverse.T

    @cached_property
    def _inverse(self) -> Array:
        return np.linalg.inv(self.coupling).astype(float)

    @cached_property
    def start_branches(self) -> np.ndarray:
        """The branches of the robot's precomputed starts: (k, 3) bool."""
        q = starts_of(self.robot).q
        return postures(self.robot, q, self.to_controller(q))


@dataclass(frozen=True, eq=False)
class Answers:
    """Joint positions for N poses.

    q       (N, n) rad or m
    why     why a row has no solution, "" where it has one
    obeyed  (N,) whether a row is on the branch of its configuration data
    """

    q: Array
    why: list[str]
    obeyed: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """Which rows have a solution: (N,)."""
        return np.array([not why for why in self.why], dtype=bool)


def solve(
    controller: Controller,
    T_base_tool: Array,
    near: Array,
    configurations: Sequence[Configuration | None],
    strict: np.ndarray,
) -> Answers:
    """Joint positions of the nominal robot within its limits for poses (N, 4, 4), each row by
    itself.

    near (N, n): start of the iteration, which also gives the positions of external axes. Of several
    solutions the one that Newton's method reaches from there is taken, otherwise the nearest one.
    configurations: the branch and turns that are required; the solution from `near` is taken if it
    has them, otherwise the nearest one that has. strict (N,): a row without such a solution has
    none.
    """
    parts = [slice(first, first + _ROWS) for first in range(0, len(near), _ROWS)]
    found = [
        _solve(controller, T_base_tool[part], near[part], configurations[part], strict[part])
        for part in parts or [slice(0)]
    ]
    return Answers(
        np.concatenate([answers.q for answers in found]),
        [why for answers in found for why in answers.why],
        np.concatenate([answers.obeyed for answers in found]),
    )


def _solve(
    controller: Controller,
    T_base_tool: Array,
    near: Array,
    configurations: Sequence[Configuration | None],
    strict: np.ndarray,
) -> Answers:
    """The same for a part of the rows."""
    search = _Search(controller, T_base_tool, near, configurations)
    robot, count = controller.robot, len(near)
    first = search.newton(T_base_tool, np.clip(near, robot.lower, robot.upper))
    q, answered = nearest_turn(robot, first.q, near), first.reached.copy()
    required = np.array([configuration is not None for configuration in configurations], dtype=bool)
    obeyed = np.zeros(count, dtype=bool)
    possible = answered | ~excluded(robot, T_base_tool, search.tolerance)
    if has_postures(robot):
        rows = np.flatnonzero(required & answered)
        satisfied, turned = search.satisfied(rows, q[rows])
        q[rows[satisfied]], obeyed[rows[satisfied]] = turned[satisfied], True
        for seeds, which in ((search.near_starts, required), (search.random, required & strict)):
            for rows, starts in _few(np.flatnonzero(which & possible & ~obeyed), seeds):
                found, answers = search.nearest(rows, starts)
                q[rows[found]], obeyed[rows[found]] = answers[found], True
    answered |= obeyed
    search.configurations = [None] * count  # any branch will do
    for seeds in (search.near_starts, search.random):
        for rows, starts in _few(np.flatnonzero(possible & ~answered), seeds):
            found, answers = search.nearest(rows, starts)
            q[rows[found]], answered[rows[found]] = answers[found], True
    why = [""] * count
    for k in np.flatnonzero(~answered).tolist():
        why[k] = f"the pose is unreachable ({first.position[k] * 1e3:.3g} mm are missing)"
    for k in np.flatnonzero(answered & strict & required & ~obeyed).tolist():
        why[k] = f"the pose cannot be reached with the configuration {_text(configurations[k])}"
        if not has_postures(robot):
            text = _text(configurations[k])
            why[k] = (
                f"the configuration {text} is that of a six-joint arm, and {robot.name} is none"
            )
    return Answers(q, why, obeyed)


@dataclass(eq=False)
class _Search:
    """Solutions for poses (N, 4, 4), nearest to `near` (N, n), on the required branches."""

    controller: Controller
    T: Array
    near: Array
    configurations: Sequence[Configuration | None]

    @property
    def tolerance(self) -> float:
        """Tolerance of a solution, as in `inverse_kinematics`."""
        return 1e-8 if self.controller.robot.n >= 6 else 1e-5

    def newton(self, T: Array, start: Array) -> InverseResult:
        """Newton's method from joint positions (N, n); external axes stay where they are."""
        robot = self.controller.robot
        held = list(robot.external.values())

        def forward_and_jacobian(q: Array) -> tuple[Array, Array]:
            pose, jacobian = robot.mechanism.forward_and_jacobian(q)
            jacobian[..., held] = 0.0
            return pose, jacobian

        return solve_poses(
            forward_and_jacobian if held else robot.mechanism.forward_and_jacobian,
            T,
            start,
            length=robot.length,
            lower=robot.lower,
            upper=robot.upper,
            tolerance=self.tolerance,
        )

    def near_starts(self, rows: np.ndarray) -> Array:
        """Starts with poses near the rows', on the required branches: (rows, _NEAR, n)."""
        robot = self.controller.robot
        every = starts_of(robot)
        seeds = np.empty((len(rows), _NEAR, robot.n))
        if not has_postures(robot):
            return every.nearest(self.T[rows], _NEAR)
        choices = [Posture(*bits) for bits in product((False, True), repeat=3)]
        groups: dict[tuple[bool, ...], list[int]] = {}
        for k, row in enumerate(rows):
            required = self.configurations[row]
            allowed = tuple(
                required is None or required.branch(choice, self.controller.zero)
                for choice in choices
            )
            groups.setdefault(allowed, []).append(k)
        number = self.controller.start_branches @ np.array([4, 2, 1])
        for allowed, group in groups.items():
            there = np.array(allowed)[number]
            if not there.any():
                there = np.ones(len(number), dtype=bool)
            some = Starts(every.q[there], every.features[:, there], every.length)
            found = some.nearest(self.T[rows[group]], min(_NEAR, int(there.sum())))
            seeds[group] = np.resize(found, (len(group), _NEAR, robot.n))
        return seeds

    def random(self, rows: np.ndarray) -> Array:
        """Random starts, the same ones for each row: (rows, _RANDOM, n)."""
        robot = self.controller.robot
        seeds = drawn(robot, _RANDOM, np.random.default_rng(0))
        return np.broadcast_to(seeds, (len(rows), *seeds.shape))

    def nearest(self, rows: np.ndarray, seeds: Array) -> tuple[np.ndarray, Array]:
        """Rows with a solution on the required branch from starts (rows, k, n); the nearest
        ones.
        """
        robot, (count, tries) = self.controller.robot, seeds.shape[:2]
        held = list(robot.external.values())
        if held:
            seeds = seeds.copy()
            seeds[..., held] = self.near[rows][:, None, held]
        solved = self.newton(np.repeat(self.T[rows], tries, axis=0), seeds.reshape(-1, robot.n))
        distinct = solved.reached & ~_repeated(solved.q.reshape(seeds.shape)).ravel()
        answers = np.flatnonzero(distinct)
        owners = answers // tries
        satisfied, turned = self.satisfied(rows[owners], solved.q[answers])
        found, best = np.zeros(count, dtype=bool), self.near[rows].copy()
        distance = np.full(count, np.inf)
        for k, q in zip(owners[satisfied], turned[satisfied], strict=True):
            away = float(np.linalg.norm(q - self.near[rows[k]]))
            if away < distance[k] - _SAME:
                found[k], best[k], distance[k] = True, q, away
        return found, best

    def satisfied(self, rows: np.ndarray, q: Array) -> tuple[np.ndarray, Array]:
        """Which joints q (rows, n) are on the required branch, and the same in its turn."""
        robot = self.controller.robot
        turned = nearest_turn(robot, q, self.near[rows])
        satisfied = np.array([self.configurations[k] is None for k in rows], dtype=bool)
        if satisfied.all():
            return satisfied, turned
        q_controller = self.controller.to_controller(turned)[:, robot.arm]
        branches = postures(robot, q, self.controller.to_controller(q)).tolist()
        for k in np.flatnonzero(~satisfied):
            required = self.configurations[rows[k]]
            if required is None or not required.branch(Posture(*branches[k]), self.controller.zero):
                continue
            if required.turns(q_controller[k]):
                satisfied[k] = True
                continue
            for answer in _turns(robot, turned[k]):
                if required.turns(self.controller.to_controller(answer)[robot.arm]):
                    satisfied[k], turned[k] = True, answer
                    break
        return satisfied, turned


def _few(
    rows: np.ndarray, seeds: Callable[[np.ndarray], Array]
) -> Iterator[tuple[np.ndarray, Array]]:
    """Rows with their starts, in groups that fit into memory."""
    for first in range(0, len(rows), _TOGETHER):
        yield rows[first : first + _TOGETHER], seeds(rows[first : first + _TOGETHER])


def _text(configuration: Configuration | None) -> str:
    return "" if configuration is None else configuration.text


def _repeated(q: Array) -> np.ndarray:
    """Which of the solutions (N, k, n) are equal to an earlier one of the same row: (N, k)."""
    result = np.zeros(q.shape[:2], dtype=bool)
    for j in range(1, q.shape[1]):
        result[:, j] = (np.abs(q[:, :j] - q[:, j : j + 1]).max(axis=-1) < _SAME).any(axis=1)
    return result


def _turns(robot: Robot, q: Array) -> list[Array]:
    """The same pose with whole turns added where the limits allow it, nearest first."""
    choices = []
    for j, (angle, low, high) in enumerate(zip(q, robot.lower, robot.upper, strict=True)):
        turns = [angle + 2 * np.pi * k for k in ((0,) if robot.prismatic[j] else (0, -1, 1, -2, 2))]
        choices.append([t for t in turns if low - 1e-9 <= t <= high + 1e-9] or [angle])
    answers = [np.array(combination) for combination in product(*choices)]
    return sorted(answers, key=lambda answer: float(np.abs(answer - q).sum()))
