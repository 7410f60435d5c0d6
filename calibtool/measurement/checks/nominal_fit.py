"""The nominal robot registered to measured points, from which the checks of the data start."""

from dataclasses import dataclass, replace

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import residuals
from calibtool.measurement.registration import register
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array


@dataclass(frozen=True, eq=False)
class Fit:
    """A set-up, residuals of the points (N, 3m) in K_0, rms distance per target, m (inf: none)."""

    setup: Setup
    residual: Array
    rms: float


def nominal_fit(measurements: Measurements, *, free: bool) -> Fit:
    """The nominal robot registered to the points alone; free: given parts of the set-up, too."""
    points = measurements.points_alone()
    setup = replace(points.setup, frame_known=False, targets_known=False) if free else points.setup
    points = replace(points, setup=setup)
    try:
        setup = register(points)
    except NoSolutionError:
        return Fit(setup, np.full((len(points), 3 * points.points.shape[1]), np.nan), np.inf)
    residual = residuals(points, setup, points.robot.mechanism.forward(points.q))
    return Fit(setup, residual, float(np.sqrt((residual**2).sum() / points.seen.sum())))


def rms_of_lengths(measurements: Measurements) -> tuple[Setup, float]:
    """The set-up registered to the nominal robot, and the rms residual of all lengths, m.

    The given set-up and infinity where it cannot be registered.
    """
    poses = measurements.robot.mechanism.forward(measurements.q)
    try:
        setup = register(measurements, poses)
    except NoSolutionError:
        return measurements.setup, np.inf
    residual = residuals(measurements, setup, poses)[:, setup.kind.lengths(setup)]
    return setup, float(np.sqrt((residual**2).mean()))
