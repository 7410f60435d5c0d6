"""Calibration: a base model and networks on top of it, how they are fitted and judged, and
how sure they are.
"""

from calibtool.calibration.calibration import Calibration, check_same_robot, fitting_setup
from calibtool.calibration.fit import BASE_MODELS, IDENTIFIED_MODELS, identify, train

__all__ = [
    "BASE_MODELS",
    "IDENTIFIED_MODELS",
    "Calibration",
    "check_same_robot",
    "fitting_setup",
    "identify",
    "train",
]
