"""The geometry that a URDF can hold, identified again from what a calibration predicts."""

from collections.abc import Callable

import numpy as np

from calibtool.calibration import Calibration
from calibtool.errormodel.placements import placement_columns
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errormodel.tolerances import Tolerances
from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.damped_least_squares import at_point, scale_rows
from calibtool.robot.mechanism import Frames
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, relative_error

Forward = Callable[[Array], Array]  # q (N, n), rad or m → T_base_tool (N, 4, 4)

_SAMPLE = 500  # configurations for the fit, and as many others for the judgement
_MOST = 0.9
_STEPS = 20
_CONVERGED = 1e-9  # of the tolerances
_ROUNDING = 1e-8  # of the largest singular value: smaller ones are exact redundancies


def urdf_geometry(calibration: Calibration) -> RobotErrors:
    """Placement errors δζ that bring Π M_j exp6(δζ_j) exp6(ξ_j q_j) near the calibrated robot.

    Fitted over the configurations of the calibration and over a sample of where they lie, which
    count the same. There are no errors where those found are not better than none on other samples,
    by two standard errors of the mean weighted pose error.
    """
    robot, known = calibration.robot, calibration.q
    sample, judged = np.split(_sample(calibration, 2 * _SAMPLE), 2)
    as_many = known[np.linspace(0, len(known) - 1, _SAMPLE).round().astype(int)]
    q = np.concatenate([sample, as_many])
    fitted, drawing = fitted_geometry(robot, calibration.forward, q), RobotErrors.of(robot)
    target = calibration.forward(judged)
    before, after = (
        np.linalg.norm(_pose_error(robot, target, geometry.frames(judged)), axis=-1)
        for geometry in (drawing, fitted)
    )
    gain = before - after
    return fitted if gain.mean() > 2.0 * gain.std() / np.sqrt(len(gain)) else drawing


def fitted_geometry(robot: Robot, forward: Forward, q: Array) -> RobotErrors:
    """δζ of the least weighted pose error to the poses `forward(q)`, q (N, n) in rad or m.

    Gauss–Newton from the drawing. Placements that the poses do not tell apart share their part by
    minimum norm over the tolerances of the robot's description; the error that no placement takes
    up counts as noise, so that poses which a URDF can hold are met exactly.
    """
    target, geometry = forward(q), RobotErrors.of(robot)
    tolerances = Tolerances.of_robot(robot)
    scale = np.tile(np.repeat([tolerances.length, tolerances.angle], 3), robot.n + 1)
    for _ in range(_STEPS):
        frames = geometry.frames(q)
        error = _pose_error(robot, target, frames).ravel()
        columns = _weighted(robot, placement_columns(frames), frames)
        u, s, vt = np.linalg.svd(columns.reshape(len(error), -1) * scale, full_matrices=False)
        noise = max(float(np.mean(error**2)), (_ROUNDING * s[0]) ** 2)
        prior = vt @ (geometry["placements"].ravel() / scale)
        step = vt.T @ ((s * (error @ u) - noise * prior) / (s**2 + noise))
        geometry = geometry.moved(placements=(step * scale).reshape(-1, 6))
        if np.abs(step).max() < _CONVERGED:
            break
    return geometry


def _sample(calibration: Calibration, count: int) -> Array:
    """Configurations (count, n) of the default workspace, or of the calibration's joint range
    where it is another.
    """
    robot, q, rng = calibration.robot, calibration.q, np.random.default_rng(0)
    workspace = robot.workspace(None)[1]
    if workspace is not None:
        home, points = (
            robot.mechanism.forward(x)[:, :3, 3] for x in (robot.home(workspace)[None], q)
        )
        inside = np.all(np.abs(points - home) <= np.array(workspace.box_m) / 2 + 1e-3, axis=-1)
        if inside.mean() > _MOST:
            return sample_configurations(robot, workspace, count, rng)
    return rng.uniform(q.min(axis=0), q.max(axis=0), (count, robot.n))


def _pose_error(robot: Robot, target: Array, frames: Frames) -> Array:
    """Weighted pose error at the tool point, rad: (N, 6)."""
    return _weighted(robot, relative_error(target, frames.tool)[..., None], frames)[..., 0]


def _weighted(robot: Robot, twists: Array, frames: Frames) -> Array:
    """Twists of K_0 (N, 6, c) at the tool point, translations over the length."""
    return scale_rows(at_point(twists, frames.tool[:, :3, 3]), robot.length)
