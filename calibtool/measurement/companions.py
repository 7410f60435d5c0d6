"""Companions of the measurements: what was recorded beside the joint positions and the points."""

from dataclasses import dataclass

from calibtool.robot.se3 import Array


@dataclass(frozen=True, eq=False)
class Companions:
    """Optional records, one row per configuration; None: not recorded.

    q_commanded, q_read  (N, n) joint positions sent to the controller and read back from it, rad or m
    time_s               (N,) time of the measurement, s
    temperature_c        (N,) temperature, °C
    reference_points     (N, k, 3) fixed points measured again and again, instrument's frame, m; NaN where missing
    """

    q_commanded: Array | None = None
    q_read: Array | None = None
    time_s: Array | None = None
    temperature_c: Array | None = None
    reference_points: Array | None = None
