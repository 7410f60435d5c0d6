"""Operating conditions on which errors depend: direction of motion, payload, temperature."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from calibtool.errors import InputError
from calibtool.robot.se3 import Array, readonly

REFERENCE_C = 20.0  # °C at which lengths are those of the drawing
_STANDS_STILL = 1e-6  # rad or m: a smaller move is rounding and reverses no gear


@dataclass(frozen=True, eq=False)
class Conditions:
    """Operating conditions of N rows; None where unknown. A number () holds for every row.

    direction      (N, n) −1, 0, +1: direction of each joint's last motion before the row, 0 where
                   unknown
    payload_kg     (N,) mass at the tool; None: that of the description of the robot
    temperature_c  (N,) of the links; None: `REFERENCE_C`
    """

    direction: Array | None = None
    payload_kg: Array | None = None
    temperature_c: Array | None = None

    def rows(self, index: np.ndarray) -> Self:
        """Conditions of some rows only: their indices (k,)."""
        kept = {field.name: getattr(self, field.name) for field in fields(self)}
        return replace(
            self, **{k: readonly(v[index]) for k, v in kept.items() if v is not None and np.ndim(v)}
        )

    def alike(self, count: int) -> Iterator[tuple[Self, np.ndarray]]:
        """Groups of rows with equal payload and temperature: numbers and row indices."""
        columns = [v for v in (self.payload_kg, self.temperature_c) if v is not None and np.ndim(v)]
        if not columns:
            yield replace(self, direction=None), np.arange(count)
            return
        _, group = np.unique(np.stack(columns, axis=-1), axis=0, return_inverse=True)
        for number in range(group.max() + 1):
            rows = np.flatnonzero(group == number)
            yield replace(self, direction=None).rows(rows[0]), rows

    def anywhere(self, shape: tuple[int, ...], rng: np.random.Generator) -> Self:
        """Conditions for joints (N, n), drawn from these rows; unknown ones stay unknown."""
        direction = (
            None if self.direction is None else readonly(rng.choice([-1.0, 1.0], size=shape))
        )
        drawn = {
            name: None
            if values is None
            else readonly(rng.uniform(np.min(values), np.max(values), shape[0]))
            for name, values in (
                ("payload_kg", self.payload_kg),
                ("temperature_c", self.temperature_c),
            )
        }
        return replace(self, direction=direction, **drawn)

    def check(self, shape: tuple[int, ...], place: str) -> None:
        """InputError unless these are the conditions of joint positions of this shape (N, n)."""
        if self.direction is not None and (
            self.direction.shape != shape or not np.isin(self.direction, (-1, 0, 1)).all()
        ):
            raise InputError(
                f"{place}: the directions are not -1, 0 or 1 for every joint of every row"
            )
        for name, lowest in (("payload_kg", 0.0), ("temperature_c", -273.15)):
            values = getattr(self, name)
            if values is None:
                continue
            if np.ndim(values) and values.shape != shape[:1]:
                raise InputError(
                    f"{place}: {name} has shape {values.shape}; expected one number per "
                    f"row, {shape[:1]}"
                )
            if not (np.isfinite(values) & (values >= lowest)).all():
                raise InputError(
                    f"{place}: {name} holds a value that is not finite or below {lowest:g}"
                )


def directions(q: Array, start: Array | None = None, before: Array | None = None) -> Array:
    """Sign −1, 0, +1 of each joint's last motion on the way through the rows of q (N, n),
    in order: (N, n).

    A joint that stands still keeps its direction. start (n,): where it last counted as moved
    (`last_moved`) before the first row, and before (n,) the directions there; 0, unknown, until a
    joint has moved.
    """
    start = q[0] if start is None else start
    signs = np.sign(np.diff(last_moved(q, start), axis=0, prepend=start[None]))
    signs = np.concatenate([np.zeros((1, q.shape[1])) if before is None else before[None], signs])
    last = np.maximum.accumulate(np.where(signs != 0, np.arange(len(signs))[:, None], 0), axis=0)
    return np.take_along_axis(signs, last, axis=0)[1:]


def last_moved(q: Array, start: Array) -> Array:
    """Where each joint last counted as moved on the way through the rows of q (N, n), in order,
    from start (n,): (N, n).

    A joint counts as moved when it is farther from there than rounding. A joint that moves very
    slowly counts as moved every few rows.
    """
    places = q.copy()
    steps = np.abs(np.diff(q, axis=0, prepend=start[None]))
    for j in np.flatnonzero(((steps > 0.0) & (steps <= _STANDS_STILL)).any(axis=0)):
        place = float(start[j])
        for k, position in enumerate(q[:, j].tolist()):
            if abs(position - place) > _STANDS_STILL:
                place = position
            places[k, j] = place
    return places
