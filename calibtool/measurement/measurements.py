"""Measurements: commanded joints, observations, and the conditions of each row."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from calibtool.errormodel.actual import ActualRobot
from calibtool.errormodel.operating_conditions import Conditions
from calibtool.errors import InputError
from calibtool.measurement.kinds import Readings
from calibtool.measurement.setup import Setup
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, check_poses, readonly

# m or rad: smaller or larger than its inverse, and squares of weighted residuals overflow
SMALLEST_NOISE = 1e-15


@dataclass(frozen=True, eq=False)
class Truth:
    """Actual robot and actual set-up of a simulation."""

    actual: ActualRobot
    setup: Setup


@dataclass(frozen=True, eq=False, repr=False)
class Measurements:
    """N configurations and the observations made there.

    q            (N, n) joint positions that the robot was driven to, rad or m
    points       (N, m, 3) measured target points in the instrument's frame, m; NaN for a target
                 that was not seen
    rotations    (N, 3, 3) measured R_instrument_sensor of a 6-D instrument, or None
    setup        frames of instrument and targets, known or estimated
    noise_position, noise_orientation   stated standard deviations per coordinate, m and rad
    deviations   (N, d) standard deviations of every coordinate of every row along the instrument's
                 axes, m and rad; None where noise_position and noise_orientation hold for all
    truth        actual robot and set-up of a simulation; None for real measurements
    conditions   of every row, as far as they are known: directions of motion, payload, temperature
    values       (N, w) measured lengths, m, or image coordinates, px, of kinds that have such; NaN
                 for one that was not read
    place        (N,) number from 0 of the labelled place (station, placement, board) of each row;
                 None where all rows belong to one
    findings     what was found to be wrong with them when they were made, one line each
    provenance   command line, seed, checksums of inputs, versions: text by name
    commanded    (N, 4, 4) commanded T_base_tool in K_0, where q are joints corrected for it; None
                 where q itself is the command
    """

    robot: Robot
    q: Array
    points: Array
    rotations: Array | None
    setup: Setup
    noise_position: float
    noise_orientation: float
    truth: Truth | None = None
    conditions: Conditions = field(default_factory=Conditions)
    deviations: Array | None = None
    values: Array | None = None
    place: np.ndarray | None = None
    findings: tuple[str, ...] = ()
    provenance: dict[str, str] = field(default_factory=dict)
    commanded: Array | None = None

    def __post_init__(self) -> None:
        self.robot.check_positions(self.q, "measurements")
        shape = (len(self.q), len(self.setup.targets), 3)
        if self.points.shape != shape:
            raise InputError(
                f"measurements: points have shape {self.points.shape}, expected {shape}"
            )
        if not np.isfinite(self.setup.targets).all():
            raise InputError("measurements: a coordinate of the targets on the tool is not finite")
        whole = np.isfinite(self.points).all(axis=-1) | np.isnan(self.points).all(axis=-1)
        if not whole.all() or (
            self.rotations is not None and not np.isfinite(self.rotations).all()
        ):
            raise InputError("measurements: a measured value is not finite")
        if self.values is not None and (
            self.values.ndim != 2
            or len(self.values) != len(self.q)
            or not np.isfinite(self.values).any(axis=-1).all()
        ):
            raise InputError("measurements: a row has no measured length at all")
        if self.place is not None and (
            self.place.shape != self.q.shape[:1]
            or not np.isin(self.place, np.arange(len(self.places))).all()
        ):
            raise InputError("measurements: a row belongs to no labelled place")
        if self.setup.kind.of_points and not self.seen.any(axis=-1).all():
            raise InputError(
                f"measurements: row {int(np.argmin(self.seen.any(axis=-1))) + 1} has "
                "no target at all"
            )
        oriented = self.setup.kind.of_points and not self.setup.kind.lengths(self.setup).all()
        if (self.rotations is not None) != oriented:
            raise InputError(
                "measurements: measured rotations and the sensor's orientation on the tool "
                "belong together"
            )
        if self.rotations is not None and self.rotations.shape != (len(self.q), 3, 3):
            raise InputError(
                f"measurements: rotations have shape {self.rotations.shape}, expected "
                f"{(len(self.q), 3, 3)}"
            )
        self.conditions.check(self.q.shape, "measurements")
        if self.commanded is not None:
            check_poses(self.commanded, "measurements: commanded poses")
            if len(self.commanded) != len(self.q):
                raise InputError("measurements: the commanded poses are not as many as the rows")
        if self.truth is not None and self.truth.setup.targets.shape != self.setup.targets.shape:
            raise InputError("measurements: the true targets are not as many as the measured ones")
        if not all(
            SMALLEST_NOISE < noise < 1 / SMALLEST_NOISE
            for noise in (self.noise_position, self.noise_orientation)
        ):
            raise InputError(
                "measurements: the stated noise must be above zero; it is the weight of the fit"
            )

        if self.deviations is not None:
            if self.deviations.shape != (len(self.q), self.coordinates):
                raise InputError(f"measurements: deviations have shape {self.deviations.shape}")
            if not (
                (self.deviations > SMALLEST_NOISE) & (self.deviations < 1 / SMALLEST_NOISE)
            ).all():
                raise InputError("measurements: a standard deviation is not above zero")

    @classmethod
    def from_points(
        cls,
        robot: Robot,
        q: ArrayLike,
        points: ArrayLike,
        *,
        noise: float = 0.05e-3,
        targets: ArrayLike | None = None,
        T_instrument_base: ArrayLike | None = None,
    ) -> Self:
        """Measurements of target points from arrays.

        q                  (N, n) joint positions of the serial chain, rad or m
        points             (N, m, 3), or (N, 3) for one target: measured in the instrument's frame,
                           m; NaN for a target that was not seen
        noise              standard deviation of a coordinate, m
        targets            (m, 3) target points in the tool frame, m
        T_instrument_base  (4, 4) pose of K_0 in the instrument's frame

        What is not given of the set-up is registered with the nominal robot. Raises InputError for
        arrays that do not fit, NoSolutionError where too few rows register it.
        """
        points = np.asarray(points, dtype=float)
        points = points[:, None, :] if points.ndim == 2 else points
        known = targets is not None
        setup = Setup(
            T_instrument_base=_pose(T_instrument_base),
            targets=readonly(targets if known else np.zeros(points.shape[1:])),
            frame_known=T_instrument_base is not None,
            targets_known=known,
        )
        return cls(robot, readonly(q), readonly(points), None, setup, noise, 1e-3)._registered()

    @classmethod
    def from_poses(
        cls,
        robot: Robot,
        q: ArrayLike,
        T_instrument_sensor: ArrayLike,
        *,
        noise: float = 0.05e-3,
        noise_orientation: float = 0.1e-3,
        T_tool_sensor: ArrayLike | None = None,
        T_instrument_base: ArrayLike | None = None,
    ) -> Self:
        """Measurements of a 6-D sensor on the tool from arrays.

        q                    (N, n) joint positions of the serial chain, rad or m
        T_instrument_sensor  (N, 4, 4) measured poses, m
        noise, noise_orientation   standard deviations of a coordinate, m, and of a rotation, rad
        T_tool_sensor        (4, 4) pose of the sensor in the tool frame
        T_instrument_base    (4, 4) pose of K_0 in the instrument's frame

        What is not given of the set-up is registered with the nominal robot. Raises InputError for
        arrays that do not fit, NoSolutionError where too few rows register it.
        """
        poses = np.asarray(T_instrument_sensor, dtype=float)
        check_poses(poses, "measured poses")
        T_sensor = _pose(T_tool_sensor)
        setup = Setup(
            T_instrument_base=_pose(T_instrument_base),
            targets=readonly(T_sensor[None, :3, 3]),
            R_tool_sensor=readonly(T_sensor[:3, :3]),
            frame_known=T_instrument_base is not None,
            targets_known=T_tool_sensor is not None,
        )
        points, rotations = readonly(poses[:, None, :3, 3]), readonly(poses[:, :3, :3])
        return cls(
            robot, readonly(q), points, rotations, setup, noise, noise_orientation
        )._registered()

    def _registered(self) -> Self:
        if self.setup.known:
            return self
        from calibtool.measurement.registration import register  # which needs this module

        return replace(self, setup=register(self))

    def __repr__(self) -> str:
        observed = self.setup.kind.words.format(m=self.points.shape[1])
        return (
            f"<Measurements of {self.robot.name}: {len(self)} configurations, {observed}, "
            f"noise {self.noise_position * 1e3:g} mm>"
        )

    def __len__(self) -> int:
        return len(self.q)

    @property
    def seen(self) -> np.ndarray:
        """(N, m) bool: which targets were seen."""
        return ~np.isnan(self.points[..., 0])

    @property
    def readings(self) -> Readings:
        """What was measured, in the instrument's frame."""
        return Readings(self.points, self.rotations, self.values, self.place)

    @property
    def places(self) -> tuple[str, ...]:
        """Labels of the places."""
        return self.setup.places

    @property
    def coordinates(self) -> int:
        """Number of coordinates measured at a configuration where everything is seen."""
        return self.setup.kind.coordinates(self.setup)

    @property
    def equations(self) -> int:
        """Number of measured coordinates."""
        return int((self.setup.kind.weights(self.readings, 1.0, 1.0) > 0).sum())

    @property
    def kind(self) -> str:
        """`points` (target points) or `pose` (one 6-D sensor)."""
        return self.setup.kind.id

    def points_alone(self) -> Self:
        """The measured points without orientations and without the truth of a simulation."""
        setup = replace(self.setup, R_tool_sensor=None)
        deviations = (
            None
            if self.deviations is None
            else readonly(self.deviations[:, : 3 * len(setup.targets)])
        )
        return replace(self, rotations=None, setup=setup, truth=None, deviations=deviations)

    def anywhere(self, q: Array, rng: np.random.Generator) -> Self:
        """As if measured at q (N, n), rad or m, with everything seen; the readings are arbitrary.

        Every row has a random place and random conditions of these measurements.
        """
        count = len(q)
        width = None if self.values is None else self.values.shape[1]
        place = None if self.place is None else rng.integers(len(self.places), size=count)
        return replace(
            self.rows(np.zeros(count, dtype=int)),
            q=readonly(q),
            points=readonly(np.zeros((count, *self.points.shape[1:]))),
            values=None if width is None else readonly(np.zeros((count, width))),
            place=place,
            conditions=self.conditions.anywhere((count, self.robot.n), rng),
        )

    def rows(self, index: np.ndarray) -> Self:
        """The same measurements at some configurations only: their indices (k,)."""

        def chosen(values: Array | None) -> Array | None:
            return None if values is None else readonly(values[index])

        return replace(
            self,
            q=readonly(self.q[index]),
            points=readonly(self.points[index]),
            rotations=chosen(self.rotations),
            values=chosen(self.values),
            place=None if self.place is None else self.place[index],
            deviations=chosen(self.deviations),
            commanded=chosen(self.commanded),
            conditions=self.conditions.rows(index),
        )


def _pose(given: ArrayLike | None) -> Array:
    """A pose (4, 4), or the identity."""
    if given is None:
        return readonly(np.eye(4))
    pose = readonly(given)
    check_poses(pose[None], "pose")
    return pose
