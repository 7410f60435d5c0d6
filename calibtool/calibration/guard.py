"""Extrapolation guard: detects configurations that are unlike those of the training."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from calibtool.calibration.calibration import Calibration
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.robot.se3 import Array

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# times the largest distance between a configuration of the training and its nearest neighbour
_DISTANCE = 1.5
_ROUGH = 4.0  # the bound of a distance is at most 1 + this times the distance
_AT_A_TIME = 256
# rad or m: a joint that moved less counts as fixed, and is covered up to this distance
_STANDS = 1e-3
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
    distance = reference.nearest(q) / reference.spacing
    deviation = np.zeros(len(q))
    doubtful = (distance > 1.0) & (distance <= _DISTANCE)
    if calibration.base.posterior is not None and doubtful.any():
        found = _deviation(calibration, q[doubtful])
        deviation[doubtful] = found / max(_largest_deviation(calibration), 1e-15)
    return Coverage(distance, deviation)


def also_in_training(calibration: Calibration, q: Array) -> int:
    """How many of the rows q (N, n), rad or m, were used to make the calibration."""
    known = {row.tobytes() for row in np.round(calibration.q, 9) + 0.0}
    return sum(row.tobytes() in known for row in np.round(q, 9) + 0.0)


@dataclass(frozen=True, eq=False)
class _Reference:
    """Scaled configurations of the training in a k-d tree, their scale (n,) and largest spacing."""

    tree: "cKDTree"
    scale: Array
    spacing: float

    def nearest(self, q: Array) -> Array:
        """Scaled distance (N,) of joints (N, n) to the nearest of the training; NaN for NaN."""
        distance = np.full(len(q), np.nan)
        known = np.isfinite(q).all(axis=-1)
        distance[known] = self.tree.query(q[known] / self.scale)[0]
        return distance


@lru_cache(maxsize=8)
def _reference(calibration: Calibration) -> _Reference:
    from scipy.spatial import cKDTree

    known = calibration.q
    scale = np.maximum(np.ptp(known, axis=0) / 2, _STANDS)
    tree = cKDTree(known / scale)
    spacing = _largest_spacing(tree) if len(known) > 1 else 1.0
    return _Reference(tree, scale, max(spacing, float(np.linalg.norm(_STANDS / scale))))


@lru_cache(maxsize=8)
def _largest_deviation(calibration: Calibration) -> float:
    """Largest predicted standard deviation (m) of the training configurations."""
    return float(_deviation(calibration, calibration.q).max())


def _deviation(calibration: Calibration, q: Array) -> Array:
    """Predicted standard deviation (N,) of the tool point, m; backlash is not included."""
    return predicted_uncertainty(calibration, q, np.ones_like(q)).position


def _largest_spacing(tree: "cKDTree") -> float:
    """Largest distance between a point of a tree and the nearest other one.

    Bounds on the distances are computed fast. Exact distances follow, from the largest bound on,
    until no bound exceeds the largest one found.
    """
    bound = tree.query(tree.data, k=2, eps=_ROUGH)[0][:, 1]
    order = np.argsort(-bound)
    largest = 0.0
    for start in range(0, len(order), _AT_A_TIME):
        rows = order[start : start + _AT_A_TIME]
        if bound[rows[0]] <= largest:
            break
        largest = max(largest, float(tree.query(tree.data[rows], k=2)[0][:, 1].max()))
    return largest
