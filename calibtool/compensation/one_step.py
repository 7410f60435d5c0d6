"""The one-step rule: the correction that a controller can evaluate (Eqs. 23, 24), bounded and judged."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.judge import REACHED, Judged, Proposal, judged
from calibtool.compensation.step import bounded_step
from calibtool.compensation.weighed import Task, weighted_error, weighted_jacobian
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array

_CHANGE_PER_ERROR = 20.0  # largest joint change over the rms pose error of a calibration
_USUAL = 3.0  # times the median of what one step leaves: more than that is no full correction
_COST_OF_TASK = 0.75  # the part of what the whole pose error can gain that the task components may cost


@dataclass(frozen=True)
class Bounds:
    """What a correction may do.

    largest_change   of a joint, rad, for a slide characteristic lengths
    usual            largest weighted error (rad) that one step leaves in an `ok` row: of the task
                     components, and of all six
    """

    largest_change: float
    usual: tuple[float, float]


def one_step(
    calibration: Calibration,
    q: Array,
    commanded: Array | None = None,
    bounds: Bounds | None = None,
) -> Judged:
    """The one-step rule for joints q (N, n), rad or m; exported code computes it step by step.

    commanded (N, 4, 4): T_base_tool that is asked for, that of the nominal robot at q unless given.
    bounds: those of `default_bounds` unless given.

    1. T, J_ρ = the calibrated model at q, `Calibration.forward_and_jacobian`. The first n columns
       of J_ρ belong to the actuated joints.
    2. e = ((p − p_c) / length, log3(R R_cᵀ)), (6,), and J (6, n): those columns seen at p,
       ((v + ω × p) / length, ω).
    3. The box of Δ, per joint: lower = max(−B, min(0, q_min − q)), upper = min(B, max(0, q_max − q)),
       B the largest change in rad, times length for a slide.
    4. n ≥ 6: Δ, d = `bounded_step`(J, e, box). On the nominal base Δ = −N(q), the first n outputs
       of the network (Eq. 23), or 0 without one, takes the place of its item 3; d and λ are needed
       all the same.
       n < 6: the same with A, e_A for J, e gives Δ_A and d. A and e_A are the n rows of R_cᵀ v and
       R_cᵀ ω that are no virtual joints (`Task`). A second `bounded_step`(J, e, box), always solved
       and with a d of its own, gives Δ_J. Then Δ = Δ_J + w (Δ_A − Δ_J), with
       cost = |J (Δ_A − Δ_J)|², allowed = ¾ max(0, |e|² − |e + J Δ_J|²), w = sqrt(allowed / cost)
       where cost > allowed, else 1: the task components alone, unless the whole pose error would
       lose more than three quarters of what it can gain.
    5. `judged`: T_calibrated(q + Δ) decides whether Δ is taken, shortened to t Δ (one more pose of
       the model) or dropped. q_m = q + t Δ, and the status. A joint was held (at the largest change
       where |Δ| ≥ B, else at its limit) where Δ ≤ lower or Δ ≥ upper.

    No loop depends on the numbers. q_m changes with q as smoothly as e, J and d do, but for rows
    that are dropped.
    """
    robot = calibration.robot
    commanded = robot.mechanism.forward(q) if commanded is None else commanded
    bounds = default_bounds(calibration) if bounds is None else bounds
    return judged(calibration, q, commanded, proposed(calibration, q, commanded, bounds.largest_change), bounds.usual)


def proposed(calibration: Calibration, q: Array, commanded: Array, largest_change: float) -> Proposal:
    """Items 1 to 4 of `one_step`."""
    robot, task = calibration.robot, Task.of(calibration.equivalent)
    pose, jacobian = calibration.forward_and_jacobian(q)
    e = weighted_error(pose, commanded, robot.length)
    J = weighted_jacobian(jacobian[:, :, : robot.n], pose, robot.length)
    lower, upper = box(robot, q, largest_change)
    first = None
    if calibration.base.model == "nominal":
        first = np.zeros_like(q) if calibration.network is None else -calibration.network(q)[:, : robot.n]
    if task.components is None:
        change, distance, _ = bounded_step(J, e, lower, upper, first)
        traded = np.zeros(len(q), dtype=bool)
    else:
        A, e_A = task.of_jacobian(J, commanded), task.of_error(e, commanded)
        of_task, distance, _ = bounded_step(A, e_A, lower, upper, first)
        of_all, _, _ = bounded_step(J, e, lower, upper)
        weight = _weight_of_task(J, e, of_task, of_all)
        change, traded = of_all + weight[:, None] * (of_task - of_all), weight < 1.0
    stopped = (change <= lower) | (change >= upper)
    farthest = np.abs(change) >= reach(robot, largest_change)
    return Proposal(
        change=change,
        held_change=np.any(stopped & farthest, axis=-1),
        held_limit=np.any(stopped & ~farthest, axis=-1),
        traded=traded,
        distance=distance,
        error=e,
        slope=(J @ change[..., None])[..., 0],
    )


def _weight_of_task(J: Array, e: Array, of_task: Array, of_all: Array) -> Array:
    """w (N,) of item 4 of `one_step`, from the two steps (N, n)."""
    gain = (e**2).sum(axis=-1) - ((e + (J @ of_all[..., None])[..., 0]) ** 2).sum(axis=-1)
    cost = ((J @ (of_task - of_all)[..., None])[..., 0] ** 2).sum(axis=-1)
    allowed = _COST_OF_TASK * np.maximum(0.0, gain)
    weight: Array = np.sqrt(allowed / np.where(cost > allowed, cost, 1.0))
    return np.where(cost > allowed, weight, 1.0)


def reach(robot: Robot, largest_change: float) -> Array:
    """B (n,): the largest change of each joint, rad or m, from `Bounds.largest_change`."""
    return largest_change * np.where(robot.prismatic, robot.length, 1.0)


def box(robot: Robot, q: Array, largest_change: float) -> tuple[Array, Array]:
    """Item 3 of `one_step`: smallest and largest Δ, (N, n) each.

    A joint outside its limits goes no farther out.
    """
    most = reach(robot, largest_change)
    lower = np.maximum(-most, np.minimum(0.0, robot.lower - q))
    return lower, np.minimum(most, np.maximum(0.0, robot.upper - q))


@lru_cache(maxsize=8)  # a calibration is what it is: hashed by identity
def default_bounds(calibration: Calibration) -> Bounds:
    """Bounds from the size of the identified errors.

    largest_change is 20 times the rms of |e| at the configurations that the calibration was made
    from: joints a twentieth of a radian away from a singularity can make up for such an error.
    `usual` is 3 times the median of what the one-step rule leaves, there or over the joint range
    (500 fixed rows), whichever is less, and at least 1e-9; rows in which the task components were
    traded (w < 1) do not count where there are others.
    """
    robot, known = calibration.robot, calibration.q
    anywhere = robot.lower + (robot.upper - robot.lower) * np.random.default_rng(0).random((500, robot.n))
    error = weighted_error(calibration.forward(known), robot.mechanism.forward(known), robot.length)
    largest_change = _CHANGE_PER_ERROR * float(np.sqrt((error**2).sum(axis=-1).mean()))
    task, medians = Task.of(calibration.equivalent), []
    for q in (known, anywhere):
        commanded = robot.mechanism.forward(q)
        proposal = proposed(calibration, q, commanded, largest_change)
        left = judged(calibration, q, commanded, proposal, (np.inf, np.inf)).error
        rows = slice(None) if proposal.traded.all() else ~proposal.traded
        parts = task.of_error(left, commanded)[rows], left[rows]
        medians.append([float(np.median(np.linalg.norm(part, axis=-1))) for part in parts])
    of_task, of_all = (max(REACHED, _USUAL * min(pair)) for pair in zip(*medians, strict=True))
    return Bounds(largest_change, (of_task, of_all))
