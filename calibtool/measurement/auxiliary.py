"""Auxiliary readings of instrument and controller: joints as read, time, temperature, reference
points.
"""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from calibtool.errors import InputError
from calibtool.robot.se3 import Array, readonly


@dataclass(frozen=True, eq=False)
class AuxiliaryReadings:
    """Further columns of N measured configurations; None where a table has none, NaN for a missing
    value.

    q_commanded       (N, n) joint positions that the controller was told to drive to, rad or m
    q_read            (N, n) joint positions that the controller reported, rad or m
    time_s            (N,) time stamps, s from an arbitrary start (UTC epoch for ISO 8601 stamps)
    temperature_c     (N,) temperature, °C
    reference_points  (N, k, 3) targets fixed to the base, measured again with every configuration,
                      in the instrument's frame, m
    The arrays are read-only. Raises InputError when they differ in length or have another shape.
    """

    q_commanded: Array | None = None
    q_read: Array | None = None
    time_s: Array | None = None
    temperature_c: Array | None = None
    reference_points: Array | None = None

    def __post_init__(self) -> None:
        lengths = set()
        for field, dimensions in zip(fields(self), (2, 2, 1, 1, 3), strict=True):
            values = getattr(self, field.name)
            if values is None:
                continue
            if values.ndim != dimensions or (dimensions == 3 and values.shape[2] != 3):
                raise InputError(f"auxiliary readings: {field.name} has shape {values.shape}")
            lengths.add(len(values))
            object.__setattr__(self, field.name, readonly(np.array(values, dtype=float)))
        if len(lengths) > 1:
            raise InputError(
                f"auxiliary readings: the columns have {sorted(lengths)} rows; expected as many as "
                "configurations"
            )

    def rows(self, index: np.ndarray) -> Self:
        """The same columns at some configurations only: their indices (k,)."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return type(self)(
            **{name: None if column is None else column[index] for name, column in values.items()}
        )
