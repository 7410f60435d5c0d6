"""Constraints: joint margins, singularities, floor, keep-out boxes, line of sight."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from calibtool.errors import NoSolutionError
from calibtool.measurement.checks.design import REPEATS
from calibtool.measurement.sampling import sample_configurations
from calibtool.planning.instrument_rows import InstrumentRows, Rows
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, transform_points
from calibtool.robot.singularity import MIN_SINGULARITY_DISTANCE
from calibtool.robot.workspace import Workspace

JOINT_MARGIN = 0.01  # of the range of a joint, kept free at either end
_TOGETHER = 500  # draws at least
_TRIES = 50  # as many times, before the plan goes on with what it has


@dataclass(frozen=True)
class Sight:
    """A line of sight that every target needs.

    instrument  (3,) in K_0, m
    normal      (3,) direction in which the targets look, in the tool frame
    cone        half angle round the normal inside which the instrument must lie, rad
    """

    instrument: tuple[float, float, float]
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    cone: float = np.deg2rad(30.0)


@dataclass(frozen=True)
class Constraints:
    """Constraints that a configuration has to satisfy.

    joint_margin          part of each joint's range that stays free at both ends
    singularity_distance  smallest `Robot.singularity_distance`
    floor                 lowest z of all moving parts, m in K_0; None: no floor
    keep_out              boxes (x0, y0, z0, x1, y1, z1) that nothing enters, m in K_0; they also
                          block the line of sight
    sight                 line of sight from every target to the instrument; None: not required

    The moving parts are straight links between joint origins, from the flange to the tool and to
    every target. They have no thickness; enlarge the boxes accordingly. Motions between
    configurations are not checked.
    """

    joint_margin: float = JOINT_MARGIN
    singularity_distance: float = MIN_SINGULARITY_DISTANCE
    floor: float | None = None
    keep_out: tuple[tuple[float, ...], ...] = ()
    sight: Sight | None = None

    def checks(self, robot: Robot, targets: Array, q: Array) -> Iterator[tuple[str, Any]]:
        """The option of every constraint, with (N,) bool: whether q (N, n) satisfies it."""
        margin = self.joint_margin * (robot.upper - robot.lower)
        inside = (q >= robot.lower + margin - 1e-9) & (q <= robot.upper - margin + 1e-9)
        yield "--joint-margin", inside.all(axis=-1)
        yield (
            "--min-singularity-distance",
            robot.singularity_distance(q) >= self.singularity_distance,
        )
        starts, ends = links(robot, targets, q)
        if self.floor is not None:
            yield "--floor-mm", (ends[..., 2] >= self.floor).all(axis=-1)
        for box in self.keep_out:
            yield "--keep-out", ~crosses(starts, ends, np.array(box)).any(axis=-1)
        if self.sight is not None:
            yield "--instrument", self._seen(robot, targets, q)

    def kept(self, robot: Robot, targets: Array, q: Array) -> np.ndarray:
        """Whether q (N, n) satisfies all of them: (N,) bool."""
        kept: np.ndarray = np.logical_and.reduce(
            [kept for _, kept in self.checks(robot, targets, q)]
        )
        return kept

    def _seen(self, robot: Robot, targets: Array, q: Array) -> np.ndarray:
        sight = self.sight
        assert sight is not None
        pose = robot.mechanism.forward(q)
        points = transform_points(pose, targets)
        normal = pose[:, :3, :3] @ (np.array(sight.normal) / np.linalg.norm(sight.normal))
        ray = np.array(sight.instrument) - points
        cosine = (ray @ normal[..., None])[..., 0] / np.maximum(np.linalg.norm(ray, axis=-1), 1e-12)
        seen: np.ndarray = (cosine >= np.cos(sight.cone)).all(axis=-1)
        instrument = np.broadcast_to(np.array(sight.instrument), points.shape)
        for box in self.keep_out:
            seen &= ~crosses(points, instrument, np.array(box)).any(axis=-1)
        return seen


@dataclass(frozen=True, eq=False)
class Candidates:
    """Configurations to choose from.

    rows       those that satisfy the constraints, with the places of an instrument
    workspace  (M, n) the first ones drawn, whether they satisfy them or not, for predictions
    drawn      number of all that were drawn
    rejected   number of those that each constraint rejected, by its option
    """

    rows: Rows
    workspace: Array
    drawn: int
    rejected: dict[str, int] = field(default_factory=dict)

    @property
    def q(self) -> Array:
        """(N, n) joint positions that keep the constraints, rad or m."""
        return self.rows.q


def draw_candidates(
    robot: Robot,
    workspace: Workspace | str | None,
    constraints: Constraints,
    targets: Array,
    count: int,
    needed: int,
    rng: np.random.Generator,
    instrument: InstrumentRows | None = None,
) -> Candidates:
    """`count` configurations of a workspace that satisfy the constraints, fewer where they are hard
    to find.

    With an instrument, it must see the tool there. targets (m, 3) in the tool frame, m. Raises
    NoSolutionError with the constraint that rejects most when not even `needed` are found.
    """
    workspace = robot.workspace(workspace)
    accepted: list[Rows] = []
    first: Array | None = None
    rejected: dict[str, int] = {}
    found = drawn = 0
    together = max(count, _TOGETHER)
    while found < count and drawn < _TRIES * together:
        if instrument is None:
            rows = Rows(sample_configurations(robot, workspace, together, rng))
        else:
            rows = instrument.draw(together, rng)
        if workspace.bounded or instrument is not None:  # `full` means all turns
            q = wrapped(robot, rows.q, constraints.joint_margin, workspace.home)
            rows = rows._replace(q=q)
        q = rows.q
        first = q if first is None else first
        keep = ~_again(q, accepted)
        for option, kept in constraints.checks(robot, targets, q):
            rejected[option] = rejected.get(option, 0) + int((~kept).sum())
            keep &= kept
        accepted.append(rows.take(keep))
        found, drawn = found + int(keep.sum()), drawn + len(q)
    assert first is not None
    if found < needed:
        worst = max(rejected, key=lambda option: rejected[option])
        raise NoSolutionError(
            f"{robot.name}: {found} of {drawn} configurations keep the constraints, {needed} are "
            f"needed; {worst} turns down {rejected[worst]}: loosen it, or choose "
            "another --workspace"
        )
    every = reduce(Rows.with_more, accepted)
    return Candidates(
        every.take(np.arange(min(count, len(every.q)))),
        first,
        drawn,
        {o: k for o, k in rejected.items() if k},
    )


def wrapped(robot: Robot, q: Array, margin: float, home: Array) -> Array:
    """The same configurations (N, n) with joints of several turns as near to home (n,) as their
    limits, reduced by a margin (part of the range), allow.
    """
    span = robot.upper - robot.lower
    several = (span > 2 * np.pi) & ~np.array(robot.prismatic) & (robot.chain.tree is None)
    low, high = robot.lower + margin * span, robot.upper - margin * span
    near = q - 2 * np.pi * np.round((q - home) / (2 * np.pi))
    inside = (near >= low) & (near <= high)
    found: Array = np.where(several & inside, near, q)
    return found


def distinct(q: Array) -> np.ndarray:
    """Rows (k,) of q (N, n) without those within REPEATS of an earlier one of them.

    Rows in a chain of near ones are not all alike: with one joint, a dense draw is one chain.
    """
    pairs = cKDTree(q).query_pairs(REPEATS, output_type="ndarray")
    kept = np.ones(len(q), dtype=bool)
    for first, second in pairs[np.lexsort(pairs.T[::-1])]:  # by the first row, then the second
        if kept[first]:
            kept[second] = False
    return np.flatnonzero(kept)


def _again(q: Array, accepted: Sequence[Rows]) -> np.ndarray:
    """Which rows of q (N, n) repeat another one of them, or one that was accepted: (N,) bool."""
    before = np.concatenate([*(rows.q for rows in accepted), q])
    again = np.ones(len(before), dtype=bool)
    again[distinct(before)] = False
    return again[len(before) - len(q) :]


def links(robot: Robot, targets: Array, q: Array) -> tuple[Array, Array]:
    """Ends (N, s, 3) of the straight parts of the arm in K_0: between joints, flange to targets."""
    frames = robot.mechanism.frames(q)
    if frames.cuts is not None:
        moving = np.array(robot.chain.placed_on) >= 0
        starts, ends = (each[:, moving] for each in frames.links(robot.chain.placed_on))
        on_tool = transform_points(frames.tool, targets)
        tool = np.broadcast_to(frames.tool[:, None, :3, 3], on_tool.shape)
        return np.concatenate([starts, tool], axis=1), np.concatenate([ends, on_tool], axis=1)
    joints = frames.after[:, :, :3, 3]
    points = np.concatenate(
        [frames.tool[:, None, :3, 3], transform_points(frames.tool, targets)], axis=1
    )
    last = np.broadcast_to(joints[:, -1:], points.shape)
    return np.concatenate([joints[:, :-1], last], axis=1), np.concatenate(
        [joints[:, 1:], points], axis=1
    )


def crosses(start: Array, end: Array, box: Array) -> np.ndarray:
    """Whether straight parts (…, 3) touch a box (6,), lower and upper corner: (…,) bool."""
    way = end - start
    way = np.where(np.abs(way) < 1e-12, 1e-12, way)  # a piece along a face: far away or everywhere
    first, second = (box[:3] - start) / way, (box[3:] - start) / way
    enters = np.minimum(first, second).max(axis=-1)
    leaves = np.maximum(first, second).min(axis=-1)
    result: np.ndarray = np.maximum(enters, 0.0) <= np.minimum(leaves, 1.0)
    return result


def inside(robot: Robot, workspace: Workspace, q: Array) -> np.ndarray:
    """Whether q (N, n) is in a workspace as `sample_configurations` draws from it, (N,) bool:
    limits, box, cone and roll.

    For n < 6 the cone is not checked, because the drawn pose is only approximated.
    """
    result: np.ndarray = robot.within_limits(q)
    if not workspace.bounded:
        return result
    home = robot.mechanism.forward(workspace.home[None])[0]
    pose = robot.mechanism.forward(q)
    result &= (np.abs(pose[:, :3, 3] - home[:3, 3]) <= workspace.box / 2 + 1e-9).all(axis=-1)
    if robot.n < 6:
        return result
    x, y, z, w = Rotation.from_matrix(home[:3, :3].T @ pose[:, :3, :3]).as_quat().T
    # swing, then twist about z
    tilt, turn = (
        2 * np.arctan2(np.hypot(x, y), np.hypot(z, w)),
        2 * np.arctan2(z, w),
    )
    turn = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
    result &= (tilt <= workspace.cone + 1e-9) & (turn <= workspace.roll + 1e-9)
    return result
