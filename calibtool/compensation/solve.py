"""Corrected joint positions (Eqs. 23, 24): the one-step rule, or the exact solution."""

from collections import Counter
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from calibtool.calibration import Calibration
from calibtool.compensation.bounds import Bounds
from calibtool.compensation.exact import exact
from calibtool.compensation.one_step import one_step
from calibtool.compensation.status import NOT_CLOSED, UNREACHABLE
from calibtool.errors import check_choice
from calibtool.robot.inverse import follow_path, inverse_kinematics
from calibtool.robot.se3 import Array, check_poses

Method = Literal["exact", "one-step"]


@dataclass(frozen=True, eq=False, repr=False)
class Compensation:
    """Corrected joint positions and how far each row can be trusted.

    q            (N, n) corrected joint positions, rad or m; NaN in unreachable rows
    status       (N,) of `compensation.status`: `ok`, or why an error remains
    position     (N,) remaining error of the tool point under the calibrated model, m
    orientation  (N,) the same as a rotation angle, rad
    commanded    (N, n) joint positions of the nominal robot at the command, rad or m
    """

    q: Array
    status: np.ndarray
    position: Array
    orientation: Array
    commanded: Array

    def __repr__(self) -> str:
        counts = Counter(self.status.tolist())
        statuses = ", ".join(f"{count} {status}" for status, count in counts.most_common())
        return f"<Compensation of {len(self.q)} rows: {statuses}>"


def compensate_joints(
    calibration: Calibration,
    q: ArrayLike,
    method: Method = "exact",
    bounds: Bounds | None = None,
) -> Compensation:
    """Correct joints q (N, n), or (n,) for one row, so that the calibrated robot goes where the
    nominal one would at q.

    Under the calibrated model no row is worse than the commanded one (`judged`): where no better
    joints are found, they are not changed. bounds: `default_bounds` unless given. Raises InputError
    for a wrong number of joint positions or positions that are not finite, UsageError for an
    unknown method. Rows without a solution raise nothing: see `Compensation.status`.
    """
    q = np.atleast_2d(np.asarray(q, dtype=float))
    calibration.robot.check_positions(q, "joint positions")
    return _compensate(calibration, None, q, method, bounds)


def compensate_poses(
    calibration: Calibration,
    T_base_tool: ArrayLike,
    q_seed: ArrayLike | None = None,
    method: Method = "exact",
    bounds: Bounds | None = None,
) -> Compensation:
    """Correct joints for commanded poses (N, 4, 4), or (4, 4) for one row.

    The nominal inverse kinematics gives joints, which are corrected as in `compensate_joints`.

    q_seed (N, n) chooses the branch. With one seed (n,), or without any, the rows are a path: each
    starts from the solution of the row before, the first from the seed or the home of the default
    workspace. A pose that no joint positions reach has the status `unreachable` and NaN in its row.
    Raises InputError for poses that are not rigid, or seeds of another shape.
    """
    robot = calibration.robot
    T_base_tool = np.asarray(T_base_tool, dtype=float)
    T_base_tool = T_base_tool[None] if T_base_tool.ndim == 2 else T_base_tool
    check_poses(T_base_tool, "commanded poses")
    if q_seed is not None:
        q_seed = np.asarray(q_seed, dtype=float)
        robot.check_positions(np.atleast_2d(q_seed), "seeds")
    if q_seed is not None and q_seed.ndim == 2:
        solved = inverse_kinematics(robot, T_base_tool, q_seed)
        q, reached = solved.q, solved.reached
    else:
        q, reached = follow_path(robot, T_base_tool, q_seed)
    result = _compensate(calibration, T_base_tool, q, method, bounds)
    result.status[~reached] = UNREACHABLE
    result.q[~reached] = np.nan
    return result


def _compensate(
    calibration: Calibration,
    commanded: Array | None,
    q: Array,
    method: Method,
    bounds: Bounds | None,
) -> Compensation:
    """Correct joints q (N, n) for commanded poses (N, 4, 4), nominal ones for None."""
    check_choice(method, get_args(Method), "method")
    rule = exact if method == "exact" else one_step
    result = rule(calibration, q, commanded, bounds)
    lost = np.isnan(result.error).any(axis=-1)  # closed loops, of the nominal or of this robot
    result.q[lost], result.status[lost] = q[lost], NOT_CLOSED
    return Compensation(
        q=result.q,
        status=result.status,
        position=np.linalg.norm(result.error[:, :3], axis=-1) * calibration.robot.length,
        orientation=np.linalg.norm(result.error[:, 3:], axis=-1),
        commanded=q,
    )
