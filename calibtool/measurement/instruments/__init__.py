"""Simulated instruments besides a tracker: contact, wires, probes, cameras, a second arm.

Each chooses its place in the cell, drives the actual robot to where it sees something, and reads
with its own noise. Its set-up is kept as truth, and unknown to every fit. A new instrument is one
more line here.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calibtool.measurement.instruments.cameras import camera_beside, camera_on_tool
from calibtool.measurement.instruments.cell import Cell, Observed
from calibtool.measurement.instruments.gauge import contact
from calibtool.measurement.instruments.image_corners import corners_beside, corners_on_tool
from calibtool.measurement.instruments.probes import plane_probe, sphere_probe
from calibtool.measurement.instruments.second_robot import second_arm
from calibtool.measurement.instruments.wires import wires
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import readonly

__all__ = ["INSTRUMENTS", "Cell", "Observed", "unknown"]

INSTRUMENTS: dict[str, Callable[[Cell, int, int, np.random.Generator], Observed]] = {
    "contact": contact,
    "distance": wires,
    "plane": plane_probe,
    "sphere": sphere_probe,
    "second-arm": second_arm,
    "board": camera_on_tool,
    "camera": camera_beside,
    "corners": corners_on_tool,
    "corners-beside": corners_beside,
}


def unknown(setup: Setup) -> Setup:
    """The set-up as an estimator may start from it: only its kind is known."""
    blank = replace(
        setup,
        T_instrument_base=readonly(np.eye(4)),
        targets=readonly(np.zeros_like(setup.targets)),
    )
    for name, array in setup.arrays.items():
        if name in setup.kind.given:
            continue
        value = readonly(setup.kind.blank(name, array))
        blank = replace(blank, **{name: value})  # type: ignore[arg-type]
    if setup.further_frames is not None:
        frames = np.broadcast_to(np.eye(4), setup.further_frames.shape).copy()
        blank = replace(blank, further_frames=readonly(frames))
    return blank
