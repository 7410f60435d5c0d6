"""The extrapolation guard: configurations unlike any that a calibration was made from."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import KDTree

from calibtool.calibration.model import Calibration
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.robot.se3 import Array

_DISTANCE = 1.5  # times the largest distance between a configuration of the training and its nearest neighbour
_UNCERTAINTY = 2.0  # times the largest predicted standard deviation on the training configurations


@dataclass(frozen=True, eq=False)
class Coverage:
    """Where configurations lie relative to those of the training.

    distance   (N,) to the nearest one, joints scaled by half their range in the training, over the largest such distance
               within the training
    deviation  (N,) predicted standard deviation of the tool point over the largest one on the training configurations;
               0 for a base model without a posterior, and where the distance alone decides
    """

    distance: Array
    deviation: Array

    @property
    def outside(self) -> np.ndarray:
        """(N,) rows on which nothing was learned: far away in a joint space, or much less certain."""
        return (self.distance > _DISTANCE) | (self.deviation > _UNCERTAINTY)


def coverage(calibration: Calibration, q: Array) -> Coverage:
    """Compare joint positions q (N, n) with the configurations that the calibration was made from.

    Nearer to one of them than they are to each other, and farther than the limit, no deviation is computed: it costs ten
    times the correction itself.
    """
    reference = _reference(calibration)
    distance = reference.tree.query(q / reference.scale)[0] / reference.spacing
    deviation = np.zeros(len(q))
    doubtful = (distance > 1.0) & (distance <= _DISTANCE)
    if calibration.base.posterior is not None and doubtful.any():
        found = predicted_uncertainty(calibration, q[doubtful]).position
        deviation[doubtful] = found / max(reference.deviation, 1e-15)
    return Coverage(distance, deviation)


@dataclass(frozen=True, eq=False)
class _Reference:
    """Scaled configurations of the training, their largest spacing and predicted standard deviation (m)."""

    tree: KDTree
    scale: Array
    spacing: float
    deviation: float


@lru_cache(maxsize=8)
def _reference(calibration: Calibration) -> _Reference:
    known = calibration.q
    half = np.ptp(known, axis=0) / 2
    scale = np.where(half > 0.5e-9, half, 1e-3)
    tree = KDTree(known / scale)
    within = tree.query(known / scale, k=2)[0][:, 1] if len(known) > 1 else np.ones(1)
    deviation = 0.0
    if calibration.base.posterior is not None:
        deviation = float(predicted_uncertainty(calibration, known).position.max())
    return _Reference(tree, scale, max(float(within.max()), 1e-12), deviation)
