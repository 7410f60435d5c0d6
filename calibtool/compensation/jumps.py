"""Rows in order: where a correction changes faster than the command."""

from dataclasses import dataclass

import numpy as np

from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

LARGEST_RATIO = 0.15  # of the change of a correction to the commanded step, from row to row
_SMALLEST = 1e-6  # rad, or characteristic lengths: smaller changes are rounding


@dataclass(frozen=True)
class CorrectionJump:
    """A row whose correction changes faster than LARGEST_RATIO allows.

    row      its number in the batch
    joint    index of the joint whose correction changes most
    change   of that joint's correction since the row before, rad or m
    step     the largest commanded step of a joint, rad, or characteristic lengths
    """

    row: int
    joint: int
    change: float
    step: float


class CorrectionPath:
    """State of the last row of joints over batches of rows in order."""

    def __init__(self, robot: Robot) -> None:
        self._span = np.where(robot.prismatic, robot.length, 1.0)
        self._last: tuple[Array, Array] | None = None

    def jumps(self, commanded: Array, corrected: Array) -> list[CorrectionJump]:
        """Jumps among the next rows: commanded and corrected joints (N, n), rad or m.

        Rows with NaN are not driven to: the next row has the one before them for a neighbour.
        """
        driven = np.flatnonzero(np.isfinite(corrected).all(axis=-1))
        if not len(driven):
            return []
        asked, correction = commanded[driven], (corrected - commanded)[driven]
        before = (asked[0], correction[0]) if self._last is None else self._last
        self._last = asked[-1], correction[-1]
        steps = np.abs(np.diff(asked, axis=0, prepend=before[0][None]) / self._span).max(axis=-1)
        changes = np.abs(np.diff(correction, axis=0, prepend=before[1][None]))
        largest = (changes / self._span).max(axis=-1)
        found = np.flatnonzero(largest > np.maximum(LARGEST_RATIO * steps, _SMALLEST))
        joints = (changes / self._span).argmax(axis=-1)
        return [
            CorrectionJump(
                int(driven[k]), int(joints[k]), float(changes[k, joints[k]]), float(steps[k])
            )
            for k in found
        ]
