"""Measurements of an instrument that stands elsewhere than in the calibration."""

import numpy as np

from calibtool.calibration.calibration import Calibration, fitting_setup
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import weighted_residuals
from calibtool.units import three_digits

_SEEN = 1e3  # m: a larger residual is that of points behind a camera
_ELSEWHERE = 10.0  # times the residual in a set-up of their own: the instrument was moved


def moved_instrument(calibration: Calibration, measurements: Measurements) -> str | None:
    """A line where the instrument clearly stands elsewhere than in the calibration; else None.

    The rows fit an own set-up with the nominal robot ten times as well as the calibration's with
    the calibrated one. An arm that has drifted by some mm does not do that.
    """
    if measurements.setup.known:
        return None
    nominal = calibration.robot.mechanism.forward(measurements.q)
    setup = fitting_setup(calibration, measurements)
    pose = calibration.forward(measurements.q, measurements.conditions)
    with np.errstate(over="ignore"):
        own, there = (
            float(np.sqrt((weighted_residuals(measurements, at, poses) ** 2).mean()))
            for at, poses in ((measurements.setup, nominal), (setup, pose))
        )
    if not there > _ELSEWHERE * max(own, 1.0):
        return None
    own, there = own * measurements.noise_position, there * measurements.noise_position
    far = f"{three_digits(there * 1e3)} mm rms off" if there < _SEEN else "not seen"
    return (
        f"in the set-up of the calibration the rows are {far}, in one of their own "
        f"{three_digits(own * 1e3)} mm off; if the instrument or what it measures was moved, add "
        "--refit-setup"
    )
