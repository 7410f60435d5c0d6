"""The cell of a simulated instrument: the robot in it, driven to where the instrument sees it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibtool.errormodel.actual import ActualRobot
from calibtool.errors import NoSolutionError
from calibtool.measurement.kinds import Readings
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.setup import Setup
from calibtool.robot.inverse import solve_poses
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, skew, transform_points
from calibtool.robot.singularity import MIN_SINGULARITY_DISTANCE
from calibtool.robot.workspace import Workspace

TIP = np.array([0.03, -0.02, 0.15])  # m: the probe's tip on the tool
_TILT = np.deg2rad(90.0)  # largest tilt of the tool against its first orientation at the place
_TRIES = 60
_CANDIDATES = 40  # number of places among which those far from each other are chosen
_STEPS = 25  # of Newton's method to a surface
_ON_SURFACE = 1e-9  # m
_ANY_ARM = "points, distance, plane and sphere"
_ROUNDS = 5  # number of iterations for errors of joint motions

# Points (k, 3) → distances (k,), gradients (k, 3) and whether they are on the part that is used.
Gap = Callable[[Array], tuple[Array, Array, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Observed:
    """The readings of a simulated instrument at q (N, n), with its set-up, places and noise.

    deviations  (N, d) standard deviations, None: the stated noise is valid
    noise       standard deviation of a coordinate where the instrument has its own, m
    """

    q: Array
    setup: Setup
    readings: Readings
    places: tuple[str, ...] = ()
    deviations: Array | None = None
    noise: float | None = None


@dataclass(frozen=True, eq=False)
class Cell:
    """The robot that an instrument observes, nominal and actual, its workspace, and the noise in m.

    gauge  length of the instrument's gauge, m: between its two sockets, or the height of a block on
           a plane; None: the default
    """

    robot: Robot
    actual: ActualRobot
    workspace: Workspace
    noise: float
    gauge: float | None = None

    def sampled(self, count: int, rng: np.random.Generator) -> Array:
        """Joint positions (count, n) all over the workspace."""
        return sample_configurations(self.robot, self.workspace, count, rng)

    def apart(self, places: int, rng: np.random.Generator) -> Array:
        """Joint positions (places, n) well inside the reach, with tools far from each other."""
        q = self.sampled(_CANDIDATES, rng)
        points = self.robot.mechanism.forward(q)[:, :3, 3]
        inside = np.linalg.norm(points - points.mean(axis=0), axis=-1)
        q, points = (part[inside <= np.quantile(inside, 0.7)] for part in (q, points))
        chosen = [0]
        while len(chosen) < places:
            gaps = np.linalg.norm(points[:, None] - points[chosen], axis=-1).min(axis=-1)
            chosen.append(int(np.argmax(gaps)))
        found: Array = q[chosen]
        return found

    def driven(
        self, count: int, rng: np.random.Generator, start: Array, drawn: Callable[[int], Array]
    ) -> Array:
        """Joint positions (count, n) that bring the actual tool to drawn poses (k, 4, 4).

        Raises NoSolutionError where they are not reached; at once for fewer than six joints, which
        cannot take poses of any orientation.
        """
        robot, found = self.robot, [np.zeros((0, self.robot.n))]
        self.check_any_pose()
        for _ in range(_TRIES):
            poses = drawn(4 * count)
            solved = solve_poses(
                self.actual.mechanism.forward_and_jacobian,
                poses,
                self._from(start, len(poses), rng),
                length=robot.length,
                lower=robot.lower,
                upper=robot.upper,
                tolerance=1e-10,
            )
            found.append(self._kept(solved.q[solved.reached]))
            if sum(map(len, found)) >= count:
                return np.concatenate(found)[:count]
        raise NoSolutionError(
            f"{robot.name}: the instrument's place cannot be reached; take another seed"
        )

    def check_any_pose(self) -> None:
        """NoSolutionError for fewer than six joints, whose tool cannot take any orientation."""
        if self.robot.n < 6:
            raise NoSolutionError(
                f"{self.robot.name}: with {self.robot.n} joints the tool cannot take the poses "
                f"that this instrument needs; such an arm is observed by {_ANY_ARM}"
            )

    def on_surface(self, count: int, rng: np.random.Generator, gap: Gap) -> Array:
        """Joint positions (count, n) all over the workspace that bring the actual tip to a surface.

        For arms of fewer than six joints: in the orientations that they have. See `brought`.
        """
        robot, found = self.robot, [np.zeros((0, self.robot.n))]
        for _ in range(_TRIES):
            q = self.sampled(4 * count, rng)
            q, reached = brought(robot, self.actual.mechanism, q, TIP, gap)
            found.append(self._kept(q[reached]))
            if sum(map(len, found)) >= count:
                return np.concatenate(found)[:count]
        raise NoSolutionError(
            f"{robot.name}: the surface is hardly reached; take another seed, or more --places"
        )

    def _kept(self, reached: Array) -> Array:
        """Joint positions to command for `reached` (N, n) that the robot can take, away from
        singularities."""
        q = self._commanded(reached)
        q = q[self.robot.within_limits(q)]
        kept: Array = q[self.robot.singularity_distance(q) >= MIN_SINGULARITY_DISTANCE]
        return kept

    def _from(self, start: Array, count: int, rng: np.random.Generator) -> Array:
        """Joint positions (count, n) to start from: half of them one given position, half random,
        so that the arm reaches a place in all of its branches.
        """
        low, high = np.maximum(self.robot.lower, -np.pi), np.minimum(self.robot.upper, np.pi)
        anywhere = low + (high - low) * rng.random((count, len(start)))
        anywhere[::2] = start
        return anywhere

    def _commanded(self, reached: Array) -> Array:
        """Joint positions to command so that the joints really are at `reached` (N, n)."""
        q = reached
        for _ in range(_ROUNDS):
            q = reached - (self.actual.errors.at(q)[1] - q)
        return q


def brought(
    robot: Robot, mechanism: Mechanism, q: Array, tip: Array, gap: Gap
) -> tuple[Array, np.ndarray]:
    """Joint positions (N, n) near q that bring the tip (3,) on the tool to a surface, and which of
    them do.

    gap: distances (k,) of points (k, 3) in K_0 from the surface, m, their gradients (k, 3), and
    which are on its part that is used. Newton's method along the gradient, in parts of the ranges
    of the joints; at a limit it stays there.
    """
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    for _ in range(_STEPS):
        pose, jacobian = mechanism.forward_and_jacobian(q)
        points = transform_points(pose, tip[None])[:, 0]
        distance, gradient, _ = gap(points)
        moving = jacobian[:, :3] - skew(points) @ jacobian[:, 3:]
        row = (gradient[:, None] @ moving)[:, 0] * (high - low)
        step = distance / np.maximum((row**2).sum(axis=-1), 1e-12)
        step = np.nan_to_num(np.clip(step[:, None] * row, -0.1, 0.1)) * (high - low)
        q = np.clip(q - step, robot.lower, robot.upper)
    pose = mechanism.forward(q)
    distance, _, used = gap(transform_points(pose, tip[None])[:, 0])
    return q, (np.abs(distance) < _ON_SURFACE) & used


def shares(count: int, places: int) -> list[int]:
    """Numbers of rows of each of several places, as equal as possible."""
    return [len(part) for part in np.array_split(np.arange(count), places)]


def labels(word: str, places: int) -> tuple[str, ...]:
    """Labels of several places; none for one."""
    return tuple(f"{word} {g + 1}" for g in range(places)) if places > 1 else ()


def tip(cell: Cell, q: Array) -> Array:
    """Where the tip is at joint positions (n,): (3,), m."""
    tip: Array = transform_points(cell.robot.mechanism.forward(q[None]), TIP[None])[0, 0]
    return tip


def touching(
    cell: Cell, start: Array, at: Array, rng: np.random.Generator
) -> Callable[[int], Array]:
    """Tool poses in all orientations that have the tip at one point (3,)."""

    def drawn(k: int) -> Array:
        return tilted(cell, start, at + rng.normal(size=(k, 3)) * cell.noise, rng)

    return drawn


def tilted(cell: Cell, start: Array, at: Array, rng: np.random.Generator) -> Array:
    """Tool poses (k, 4, 4) with the tip at points (k, 3), tilted and turned from that at start."""
    turn = rng.normal(size=(len(at), 3))
    turn *= (_TILT * rng.random((len(at), 1))) / np.linalg.norm(turn, axis=-1, keepdims=True)
    roll = np.zeros((len(at), 6))
    roll[:, 5] = rng.uniform(-np.pi, np.pi, len(at))
    first = cell.robot.mechanism.forward(start[None])[0]
    poses = first @ exp6(np.concatenate([np.zeros_like(turn), turn], axis=-1)) @ exp6(roll)
    poses[:, :3, 3] = at - poses[:, :3, :3] @ TIP
    found: Array = poses
    return found
