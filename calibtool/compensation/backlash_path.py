"""Taking up backlash along a path: what corrected joints need on top, by the direction in which
each joint moves.
"""

import numpy as np

from calibtool.errormodel.operating_conditions import directions, last_moved
from calibtool.robot.se3 import Array


class BacklashPath:
    """Remembers where the joints last moved to and from which side, over batches of rows in the
    order of motion.
    """

    def __init__(
        self, backlash: Array, lower: Array | float = -np.inf, upper: Array | float = np.inf
    ) -> None:
        """backlash (n,): half widths; lower, upper (n,): joint limits; rad or m."""
        self.backlash, self.lower, self.upper = backlash, lower, upper
        self._last: Array | None = None
        self._direction: Array | None = None

    def taken_up(self, corrected: Array) -> Array:
        """Half width times direction for corrected joint positions (N, n) in order: (N, n), to
        be added to them.

        The directions are those of the corrected motion, which is the one that is driven: a
        correction turns small steps round. What is added does not turn them again, and takes no
        joint beyond a limit. 0 for a joint that has not moved yet: nobody knows its side. Rows with
        NaN are not driven to and get 0.
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
