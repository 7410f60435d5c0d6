"""Poses for a controller that has its own kinematic model."""

from collections.abc import Sequence

import numpy as np

from calibtool.calibration import Calibration
from calibtool.errors import UsageError
from calibtool.robot.inverse import solve_poses
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.se3 import Array, pose_difference

_NEARER = 1e-9  # m: the untouched pose must be nearer by more than this to count as better


def check_controller_known(
    calibration: Calibration, model: Mechanism | None, name: str
) -> tuple[str, ...]:
    """Note for a program with poses; UsageError where the model of its controller is not known.

    It is not known where the description states that the controller may have its own model and none
    is given. The controller of a simulated robot has the nominal model.
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
    """T_controller(q_m) (N, 4, 4) at the corrected joints, and which targets should not be changed,
    (N,) bool.

    model: the controller's, by default the nominal robot. T_base_tool: commanded poses (4, 4), None
    for a joint target. q (N, n): joints of the nominal robot; q_m (N, n): corrected ones, NaN where
    there are none.
    """
    model = model or calibration.robot.mechanism
    worse = np.zeros(len(q), dtype=bool)
    if model is not calibration.robot.mechanism:
        solved = np.flatnonzero(np.isfinite(q_m).all(axis=-1))
        rows = [k for k in solved.tolist() if T_base_tool[k] is not None]
        T = np.array([T_base_tool[k] for k in rows]).reshape(-1, 4, 4)
        worse[rows] = worse_than_untouched(calibration, model, T, q[rows], q_m[rows])
    return model.forward(np.nan_to_num(q_m)), worse


def worse_than_untouched(
    calibration: Calibration, model: Mechanism, T_base_tool: Array, q: Array, q_m: Array
) -> np.ndarray:
    """Rows whose tool would be nearer to the commanded pose if the program were not changed: (N,)
    bool.

    T_base_tool (N, 4, 4) commanded; q (N, n) the nominal robot's joints there; q_m (N, n) corrected
    ones, which the controller takes for the pose T_controller(q_m). For the unchanged pose it takes
    T_controller⁻¹ of it.
    """
    robot = calibration.robot
    untouched = solve_poses(
        model.forward_and_jacobian, T_base_tool, q, length=robot.length, descend=True
    )
    before, after = (
        _pose_error(calibration.forward(joints), T_base_tool, robot.length)
        for joints in (untouched.q, q_m)
    )
    return untouched.reached & (before < after - _NEARER)


def _pose_error(pose: Array, commanded: Array, length: float) -> Array:
    """Distance of the tool plus its rotation times a length, as one number: (N,) m."""
    difference = pose_difference(pose, commanded)
    difference[:, 3:] *= length
    return np.asarray(np.linalg.norm(difference, axis=-1))
