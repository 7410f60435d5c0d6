"""How sure a calibration is of a pose: posterior of the base model's parameters and spread of the ensemble."""

from dataclasses import dataclass

import numpy as np

from calibtool.calibration.model import Calibration
from calibtool.errors import InputError
from calibtool.robot.damped import at_point
from calibtool.robot.se3 import Array

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


def predicted_uncertainty(calibration: Calibration, q: Array) -> PoseUncertainty:
    """Covariance of the calibrated pose at q (N, n): C Σ Cᵀ of the parameters plus that of the networks' mean.

    For an unregistered calibration the pose is that in the instrument's frame. Raises InputError for a base model
    without a posterior.
    """
    posterior = calibration.base.posterior
    if posterior is None:
        raise InputError(f"a '{calibration.base.model}' base has no posterior; identify with --model complete")
    parameters = posterior.parameters
    poses = parameters.blocks["targets"].start
    covariance = np.empty((len(q), 6, 6))
    for start in range(0, len(q), _CHUNK):
        part = q[start : start + _CHUNK]
        context = calibration.base_context(part)
        columns = at_point(parameters.pose_columns(context), context.frames.tool[:, :3, 3])
        covariance[start : start + _CHUNK] = columns @ posterior.covariance[:poses, :poses] @ np.swapaxes(columns, 1, 2)
    return PoseUncertainty(covariance + _spread(calibration, q))


def _spread(calibration: Calibration, q: Array) -> Array:
    """Covariance of the ensemble's mean pose, from its members' differences: (N, 6, 6)."""
    if len(calibration.networks) < 2:
        return np.zeros((len(q), 6, 6))
    pose, jacobian = calibration.base_forward_and_jacobian(q)
    jacobian = at_point(jacobian, pose[:, :3, 3])
    members = np.stack([(jacobian @ network(q)[..., None])[..., 0] for network in calibration.networks])
    apart = members - members.mean(axis=0)
    scatter: Array = np.einsum("mki,mkj->kij", apart, apart)
    return scatter / (len(members) - 1)
