"""Corrected joint positions (Eqs. 23, 24): one step that a controller can evaluate, or the exact solution."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibtool.calibration import Calibration
from calibtool.robot.geometry import relative_error
from calibtool.robot.inverse import inverse_kinematics, solve_poses
from calibtool.robot.mechanism import MIN_SINGULARITY_DISTANCE, at_point, damped_solution
from calibtool.robot.se3 import Array, log3

Method = Literal["exact", "one-step"]

OK, NEAR_SINGULAR, OUT_OF_LIMITS, UNREACHABLE = "ok", "near-singular", "out-of-limits", "unreachable"
OUTSIDE = "outside"  # unlike any configuration of the training
LARGEST_CORRECTION = 0.5  # rad or characteristic lengths; a longer way near a singularity is another branch


@dataclass(frozen=True, eq=False)
class Compensation:
    """Corrected joint positions and how far each row can be trusted.

    q            (N, n) corrected joint positions, rad or m; NaN in unreachable rows
    status       (N,) `ok`, `near-singular` (damped, a part of the error stays), `out-of-limits`, `unreachable`
    position     (N,) what the calibrated model leaves at the tool point, m (for n < 6: what no joint can correct)
    orientation  (N,) the same as a rotation angle, rad
    """

    q: Array
    status: np.ndarray
    position: Array
    orientation: Array


def compensate_joints(calibration: Calibration, q: Array, method: Method = "exact") -> Compensation:
    """Correct joint positions q (N, n) so that the calibrated robot goes where the nominal one would at q."""
    calibration.robot.check_positions(q, "joint positions")
    return _compensate(calibration, calibration.robot.mechanism.forward(q), q, method)


def compensate_poses(
    calibration: Calibration, T_base_tool: Array, q_seed: Array | None = None, method: Method = "exact"
) -> Compensation:
    """Correct joint positions for commanded poses (N, 4, 4), by nominal inverse kinematics and then as for joints.

    q_seed (N, n) chooses the branch; without it each row starts from the solution of the row before.
    """
    robot = calibration.robot
    if q_seed is not None:
        solved = inverse_kinematics(robot, T_base_tool, q_seed)
        q, reached = solved.q, solved.reached
    else:
        q, reached = _along_path(calibration, T_base_tool)
    result = _compensate(calibration, T_base_tool, q, method)
    result.status[~reached] = UNREACHABLE
    result.q[~reached] = np.nan
    return result


def one_step(calibration: Calibration, q: Array) -> tuple[Array, Array]:
    """q_m = q − δρ_a (Eq. 24) and the singularity distance of each row.

    On the nominal base δρ = N(q) (Eq. 23). On an identified base δρ = J_ρ⁻¹ log6(T_calibrated T_nominal⁻¹) (Eq. 15),
    damped near singularities.
    """
    robot = calibration.robot
    pose, jacobian = calibration.forward_and_jacobian(q)
    point = pose[:, :3, 3]
    nominal = robot.mechanism.forward(q)
    error = at_point(relative_error(pose, nominal)[..., None], point)[..., 0]
    motion, distance = damped_solution(at_point(jacobian, point), error, robot.length)
    if calibration.base.model == "nominal":
        motion = np.zeros_like(motion) if calibration.network is None else calibration.network(q)
    return q - motion[:, : robot.n], distance


def _compensate(calibration: Calibration, target: Array, q: Array, method: Method) -> Compensation:
    robot = calibration.robot
    stepped, distance = one_step(calibration, q)
    if method == "one-step":
        corrected = stepped
    else:
        corrected, lost = _solved(calibration, target, q, stepped)
        distance = np.where(lost, 0.0, distance)
    pose = calibration.forward(corrected)
    status = np.full(len(q), OK, dtype=object)
    status[~robot.within_limits(corrected)] = OUT_OF_LIMITS
    status[distance < MIN_SINGULARITY_DISTANCE] = NEAR_SINGULAR
    turn = log3(target[:, :3, :3] @ np.swapaxes(pose[:, :3, :3], -1, -2))
    return Compensation(
        q=corrected,
        status=status,
        position=np.linalg.norm(target[:, :3, 3] - pose[:, :3, 3], axis=-1),
        orientation=np.linalg.norm(turn, axis=-1),
    )


def _solved(calibration: Calibration, target: Array, q: Array, stepped: Array) -> tuple[Array, np.ndarray]:
    """Newton from the one-step correction, where that fails from q itself; and the rows that found no answer near q.

    Such a row is out of reach, as where a stretched arm is shorter than drawn: it gets the nearest pose.
    """
    robot = calibration.robot
    span = np.where(robot.prismatic, robot.length, 1.0)
    corrected, lost = stepped.copy(), np.ones(len(q), dtype=bool)

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
        corrected[rows[found]] = solved.q[found]
        return rows[found]

    for start in (stepped, q):
        rows = np.flatnonzero(lost)
        if not len(rows):
            return corrected, lost
        lost[solve(rows, start, False, 30)] = False
    if lost.any():
        solve(np.flatnonzero(lost), q, True, 300)
    return corrected, lost


def _actuated(calibration: Calibration, q: Array) -> tuple[Array, Array]:
    pose, jacobian = calibration.forward_and_jacobian(q)
    return pose, jacobian[:, :, : calibration.robot.n]


def _along_path(calibration: Calibration, T_base_tool: Array) -> tuple[Array, np.ndarray]:
    """Nominal inverse kinematics of rows in order, each from the answer before: neighbours stay on one branch."""
    robot = calibration.robot
    q = np.empty((len(T_base_tool), robot.n))
    reached = np.zeros(len(T_base_tool), dtype=bool)
    seed = None
    for k in range(len(T_base_tool)):
        solved = inverse_kinematics(robot, T_base_tool[k : k + 1], seed)
        q[k], reached[k] = solved.q[0], solved.reached[0]
        if reached[k]:
            seed = solved.q[0]
    return q, reached
