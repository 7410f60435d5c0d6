"""Errors as an instrument observes them: target points or a sensor."""

import numpy as np

from calibtool.evaluation.metrics import MethodErrors
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import measured_in_base, residuals
from calibtool.measurement.registration import rigid_fit
from calibtool.measurement.setup import Setup, determines_orientation
from calibtool.robot.se3 import Array, log3, transform_points


def errors_against(
    name: str, measurements: Measurements, setup: Setup, pose: Array
) -> MethodErrors:
    """Measured minus predicted observations for poses (N, 4, 4) in a set-up, in K_0."""
    readings = measured_in_base(measurements, setup)
    if setup.kind.id == "points":
        return point_errors(name, readings.points, pose, setup)
    moved = setup.kind.displacements(readings, setup, pose)
    angles = ~setup.kind.lengths(setup)
    turned = residuals(measurements, setup, pose)[:, angles] if angles.any() else None
    return MethodErrors(name, moved, turned)


def point_errors(name: str, points: Array, pose: Array, setup: Setup) -> MethodErrors:
    """Errors (N, m, 3) in m of target points in K_0 with respect to those of poses (N, 4, 4).

    The orientation error is that of the best rigid fit; None where the targets do not determine it.
    """
    expected = transform_points(pose, setup.targets)
    turn = None
    if determines_orientation(setup.targets):
        turn = log3(rigid_fit(expected, points)[:, :3, :3])
    return MethodErrors(name, points - expected, turn)


def noise_of_errors(measurements: Measurements) -> dict[str, float | None]:
    """Root mean square of the errors that noise alone causes: `position` in m and `orientation` in
    rad.

    A target has √3 σ. A rotation observed by targets at r_i from their centre has the covariance σ²
    (Σ |r_i|² I − r_i r_iᵀ)⁻¹, and its rms is the root of the trace. None where it is not observed,
    or the instrument measures neither points nor poses.
    """
    sigma, targets = measurements.noise_position, measurements.setup.targets
    turn = None
    if measurements.setup.kind.id == "pose":
        turn = float(np.sqrt(3.0) * measurements.noise_orientation)
    elif determines_orientation(targets):
        arm = targets - targets.mean(axis=0)
        seen = (arm**2).sum() * np.eye(3) - arm.T @ arm
        turn = float(sigma * np.sqrt(np.trace(np.linalg.inv(seen))))
    if measurements.setup.kind.id not in ("points", "pose"):
        return {"position": None, "orientation": None}
    return {"position": float(np.sqrt(3.0) * sigma), "orientation": turn}
