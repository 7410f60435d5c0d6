"""Inverse kinematics: damped Newton in batches, with joint limits and several starts."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibtool.robot.inverse_starts import drawn, starts_of
from calibtool.robot.reach import excluded
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, pose_difference
from calibtool.robot.singularity import weighted_jacobian

ForwardAndJacobian = Callable[[Array], tuple[Array, Array]]

# rad (or characteristic lengths): over longer steps the Jacobian is not accurate
_STEP_LIMIT = 0.6

_ROWS_TOGETHER = 64  # rows for which several starts are tried at once
_NEAR_STARTS = 24  # starts near the pose before those drawn from everywhere
# Newton steps: a start that needs more is at a joint limit, and another one is better
_FROM_NEAR = 12
_FROM_AFAR = 60


@dataclass(frozen=True, eq=False)
class InverseResult:
    """Result of an inverse kinematics, one row per pose.

    q            (N, n) best joint positions found, rad or m
    converged    (N,) whether a stationary point was reached: the pose itself, or, where steps
                 descend, the nearest one
    reached      (N,) whether the remaining pose error is below the tolerance
    position     (N,) remaining error of the tool point, m
    orientation  (N,) remaining rotation angle, rad
    iterations   (N,) Newton steps of the successful start
    """

    q: Array
    converged: np.ndarray
    reached: np.ndarray
    position: Array
    orientation: Array
    iterations: np.ndarray


def solve_poses(
    forward_and_jacobian: ForwardAndJacobian,
    target: Array,
    q_start: Array,
    *,
    length: float,
    lower: Array | None = None,
    upper: Array | None = None,
    max_iterations: int = 60,
    tolerance: float = 1e-9,
    descend: bool = False,
) -> InverseResult:
    """Damped Newton from `q_start` to T(q) = target.

    target (N, 4, 4) in K_0; q_start (N, n) in rad or m; length in m; limits (n,) or (N, n): joints
    stay inside when given. tolerance: rad, or characteristic lengths.

    The error is that of the tool point divided by `length`, and of the rotation in rad. The
    Levenberg–Marquardt damping grows with the squared error (Sugihara 2011), so that it vanishes at
    the solution. For n < 6, or with `descend`, only steps that reduce the error are accepted, and
    the result for an unreachable target is the nearest pose. Otherwise the error may increase on
    the way, which finds more of the reachable targets.
    """
    q = q_start.copy()
    count, n = q.shape
    descend = descend or n < 6
    lower = np.broadcast_to(-np.inf if lower is None else lower, q.shape)
    upper = np.broadcast_to(np.inf if upper is None else upper, q.shape)
    stationary = np.zeros(count, dtype=bool)
    iterations = np.zeros(count, dtype=int)
    caution = np.zeros(count)  # damping beside that of _damped_step, raised while steps fail
    pose, jacobian = forward_and_jacobian(q)
    error = pose_difference(target, pose, length)
    jacobian = weighted_jacobian(jacobian, pose, length)
    active = np.arange(count)
    for _ in range(max_iterations):
        if not len(active):
            break
        bounds = lower[active], upper[active]
        step = _bounded_step(jacobian[active], error[active], caution[active], q[active], *bounds)
        # joints that do not turn the tool, in m
        slides = np.linalg.norm(jacobian[active, 3:], axis=1) < 0.5
        longest = np.linalg.norm(np.where(slides, step / length, step), axis=-1, keepdims=True)
        proposed = np.clip(
            q[active] + step * np.minimum(1.0, _STEP_LIMIT / np.maximum(longest, 1e-300)), *bounds
        )
        moved = np.abs(proposed - q[active]).max(axis=-1)
        iterations[active] += 1
        new_pose, new_jacobian = forward_and_jacobian(proposed)
        new_error = pose_difference(target[active], new_pose, length)
        before, after = np.linalg.norm(error[active], axis=-1), np.linalg.norm(new_error, axis=-1)
        better = (after <= before) | (np.isfinite(after) & (not descend))  # a pose there is
        rows = active[better]
        q[rows], error[rows] = proposed[better], new_error[better]
        jacobian[rows] = weighted_jacobian(new_jacobian[better], new_pose[better], length)
        caution[active] = np.where(
            better, caution[active] / 5, np.maximum(5 * caution[active], 1e-4)
        )
        done = (moved < 1e-10) | (np.linalg.norm(error[active], axis=-1) < 1e-12)
        stationary[active[done]] = True
        active = active[~done]
    remaining = np.linalg.norm(error, axis=-1)
    remaining[~np.isfinite(remaining)] = np.inf  # closed loops that do not close at the start
    return InverseResult(
        q=q,
        converged=stationary | (remaining < tolerance),
        reached=remaining < tolerance,
        position=np.linalg.norm(error[:, :3], axis=-1) * length,
        orientation=np.linalg.norm(error[:, 3:], axis=-1),
        iterations=iterations,
    )


def inverse_kinematics(
    robot: Robot,
    target: Array,
    q_seed: Array | None = None,
    *,
    starts: int = 100,
) -> InverseResult:
    """Joint positions of the nominal robot within its limits for T_base_tool (N, 4, 4) in K_0.

    q_seed (N, n) or (n,): start of the iteration, which stays on its branch if possible; without a
    seed any branch is returned. Rows that do not converge are started again, up to `starts` times,
    first from joint positions whose poses are near, then from random ones, unless `excluded` shows
    that there is no solution. Angles are returned within half a
    turn of the seed (or of 0) where the limits allow it. The tolerance (rad, or characteristic
    lengths) is 1e-8, for n < 6 1e-5, because a pose written with six digits is that far
    from the poses that the robot can take.
    """
    rng, tolerance = np.random.default_rng(0), 1e-8 if robot.n >= 6 else 1e-5
    seed = np.zeros(robot.n) if q_seed is None else np.clip(q_seed, robot.lower, robot.upper)
    seed = np.broadcast_to(seed, (len(target), robot.n))

    def solve(rows: np.ndarray, q_start: Array, max_iterations: int) -> InverseResult:
        result = solve_poses(
            robot.mechanism.forward_and_jacobian,
            target[rows],
            q_start,
            length=robot.length,
            lower=robot.lower,
            upper=robot.upper,
            max_iterations=max_iterations,
            tolerance=tolerance,
        )
        result.q[:] = nearest_turn(robot, result.q, seed[rows])
        return result

    every = np.arange(len(target))
    if q_seed is None:
        best = solve(every, starts_of(robot).nearest(target, 1)[:, 0], _FROM_NEAR)
    else:
        best = solve(every, seed, _FROM_AFAR)
    if starts == 0:
        return best
    rows = np.flatnonzero(~best.reached & ~excluded(robot, target, tolerance))
    near = starts_of(robot).nearest(target[rows], min(starts, _NEAR_STARTS))
    used = 0
    while used < starts and len(rows):
        # few rows: more starts in one batch
        together = min(starts - used, max(2, _ROWS_TOGETHER // len(rows)))
        q_start, steps = near[:, used : used + together], _FROM_NEAR
        if not q_start.shape[1]:
            q_start, steps = (
                drawn(robot, len(rows) * together, rng).reshape(len(rows), together, robot.n),
                _FROM_AFAR,
            )
        together = q_start.shape[1]
        used += together
        again = solve(np.repeat(rows, together), q_start.reshape(-1, robot.n), steps)
        cost = (again.position / robot.length + again.orientation).reshape(len(rows), together)
        cost = np.where(np.isfinite(cost), cost, np.inf)
        winner = np.arange(len(rows)) * together + cost.argmin(axis=1)
        before = best.position[rows] / robot.length + best.orientation[rows]
        better = (cost.min(axis=1) < before) | ~np.isfinite(before)
        for field in ("q", "converged", "reached", "position", "orientation", "iterations"):
            getattr(best, field)[rows[better]] = getattr(again, field)[winner[better]]
        waiting = ~best.reached[rows]
        rows, near = rows[waiting], near[waiting]
    return best


def follow_path(
    robot: Robot, target: Array, q_seed: Array | None = None
) -> tuple[Array, np.ndarray]:
    """Nominal joint positions (N, n) of poses in order (N, 4, 4), and which were reached (N,).

    Each row starts from the solution of the row before, so that rows stay on one branch. q_seed
    (n,) starts the first row; by default the home of the default workspace.
    """
    q = np.empty((len(target), robot.n))
    reached = np.zeros(len(target), dtype=bool)
    q_seed = robot.workspace().home if q_seed is None else q_seed
    for k in range(len(target)):
        solved = inverse_kinematics(robot, target[k : k + 1], q_seed)
        q[k], reached[k] = solved.q[0], solved.reached[0]
        if reached[k]:
            q_seed = solved.q[0]
    return q, reached


def _bounded_step(
    jacobian: Array,
    error: Array,
    caution: Array,
    q: Array,
    lower: Array,
    upper: Array,
    again: int = 2,
) -> Array:
    """A damped step in which joints at a limit that would leave it are fixed; these joints are
    determined in `again` rounds.
    """
    step = _damped_step(jacobian, error, caution)
    held = ((q <= lower) & (step < 0)) | ((q >= upper) & (step > 0))
    rows = np.flatnonzero(held.any(axis=-1))
    if len(rows) and again:
        free = np.where(held[rows, None, :], 0.0, jacobian[rows])
        bounds = lower[rows], upper[rows]
        step[rows] = _bounded_step(free, error[rows], caution[rows], q[rows], *bounds, again - 1)
    return step


def _damped_step(jacobian: Array, error: Array, caution: Array) -> Array:
    """Least-squares step (N, n), of minimum norm for n > 6, damped by |error|² + caution."""
    transposed = np.swapaxes(jacobian, -1, -2)
    # The last term keeps the matrix regular at a singularity: it must be larger than the rounding
    # of large entries.
    damping = (
        np.minimum((error**2).sum(-1), 1.0) * 0.03
        + caution
        + 1e-14 * np.maximum(1.0, (jacobian**2).sum((1, 2)))
    )
    damping = damping[:, None, None]
    if jacobian.shape[-1] >= 6:
        gram = jacobian @ transposed + damping * np.eye(6)
        return (transposed @ np.linalg.solve(gram, error[..., None]))[..., 0]
    gram = transposed @ jacobian + damping * np.eye(jacobian.shape[-1])
    return np.linalg.solve(gram, transposed @ error[..., None])[..., 0]


def nearest_turn(robot: Robot, q: Array, seed: Array) -> Array:
    """The same poses with every angle within half a turn of the seed where the limits allow it.

    q and seed (N, n), rad or m: (N, n).
    """
    turned = q - 2 * np.pi * np.round((q - seed) / (2 * np.pi))
    allowed = (turned >= robot.lower) & (turned <= robot.upper) & ~np.array(robot.prismatic)
    return np.where(allowed, turned, q)
