"""Configurations in which an instrument sees the tool, similar to a few rows in which it has seen
it.

The limits of a plane, a gauge or a camera's field of view are known from rows: tips are moved
between the touched points, boards between the places in which the camera saw them. Without any
measurement the rows are those of a simulated instrument, whose set-up is the plan's proposal.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from calibtool.errormodel.actual import ActualRobot
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import NoSolutionError
from calibtool.measurement.instruments import INSTRUMENTS, Cell
from calibtool.measurement.instruments.cell import brought
from calibtool.measurement.kinds.corners import Corners
from calibtool.measurement.kinds.kind import Readings, of_place
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.setup import Setup
from calibtool.robot.inverse import solve_poses
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, inverse, transform_points
from calibtool.robot.workspace import Workspace

_PROPOSED = 60  # rows of a proposed set-up
_TILT, _ROLL = np.deg2rad(30.0), np.deg2rad(60.0)  # from how the tool stood in a known row
_FREE = ("distance", "second-arm")  # kinds that see the tool wherever it is


class Rows(NamedTuple):
    """Joint positions (N, n), rad or m; the labelled place of each row (N,), or None; and the
    touched points (N, c), m, or None: points of the gauge, or heights above the plane.
    """

    q: Array
    place: np.ndarray | None = None
    touches: Array | None = None

    def take(self, index: np.ndarray) -> "Rows":
        """Some of the rows: indices (k,) or a mask (N,)."""
        return Rows(*(None if part is None else part[index] for part in self))  # type: ignore[arg-type]

    def with_more(self, more: "Rows") -> "Rows":
        """These rows and more."""
        pairs = zip(self, more, strict=True)
        both = (None if one is None else np.concatenate([one, other]) for one, other in pairs)
        return Rows(*both)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class InstrumentRows:
    """An instrument in a set-up, and rows in which it has seen the tool.

    noise, noise_orientation  of the instrument per coordinate, m and rad
    """

    robot: Robot
    workspace: Workspace
    setup: Setup
    rows: Rows
    readings: Readings
    noise: float
    noise_orientation: float

    @classmethod
    def proposed(
        cls,
        robot: Robot,
        workspace: Workspace,
        instrument: str,
        places: int,
        gauge: float | None,
        noise: float,
        rng: np.random.Generator,
    ) -> Self:
        """A simulated instrument beside the nominal robot, see `instruments`."""
        cell = Cell(robot, ActualRobot(RobotErrors.of(robot)), workspace, 0.0, gauge)
        seen = INSTRUMENTS[instrument](cell, max(_PROPOSED, 20 * places), places, rng)
        own = seen.noise, None if seen.deviations is None else np.median(seen.deviations, axis=0)
        stated = noise if own[0] is None else own[0]
        turned = stated
        if own[1] is not None:
            stated, turned = float(np.median(own[1][:3])), float(np.median(own[1][3:]))
        setup = replace(seen.setup, places=seen.places)
        rows = Rows(seen.q, seen.readings.place)
        return cls(robot, workspace, setup, rows, seen.readings, stated, turned)

    @classmethod
    def of(cls, measurements: Measurements, workspace: Workspace) -> Self:
        """The instrument of measurements, in its registered set-up."""
        rows = Rows(measurements.q, measurements.place)
        return cls(
            measurements.robot,
            workspace,
            measurements.setup,
            rows,
            measurements.readings,
            measurements.noise_position,
            measurements.noise_orientation,
        )

    def draw(self, count: int, rng: np.random.Generator) -> Rows:
        """About `count` rows in which the nominal robot is seen, fewer where these are hard to
        find.

        Raises NoSolutionError where hardly any is found.
        """
        kind = self.setup.kind
        if kind.id in _FREE or (kind.id == "points" and not self._touches):
            q = sample_configurations(self.robot, self.workspace, count, rng)
            one = self.setup.places and kind.id != "second-arm"
            return Rows(q, rng.integers(len(self.setup.places), size=count) if one else None)
        i, j = self._pairs(count, rng)
        own = self.rows.take(i)
        robot = self.robot
        if robot.n < 6 and kind.id in ("plane", "sphere"):
            q, good = self._brought(i, j, rng)
        else:
            touched = kind.id in ("plane", "sphere", "points")
            solved = solve_poses(
                robot.mechanism.forward_and_jacobian,
                self._touching(i, j, rng) if touched else self._in_view(i, j, rng),
                own.q,
                length=robot.length,
                lower=robot.lower,
                upper=robot.upper,
                tolerance=1e-9,
            )
            q, good = solved.q, solved.reached
        good &= robot.within_limits(q)
        found = Rows(q, own.place, self._touched(i)).take(good)
        seen = kind.sees(self.setup, robot.mechanism.forward(found.q), found.place)
        if good.sum() < 0.02 * count or not seen.any():
            raise NoSolutionError(
                f"{robot.name}: hardly any configuration is left in which the instrument sees the "
                "tool; measure a few more rows by hand and give them with --set-up"
            )
        return found.take(seen)

    @property
    def _touches(self) -> bool:
        """Whether the points are sockets of a gauge, which repeat."""
        points = self.readings.points
        if self.setup.kind.id != "points":
            return False
        distinct = len(np.unique(points.reshape(-1, 3), axis=0))
        return bool(2 * distinct <= len(points))

    def _touched(self, i: np.ndarray) -> Array | None:
        """The touched points of rows i: points of the gauge (k, 3), or heights (k, 1) to 0.1 mm."""
        if self._touches:
            points: Array = self.readings.points[i, 0]
            return points
        if self.readings.values is None or self.setup.kind.id not in ("plane", "sphere"):
            return None
        found: Array = np.round(self.readings.values[i], 4) + 0.0
        return found

    def _pairs(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Known rows i and, of the same place, j: (count,) each."""
        known = len(self.rows.q)
        place = np.zeros(known, dtype=int) if self.rows.place is None else self.rows.place
        i = rng.integers(known, size=count)
        order = np.argsort(place, kind="stable")
        first = np.searchsorted(place[order], place[i])
        many = np.bincount(place)[place[i]]
        return i, order[first + (rng.random(count) * many).astype(int)]

    def _brought(
        self, i: np.ndarray, j: np.ndarray, rng: np.random.Generator
    ) -> tuple[Array, np.ndarray]:
        """Joint positions (k, n) between those of rows i and j that touch what these touched, and
        which of them do: for arms that cannot take every orientation.
        """
        setup, robot, count = self.setup, self.robot, len(i)
        place = None if self.rows.place is None else self.rows.place[i]
        touched = self._touched(i)
        read = np.zeros(count) if touched is None else touched[:, 0]

        def gap(points: Array) -> tuple[Array, Array, np.ndarray]:
            every = np.ones(count, dtype=bool)
            if setup.planes is not None:
                planes = of_place(setup.planes, place, count)
                height = (points * planes[:, :3]).sum(axis=-1) - planes[:, 3]
                return height - read, planes[:, :3], every
            assert setup.spheres is not None
            spheres = of_place(setup.spheres, place, count)
            away = points - spheres[:, :3]
            distance = np.linalg.norm(away, axis=-1)
            normal = away / np.maximum(distance, 1e-12)[:, None]
            return distance - spheres[:, 3] - read, normal, every

        part = rng.random((count, 1))
        between = part * self.rows.q[i] + (1 - part) * self.rows.q[j]
        return brought(robot, robot.mechanism, between, setup.targets[0], gap)

    def _touching(self, i: np.ndarray, j: np.ndarray, rng: np.random.Generator) -> Array:
        """Poses of the tool (k, 4, 4) with its tip between those of rows i and j."""
        setup, count = self.setup, len(i)
        poses = self.robot.mechanism.forward(self.rows.q)
        tips = transform_points(poses, setup.targets)[:, 0]
        part = rng.random((count, 1))
        at = part * tips[i] + (1 - part) * tips[j]
        place = None if self.rows.place is None else self.rows.place[i]
        touched = self._touched(i)
        read = np.zeros(count) if touched is None else touched[:, 0]
        if setup.planes is not None:
            planes = of_place(setup.planes, place, count)
            above = (at * planes[:, :3]).sum(axis=-1) - planes[:, 3]
            at = at + (read - above)[:, None] * planes[:, :3]
        elif setup.spheres is not None:
            spheres = of_place(setup.spheres, place, count)
            away = at - spheres[:, :3]
            away /= np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9)
            at = spheres[:, :3] + (spheres[:, 3] + read)[:, None] * away
        else:
            at = tips[i]
        found = poses[i] @ _turns(count, rng)
        found[:, :3, 3] = at - found[:, :3, :3] @ setup.targets[0]
        result: Array = found
        return result

    def _in_view(self, i: np.ndarray, j: np.ndarray, rng: np.random.Generator) -> Array:
        """Poses of the tool (k, 4, 4) with the board between where the camera saw it in rows i
        and j: a field of view is convex.
        """
        setup, kind, count = self.setup, self.setup.kind, len(self.rows.q)
        carried, standing, on_tool = _board_and_camera(setup)
        cell = of_place(standing, self.rows.place, count)
        tool = self.robot.mechanism.forward(self.rows.q) @ carried
        seen = inverse(tool) @ cell if on_tool else inverse(cell) @ tool
        middle = np.zeros(3)
        if isinstance(kind, Corners) and setup.corners is not None:
            middle = setup.corners.mean(axis=0)
        centres = transform_points(seen, middle[None])[:, 0]
        part = rng.random((len(i), 1))
        moved = seen[i] @ _turns(len(i), rng)
        at = part * centres[i] + (1 - part) * centres[j]
        moved[:, :3, 3] = at - moved[:, :3, :3] @ middle
        cell = cell[i]
        in_base = cell @ inverse(moved) if on_tool else cell @ moved
        found: Array = in_base @ inverse(carried)
        return found


def _board_and_camera(setup: Setup) -> tuple[Array, Array, bool]:
    """Object on the tool (4, 4), objects in the cell (G, 4, 4), and whether the first is a
    camera.
    """
    if setup.T_tool_camera is not None and setup.T_base_boards is not None:
        return setup.T_tool_camera, setup.T_base_boards, True
    if setup.T_tool_board is not None and setup.T_base_cameras is not None:
        return setup.T_tool_board, setup.T_base_cameras, False
    sensor = np.eye(4)
    assert setup.R_tool_sensor is not None
    sensor[:3, :3], sensor[:3, 3] = setup.R_tool_sensor, setup.targets[0]
    return sensor, inverse(setup.frames), False


def _turns(count: int, rng: np.random.Generator) -> Array:
    """Random tilts and turns (count, 4, 4) about the axes of what is turned."""
    tilt, roll = np.zeros((count, 6)), np.zeros((count, 6))
    tilt[:, 3:5] = rng.uniform(-_TILT, _TILT, (count, 2))
    roll[:, 5] = rng.uniform(-_ROLL, _ROLL, count)
    found: Array = exp6(tilt) @ exp6(roll)
    return found


def placed(setup: Setup) -> list[str]:
    """Positions of a proposed instrument, in words, one line for each object; lengths in mm."""

    def at(point: Array) -> str:
        return ", ".join(f"{v:.0f}" for v in np.asarray(point) * 1e3)

    def along(direction: Array) -> str:
        return ", ".join(f"{v:.2f}" for v in direction)

    lines = []
    names = setup.places or ("it",)
    if setup.kind.id == "points":
        bases = inverse(setup.frames)
        for name, T in zip(names, bases, strict=True):
            lines.append(f"{name}: gauge at {at(T[:3, 3])} mm, along {along(T[:3, 0])}")
    for what, array in (("plane", setup.planes), ("sphere", setup.spheres)):
        for name, row in zip(names, [] if array is None else array, strict=False):
            if what == "plane":
                lines.append(
                    f"{name}: plane through {at(row[:3] * row[3])} mm, normal {along(row[:3])}"
                )
            else:
                lines.append(f"{name}: sphere of {row[3] * 1e3:.0f} mm at {at(row[:3])} mm")
    for k, anchor in enumerate([] if setup.anchors is None else setup.anchors):
        lines.append(f"wire {k + 1}: fixed at {at(anchor)} mm")
    for what, array in (("board", setup.T_base_boards), ("camera", setup.T_base_cameras)):
        for name, T in zip(names, [] if array is None else array, strict=False):
            lines.append(f"{name}: {what} at {at(T[:3, 3])} mm, its z along {along(T[:3, 2])}")
    if setup.kind.id == "pose":
        for name, T in zip(names, inverse(setup.frames), strict=True):
            lines.append(f"{name}: camera at {at(T[:3, 3])} mm, its z along {along(T[:3, 2])}")
    if len(setup.targets) == 1 and not setup.kind.id.startswith("corners"):
        lines.append(f"on the tool: the point {at(setup.targets[0])} mm")
    return lines
