"""Poses for a controller that computes with a model of its own."""

from collections.abc import Sequence

import numpy as np

from calibtool.calibration import Calibration
from calibtool.errors import UsageError
from calibtool.robot.inverse import solve_poses
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.se3 import Array, log3

_NEARER = 1e-9  # m: by less the untouched pose is not better


def check_controller_known(
    calibration: Calibration, model: Mechanism | None, name: str
) -> tuple[str, ...]:
    """Note for a program with poses; UsageError where the model of its controller is not known.

    That is where the description states that the controller may have a model of its own and none is
    given. The controller of a simulated robot has the nominal model.
    """
    robot = calibration.robot
    known = robot.source.description.controller
    if model is not None or known is None:
        return ()
    if calibration.simulated:
        note = "poses are for a controller with the nominal model, as in the simulation"
        return (f"{note}; for a real arm give --controller",)
    kind = "has" if known.factory_calibration == "always" else "may have"
    raise UsageError(
        f"{name}: holds poses, and the controller of {robot.name} {kind} a model of its own "
        f"({known.reason}); say which: --controller nominal or --controller FILE (URDF, UR "
        "calibration yaml, calibration.conf, DH table)"
    )


def poses_to_write(
    calibration: Calibration,
    model: Mechanism | None,
    T_base_tool: Sequence[Array | None],
    q: Array,
    q_m: Array,
) -> tuple[Array, np.ndarray]:
    """T_controller(q_m) (N, 4, 4) of corrected joints, and targets (N,) that had better be left.

    model: the controller's, the nominal robot unless given. T_base_tool: commanded poses (4, 4),
    None for a joint target; q (N, n) the nominal robot's joints, q_m (N, n) corrected ones, NaN
    where there are none.
    """
    model = model or calibration.robot.mechanism
    left = np.zeros(len(q), dtype=bool)
    if model is not calibration.robot.mechanism:
        solved = np.flatnonzero(np.isfinite(q_m).all(axis=-1))
        rows = [k for k in solved.tolist() if T_base_tool[k] is not None]
        T = np.array([T_base_tool[k] for k in rows]).reshape(-1, 4, 4)
        left[rows] = worse_than_untouched(calibration, model, T, q[rows], q_m[rows])
    return model.forward(np.nan_to_num(q_m)), left


def worse_than_untouched(
    calibration: Calibration, model: Mechanism, T_base_tool: Array, q: Array, q_m: Array
) -> np.ndarray:
    """Rows whose tool would come nearer to the commanded pose if the program stayed as it is. (N,)

    T_base_tool (N, 4, 4) commanded, q (N, n) the nominal robot's joints there, q_m (N, n) corrected
    ones, which a pose T_controller(q_m) makes the controller drive. Left as it is, the commanded
    pose makes it drive T_controller⁻¹.
    """
    robot = calibration.robot
    untouched = solve_poses(
        model.forward_and_jacobian, T_base_tool, q, length=robot.length, descend=True
    )
    before, after = (
        _pose_error(calibration.forward(joints), T_base_tool, robot.length)
        for joints in (untouched.q, q_m)
    )
    worse: np.ndarray = untouched.reached & (before < after - _NEARER)
    return worse


def _pose_error(pose: Array, commanded: Array, length: float) -> Array:
    """Distance of the tool and its turn times a length, as one figure: (N,) m."""
    turn = log3(pose[:, :3, :3] @ np.swapaxes(commanded[:, :3, :3], -1, -2))
    both = np.concatenate([pose[:, :3, 3] - commanded[:, :3, 3], turn * length], axis=-1)
    error: Array = np.linalg.norm(both, axis=-1)
    return error
