"""Errors as an instrument observes them: target points or a sensor."""

from calibtool.evaluation.metrics import MethodErrors
from calibtool.measurement.measurements import Measurements, Setup, determines_orientation
from calibtool.measurement.observation import measured_in_base, residuals
from calibtool.measurement.registration import rigid_fit
from calibtool.robot.se3 import Array, log3, transform_points


def errors_against(
    name: str, measurements: Measurements, setup: Setup, pose: Array
) -> MethodErrors:
    """Measured minus predicted observations for T_base_tool `pose` (N, 4, 4), in K_0."""
    points, rotations = measured_in_base(measurements, setup)
    if rotations is None:
        return point_errors(name, points, pose, setup)
    residual = residuals(measurements, setup, pose)
    return MethodErrors(name, residual[:, None, :3], residual[:, 3:])


def point_errors(name: str, points: Array, pose: Array, setup: Setup) -> MethodErrors:
    """Errors (N, m, 3) in m of target points in K_0 with respect to those of poses (N, 4, 4).

    The orientation error is that of the best rigid fit; None where the targets do not determine it.
    """
    expected = transform_points(pose, setup.targets)
    turn = None
    if determines_orientation(setup.targets):
        turn = log3(rigid_fit(expected, points)[:, :3, :3])
    return MethodErrors(name, points - expected, turn)
