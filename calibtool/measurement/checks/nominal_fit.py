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
    """A set-up, its residuals of the points (N, 3m) in K_0, and the rms distance per target, m
    (infinite: no fit).
    """

    setup: Setup
    residual: Array
    rms: float


def nominal_fit(measurements: Measurements, *, free: bool) -> Fit:
    """The nominal robot registered to the points, without orientations; free: given parts of the
    set-up, too.
    """
    points = measurements.points_alone()
    setup = replace(points.setup, frame_known=False, targets_known=False) if free else points.setup
    points = replace(points, setup=setup)
    try:
        setup = register(points)
    except NoSolutionError:
        return Fit(setup, np.full((len(points), 3 * points.points.shape[1]), np.nan), np.inf)
    left = residuals(points, setup, points.robot.mechanism.forward(points.q))
    return Fit(setup, left, float(np.sqrt((left**2).sum() / points.seen.sum())))
