"""Acceptance of corrections: joints change only where the pose of the calibrated model improves."""

from dataclasses import dataclass

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.bounds import Bounds
from calibtool.compensation.status import (
    LIMITED,
    NEAR_SINGULAR,
    OK,
    OUT_OF_LIMITS,
    PARTIAL,
    UNCORRECTED,
)
from calibtool.compensation.step import DAMPED_BELOW
from calibtool.compensation.weighted_error import Task
from calibtool.robot.se3 import Array, pose_difference

# A change is shortened where it is longer than this times the best length along it
_OVERSHOOT = 1.5


@dataclass(frozen=True, eq=False)
class Proposal:
    """Changed joints before they are judged.

    q          (N, n) commanded joints, rad or m
    change     Δ (N, n), rad or m
    box        smallest and largest Δ, `Bounds.box`, (N, n) each
    distance   d (N,), singularity distance at the commanded joints
    error      e (N, 6) weighted, of the commanded joints under the calibrated model
    slope      J Δ (N, 6), how `error` changes along the way to first order
    """

    q: Array
    change: Array
    box: tuple[Array, Array]
    distance: Array
    error: Array
    slope: Array


@dataclass(frozen=True, eq=False)
class Judged:
    """Results of judging the proposals.

    q        (N, n) corrected joints, rad or m; the commanded ones where no better were found
    status   (N,) see `judged`
    error    (N, 6) weighted error that the calibrated model leaves at q, in K_0
    """

    q: Array
    status: np.ndarray
    error: Array


def judged(
    calibration: Calibration,
    commanded: Array,
    proposal: Proposal,
    bounds: Bounds,
    error: Array | None = None,
) -> Judged:
    """Take, shorten or drop the proposed changes of joints, by the calibrated model.

    E(t) is the weighted error of T_calibrated(q + t Δ) against `commanded` (N, 4, 4). error (N, 6)
    is E(1) in K_0, if it is known already. Its square is judged over the task components and over
    all six; both are the same for n ≥ 6. For each, from E(0), its slope and E(1):

    1. g = 2 e·(J Δ) and c = |E(1)|² − |E(0)|² − g define a parabola with its minimum in [0, 1] at
       t*: 1 where 2 c ≤ −g, otherwise −g / (2 c) for g < 0 and 0 for g ≥ 0.
    2. t = min(1, 1.5 t*), the smaller of the two. Only where t < 1 the model is evaluated once
       more, at q + t Δ.
    3. The change is dropped, t = 0, unless both |E(t)|² < |E(0)|².

    The status is the first that applies. "More" means that |E(t)|, of the task or of all
    components, is larger than `bounds.usual`. A joint is held where Δ is on a face of the box.

    uncorrected    dropped, and more remains: the joints are as commanded
    out-of-limits  q + t Δ is outside the joint limits (by more than 1e-9)
    near-singular  d < DAMPED_BELOW
    out-of-limits  a joint was held at its limit, and more remains
    limited        a joint was held at the largest change, |Δ| ≥ B, and more remains
    partial        more remains
    ok             none of these
    """
    robot, q, change = calibration.robot, proposal.q, proposal.change
    task = Task.of(calibration.equivalent, bounds.weights)

    def driven(rows: np.ndarray | slice, t: Array) -> Array:
        pose = calibration.forward(q[rows] + t[:, None] * change[rows])
        return pose_difference(pose, commanded[rows], robot.length)

    error = driven(slice(None), np.ones(len(q))) if error is None else error.copy()
    before = task.products(proposal.error, proposal.error, commanded)
    after = task.products(error, error, commanded)
    t = shortened(before, 2.0 * task.products(proposal.error, proposal.slope, commanded), after)
    rows = np.flatnonzero(t < 1.0)
    if len(rows):
        error[rows] = driven(rows, t[rows])
        after[:, rows] = task.products(error[rows], error[rows], commanded[rows])
    dropped = ~(after < before).all(axis=0)
    t[dropped] = 0.0
    error[dropped], after[:, dropped] = proposal.error[dropped], before[:, dropped]
    corrected = q + t[:, None] * change

    more = np.any(after > np.square(bounds.usual)[: len(after), None], axis=0)
    held = more[:, None] & ((change <= proposal.box[0]) | (change >= proposal.box[1]))
    farthest = np.abs(change) >= bounds.of_joints(robot)
    status = np.full(len(q), OK, dtype=object)
    status[more] = PARTIAL
    status[np.any(held & farthest, axis=-1)] = LIMITED
    status[np.any(held & ~farthest, axis=-1)] = OUT_OF_LIMITS
    status[proposal.distance < DAMPED_BELOW] = NEAR_SINGULAR
    status[~robot.within_limits(corrected)] = OUT_OF_LIMITS
    status[dropped & more] = UNCORRECTED
    return Judged(corrected, status, error)


def shortened(before: Array, slope: Array, after: Array) -> Array:
    """t (N,) of items 1 and 2 of `judged`: |E(0)|², its slope g and |E(1)|² (1 or 2, N) each."""
    bend = after - before - slope
    beyond = 2.0 * bend <= -slope  # the minimum is at t = 1, or farther
    best = np.maximum(0.0, -slope) / np.where(beyond | (bend <= 0.0), 1.0, 2.0 * bend)
    best[beyond] = 1.0
    shortened: Array = np.minimum(1.0, _OVERSHOOT * best.min(axis=0))
    return shortened
