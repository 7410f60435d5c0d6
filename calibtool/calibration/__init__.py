"""Calibration: a base model with networks on top, its fit, its validation and its uncertainty."""

from calibtool.calibration.calibration import (
    Calibration,
    check_same_robot,
    fitting_setup,
    moved_setup,
)
from calibtool.calibration.fit import BASE_MODELS, IDENTIFIED_MODELS, identify, train

__all__ = [
    "BASE_MODELS",
    "IDENTIFIED_MODELS",
    "Calibration",
    "check_same_robot",
    "fitting_setup",
    "identify",
    "moved_setup",
    "train",
]
