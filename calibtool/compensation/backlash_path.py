"""Backlash along a path: additional joint motion by the direction in which each joint moves."""

from typing import Self

import numpy as np

from calibtool.calibration import Calibration
from calibtool.errormodel.operating_conditions import directions, last_moved
from calibtool.robot.se3 import Array


class BacklashPath:
    """State of the backlash of each joint over batches of rows in the order of motion."""

    def __init__(
        self, backlash: Array, lower: Array | float = -np.inf, upper: Array | float = np.inf
    ) -> None:
        """backlash (n,): half widths; lower, upper (n,): joint limits; rad or m."""
        self.backlash, self.lower, self.upper = backlash, lower, upper
        self._last: Array | None = None
        self._direction: Array | None = None

    @classmethod
    def of(cls, calibration: Calibration) -> Self | None:
        """For the backlash and the joint limits of a calibrated robot; None without backlash."""
        widths, robot = calibration.base.errors["backlash"], calibration.robot
        return cls(widths, robot.lower, robot.upper) if widths.any() else None

    def taken_up(self, corrected: Array) -> Array:
        """Half width times direction (N, n), to be added to corrected joint positions (N, n) in
        order.

        Directions are those of the corrected motion, because a correction can reverse small steps.
        The addition neither reverses them again nor moves a joint beyond a limit. It is 0 for a
        joint that has not moved yet, since its side is unknown. Rows with NaN are not driven to and
        get 0.
        """
        result = np.zeros_like(corrected)
        driven = np.flatnonzero(np.isfinite(corrected).all(axis=-1))
        if len(driven):
            start = corrected[driven[0]] if self._last is None else self._last
            places = last_moved(corrected[driven], start)
            found = directions(places, start, self._direction)
            self._last, self._direction = places[-1], found[-1]
            to_lower = np.minimum(0.0, self.lower - corrected[driven])
            to_upper = np.maximum(0.0, self.upper - corrected[driven])
            result[driven] = np.clip(self.backlash * found, to_lower, to_upper)
        return result
