"""From poses to what an instrument sees, and back to weighted residuals (Eqs. 18, 19).

An observation of one configuration has d components in K_0: x, y, z of each target point (d = 3m), for a 6-D instrument
x, y, z of the sensor and a rotation vector (d = 6).
"""

import numpy as np

from calibtool.measurement.measurements import Measurements, Setup
from calibtool.robot.se3 import Array, inverse, log3, skew, transform_points


def measured_in_base(measurements: Measurements, setup: Setup) -> tuple[Array, Array | None]:
    """Measured points (N, m, 3) and sensor rotations (N, 3, 3) or None, brought from the instrument's frame to K_0."""
    T_base_instrument = inverse(setup.T_instrument_base)
    points = transform_points(T_base_instrument, measurements.points)
    if measurements.rotations is None:
        return points, None
    return points, T_base_instrument[:3, :3] @ measurements.rotations


def residuals(measurements: Measurements, setup: Setup, T_base_tool: Array) -> Array:
    """Measured minus predicted, in K_0: (N, d), m and rad; 0 for a target that was not seen."""
    points, rotations = measured_in_base(measurements, setup)
    left = (points - transform_points(T_base_tool, setup.targets)).reshape(len(points), -1)
    left[~measurements.seen.repeat(3, axis=-1)] = 0.0
    if rotations is None or setup.R_tool_sensor is None:
        return left
    predicted = T_base_tool[:, :3, :3] @ setup.R_tool_sensor
    return np.concatenate([left, log3(rotations @ np.swapaxes(predicted, -1, -2))], axis=-1)


def observation_matrix(setup: Setup, T_base_tool: Array) -> Array:
    """P of Eq. 18, ∂(observation)/∂δy with rows [I, −[p_i]×] and, for a sensor's orientation, [0, I]: (N, d, 6)."""
    points = transform_points(T_base_tool, setup.targets)
    count, m = points.shape[:2]
    identity = np.broadcast_to(np.eye(3), (count, m, 3, 3))
    P = np.concatenate([identity, -skew(points)], axis=-1).reshape(count, 3 * m, 6)
    if setup.R_tool_sensor is None:
        return P
    rotation_rows = np.broadcast_to(np.hstack([np.zeros((3, 3)), np.eye(3)]), (count, 3, 6))
    return np.concatenate([P, rotation_rows], axis=1)


def target_columns(setup: Setup, T_base_tool: Array) -> Array:
    """∂(observation)/∂(targets and sensor orientation), shifts and left turns in the tool frame: (N, d, d)."""
    count, m = len(T_base_tool), len(setup.targets)
    blocks = m + (setup.R_tool_sensor is not None)
    columns = np.zeros((count, blocks, 3, blocks, 3))
    for block in range(blocks):
        columns[:, block, :, block, :] = T_base_tool[:, :3, :3]
    return columns.reshape(count, 3 * blocks, 3 * blocks)


def linearised(
    measurements: Measurements, setup: Setup, T_base_tool: Array, pose_columns: Array | None, targets: bool
) -> tuple[Array, Array]:
    """Columns (N, d, p) and residuals (N, d) of every configuration over the stated noise, at predicted poses (N, 4, 4).

    pose_columns (N, 6, ·) ∂δy/∂θ; with `targets`, the columns of the target coordinates follow.
    """
    blocks = [] if pose_columns is None else [observation_matrix(setup, T_base_tool) @ pose_columns]
    blocks += [target_columns(setup, T_base_tool)] if targets else []
    weight = weights(measurements)
    columns = np.concatenate(blocks, axis=-1) if len(blocks) > 1 else blocks[0]
    return columns * weight[..., None], residuals(measurements, setup, T_base_tool) * weight


def weights(measurements: Measurements) -> Array:
    """1/σ of every component of every observation, from the stated noise, 0 where a target was not seen: (N, d)."""
    seen = measurements.seen.repeat(3, axis=-1)
    position = seen / measurements.noise_position
    if measurements.rotations is None:
        return position
    orientation = np.full((len(seen), 3), 1.0 / measurements.noise_orientation)
    return np.concatenate([position, orientation], axis=-1)
