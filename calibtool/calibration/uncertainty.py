"""Uncertainty of a calibrated pose from the posterior and the spread of the networks."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calibtool.calibration.calibration import Calibration
from calibtool.calibration.frame import free_columns, pose_sigma
from calibtool.errors import InputError
from calibtool.robot.se3 import Array, readonly
from calibtool.robot.singularity import at_point

_CHUNK = 2000


@dataclass(frozen=True, eq=False)
class PoseUncertainty:
    """Predicted standard deviations of calibrated poses.

    covariance  (N, 6, 6) of displacement of the tool point (m) and rotation vector (rad), in K_0
    """

    covariance: Array

    @property
    def position(self) -> Array:
        """Standard deviation of the tool point, root of the sum over x, y, z: (N,) m."""
        variance: Array = np.trace(self.covariance[:, :3, :3], axis1=1, axis2=2)
        return np.sqrt(variance)

    @property
    def orientation(self) -> Array:
        """Standard deviation of the rotation, root of the sum over its axes: (N,) rad."""
        variance: Array = np.trace(self.covariance[:, 3:, 3:], axis1=1, axis2=2)
        return np.sqrt(variance)


def with_discrepancy(calibration: Calibration, of: PoseUncertainty) -> PoseUncertainty:
    """The same with what the model does not describe, `Posterior.discrepancy`, on every axis.

    It is known of what was measured: orientations have none where only points were.
    """
    posterior = calibration.base.posterior
    if posterior is None:
        return of
    stated = np.array([calibration.noise_position, calibration.noise_orientation])
    variance = np.repeat((posterior.discrepancy * stated) ** 2, 3)
    return PoseUncertainty(of.covariance + np.diag(variance))


def predicted_uncertainty(
    calibration: Calibration, q: Array, direction: Array | None = None
) -> PoseUncertainty:
    """Covariance of the calibrated pose at q (N, n): C Σ Cᵀ of the parameters, that of the
    networks' mean, and what backlash does from a side that is not known, (w_j² + σ_w²) of joint j.

    direction: (N, n) −1 or +1 where the side is known, because backlash w_j is taken up in it, 0
    where it is not; None: nowhere. For an unregistered calibration the free base and tool frame
    follow the parameters, since they are chosen by the poses at the measured configurations.
    Raises InputError for a base model without a posterior.
    """
    posterior = calibration.base.posterior
    if posterior is None:
        raise InputError(
            f"a '{calibration.base.model}' base has no posterior; identify with --model complete"
        )
    covariance = np.empty((len(q), 6, 6))
    direction = np.zeros(q.shape) if direction is None else direction
    for rows in _chunks(len(q)):
        columns = _determined_columns(calibration, q[rows], direction[rows])
        poses = columns.shape[-1]
        covariance[rows] = (
            columns @ posterior.covariance[:poses, :poses] @ np.swapaxes(columns, 1, 2)
        ) + _slack(calibration, q[rows], direction[rows])
    return PoseUncertainty(covariance + _spread(calibration, q))


def _slack(calibration: Calibration, q: Array, direction: Array) -> Array:
    """Covariance of poses (N, 6, 6) from joints that stand at either end of their backlash."""
    widths = calibration.base.errors["backlash"]
    if not widths.any():
        return np.zeros((len(q), 6, 6))
    posterior = calibration.base.posterior
    assert posterior is not None
    squares = widths**2
    for part in posterior.parameters.parts:
        if part.family.id == "backlash":
            variances = np.diag(posterior.covariance)
            squares[part.elements] += variances[posterior.parameters.blocks["backlash"]]
    context = calibration.base_context(q)
    joints = at_point(context.offset_columns, context.frames.tool[:, :3, 3])
    unknown = squares * (direction == 0.0)
    return np.asarray((joints * unknown[:, None]) @ np.swapaxes(joints, 1, 2))


def _chunks(count: int) -> list[slice]:
    return [slice(start, start + _CHUNK) for start in range(0, count, _CHUNK)]


def _determined_columns(calibration: Calibration, q: Array, direction: Array) -> Array:
    """∂(tool point, turn)/∂θ without the targets (N, 6, p), less what the free frames take up."""
    columns, pose = _columns(calibration, q, direction)
    setup = calibration.setup
    return columns if setup.known else columns - free_columns(pose, setup) @ _taken_up(calibration)


def _columns(
    calibration: Calibration, q: Array, direction: Array | None = None
) -> tuple[Array, Array]:
    """The same with fixed frames, and T_base_tool (N, 4, 4).

    In chosen frames the columns of the last placement and of the base are not those of the fit,
    but span the same: all that the free frames take up.
    """
    base = calibration.base
    assert base.posterior is not None
    conditions = calibration.conditions
    if direction is not None:
        conditions = replace(conditions, direction=readonly(direction))
    context = calibration.errors.context(q, conditions)
    tool = context.frames.tool
    return at_point(base.posterior.parameters.pose_columns(context), tool[:, :3, 3]), tool


@lru_cache(maxsize=8)
def _taken_up(calibration: Calibration) -> Array:
    """How the free frames follow the parameters: −∂(frames)/∂θ (6 or 12, p), see `taught_frame`."""
    setup = calibration.setup
    sigma = pose_sigma(calibration.noise_position, calibration.noise_orientation)[:, None]
    squares, products = np.zeros(()), np.zeros(())
    for rows in _chunks(len(calibration.q)):
        columns, pose = _columns(calibration, calibration.q[rows])
        free, moved = (
            (part / sigma).reshape(-1, part.shape[-1])
            for part in (free_columns(pose, setup), columns)
        )
        squares, products = squares + free.T @ free, products + free.T @ moved
    return np.linalg.lstsq(squares, products, rcond=1e-12)[0].astype(float)


def _spread(calibration: Calibration, q: Array) -> Array:
    """Covariance of the ensemble's mean pose, from its members' differences: (N, 6, 6)."""
    if len(calibration.networks) < 2:
        return np.zeros((len(q), 6, 6))
    pose, jacobian = calibration.base_forward_and_jacobian(q)
    jacobian = at_point(jacobian, pose[:, :3, 3])
    members = np.stack(
        [(jacobian @ network(q)[..., None])[..., 0] for network in calibration.networks]
    )
    apart = members - members.mean(axis=0)
    scatter: Array = np.einsum("mki,mkj->kij", apart, apart)
    return scatter / (len(members) * (len(members) - 1))
