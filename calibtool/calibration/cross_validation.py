"""Cross-validation over configurations: base and learned models are fitted in every fold."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from calibtool.calibration.calibration import Calibration, CrossValidation, fitting_setup
from calibtool.errors import NoSolutionError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import weighted_residuals
from calibtool.progress import Progress, silent
from calibtool.robot.se3 import Array

Fit = Callable[[Measurements, np.random.Generator], Sequence[Calibration]]


def cross_validate(
    measurements: Measurements,
    fit: Fit,
    folds: int,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> list[CrossValidation]:
    """Weighted squared errors on held-out configurations with and without the learned model of
    every calibration that `fit` makes of the same base model.

    All target points of a configuration are in the same fold. Raises NoSolutionError for a single
    configuration.
    """
    count = len(measurements)
    if count < 2:
        raise NoSolutionError(
            "cross-validation: one configuration leaves none to train on; measure more"
        )
    folds = min(folds, count)
    without, learned = np.empty(count), []
    order = rng.permutation(count)
    parts = list(zip(np.array_split(order, folds), rng.spawn(folds), strict=True))
    for held, stream in progress(parts, "folds"):
        rest = np.setdiff1d(order, held)
        calibrations = fit(measurements.rows(rest), stream)
        part = measurements.rows(held)
        learned.append([squared_errors(calibration, part) for calibration in calibrations])
        without[held] = squared_errors(replace(calibrations[0], networks=()), part)
    held = np.concatenate([held for held, _ in parts])
    return [
        _gain(folds, without[held], np.concatenate(squares))
        for squares in zip(*learned, strict=True)
    ]


def _gain(folds: int, without: Array, learned: Array) -> CrossValidation:
    difference, count = without - learned, len(without)
    base = max(float(without.mean()), 1e-300)
    error = float(difference.std(ddof=1)) / np.sqrt(count) if count > 1 else np.inf
    return CrossValidation(folds, 100.0 * float(difference.mean()) / base, 100.0 * error / base)


def squared_errors(calibration: Calibration, measurements: Measurements) -> Array:
    """Weighted squared residual of each configuration in the calibration's own set-up: (N,)."""
    pose = calibration.forward(measurements.q, measurements.conditions)
    residual = weighted_residuals(measurements, fitting_setup(calibration, measurements), pose)
    squared: Array = (residual**2).sum(axis=-1)
    return squared
