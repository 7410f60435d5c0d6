"""The promise: joints are changed only where the calibrated model says that this is no worse than leaving them."""

from dataclasses import dataclass

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.weighed import Task, weighted_error
from calibtool.compensation.step import DAMPED_BELOW
from calibtool.robot.se3 import Array

OK = "ok"
PARTIAL = "partial"
LIMITED = "limited"
NEAR_SINGULAR = "near-singular"
OUT_OF_LIMITS = "out-of-limits"
UNCORRECTED = "uncorrected"

REACHED = 1e-9  # rad, or characteristic lengths: a smaller error is none
_OVERSHOOT = 1.5  # a step is shortened where it is longer than this times the best length on its way


@dataclass(frozen=True, eq=False)
class Proposal:
    """Changed joints before they are judged.

    change        Δ (N, n), rad or m
    held_change   (N,) a joint was held at the largest change
    held_limit    (N,) a joint was held at a joint limit
    traded        (N,) for n < 6: the task components were not solved alone, the others would have lost too much
    distance      (N,) singularity distance at the commanded joints
    error         e (N, 6) weighted, of the commanded joints under the calibrated model
    slope         J Δ (N, 6), how `error` changes along the way to first order
    """

    change: Array
    held_change: np.ndarray
    held_limit: np.ndarray
    traded: np.ndarray
    distance: Array
    error: Array
    slope: Array


@dataclass(frozen=True, eq=False)
class Judged:
    """What became of proposals.

    q        (N, n) corrected joints, rad or m; the commanded ones where no better were found
    status   (N,) see `judged`
    error    (N, 6) weighted error that the calibrated model leaves at q, in K_0
    """

    q: Array
    status: np.ndarray
    error: Array


def judged(
    calibration: Calibration,
    q: Array,
    commanded: Array,
    proposal: Proposal,
    usual: tuple[float, float],
) -> Judged:
    """Take, shorten or drop the proposed changes of commanded joints q (N, n), by the calibrated model.

    E(t) is the weighted error of T_calibrated(q + t Δ) against `commanded` (N, 4, 4). Its square is
    judged over the task components and over all six; both are the same for n ≥ 6. For each, from
    E(0), its slope and E(1):

    1. g = 2 e·(J Δ) and c = |E(1)|² − |E(0)|² − g make a parabola, least in [0, 1] at t*: 1 where
       2 c ≤ −g, otherwise −g / (2 c) for g < 0 and 0 for g ≥ 0.
    2. t = min(1, 1.5 t*), the smaller of both. Only where t < 1 the model is driven once more, to
       q + t Δ.
    3. The change is dropped, t = 0, unless both |E(t)|² < |E(0)|².

    Status, the first that is true, where `more` means that |E(t)| is larger than `usual`, of the
    task or of all components:

    uncorrected    dropped, and more stays: the joints are as commanded
    out-of-limits  q + t Δ is outside the joint limits (by more than 1e-9), or a joint was held
                   there and more stays
    near-singular  d < DAMPED_BELOW
    limited        a joint was held at the largest change, and more stays
    partial        more stays
    ok             none of these
    """
    robot = calibration.robot
    task = Task.of(calibration.equivalent)

    def squares(a: Array, b: Array, rows: np.ndarray | slice) -> Array:
        whole = (a * b).sum(axis=-1)
        if task.components is None:
            return np.stack([whole, whole])
        aim = commanded[rows]
        return np.stack([(task.of_error(a, aim) * task.of_error(b, aim)).sum(axis=-1), whole])

    def driven(rows: np.ndarray | slice, t: Array) -> Array:
        pose = calibration.forward(q[rows] + t[:, None] * proposal.change[rows])
        return weighted_error(pose, commanded[rows], robot.length)

    every = slice(None)
    t = np.ones(len(q))
    error = driven(every, t)
    before, after = squares(proposal.error, proposal.error, every), squares(error, error, every)
    t = _shortened(before, 2.0 * squares(proposal.error, proposal.slope, every), after)
    rows = np.flatnonzero(t < 1.0)
    if len(rows):
        error[rows] = driven(rows, t[rows])
        after[:, rows] = squares(error[rows], error[rows], rows)
    dropped = ~(after < before).all(axis=0)
    t[dropped] = 0.0
    error[dropped], after[:, dropped] = proposal.error[dropped], before[:, dropped]
    corrected = q + t[:, None] * proposal.change

    more = (after > np.square(usual)[:, None]).any(axis=0)
    status = np.full(len(q), OK, dtype=object)
    status[more] = PARTIAL
    status[more & proposal.held_change] = LIMITED
    status[proposal.distance < DAMPED_BELOW] = NEAR_SINGULAR
    status[(more & proposal.held_limit) | ~robot.within_limits(corrected)] = OUT_OF_LIMITS
    status[dropped & more] = UNCORRECTED
    return Judged(corrected, status, error)


def _shortened(before: Array, slope: Array, after: Array) -> Array:
    """t (N,) of items 1 and 2 of `judged`, from |E(0)|², its slope g and |E(1)|², (2, N) each."""
    bend = after - before - slope
    beyond = 2.0 * bend <= -slope  # least at t = 1, or farther
    best = np.maximum(0.0, -slope) / np.where(beyond | (bend <= 0.0), 1.0, 2.0 * bend)
    best[beyond] = 1.0
    shortened: Array = np.minimum(1.0, _OVERSHOOT * best.min(axis=0))
    return shortened
