"""Learning curve: cross-validated error as a function of the number of configurations."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from calibtool.calibration.calibration import Calibration, fitting_setup
from calibtool.errors import NoSolutionError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import residuals
from calibtool.progress import Progress, silent
from calibtool.robot.se3 import Array, readonly

_PARTS = (0.25, 0.4, 0.6, 0.8, 1.0)

Fit = Callable[[Measurements, np.random.Generator], Calibration]


@dataclass(frozen=True, eq=False)
class LearningCurve:
    """Position error on held-out configurations, RMS per coordinate.

    configurations  (s,) numbers of configurations of the fits
    error           (s,) m
    floor, slope    of error² = floor² + slope² / configurations: the error that more configurations
                    do not remove (m), and the part that decreases (m)
    """

    configurations: np.ndarray
    error: Array
    floor: float
    slope: float

    def predicted(self, count: int) -> float:
        """Expected error in m for `count` configurations."""
        return float(np.sqrt(self.floor**2 + self.slope**2 / count))


def learning_curve(
    measurements: Measurements,
    fit: Fit,
    folds: int,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> LearningCurve:
    """Fit to growing parts of the training rows of every fold and evaluate on the held-out fold.

    Numbers of configurations that are too small for the fit are left out.
    """
    count = len(measurements)
    order = rng.permutation(count)
    sizes = sorted({round(part * (count - count // folds)) for part in _PARTS})
    squares: dict[int, list[float]] = {}
    parts = list(zip(np.array_split(order, folds), rng.spawn(folds), strict=True))
    for held, stream in progress(parts, "folds of the learning curve"):
        rest = rng.permutation(np.setdiff1d(order, held))
        judged = measurements.rows(held)
        for size in sizes:
            try:
                calibration = fit(measurements.rows(np.sort(rest[:size])), stream)
            except NoSolutionError:
                continue
            pose = calibration.forward(judged.q, judged.conditions)
            residual = residuals(judged, fitting_setup(calibration, judged), pose)
            position = residual[:, : 3 * judged.points.shape[1]]
            squares.setdefault(size, []).append(
                float((position**2).sum() / (3 * judged.seen.sum()))
            )
    known = sorted(size for size, values in squares.items() if len(values) == folds)
    if len(known) < 2:
        raise NoSolutionError(
            f"learning curve: {count} configurations are too few to hold some back; measure more"
        )
    errors = np.array([np.mean(squares[size]) for size in known])
    A = np.stack([np.ones(len(known)), 1.0 / np.array(known)], axis=-1) / errors[:, None]
    (floor, slope), _ = nnls(A, np.ones(len(known)))
    return LearningCurve(
        np.array(known), readonly(np.sqrt(errors)), float(np.sqrt(floor)), float(np.sqrt(slope))
    )
