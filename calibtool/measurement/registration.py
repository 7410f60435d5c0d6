"""Registration: the instrument's frame and the targets on the tool, from measurements and a model of the robot (METHOD §3).

A linear closed form, without any assumption of small angles, starts a Gauss–Newton refinement of the exact residuals.
"""

from dataclasses import replace

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.measurement.measurements import Measurements, Setup
from calibtool.measurement.observation import observation_matrix, residuals, target_columns, weights
from calibtool.robot.se3 import Array, exp6, inverse, readonly

_RANK_TOLERANCES = (1e-9, 1e-2)  # the second one for designs in which a direction is seen only through errors


def register(measurements: Measurements, T_base_tool: Array | None = None) -> Setup:
    """The set-up with its unknown parts fitted to the measurements; known parts stay.

    T_base_tool (N, 4, 4): poses that a model of the robot gives; those of the nominal robot unless given.
    Raises NoSolutionError when there are fewer configurations than the unknowns need, or no start converges.
    """
    setup = measurements.setup
    if setup.known:
        return setup
    poses = measurements.robot.mechanism.forward(measurements.q) if T_base_tool is None else T_base_tool
    unknowns = 6 * (not setup.frame_known) + (3 * len(setup.targets) + 3 * (setup.R_tool_sensor is not None)) * (
        not setup.targets_known
    )
    equations = measurements.equations
    if equations <= unknowns:
        raise NoSolutionError(
            f"registration: {len(measurements)} configurations give {equations} equations for {unknowns} unknowns of "
            "instrument frame and targets; measure more configurations"
        )
    refined = [_refine(measurements, start, poses) for start in _closed_forms(measurements, poses)]
    best, cost = min(refined, key=lambda item: item[1])
    if not np.isfinite(cost):
        raise NoSolutionError(
            "registration: no start converged; check joint values, units and the order of the targets"
        )
    return best


def update_setup(setup: Setup, base: Array | None, target_shift: Array | None) -> Setup:
    """Apply a Gauss–Newton step: a twist (6,) of K_0 that moves the predictions, and shifts (d,) as in `target_columns`."""
    if base is not None:
        setup = replace(setup, T_instrument_base=readonly(setup.T_instrument_base @ exp6(base)))
    if target_shift is not None:
        m = len(setup.targets)
        turned = setup.R_tool_sensor
        if turned is not None:
            turned = readonly(exp6(np.concatenate([np.zeros(3), target_shift[3 * m :]]))[:3, :3] @ turned)
        targets = readonly(setup.targets + target_shift[: 3 * m].reshape(m, 3))
        setup = replace(setup, targets=targets, R_tool_sensor=turned)
    return setup


def _refine(measurements: Measurements, setup: Setup, poses: Array) -> tuple[Setup, float]:
    """Gauss–Newton with minimum-norm steps; the cost is infinite when it does not settle."""
    weight = weights(measurements)
    cost = np.inf
    for _ in range(50):
        blocks = []
        if not setup.frame_known:
            blocks.append(observation_matrix(setup, poses))
        if not setup.targets_known:
            blocks.append(target_columns(setup, poses))
        left = (residuals(measurements, setup, poses) * weight).ravel()
        columns = (np.concatenate(blocks, axis=-1) * weight[..., None]).reshape(len(left), -1)
        step: Array = np.linalg.lstsq(columns, left, rcond=1e-9)[0].astype(float)
        base = None if setup.frame_known else step[:6]
        shift = None if setup.targets_known else step[0 if setup.frame_known else 6 :]
        setup = update_setup(setup, base, shift)
        cost = float((residuals(measurements, setup, poses) ** 2 * weight**2).sum())
        if np.abs(step).max() < 1e-11:
            return setup, cost
    return setup, cost if np.abs(step).max() < 1e-8 else np.inf


def _closed_forms(measurements: Measurements, poses: Array) -> list[Setup]:
    """Starting values of the unknown parts."""
    setup, rotations = measurements.setup, measurements.rotations
    points = measurements.points
    if rotations is not None:
        # A sensor pose as four points: its origin and the tips of its axes, 1 m long.
        points = np.concatenate([points, points + np.swapaxes(rotations, -1, -2)], axis=1)
    starts = []
    if setup.frame_known:
        starts.append((setup.T_instrument_base, _mean_targets(poses, setup.T_instrument_base, points)))
    elif setup.targets_known:
        targets = setup.targets
        if setup.R_tool_sensor is not None:
            targets = np.concatenate([targets, targets + setup.R_tool_sensor.T])
        predicted = targets @ np.swapaxes(poses[:, :3, :3], -1, -2) + poses[:, None, :3, 3]
        seen = ~np.isnan(points[..., 0])
        starts.append((rigid_fit(predicted[seen], points[seen]), targets))
    else:
        for tolerance in _RANK_TOLERANCES:
            frame = _linear_frame(poses, points, tolerance)
            starts.append((frame, _mean_targets(poses, frame, points)))
    m = len(setup.targets)
    result = []
    for frame, targets in starts:
        turned = setup.R_tool_sensor
        if turned is not None and not setup.targets_known:
            turned = readonly(_nearest_rotation((targets[m:] - targets[:m]).T))
        result.append(
            replace(setup, T_instrument_base=readonly(frame), targets=readonly(targets[:m]), R_tool_sensor=turned)
        )
    return result


def _linear_frame(poses: Array, points: Array, tolerance: float) -> Array:
    """T_instrument_base from R_base_instrument p_k,i + s − R_k p_i = t_k, linear in the nine elements of the rotation."""
    count, m = points.shape[:2]
    centre = np.nanmean(points.reshape(-1, 3), axis=0)
    seen = ~np.isnan(points[..., 0])
    A = np.zeros((count, m, 3, 12 + 3 * m))
    for row in range(3):
        A[:, :, row, 3 * row : 3 * row + 3] = points - centre
        A[:, :, row, 9 + row] = 1.0
    for i in range(m):
        A[:, i, :, 12 + 3 * i : 15 + 3 * i] = -poses[:, :3, :3]
    b = np.broadcast_to(poses[:, None, :3, 3], (count, m, 3))
    x: Array = np.linalg.lstsq(A[seen].reshape(-1, 12 + 3 * m), b[seen].ravel(), rcond=tolerance)[0].astype(float)
    T_base_instrument = np.eye(4)
    T_base_instrument[:3, :3] = _nearest_rotation(x[:9].reshape(3, 3))
    T_base_instrument[:3, 3] = x[9:12] - T_base_instrument[:3, :3] @ centre
    return inverse(T_base_instrument)


def _mean_targets(poses: Array, T_instrument_base: Array, points: Array) -> Array:
    """Targets in the tool frame, averaged over the configurations: (m, 3)."""
    T_tool_instrument = inverse(T_instrument_base @ poses)
    seen = points @ np.swapaxes(T_tool_instrument[:, :3, :3], -1, -2) + T_tool_instrument[:, None, :3, 3]
    return np.nanmean(seen, axis=0)


def rigid_fit(source: Array, target: Array) -> Array:
    """The motion T with T · source ≈ target in least squares (Kabsch), batched: (…, m, 3), (…, m, 3) → (…, 4, 4)."""
    a, b = source.mean(axis=-2, keepdims=True), target.mean(axis=-2, keepdims=True)
    T = np.zeros((*source.shape[:-2], 4, 4))
    T[..., :3, :3] = _nearest_rotation(np.swapaxes(target - b, -1, -2) @ (source - a))
    T[..., :3, 3] = (b - a @ np.swapaxes(T[..., :3, :3], -1, -2))[..., 0, :]
    T[..., 3, 3] = 1.0
    return T


def _nearest_rotation(matrix: Array) -> Array:
    """The proper rotation nearest to a matrix (Frobenius norm): (…, 3, 3) → (…, 3, 3)."""
    u, _, vt = np.linalg.svd(matrix)
    sign = np.ones(matrix.shape[:-1])
    sign[..., 2] = np.linalg.det(u @ vt)
    return (u * sign[..., None, :]) @ vt
