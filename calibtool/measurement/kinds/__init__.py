"""Kinds of observation, one file each: what an instrument measures of the tool.

A new kind is one more line here.
"""

from calibtool.measurement.kinds.board import BoardPose
from calibtool.measurement.kinds.corners import CornersFromBeside, CornersFromTool
from calibtool.measurement.kinds.distance import Distances
from calibtool.measurement.kinds.kind import Kind, Readings
from calibtool.measurement.kinds.plane import PlaneProbe
from calibtool.measurement.kinds.points import TargetPoints
from calibtool.measurement.kinds.pose import SensorPose
from calibtool.measurement.kinds.second_arm import SeenFromArm
from calibtool.measurement.kinds.sphere import SphereProbe

__all__ = [
    "KINDS",
    "BoardPose",
    "CornersFromBeside",
    "CornersFromTool",
    "Distances",
    "Kind",
    "PlaneProbe",
    "Readings",
    "SeenFromArm",
    "SensorPose",
    "SphereProbe",
    "TargetPoints",
]

KINDS: dict[str, Kind] = {  # a kind with the arrays of another and more comes before it
    kind.id: kind
    for kind in (
        TargetPoints(),
        SensorPose(),
        CornersFromTool(),
        CornersFromBeside(),
        BoardPose(),
        Distances(),
        PlaneProbe(),
        SphereProbe(),
        SeenFromArm(),
    )
}
