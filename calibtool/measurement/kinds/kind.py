"""Protocol of a kind of observation: residuals, their columns, free part of the set-up."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from calibtool.measurement.rotation_search import nearest_rotation
from calibtool.robot.se3 import Array, inverse, readonly, transform_points, translation

if TYPE_CHECKING:
    from calibtool.measurement.setup import Setup


class Readings(NamedTuple):
    """Readings of N rows.

    points     (N, m, 3) m; NaN for a point that was not seen
    rotations  (N, 3, 3) or None
    values     (N, w) lengths, m, or image coordinates, px; NaN for one that was not read; None for
               kinds without
    place      (N,) number of the labelled place that the row belongs to; None: all to the first
    """

    points: Array
    rotations: Array | None = None
    values: Array | None = None
    place: np.ndarray | None = None

    @property
    def seen(self) -> np.ndarray:
        """Which points were seen: (N, m) bool."""
        return ~np.isnan(self.points[..., 0])


class Kind(ABC):
    """A kind of observation.

    A row has d coordinates, in m and rad; predicted poses are T_base_tool (N, 4, 4). The set-up may
    have several labelled places (stations of an instrument, placements of a gauge, boards, planes),
    one of which a row belongs to.

    id      name in files
    words   description; `{m}` stands for the number of points
    arrays  of the set-up beside frame and targets, by name: (shape, unit, description), -1 for any
            length
    given   names of those that are known beforehand, if only roughly
    unit    of the readings' values
    sees_all  whether the instrument sees the tool wherever it is
    """

    id: ClassVar[str]
    words: ClassVar[str]
    arrays: ClassVar[dict[str, tuple[tuple[int, ...], str, str]]] = {}
    of_points: ClassVar[bool] = True
    given: ClassVar[tuple[str, ...]] = ()
    unit: ClassVar[str] = "m"
    sees_all: ClassVar[bool] = True

    @abstractmethod
    def coordinates(self, setup: Setup) -> int:
        """Number of coordinates d of a row."""

    @abstractmethod
    def names(self, setup: Setup) -> tuple[str, ...]:
        """Names (k,) of the free elements of the set-up beside the instrument's first frame."""

    @abstractmethod
    def residuals(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        """Measured minus predicted: (N, d); 0 for what was not seen."""

    @abstractmethod
    def matrix(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        """∂(observation)/∂δy: (N, d, 6)."""

    @abstractmethod
    def columns(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
        """∂(observation)/∂(free elements): (N, d, k)."""

    @abstractmethod
    def moved(self, setup: Setup, step: Array) -> Setup:
        """The set-up after a step (k,) of its free elements."""

    def blank(self, name: str, array: Array) -> Array:
        """An array of the set-up before anything is known: zeros and identities."""
        if array.shape[-2:] in ((3, 3), (4, 4)):
            return np.broadcast_to(np.eye(array.shape[-1]), array.shape).copy()
        return np.zeros_like(array)

    def registered(self, setup: Setup) -> np.ndarray:
        """Which free elements (k,) bool a registration alone fits; the complete model fits all."""
        return np.ones(len(self.names(setup)), dtype=bool)

    def sees(self, setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> np.ndarray:
        """Whether the instrument sees anything at these poses: (N,) bool."""
        return np.ones(len(T_base_tool), dtype=bool)

    def weights(self, readings: Readings, noise_position: float, noise_orientation: float) -> Array:
        """1/σ of every coordinate (N, d) from the stated noise, 0 for what was not seen."""
        if readings.values is not None:
            return np.isfinite(readings.values) / noise_position
        return readings.seen.repeat(3, axis=-1) / noise_position

    def lengths(self, setup: Setup) -> np.ndarray:
        """Which coordinates are lengths, the others angles: (d,) bool."""
        return np.ones(self.coordinates(setup), dtype=bool)

    def in_axes(self, setup: Setup, rows: Array, place: np.ndarray | None) -> Array:
        """Rows (N, d, k) along the axes in which the noise of single coordinates is stated."""
        return rows

    def displacements(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        """Residuals as displacements of points in K_0: (N, ·, 3), m."""
        residual = self.residuals(readings, setup, T_base_tool)[:, self.lengths(setup)]
        return residual.reshape(len(residual), -1, 3)

    # --- registration ---

    def starts(self, readings: Readings, setup: Setup, poses: Array) -> list[Setup]:
        """Set-ups to start a registration from, where the kind is not one of points."""
        return []

    def as_points(self, readings: Readings, setup: Setup, arm: float) -> tuple[Array, Array]:
        """The readings as points (N, k, 3) of targets (k, 3) on the tool, the start of a
        registration.

        arm: the distance in m at which an orientation error has the same weight as a position
        error.
        """
        raise NotImplementedError

    def from_points(self, setup: Setup, targets: Array) -> Setup:
        """The set-up with targets (k, 3) that were found for `as_points`."""
        raise NotImplementedError

    # --- other frames ---

    def in_tool(self, setup: Setup, T_new_tool: Array) -> Setup:
        """The set-up in another tool frame.

        T_new_tool (4, 4), m: pose of the present tool frame in the new one.
        """
        return replace(setup, targets=readonly(transform_points(T_new_tool, setup.targets)))

    def in_base(self, setup: Setup, T_new_base: Array) -> Setup:
        """The set-up in another base frame.

        T_new_base (4, 4), m: pose of the present base frame in the new one.
        """
        T_base_new = inverse(T_new_base)
        further = setup.further_frames
        return replace(
            setup,
            T_instrument_base=readonly(setup.T_instrument_base @ T_base_new),
            further_frames=None if further is None else readonly(further @ T_base_new),
        )


def places_of(place: np.ndarray | None, count: int) -> np.ndarray:
    """The number of each row's place, (count,); the first one where there are no labels."""
    return np.zeros(count, dtype=int) if place is None else place


def of_place(arrays: np.ndarray, place: np.ndarray | None, count: int) -> Array:
    """The array of each row's place: (G, …) → (count, …)."""
    found: Array = arrays[places_of(place, count)]
    return found


def array_of(setup: Setup, name: str) -> Array:
    """An array of the set-up that its kind has, by name."""
    found: Array = getattr(setup, name)
    return found


def tripod(poses: Array, arm: float) -> Array:
    """Origins of poses (N, 4, 4) and the points at `arm` (m) on their three axes: (N, 4, 3), m."""
    origin = poses[:, None, :3, 3]
    return np.concatenate([origin, origin + arm * np.swapaxes(poses[:, :3, :3], -1, -2)], axis=1)


def pose_of_tripod(points: Array) -> Array:
    """The pose (4, 4), m, with its origin at the first of points (4, 3), m, and axes nearest to
    those of their `tripod`.
    """
    pose = translation(points[0])
    pose[:3, :3] = nearest_rotation((points[1:] - points[:1]).T)
    return pose
