"""Protocol of a kind of observation: residuals of a row, their columns, and the free part of the
set-up.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from calibtool.robot.se3 import Array

if TYPE_CHECKING:
    from calibtool.measurement.measurements import Setup


class Readings(NamedTuple):
    """Readings of N rows.

    points     (N, m, 3) m; NaN for a point that was not seen
    rotations  (N, 3, 3) or None
    """

    points: Array
    rotations: Array | None = None

    @property
    def seen(self) -> np.ndarray:
        """Which points were seen: (N, m) bool."""
        seen: np.ndarray = ~np.isnan(self.points[..., 0])
        return seen


class Kind(ABC):
    """A kind of observation.

    A row has d coordinates in K_0, in m and rad; predicted poses are T_base_tool (N, 4, 4).

    id      name in files
    words   description; `{m}` stands for the number of points
    arrays  of the set-up beside the targets, by name: (shape, unit, description)
    """

    id: ClassVar[str]
    words: ClassVar[str]
    arrays: ClassVar[dict[str, tuple[tuple[int, ...], str, str]]] = {}

    @abstractmethod
    def names(self, points: int) -> tuple[str, ...]:
        """Names (d,) of the free elements of the set-up on the tool, as many as coordinates of a
        row.
        """

    @abstractmethod
    def residuals(self, readings: Readings, setup: Setup, T_base_tool: Array) -> Array:
        """Measured minus predicted in K_0: (N, d); 0 for what was not seen."""

    @abstractmethod
    def matrix(self, setup: Setup, T_base_tool: Array) -> Array:
        """∂(observation)/∂δy: (N, d, 6)."""

    @abstractmethod
    def moved(self, setup: Setup, step: Array) -> Setup:
        """Set-up after a step (d,) of its free elements.

        Displacements and left-multiplied rotations in the tool frame.
        """

    @abstractmethod
    def weights(self, readings: Readings, noise_position: float, noise_orientation: float) -> Array:
        """1/σ of every coordinate (N, d) from the stated noise, 0 for what was not seen."""

    @abstractmethod
    def as_points(self, readings: Readings, setup: Setup, arm: float) -> tuple[Array, Array]:
        """The readings as points (N, k, 3) of targets (k, 3) on the tool, to start a registration.

        arm: distance in m at which a rotation counts as much as a displacement.
        """

    @abstractmethod
    def from_points(self, setup: Setup, targets: Array) -> Setup:
        """Set-up from targets (k, 3) that were found for `as_points`."""

    @abstractmethod
    def in_tool(self, setup: Setup, T_new_tool: Array) -> Setup:
        """The set-up in another tool frame; T_new_tool (4, 4): pose of the present one in it, m."""

    def columns(self, setup: Setup, T_base_tool: Array) -> Array:
        """∂(observation)/∂(free elements): (N, d, d).

        Displacements and left-multiplied rotations in the tool frame, three by three.
        """
        d = len(self.names(len(setup.targets)))
        columns = np.zeros((len(T_base_tool), d // 3, 3, d // 3, 3))
        for block in range(d // 3):
            columns[:, block, :, block, :] = T_base_tool[:, :3, :3]
        return columns.reshape(len(T_base_tool), d, d)
