"""The one-step rule: a correction that a controller can evaluate (Eqs. 23, 24)."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.bounds import Bounds
from calibtool.compensation.judge import Judged, Proposal, judged
from calibtool.compensation.step import DAMPED_BELOW, bounded_step, times
from calibtool.compensation.weighted_error import Task, Weights
from calibtool.errors import UsageError
from calibtool.robot.se3 import Array, exp6, pose_difference
from calibtool.robot.singularity import weighted_jacobian

REACHED = 1e-9  # rad, or characteristic lengths: a smaller error counts as none
_USUAL = 3.0  # times the median remaining error: rows with more are not fully corrected
_COST_OF_TASK = 0.75  # largest share of the gain of the whole pose error that the task may cost


def one_step(
    calibration: Calibration,
    q: Array,
    commanded: Array | None = None,
    bounds: Bounds | None = None,
) -> Judged:
    """The one-step rule for joints q (N, n), rad or m; exported code computes it step by step.

    commanded (N, 4, 4): commanded T_base_tool; by default that of the nominal robot at q. bounds:
    by default those of `default_bounds`.

    1. T, J_ρ = the calibrated model at q, `Calibration.forward_and_jacobian`. The first n columns
       of J_ρ belong to the actuated joints.
    2. e = ((p − p_c) / length, log3(R R_cᵀ)), (6,), and J (6, n): those columns seen at p,
       ((v + ω × p) / length, ω).
    3. The box of Δ, per joint: lower = max(−B, min(0, q_min − q)) and
       upper = min(B, max(0, q_max − q)), B the largest change in rad, times length for a slide;
       −B and B for a joint that is commanded outside its limits by more than 1e-9 (`Bounds.box`).
    4. n ≥ 6: Δ, d = `bounded_step`(J, e, box). On the nominal base Δ = −N(q), the first n outputs
       of the network (Eq. 23), or 0 without one, takes the place of its item 3; d and λ are
       computed nevertheless.
       n < 6: the same with A, e_A for J, e gives Δ_A and d. A and e_A are the n rows of R_cᵀ v and
       R_cᵀ ω that are not virtual joints (`Task`). A second `bounded_step`(J, e, box), always
       solved and with a d of its own, gives Δ_J. Then Δ = Δ_J + w (Δ_A − Δ_J), with
       cost = |J (Δ_A − Δ_J)|², allowed = ¾ max(0, |e|² − |e + J Δ_J|²), w = sqrt(allowed / cost)
       where cost > allowed, else 1. This solves the task components alone, unless that would cost
       more than three quarters of the possible reduction of the whole pose error.
    5. `judged`: T_calibrated(q + Δ) decides whether Δ is taken, shortened to t Δ (one more pose of
       the model) or dropped. q_m = q + t Δ, and the status. A joint was held (at the largest change
       where |Δ| ≥ B, else at its limit) where Δ ≤ lower or Δ ≥ upper.

    The number of operations does not depend on the data. q_m changes with q as smoothly as e, J and
    d do, except in rows that are dropped.
    """
    bounds = default_bounds(calibration) if bounds is None else bounds
    model = Linearised.at(calibration, q, commanded, bounds)
    return judged(calibration, model.commanded, model.proposed()[0], bounds)


@dataclass(frozen=True, eq=False)
class Linearised:
    """The calibrated model at commanded joints, items 1 to 3 of `one_step`, and its task.

    q          (N, n) commanded joints, rad or m
    commanded  (N, 4, 4) commanded poses
    error, jacobian   e (N, 6) and J (N, 6, n), weighted, in K_0
    of_task    A (N, k, n) and e_A (N, k)
    box        smallest and largest Δ, (N, n) each
    network    −N(q) (N, n) on the nominal base, None on others and where weights are given
    """

    q: Array
    commanded: Array
    task: Task
    error: Array
    jacobian: Array
    of_task: tuple[Array, Array]
    box: tuple[Array, Array]
    network: Array | None

    @classmethod
    def at(
        cls, calibration: Calibration, q: Array, commanded: Array | None, bounds: Bounds
    ) -> "Linearised":
        """At joints q (N, n) for commanded poses (N, 4, 4), nominal ones unless given."""
        robot, task = calibration.robot, Task.of(calibration.equivalent, bounds.weights)
        nominal, network = None, None
        if calibration.base.model == "nominal":
            nominal, jacobian = calibration.base_forward_and_jacobian(q)
            motions = np.zeros((len(q), calibration.equivalent.p))
            motions = motions if calibration.network is None else calibration.network(q)
            pose = exp6(times(jacobian, motions)) @ nominal
            network = -motions[:, : robot.n] if bounds.weights is None else None
        else:
            pose, jacobian = calibration.forward_and_jacobian(q)
        if commanded is None:
            commanded = robot.mechanism.forward(q) if nominal is None else nominal
        e = pose_difference(pose, commanded, robot.length)
        J = weighted_jacobian(jacobian[:, :, : robot.n], pose, robot.length)
        of_task = task.of_jacobian(J, commanded), task.of_error(e, commanded)
        return cls(q, commanded, task, e, J, of_task, bounds.box(robot, q), network)

    def proposed(self) -> tuple[Proposal, np.ndarray]:
        """Item 4 of `one_step`, and rows (N,) in which all components were weighed (w < 1)."""
        change, distance, _ = bounded_step(*self.of_task, *self.box, self.network)
        traded = np.zeros(len(change), dtype=bool)
        if self.task.is_part:
            of_all, _, _ = bounded_step(self.jacobian, self.error, *self.box)
            change, traded = self.blended(change, of_all)
        return self.proposal(change, distance), traded

    def proposal(self, change: Array, distance: Array) -> Proposal:
        """A change of the joints (N, n), to be judged; distance (N,)."""
        return Proposal(
            self.q, change, self.box, distance, self.error, times(self.jacobian, change)
        )

    def blended(self, of_task: Array, of_all: Array) -> tuple[Array, np.ndarray]:
        """Δ of item 4 of `one_step` for n < 6 from Δ_A and Δ_J, (N, n) each; rows where w < 1.

        The others are Δ_A to the last digit: a joint that is held stays on the face of the box.
        """
        J, e = self.jacobian, self.error
        gain = (e**2).sum(axis=-1) - ((e + times(J, of_all)) ** 2).sum(axis=-1)
        cost = (times(J, of_task - of_all) ** 2).sum(axis=-1)
        allowed = _COST_OF_TASK * np.maximum(0.0, gain)
        traded = cost > allowed
        weight = np.sqrt(allowed / np.where(traded, cost, 1.0))[:, None]
        return np.where(traded[:, None], of_all + weight * (of_task - of_all), of_task), traded


@lru_cache(maxsize=8)  # a calibration is what it is: hashed by identity
def default_bounds(
    calibration: Calibration,
    largest_change: float | None = None,
    weights: Weights | None = None,
) -> Bounds:
    """Bounds from the size of the identified errors, where they are not given.

    largest_change (rad) is the rms of |e| at the configurations that the calibration was made from,
    over DAMPED_BELOW (50 times as much). A joint may need to move so far to correct such an error
    where nothing is damped yet.
    `usual` is 3 times the median remaining error of the one-step rule, at these configurations or
    over the joint range (500 fixed rows), whichever is less, and at least 1e-9. Rows with w < 1 do
    not count where there are others.

    Raises UsageError for a largest change that is not positive, and for weights as `Task.of`.
    """
    if largest_change is not None and not largest_change > 0.0:
        raise UsageError(
            f"the largest change of a joint is {largest_change:g}; expected more than zero"
        )
    robot, known = calibration.robot, calibration.q[calibration.closes(calibration.q)]
    anywhere = robot.anywhere(500, np.random.default_rng(0))
    anywhere = anywhere[calibration.closes(anywhere)]
    error = pose_difference(
        calibration.forward(known), robot.mechanism.forward(known), robot.length
    )
    size = float(np.sqrt((error**2).sum(axis=-1).mean()))
    bounds = Bounds(size / DAMPED_BELOW, (np.inf, np.inf), weights)
    medians = np.min([_median_remaining(calibration, q, bounds) for q in (known, anywhere)], axis=0)
    of_task, of_all = (max(REACHED, _USUAL * float(median)) for median in medians)
    chosen = bounds.largest_change if largest_change is None else largest_change
    return replace(bounds, largest_change=chosen, usual=(of_task, of_all))


def _median_remaining(calibration: Calibration, q: Array, bounds: Bounds) -> tuple[float, float]:
    """Median remaining errors of the rule at joints q (N, n): of the task, of all components."""
    model = Linearised.at(calibration, q, None, bounds)
    proposal, traded = model.proposed()
    remaining = judged(calibration, model.commanded, proposal, bounds).error
    rows = slice(None) if traded.all() else ~traded
    parts = model.task.of_error(remaining, model.commanded)[rows], remaining[rows]
    of_task, of_all = (float(np.median(np.linalg.norm(part, axis=-1))) for part in parts)
    return of_task, of_all
