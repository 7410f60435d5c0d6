"""Joint positions as a stream with its own clock, taken at the instants of another clock."""

from dataclasses import dataclass, replace

import numpy as np

from calibtool.errormodel.operating_conditions import directions
from calibtool.robot.se3 import Array, readonly


@dataclass(frozen=True, eq=False)
class JointStream:
    """Joint positions over time.

    times   (L,) rising, s, on the controller's clock
    q       (L, n) joint positions, rad or m
    stamps  (N,) when the rows were measured, s, on the instrument's clock
    offset  added to the stamps to get the controller's time, s
    """

    times: Array
    q: Array
    stamps: Array
    offset: float = 0.0

    @classmethod
    def of(cls, times: Array, q: Array, stamps: Array) -> "JointStream":
        """A stream from times (L,), q (L, n) and stamps (N,), rows in any order.

        Rows without a stamp are left out, of equal stamps the
        first kept.
        """
        order = np.argsort(times, kind="stable")
        order = order[np.isfinite(times[order])]
        _, first = np.unique(times[order], return_index=True)
        return cls(readonly(times[order][first]), readonly(q[order][first]), readonly(stamps))

    def at(self, offset: float) -> tuple[Array, Array]:
        """Joints and their rates (N, n) at the stamps plus an offset, linearly interpolated."""
        after, part = self._between(offset)
        step = self.q[after] - self.q[after - 1]
        return self.q[after - 1] + part * step, step / np.diff(self.times)[after - 1, None]

    def directions(self) -> Array:
        """Direction of every joint's last motion at the stamps: (N, n) of −1, 0, +1."""
        found: Array = directions(self.q)[self._between(self.offset)[0]]
        return found

    def gaps(self) -> Array:
        """Distance of the rows of the stream around each stamp, s: (N,); infinite outside."""
        after, _ = self._between(self.offset)
        instants = self.stamps + self.offset
        inside = (instants >= self.times[0]) & (instants <= self.times[-1])
        return np.where(inside, np.diff(self.times)[after - 1], np.inf)

    def rows(self, index: np.ndarray) -> "JointStream":
        """The same stream at some of the stamps: their indices (k,)."""
        return replace(self, stamps=readonly(self.stamps[index]))

    def _between(self, offset: float) -> tuple[np.ndarray, Array]:
        """The row of the stream after each stamp, and the part of the way to it: (N,), (N, 1)."""
        instants = self.stamps + offset
        after = np.searchsorted(self.times, instants).clip(1, len(self.times) - 1)
        part = (instants - self.times[after - 1]) / np.diff(self.times)[after - 1]
        return after, np.clip(part, 0.0, 1.0)[:, None]
