"""Simulated instruments that people have beside a tracker: contact, wires, a probe, cameras.

Each places itself in the cell, drives the actual robot to where it sees something, and reads with
its own noise. The instrument's set-up is kept as truth, and unknown to every fit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibtool.errormodel.actual import ActualRobot
from calibtool.errors import NoSolutionError
from calibtool.measurement.kinds import Readings
from calibtool.measurement.measurements import Setup
from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.damped_least_squares import MIN_SINGULARITY_DISTANCE
from calibtool.robot.inverse import solve_poses
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, inverse, readonly, transform_points
from calibtool.robot.workspace import Workspace

TIP = np.array([0.03, -0.02, 0.15])  # m: the probe's tip on the tool
GAUGE = 0.05  # m between the two sockets of the gauge
CAMERA_NOISE = (0.04e-3, 0.04e-3, 0.07e-3, 0.21e-3, 0.21e-3, 0.21e-3)  # m, rad: found boards
_TILT = np.deg2rad(90.0)  # of the tool, from how it reached the place first
_VIEW = (0.3, 0.7)  # m between camera and board
_MIDDLE = 0.5
_TRIES = 60
_CANDIDATES = 40  # among which places far from each other are chosen
_ROUNDS = 5  # of the iteration for errors of joint motions


@dataclass(frozen=True, eq=False)
class Observed:
    """What a simulated instrument read at q (N, n), where, and how well.

    deviations  (N, d) standard deviations, None: the stated noise holds
    """

    q: Array
    setup: Setup
    readings: Readings
    places: tuple[str, ...] = ()
    deviations: Array | None = None


@dataclass(frozen=True, eq=False)
class Cell:
    """The robot that an instrument observes: nominal and actual, where it works, noise in m."""

    robot: Robot
    actual: ActualRobot
    workspace: Workspace
    noise: float

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
        """Joint positions (count, n) that bring the actual tool to drawn poses (k, 4, 4)."""
        robot, found = self.robot, [np.zeros((0, self.robot.n))]
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
            q = self._commanded(solved.q[solved.reached])
            q = q[robot.within_limits(q)]
            q = q[robot.singularity_distance(q) >= MIN_SINGULARITY_DISTANCE]
            found.append(q)
            if sum(map(len, found)) >= count:
                return np.concatenate(found)[:count]
        raise NoSolutionError(
            f"{robot.name}: the instrument's place cannot be reached; take another seed"
        )

    def _from(self, start: Array, count: int, rng: np.random.Generator) -> Array:
        """Joint positions (count, n) to start from: one of them, and for the other half any, so
        that the arm comes to a place in all of its branches.
        """
        low, high = np.maximum(self.robot.lower, -np.pi), np.minimum(self.robot.upper, np.pi)
        anywhere = low + (high - low) * rng.random((count, len(start)))
        anywhere[::2] = start
        return anywhere

    def _commanded(self, reached: Array) -> Array:
        """Joint positions to ask for so that the joints really are at `reached` (N, n)."""
        q = reached
        for _ in range(_ROUNDS):
            q = reached - (self.actual.errors.at(q)[1] - q)
        return q


def contact(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A tip put into the two sockets of a gauge, which is laid down in several places: target
    points in the gauge's frame. They are exact, and the tip is beside them by the noise.
    """
    q, points, place, frames = [], [], [], []
    starts = cell.apart(places, rng)
    for g, rows in enumerate(_shares(count, places)):
        start = starts[g]
        T_base_gauge = exp6(np.concatenate([np.zeros(3), rng.normal(size=3)]))
        T_base_gauge[:3, 3] = _tip(cell, start)
        socket = rng.permutation(np.arange(rows) % 2)
        in_gauge = np.zeros((rows, 3))
        in_gauge[:, 0] = GAUGE * socket
        for k in range(2):
            chosen = np.flatnonzero(socket == k)
            at = transform_points(T_base_gauge, in_gauge[chosen[:1]])[0]
            own = cell.driven(len(chosen), rng, start, _touching(cell, start, at, rng))
            q.append(own)
            points.append(in_gauge[chosen])
            place.append(np.full(len(chosen), g))
        frames.append(inverse(T_base_gauge))
    setup = Setup(
        readonly(frames[0]),
        readonly(TIP[None]),
        frame_known=False,
        targets_known=False,
        further_frames=readonly(np.array(frames[1:])) if places > 1 else None,
    )
    points_in_gauge = np.concatenate(points)[:, None]
    readings = Readings(points_in_gauge, place=np.concatenate(place) if places > 1 else None)
    return Observed(np.concatenate(q), setup, readings, _labels("placement", places))


def wires(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """Draw-wire encoders, as many as places, that pull at one point of the tool."""
    q = cell.sampled(count, rng)
    centre = cell.robot.mechanism.forward(q)[:, :3, 3].mean(axis=0)
    away = rng.normal(size=(places, 3))
    away *= cell.robot.length / np.linalg.norm(away, axis=-1, keepdims=True)
    anchors = centre + away
    points = transform_points(cell.actual.forward(q), TIP[None])
    lengths = np.linalg.norm(points - anchors, axis=-1)
    lengths = lengths + rng.normal(size=lengths.shape) * cell.noise
    setup = Setup(
        readonly(np.eye(4)),
        readonly(TIP[None]),
        frame_known=False,
        targets_known=False,
        anchors=readonly(anchors),
    )
    return Observed(q, setup, Readings(np.full((count, 1, 3), np.nan), None, lengths))


def plane_probe(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A tip put onto planes of 0.4 m: heights of zero, but for the noise of the contact."""
    q, place, planes = [], [], []
    starts = cell.apart(places, rng)
    for g, rows in enumerate(_shares(count, places)):
        start = starts[g]
        centre, T = _tip(cell, start), exp6(np.concatenate([np.zeros(3), rng.normal(size=3)]))

        def drawn(k: int, start: Array = start, centre: Array = centre, T: Array = T) -> Array:
            on_plane = np.concatenate([rng.uniform(-0.2, 0.2, (k, 2)), np.zeros((k, 1))], axis=-1)
            at = centre + on_plane @ T[:3, :3].T
            return _tilted(cell, start, at, rng)

        q.append(cell.driven(rows, rng, start, drawn))
        place.append(np.full(rows, g))
        planes.append([*T[:3, 2], float(T[:3, 2] @ centre)])
    heights = rng.normal(size=(count, 1)) * cell.noise
    setup = Setup(
        readonly(np.eye(4)),
        readonly(TIP[None]),
        frame_known=False,
        targets_known=False,
        planes=readonly(np.array(planes)),
    )
    readings = Readings(
        np.full((count, 1, 3), np.nan), None, heights, np.concatenate(place) if places > 1 else None
    )
    return Observed(np.concatenate(q), setup, readings, _labels("plane", places))


def camera_on_tool(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A camera on the tool that looks at boards fixed in the cell."""
    T_tool_camera = exp6(np.array([0.05, 0.0, 0.05, 0.1, -0.2, 0.4]))
    q, poses, boards = [], [], []
    for rows in _shares(count, places):
        start = cell.sampled(1, rng)[0]
        first = cell.robot.mechanism.forward(start[None])[0] @ T_tool_camera
        T_base_board = first @ _ahead(_MIDDLE) @ _half_turn()

        def drawn(k: int, board: Array = T_base_board) -> Array:
            seen = _views(k, rng)  # the board in the camera
            return board @ inverse(seen) @ inverse(T_tool_camera)

        own = cell.driven(rows, rng, start, drawn)
        seen = inverse(cell.actual.forward(own) @ T_tool_camera) @ T_base_board
        q.append(own)
        poses.append(_noisy(seen, rng))
        boards.append(T_base_board)
    setup = Setup(
        readonly(np.eye(4)),
        readonly(np.zeros((1, 3))),
        frame_known=False,
        targets_known=False,
        T_tool_camera=readonly(T_tool_camera),
        T_base_boards=readonly(np.array(boards)),
    )
    return _board_poses(setup, q, poses, _labels("board", places))


def camera_beside(cell: Cell, count: int, places: int, rng: np.random.Generator) -> Observed:
    """A camera beside the arm, in several places, that sees a board on the tool: 6-D poses."""
    T_tool_board = exp6(np.array([0.02, 0.03, 0.05, 0.3, 0.1, -0.2]))
    q, poses, frames = [], [], []
    for rows in _shares(count, places):
        start = cell.sampled(1, rng)[0]
        first = cell.robot.mechanism.forward(start[None])[0] @ T_tool_board
        T_base_camera = first @ _half_turn() @ inverse(_ahead(_MIDDLE + 0.3))

        def drawn(k: int, camera: Array = T_base_camera) -> Array:
            seen = _views(k, rng)
            seen[:, :3, 3] *= 1.6
            return camera @ seen @ inverse(T_tool_board)

        own = cell.driven(rows, rng, start, drawn)
        seen = inverse(T_base_camera) @ cell.actual.forward(own) @ T_tool_board
        q.append(own)
        poses.append(_noisy(seen, rng))
        frames.append(inverse(T_base_camera))
    setup = Setup(
        readonly(frames[0]),
        readonly(T_tool_board[None, :3, 3]),
        readonly(T_tool_board[:3, :3]),
        frame_known=False,
        targets_known=False,
        further_frames=readonly(np.array(frames[1:])) if places > 1 else None,
    )
    return _board_poses(setup, q, poses, _labels("station", places))


def _board_poses(
    setup: Setup, q: Sequence[Array], poses: Sequence[Array], labels: tuple[str, ...]
) -> Observed:
    """Poses of a board as a camera finds them, (k, 4, 4) per place, at joint positions (k, n)."""
    found = np.concatenate(poses)
    place = np.repeat(np.arange(len(q)), [len(part) for part in q])
    readings = Readings(
        found[:, None, :3, 3], found[:, :3, :3], place=place if len(q) > 1 else None
    )
    deviations = readonly(np.tile(CAMERA_NOISE, (len(found), 1)))
    return Observed(np.concatenate(q), setup, readings, labels, deviations)


INSTRUMENTS: dict[str, Callable[[Cell, int, int, np.random.Generator], Observed]] = {
    "contact": contact,
    "distance": wires,
    "plane": plane_probe,
    "board": camera_on_tool,
    "camera": camera_beside,
}


def _shares(count: int, places: int) -> list[int]:
    return [len(part) for part in np.array_split(np.arange(count), places)]


def _labels(word: str, places: int) -> tuple[str, ...]:
    return tuple(f"{word} {g + 1}" for g in range(places)) if places > 1 else ()


def _tip(cell: Cell, q: Array) -> Array:
    """Where the tip is at joint positions (n,): (3,), m."""
    tip: Array = transform_points(cell.robot.mechanism.forward(q[None]), TIP[None])[0, 0]
    return tip


def _touching(
    cell: Cell, start: Array, at: Array, rng: np.random.Generator
) -> Callable[[int], Array]:
    """Tool poses in all orientations that have the tip at one point (3,)."""

    def drawn(k: int) -> Array:
        return _tilted(cell, start, at + rng.normal(size=(k, 3)) * cell.noise, rng)

    return drawn


def _tilted(cell: Cell, start: Array, at: Array, rng: np.random.Generator) -> Array:
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


def _views(count: int, rng: np.random.Generator) -> Array:
    """Poses (count, 4, 4) of a board in a camera that sees it, tilted."""
    turn = np.zeros((count, 6))
    turn[:, 3:5] = rng.uniform(-0.7, 0.7, (count, 2))
    roll = np.zeros((count, 6))
    roll[:, 5] = rng.uniform(-np.pi, np.pi, count)
    seen = _half_turn() @ exp6(turn) @ exp6(roll)
    seen[:, :2, 3] = rng.uniform(-0.12, 0.12, (count, 2))
    seen[:, 2, 3] = rng.uniform(*_VIEW, count)
    found: Array = seen
    return found


def _half_turn() -> Array:
    """A board that faces the camera."""
    turned: Array = exp6(np.array([0.0, 0.0, 0.0, np.pi, 0.0, 0.0]))
    return turned


def _ahead(distance: float) -> Array:
    moved = np.eye(4)
    moved[2, 3] = distance
    return moved


def _noisy(poses: Array, rng: np.random.Generator) -> Array:
    """Poses (N, 4, 4) with a camera's noise: position and left turn along its axes."""
    noise = rng.normal(size=(len(poses), 6)) * CAMERA_NOISE
    turned = exp6(np.concatenate([np.zeros((len(poses), 3)), noise[:, 3:]], axis=-1))
    noisy = poses.copy()
    noisy[:, :3, :3] = turned[:, :3, :3] @ poses[:, :3, :3]
    noisy[:, :3, 3] += noise[:, :3]
    return noisy


def unknown(setup: Setup) -> Setup:
    """The set-up as an estimator may start from it: nothing of it is known but its kind."""
    blank = replace(
        setup,
        T_instrument_base=readonly(np.eye(4)),
        targets=readonly(np.zeros_like(setup.targets)),
    )
    for name, array in setup.arrays.items():
        value = np.zeros_like(array)
        if array.shape[-2:] in ((3, 3), (4, 4)):
            value = np.broadcast_to(np.eye(array.shape[-1]), array.shape).copy()
        blank = replace(blank, **{name: readonly(value)})  # type: ignore[arg-type]
    if setup.further_frames is not None:
        frames = np.broadcast_to(np.eye(4), setup.further_frames.shape).copy()
        blank = replace(blank, further_frames=readonly(frames))
    return blank
