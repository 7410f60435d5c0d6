"""Corrected joint positions (Eqs. 23, 24): one step that a controller can evaluate, or the exact solution."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from calibtool.calibration import Calibration
from calibtool.errors import check_choice
from calibtool.robot.damped import MIN_SINGULARITY_DISTANCE, at_point, damped_solution, singularity_distance
from calibtool.robot.inverse import follow_path, inverse_kinematics, solve_poses
from calibtool.robot.se3 import Array, check_poses, log3, relative_error

Method = Literal["exact", "one-step"]

OK, NEAR_SINGULAR, OUT_OF_LIMITS, UNREACHABLE = "ok", "near-singular", "out-of-limits", "unreachable"
OUTSIDE = "outside"  # unlike any configuration of the training
LARGEST_CORRECTION = 0.5  # rad or characteristic lengths; a longer way near a singularity is another branch


@dataclass(frozen=True, eq=False)
class Compensation:
    """Corrected joint positions and how far each row can be trusted.

    q            (N, n) corrected joint positions, rad or m; NaN in unreachable rows
    status       (N,) `ok`, `near-singular` (damped, a part of the error stays), `out-of-limits`, `unreachable`
    position     (N,) what the calibrated model leaves at the tool point, m (for n < 6: what no joint can correct); NaN where
                 nobody asked, in `ok` rows of one-step
    orientation  (N,) the same as a rotation angle, rad
    """

    q: Array
    status: np.ndarray
    position: Array
    orientation: Array


def compensate_joints(
    calibration: Calibration, q: Array, method: Method = "exact", verify: bool = False
) -> Compensation:
    """Correct joint positions q (N, n) so that the calibrated robot goes where the nominal one would at q.

    verify: drive the calibrated model to every corrected row, also for one-step, to tell what is left.
    Raises InputError for joint positions of another number or that are not finite, UsageError for an unknown method. Rows
    without an answer are no error: see `Compensation.status`.
    """
    calibration.robot.check_positions(q, "joint positions")
    return _compensate(calibration, None, q, method, verify)


def compensate_poses(
    calibration: Calibration,
    T_base_tool: Array,
    q_seed: Array | None = None,
    method: Method = "exact",
    verify: bool = False,
) -> Compensation:
    """Correct joint positions for commanded poses (N, 4, 4), by nominal inverse kinematics and then as for joints.

    q_seed (N, n) chooses the branch. With one seed (n,), or without any, the rows are a path: each starts from the solution
    of the row before, the first from the seed or the home of the default workspace. A pose that no joint positions reach has
    the status `unreachable` and NaN in its row. Raises InputError for what are no rigid motions, or seeds that do not fit.
    """
    robot = calibration.robot
    check_poses(T_base_tool, "commanded poses")
    if q_seed is not None:
        robot.check_positions(np.atleast_2d(q_seed), "seeds")
    if q_seed is not None and q_seed.ndim == 2:
        solved = inverse_kinematics(robot, T_base_tool, q_seed)
        q, reached = solved.q, solved.reached
    else:
        q, reached = follow_path(robot, T_base_tool, q_seed)
    result = _compensate(calibration, T_base_tool, q, method, verify)
    result.status[~reached] = UNREACHABLE
    result.q[~reached] = np.nan
    return result


def one_step(calibration: Calibration, q: Array) -> tuple[Array, Array]:
    """q_m = q − δρ_a (Eq. 24), (N, n) in rad or m like q, and the singularity distance of each row (N,).

    On the nominal base δρ = N(q) (Eq. 23). On an identified base δρ = J_ρ⁻¹ log6(T_calibrated T_nominal⁻¹) (Eq. 15),
    damped near singularities.
    """
    robot = calibration.robot
    if calibration.base.model == "nominal":
        pose, jacobian = calibration.base_forward_and_jacobian(q)
        distance = singularity_distance(at_point(jacobian, pose[:, :3, 3]), robot.length)
        return q if calibration.network is None else q - calibration.network(q)[:, : robot.n], distance
    pose, jacobian = calibration.forward_and_jacobian(q)
    point = pose[:, :3, 3]
    error = at_point(relative_error(pose, robot.mechanism.forward(q))[..., None], point)[..., 0]
    motion, distance = damped_solution(at_point(jacobian, point), error, robot.length)
    return q - motion[:, : robot.n], distance


def _compensate(calibration: Calibration, target: Array | None, q: Array, method: Method, verify: bool) -> Compensation:
    """target: commanded poses, those of the nominal robot at q for None."""
    check_choice(method, get_args(Method), "method")
    robot = calibration.robot
    corrected, distance = one_step(calibration, q)
    status = np.full(len(q), OK, dtype=object)
    left = np.full((2, len(q)), np.nan)
    if method == "exact":
        target = robot.mechanism.forward(q) if target is None else target
        corrected, lost, left = _solved(calibration, target, q, corrected)
        distance = np.where(lost, 0.0, distance)
    near = distance < MIN_SINGULARITY_DISTANCE
    status[near] = NEAR_SINGULAR
    status[~robot.within_limits(corrected)] = OUT_OF_LIMITS
    judged = np.isnan(left[0]) & (verify | (robot.n < 6) | near)
    if judged.any():
        aim = robot.mechanism.forward(q[judged]) if target is None else target[judged]
        pose = calibration.forward(corrected[judged])
        turn = log3(aim[:, :3, :3] @ np.swapaxes(pose[:, :3, :3], -1, -2))
        left[0, judged] = np.linalg.norm(aim[:, :3, 3] - pose[:, :3, 3], axis=-1)
        left[1, judged] = np.linalg.norm(turn, axis=-1)
    return Compensation(q=corrected, status=status, position=left[0], orientation=left[1])


def _solved(calibration: Calibration, target: Array, q: Array, stepped: Array) -> tuple[Array, np.ndarray, Array]:
    """Newton from the one-step correction, where that fails from q itself; lost rows; what is left (2, N), m and rad.

    A lost row found no answer near q: it is out of reach, as where a stretched arm is shorter than drawn, and gets the
    nearest pose.
    """
    robot = calibration.robot
    span = np.where(robot.prismatic, robot.length, 1.0)
    corrected, lost = stepped.copy(), np.ones(len(q), dtype=bool)
    left = np.full((2, len(q)), np.nan)

    def solve(rows: np.ndarray, start: Array, descend: bool, max_iterations: int) -> np.ndarray:
        solved = solve_poses(
            lambda x: _actuated(calibration, x),
            target[rows],
            start[rows],
            length=robot.length,
            max_iterations=max_iterations,
            descend=descend,
        )
        near = np.linalg.norm((solved.q - q[rows]) / span, axis=-1) <= LARGEST_CORRECTION
        found = near & (solved.converged if descend or robot.n < 6 else solved.reached)
        answered: np.ndarray = rows[found]
        corrected[answered] = solved.q[found]
        left[:, answered] = solved.position[found], solved.orientation[found]
        return answered

    for start in (stepped, q):
        rows = np.flatnonzero(lost)
        if not len(rows):
            break
        lost[solve(rows, start, False, 30)] = False
    if lost.any():
        solve(np.flatnonzero(lost), q, True, 300)
    return corrected, lost, left


def _actuated(calibration: Calibration, q: Array) -> tuple[Array, Array]:
    pose, jacobian = calibration.forward_and_jacobian(q)
    return pose, jacobian[:, :, : calibration.robot.n]
