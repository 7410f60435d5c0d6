"""Calibration: a base model with networks on top, its fit, its validation and its uncertainty."""

from calibtool.calibration.calibration import Calibration, check_same_robot, fitting_setup
from calibtool.calibration.fit import BASE_MODELS, IDENTIFIED_MODELS, identify, train
from calibtool.calibration.moved_instrument import moved_instrument

__all__ = [
    "BASE_MODELS",
    "IDENTIFIED_MODELS",
    "Calibration",
    "check_same_robot",
    "fitting_setup",
    "identify",
    "moved_instrument",
    "train",
]
