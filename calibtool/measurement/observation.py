"""Observations predicted from poses, and weighted residuals (Eqs. 18, 19), for every kind of
observation.

An observation of one configuration has d coordinates in K_0, in m and rad: see `kinds`.
"""

import numpy as np

from calibtool.measurement.kinds import Readings
from calibtool.measurement.kinds.instrument import InstrumentKind
from calibtool.measurement.kinds.kind import of_place
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.setup import Setup
from calibtool.robot.se3 import Array, inverse, transform_points


def measured_in_base(measurements: Measurements, setup: Setup) -> Readings:
    """The measured points and orientations, transformed from the instrument's frame to K_0, where
    the kind of observation has such a frame.
    """
    readings = measurements.readings
    if not isinstance(setup.kind, InstrumentKind):
        return readings
    T_base_instrument = inverse(of_place(setup.frames, measurements.place, len(measurements)))
    rotations = readings.rotations
    return readings._replace(
        points=transform_points(T_base_instrument, readings.points),
        rotations=None if rotations is None else T_base_instrument[:, :3, :3] @ rotations,
    )


def residuals(measurements: Measurements, setup: Setup, T_base_tool: Array) -> Array:
    """Measured minus predicted, in K_0: (N, d), m and rad; 0 for a target that was not seen.

    Also 0 for a row at which the loops of the model do not close: it does not determine its
    parameters.
    """
    residual = setup.kind.residuals(measured_in_base(measurements, setup), setup, T_base_tool)
    return _where_closed(residual, T_base_tool)


def weighted_residuals(measurements: Measurements, setup: Setup, T_base_tool: Array) -> Array:
    """The same divided by the stated noise (N, d), along the instrument's axes if it differs."""
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
    place = measurements.place
    blocks = (
        []
        if pose_columns is None
        else [observation_matrix(setup, T_base_tool, place) @ pose_columns]
    )
    blocks += [target_columns(setup, T_base_tool, place)] if targets else []
    columns = np.concatenate(blocks, axis=-1) if len(blocks) > 1 else blocks[0]
    columns = _where_closed(columns, T_base_tool)
    return _whitened(measurements, setup, columns), weighted_residuals(
        measurements, setup, T_base_tool
    )


def _where_closed(rows: Array, T_base_tool: Array) -> Array:
    """Rows (N, …), 0 where the model has no pose (N, 4, 4)."""
    lost = np.isnan(T_base_tool[:, 0, 0])
    if lost.any():
        rows[lost] = 0.0
    return rows


def observation_matrix(setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
    """P of Eq. 18, ∂(observation)/∂δy: (N, d, 6); place (N,): see `Readings`."""
    return setup.kind.matrix(setup, T_base_tool, place)


def target_columns(setup: Setup, T_base_tool: Array, place: np.ndarray | None = None) -> Array:
    """∂(observation)/∂(free elements of the set-up beside the first frame): (N, d, k)."""
    return setup.kind.columns(setup, T_base_tool, place)


def weights(measurements: Measurements) -> Array:
    """1/σ of every coordinate, 0 where a target was not seen: (N, d), see `_whitened`."""
    readings = measurements.readings
    if measurements.deviations is None:
        stated = measurements.noise_position, measurements.noise_orientation
        return measurements.setup.kind.weights(readings, *stated)
    return measurements.setup.kind.weights(readings, 1.0, 1.0) / measurements.deviations


def _whitened(measurements: Measurements, setup: Setup, rows: Array) -> Array:
    """Rows (N, d, k) over the stated noise.

    Deviations of single axes are those of the instrument's axes.
    """
    if measurements.deviations is not None:
        rows = setup.kind.in_axes(setup, rows, measurements.place)
    return rows * weights(measurements)[..., None]
