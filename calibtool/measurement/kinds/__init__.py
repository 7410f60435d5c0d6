"""Kinds of observation, one file each: what an instrument measures of the tool.

A new kind is one more line here.
"""

from calibtool.measurement.kinds.kind import Kind, Readings
from calibtool.measurement.kinds.points import TargetPoints
from calibtool.measurement.kinds.pose import SensorPose

__all__ = ["KINDS", "Kind", "Readings", "SensorPose", "TargetPoints"]

KINDS: dict[str, Kind] = {kind.id: kind for kind in (TargetPoints(), SensorPose())}
