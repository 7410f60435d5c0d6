"""Extrapolation guard: detects configurations that are unlike those of the training."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibtool.calibration.calibration import Calibration
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.robot.se3 import Array

# times the largest distance between a configuration of the training and its nearest neighbour
_DISTANCE = 1.5
_COMPARED = 100_000  # pairs at a time: they stay in the processor's cache
_STANDS = 1e-3  # rad or m: a joint that moved less stood still, and this far from there is like it
_UNCERTAINTY = 2.0  # times the largest predicted standard deviation on the training configurations


@dataclass(frozen=True, eq=False)
class Coverage:
    """Position of configurations relative to those of the training.

    distance   (N,) distance to the nearest one, joints scaled by half their range in the training,
               over the largest distance between nearest neighbours of the training
    deviation  (N,) predicted standard deviation of the tool point over the largest one of the
               training configurations; 0 for a base model without a posterior, and where the
               distance decides
    """

    distance: Array
    deviation: Array

    @property
    def outside(self) -> np.ndarray:
        """(N,) bool: rows too far from the training, or predicted too uncertainly."""
        return (self.distance > _DISTANCE) | (self.deviation > _UNCERTAINTY)


def coverage(calibration: Calibration, q: Array) -> Coverage:
    """Compare joint positions q (N, n), in rad or m, with the configurations of the training.

    The standard deviation costs ten times the correction, so that it is computed only where the
    distance alone does not decide.
    """
    reference = _reference(calibration)
    distance = _nearest(reference.known, q / reference.scale) / reference.spacing
    deviation = np.zeros(len(q))
    doubtful = (distance > 1.0) & (distance <= _DISTANCE)
    if calibration.base.posterior is not None and doubtful.any():
        found = predicted_uncertainty(calibration, q[doubtful]).position
        deviation[doubtful] = found / max(reference.deviation, 1e-15)
    return Coverage(distance, deviation)


@dataclass(frozen=True, eq=False)
class _Reference:
    """Scaled configurations of the training, largest spacing and standard deviation (m)."""

    known: Array
    scale: Array
    spacing: float
    deviation: float


@lru_cache(maxsize=8)
def _reference(calibration: Calibration) -> _Reference:
    known = calibration.q
    half = np.ptp(known, axis=0) / 2
    scale = np.maximum(half, _STANDS)
    within = _nearest(known / scale, known / scale, others=True) if len(known) > 1 else np.ones(1)
    deviation = 0.0
    if calibration.base.posterior is not None:
        deviation = float(predicted_uncertainty(calibration, known).position.max())
    spacing = max(float(within.max()), float(np.linalg.norm(_STANDS / scale)))
    return _Reference(known / scale, scale, spacing, deviation)


def _nearest(known: Array, points: Array, others: bool = False) -> Array:
    """Distance of points (N, n) to the nearest of known ones (K, n): (N,); with `others`, to the
    nearest but themselves.

    Compared with all of them, by |k|²/2 − k·p: in six dimensions a tree looks at most of its
    leaves all the same.
    """
    centre = known.mean(axis=0)
    known, points = known - centre, points - centre
    half_squares = (known**2).sum(axis=-1) / 2
    nearest = np.empty(len(points), dtype=int)
    step = max(1, _COMPARED // len(known))
    for start in range(0, len(points), step):
        rows = slice(start, start + step)
        score = half_squares - points[rows] @ known.T
        if others:
            score[np.arange(len(score)), np.arange(start, start + len(score))] = np.inf
        nearest[rows] = score.argmin(axis=-1)
    distance: Array = np.linalg.norm(points - known[nearest], axis=-1)
    return distance
