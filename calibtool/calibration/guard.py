"""The extrapolation guard: configurations unlike any that a calibration was made from."""

from dataclasses import dataclass

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
               0 for a base model without a posterior
    """

    distance: Array
    deviation: Array

    @property
    def outside(self) -> np.ndarray:
        """(N,) rows on which nothing was learned: far away in a joint space, or much less certain."""
        return (self.distance > _DISTANCE) | (self.deviation > _UNCERTAINTY)


def coverage(calibration: Calibration, q: Array) -> Coverage:
    """Compare joint positions q (N, n) with the configurations that the calibration was made from."""
    known = calibration.q
    low, high = known.min(axis=0), known.max(axis=0)
    scale = np.where(high - low > 1e-9, (high - low) / 2, 1e-3)
    tree = KDTree(known / scale)
    within = tree.query(known / scale, k=2)[0][:, 1] if len(known) > 1 else np.ones(1)
    distance = tree.query(q / scale)[0] / max(float(within.max()), 1e-12)
    deviation = np.zeros(len(q))
    if calibration.base.posterior is not None:
        largest = predicted_uncertainty(calibration, known).position.max()
        deviation = predicted_uncertainty(calibration, q).position / max(float(largest), 1e-15)
    return Coverage(distance, deviation)
