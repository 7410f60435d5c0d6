"""Checks of observations other than points and poses: lengths, heights, boards."""

import numpy as np

from calibtool.measurement.checks.camera_checks import camera_findings
from calibtool.measurement.checks.design import design_findings
from calibtool.measurement.checks.finding import Finding
from calibtool.measurement.checks.lonely_places import lonely_places
from calibtool.measurement.checks.nominal_fit import rms_of_lengths
from calibtool.measurement.checks.reading_mistakes import reading_findings
from calibtool.measurement.kinds.kind import of_place
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import transform_points
from calibtool.units import millimetres

_SUSPICIOUS = 5e-3  # of the length of the arm: with a larger residual, mistakes are looked for
_GROSS = 3e-2  # of the length of the arm: a larger residual is a warning
_LINE = 0.02  # extent across a line over that along it


def kind_findings(measurements: Measurements) -> list[Finding]:
    """Readings that the nominal robot does not explain, planes touched along a line, the design."""
    robot = measurements.robot
    setup, rms = rms_of_lengths(measurements)
    found = _lines(measurements, setup) if measurements.kind == "plane" else []
    if rms > _SUSPICIOUS * robot.length:
        found += reading_findings(measurements, rms) or camera_findings(measurements)
    if rms > _GROSS * robot.length and not found:
        message = (
            f"the nominal robot fits the readings to {millimetres(rms)} rms only; check the "
            "robot, its zero positions, the joint columns with their units and signs, and that "
            "rows of joints and of readings belong together"
        )
        found.append(Finding("nominal_robot", "warning", message, {"rms_mm": rms * 1e3}))
    found += [*lonely_places(measurements), *design_findings(robot, measurements.q)]
    return sorted(found, key=lambda finding: finding.severity != "warning")


def _lines(measurements: Measurements, setup: Setup) -> list[Finding]:
    """Planes whose points lie on a line."""
    assert setup.planes is not None
    poses = measurements.robot.mechanism.forward(measurements.q)
    points, found = transform_points(poses, setup.targets)[:, 0], []
    own = of_place(np.arange(len(setup.planes)), measurements.place, len(points))
    for g in range(len(setup.planes)):
        part = points[own == g]
        extents = np.linalg.svd(part - part.mean(axis=0), compute_uv=False)
        if len(part) >= 3 and extents[1] > _LINE * extents[0]:
            continue
        label = measurements.places[g] if measurements.places else "the plane"
        message = (
            f"all {len(part)} points of {label} lie on a line: its rotation about that line is "
            "unknown; touch it beside the line, too"
        )
        found.append(Finding("plane_of_a_line", "warning", message, {"plane": g + 1}))
    return found
