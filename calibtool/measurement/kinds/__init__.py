"""Kinds of observation: what an instrument sees of the tool, one file each.

A new one is one more line here.
"""

from calibtool.measurement.kinds.kind import Kind, Readings
from calibtool.measurement.kinds.points import TargetPoints
from calibtool.measurement.kinds.pose import SensorPose

__all__ = ["KINDS", "Kind", "Readings", "SensorPose", "TargetPoints"]

KINDS: dict[str, Kind] = {kind.id: kind for kind in (TargetPoints(), SensorPose())}
