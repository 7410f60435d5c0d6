"""Observations predicted from poses, and weighted residuals (Eqs. 18, 19), for every kind of
observation.

An observation of one configuration has d coordinates in K_0, in m and rad: see `kinds`.
"""

import numpy as np

from calibtool.measurement.kinds import Readings
from calibtool.measurement.measurements import Measurements, Setup
from calibtool.robot.se3 import Array, inverse, transform_points


def measured_in_base(measurements: Measurements, setup: Setup) -> Readings:
    """The measured points and orientations, transformed from the instrument's frame to K_0."""
    T_base_instrument = inverse(setup.T_instrument_base)
    rotations = measurements.rotations
    return Readings(
        transform_points(T_base_instrument, measurements.points),
        None if rotations is None else T_base_instrument[:3, :3] @ rotations,
    )


def residuals(measurements: Measurements, setup: Setup, T_base_tool: Array) -> Array:
    """Measured minus predicted, in K_0: (N, d), m and rad; 0 for a target that was not seen."""
    return setup.kind.residuals(measured_in_base(measurements, setup), setup, T_base_tool)


def weighted_residuals(measurements: Measurements, setup: Setup, T_base_tool: Array) -> Array:
    """The same divided by the stated noise (N, d), along the instrument's axes where the noise
    differs by axis.
    """
    return _whitened(measurements, setup, residuals(measurements, setup, T_base_tool)[..., None])[
        ..., 0
    ]


def linearised(
    measurements: Measurements,
    setup: Setup,
    T_base_tool: Array,
    pose_columns: Array | None,
    targets: bool,
) -> tuple[Array, Array]:
    """Weighted columns (N, d, p) and weighted residuals (N, d) of every configuration.

    They are divided by the stated noise, at predicted poses T_base_tool (N, 4, 4). pose_columns:
    (N, 6, ·), ∂δy/∂θ. With `targets`, the columns of the target coordinates follow.
    """
    blocks = [] if pose_columns is None else [observation_matrix(setup, T_base_tool) @ pose_columns]
    blocks += [target_columns(setup, T_base_tool)] if targets else []
    columns = np.concatenate(blocks, axis=-1) if len(blocks) > 1 else blocks[0]
    return _whitened(measurements, setup, columns), weighted_residuals(
        measurements, setup, T_base_tool
    )


def observation_matrix(setup: Setup, T_base_tool: Array) -> Array:
    """P of Eq. 18, ∂(observation)/∂δy: (N, d, 6)."""
    return setup.kind.matrix(setup, T_base_tool)


def target_columns(setup: Setup, T_base_tool: Array) -> Array:
    """∂(observation)/∂(targets and sensor orientation): (N, d, d).

    Displacements and left-multiplied rotations in the tool frame.
    """
    return setup.kind.columns(setup, T_base_tool)


def weights(measurements: Measurements) -> Array:
    """1/σ of every coordinate of every observation, 0 where a target was not seen: (N, d),
    see `_whitened`.
    """
    readings = Readings(measurements.points, measurements.rotations)
    if measurements.deviations is None:
        stated = measurements.noise_position, measurements.noise_orientation
        return measurements.setup.kind.weights(readings, *stated)
    return measurements.setup.kind.weights(readings, 1.0, 1.0) / measurements.deviations


def _whitened(measurements: Measurements, setup: Setup, rows: Array) -> Array:
    """Rows (N, d, k) over the stated noise.

    Deviations of single axes are those of the instrument's axes.
    """
    if measurements.deviations is not None:
        count, d, k = rows.shape
        rows = (setup.T_instrument_base[:3, :3] @ rows.reshape(count, d // 3, 3, k)).reshape(
            count, d, k
        )
    return rows * weights(measurements)[..., None]
