"""The geometry that a URDF can hold, fitted to the predictions of a calibration."""

from collections.abc import Callable

import numpy as np

from calibtool.calibration import Calibration
from calibtool.errormodel.placements import placement_columns
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errormodel.tolerances import Tolerances
from calibtool.errors import InputError
from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.mechanism import Frames
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, relative_error
from calibtool.robot.singularity import weighted_jacobian

Forward = Callable[[Array], Array]  # q (N, n), rad or m → T_base_tool (N, 4, 4)

_SAMPLE = 500  # configurations for the fit, and as many others for the judgement
_MOST = 0.9
_STEPS = 20
_CONVERGED = 1e-9  # of the tolerances
_ROUNDING = 1e-8  # of the largest singular value: smaller ones are exact redundancies


def urdf_geometry(calibration: Calibration, basis: Array | None = None) -> RobotErrors:
    """Placement errors δζ with which Π M_j exp6(δζ_j) exp6(ξ_j q_j) is nearest to the calibrated
    robot.

    Fitted over the configurations of the calibration and over a sample from the same region, with
    equal weights. They are zero where the fitted ones are not better on other samples by two
    standard errors of the mean weighted pose error. basis (6n+6, k): see `fitted_geometry`.
    """
    robot, q = calibration.robot, fit_configurations(calibration)
    judged = _sample(calibration, 2 * _SAMPLE)[_SAMPLE:]
    q, judged = q[calibration.closes(q)], judged[calibration.closes(judged)]
    fitted = fitted_geometry(robot, calibration.forward, q, basis)
    drawing = RobotErrors.of(robot)
    target = calibration.forward(judged)
    before, after = (
        np.linalg.norm(_pose_error(robot, target, geometry.frames(judged)), axis=-1)
        for geometry in (drawing, fitted)
    )
    gain = before - after
    return fitted if gain.mean() > 2.0 * gain.std() / np.sqrt(len(gain)) else drawing


def fit_configurations(calibration: Calibration) -> Array:
    """Configurations of the calibration and as many near them, (2 · 500, n) in rad or m."""
    known = calibration.q
    as_many = known[np.linspace(0, len(known) - 1, _SAMPLE).round().astype(int)]
    return np.concatenate([_sample(calibration, 2 * _SAMPLE)[:_SAMPLE], as_many])


def check_without_loops(robot: Robot, what: str) -> None:
    """Raises InputError for a robot with closed loops, of which `what` can hold no geometry."""
    if robot.chain.tree is not None:
        raise InputError(
            f"{robot.name}: {what} cannot hold closed loops; export it as urdf, json, c or st"
        )


def full_basis(robot: Robot) -> Array:
    """Every placement error, each by its tolerance: (6n+6, 6n+6), more with loops; m and rad."""
    tolerances = Tolerances.of_robot(robot)
    count = len(robot.chain.placements)
    return np.diag(np.tile(np.repeat([tolerances.length, tolerances.angle], 3), count))


def joint_basis(robot: Robot) -> Array:
    """Joint offsets δq alone, each by its tolerance: (6n+6, n), more rows with loops.

    They are placement errors, too: M exp6(ξ δq) exp6(ξ q) = M exp6(ξ (q + δq)). Actuated joints
    are the first n of a robot with loops.
    """
    tolerances = Tolerances.of_robot(robot)
    basis = np.zeros((6 * len(robot.chain.placements), robot.n))
    for j, twist in enumerate(robot.chain.twists[: robot.n]):
        size = tolerances.length if robot.prismatic[j] else tolerances.angle
        basis[6 * j : 6 * j + 6, j] = twist * size
    return basis


def fitted_geometry(
    robot: Robot, forward: Forward, q: Array, basis: Array | None = None
) -> RobotErrors:
    """δζ of the least weighted pose error to the poses `forward(q)`, q (N, n) in rad or m.

    Gauss–Newton from zero. Placements that the poses cannot distinguish share their error by
    minimum norm over the tolerances of the robot's description. The error that no placement
    explains counts as noise, so that poses which a URDF can hold are met exactly. basis: the
    directions (6n+6, k) in which δζ may change, orthogonal, each as long as its tolerance; by
    default all.
    """
    target, geometry = forward(q), RobotErrors.of(robot)
    basis = full_basis(robot) if basis is None else basis
    coordinates = basis.T / np.sum(basis**2, axis=0)[:, None]
    for _ in range(_STEPS):
        frames = geometry.frames(q)
        error = _pose_error(robot, target, frames).ravel()
        columns = _weighted(robot, placement_columns(frames), frames)
        lost = np.isnan(frames.tool[:, 0, 0])  # closed loops that do not close
        columns[lost], error[np.repeat(lost, 6)] = 0.0, 0.0
        u, s, vt = np.linalg.svd(columns.reshape(len(error), -1) @ basis, full_matrices=False)
        noise = max(float(np.mean(error**2)), (_ROUNDING * s[0]) ** 2)
        prior = vt @ (coordinates @ geometry["placements"].ravel())
        step = vt.T @ ((s * (error @ u) - noise * prior) / (s**2 + noise))
        geometry = geometry.moved(placements=(basis @ step).reshape(-1, 6))
        if np.abs(step).max() < _CONVERGED:
            break
    return geometry


def _sample(calibration: Calibration, count: int) -> Array:
    """Configurations (count, n) of the default workspace, or of the calibration's joint range."""
    robot, q, rng = calibration.robot, calibration.q, np.random.default_rng(0)
    workspace = robot.workspace()
    if workspace.bounded:
        home, points = (robot.mechanism.forward(x)[:, :3, 3] for x in (workspace.home[None], q))
        inside = np.all(np.abs(points - home) <= workspace.box / 2 + 1e-3, axis=-1)
        if inside.mean() > _MOST:
            return sample_configurations(robot, workspace, count, rng)
    return rng.uniform(q.min(axis=0), q.max(axis=0), (count, robot.n))


def _pose_error(robot: Robot, target: Array, frames: Frames) -> Array:
    """Weighted pose error at the tool point, rad: (N, 6)."""
    return _weighted(robot, relative_error(target, frames.tool)[..., None], frames)[..., 0]


def _weighted(robot: Robot, twists: Array, frames: Frames) -> Array:
    """Twists of K_0 (N, 6, c) at the tool point, translations over the length."""
    return weighted_jacobian(twists, frames.tool, robot.length)
