"""Normal equations of the complete model: what a Gauss–Newton step needs of measurements of any number."""

from dataclasses import dataclass

import numpy as np

from calibtool.identification.parameters import ErrorState, Parameters
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import observation_matrix, residuals, target_columns, weights
from calibtool.robot.motion import harmonic_functions
from calibtool.robot.se3 import Array

_CHUNK = 1000  # configurations whose columns are in memory together


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The sum of weighted squares round a state: squares − 2 gᵀx + xᵀH x, from `equations` residuals.

    information  H = AᵀA (p, p) and gradient g = Aᵀr (p,) of the residuals over the stated noise
    row_sizes    (N,) squared residuals of every configuration over the stated noise, before row weights
    """

    information: Array
    gradient: Array
    squares: float
    equations: float
    row_sizes: Array


def row_sizes(measurements: Measurements, state: ErrorState) -> Array:
    """Squared residuals of every configuration over the stated noise, (N,)."""
    frames = state.frames(measurements.robot, measurements.q, measurements.direction)
    left = residuals(measurements, state.setup, frames.tool) * weights(measurements)
    squared: Array = (left**2).sum(axis=-1)
    return squared


def normal_equations(
    measurements: Measurements, parameters: Parameters, state: ErrorState, row_weight: Array
) -> NormalEquations:
    """H and g at the state, in chunks, the squares of row k times `row_weight` (N,).

    A harmonic's column is that of its joint's offset times a function of the position, o_j f(q_j): its products are
    weighted sums of functions and need neither the columns nor their memory.
    """
    robot, setup = measurements.robot, state.setup
    p = parameters.count
    functions_of = parameters.blocks["harmonics"]
    rest = np.r_[0 : functions_of.start, functions_of.stop : p]
    offset_of = parameters.blocks["offsets"].start + np.array(parameters.revolute, dtype=int)
    information, gradient = np.zeros((p, p)), np.zeros(p)
    sizes, equations = np.empty(len(measurements)), 0.0
    for start in range(0, len(measurements), _CHUNK):
        rows = np.arange(start, min(start + _CHUNK, len(measurements)))
        part = measurements.rows(rows)
        weight = weights(part)
        frames = state.frames(robot, part.q, part.direction)
        constant = parameters.constant_columns(robot, state, frames, part.q, part.direction)
        columns = observation_matrix(setup, frames.tool) @ constant
        if parameters.targets:
            columns = np.concatenate([columns, target_columns(setup, frames.tool)], axis=-1)
        scale = np.sqrt(row_weight[rows])[:, None]
        columns *= (weight * scale)[..., None]
        left = residuals(part, setup, frames.tool) * weight
        sizes[rows] = (left**2).sum(axis=-1)
        left *= scale
        A, r = columns.reshape(-1, len(rest)), left.ravel()
        information[np.ix_(rest, rest)] += A.T @ A
        gradient[rest] += A.T @ r
        equations += float(row_weight[rows] @ (weight > 0).sum(axis=-1))
        if parameters.harmonics:
            _add_harmonics(information, gradient, parameters, columns, left, part.q, rest, offset_of)
    return NormalEquations(information, gradient, float(sizes @ row_weight), equations, sizes)


def held_out_sizes(
    measurements: Measurements, parameters: Parameters, state: ErrorState, covariance: Array, noise_factor: float
) -> Array:
    """Squared residuals over the stated noise that every configuration would have if the others alone were fitted. (N,)

    r_k without k is (1 − A_k C A_kᵀ/σ²)⁻¹ r_k, exact for the quadratic model: no fit is repeated. covariance C (p, p).
    """
    sizes = np.empty(len(measurements))
    for start in range(0, len(measurements), _CHUNK):
        part = measurements.rows(np.arange(start, min(start + _CHUNK, len(measurements))))
        weight = weights(part)
        frames = state.frames(part.robot, part.q, part.direction)
        columns = observation_matrix(state.setup, frames.tool) @ parameters.pose_columns(
            part.robot, state, frames, part.q, part.direction
        )
        if parameters.targets:
            columns = np.concatenate([columns, target_columns(state.setup, frames.tool)], axis=-1)
        columns *= weight[..., None]
        left = residuals(part, state.setup, frames.tool) * weight
        hat = columns @ covariance @ np.swapaxes(columns, 1, 2) / noise_factor**2
        alone = np.linalg.solve(np.eye(left.shape[1]) - hat, left[..., None])[..., 0]
        sizes[start : start + _CHUNK] = (alone**2).sum(axis=-1)
    return sizes


def _add_harmonics(
    information: Array,
    gradient: Array,
    parameters: Parameters,
    columns: Array,
    left: Array,
    q: Array,
    rest: np.ndarray,
    offset_of: np.ndarray,
) -> None:
    """Rows and columns of the harmonics, from the products of the offset columns with everything."""
    first, terms = parameters.blocks["harmonics"].start, 2 * parameters.harmonics
    blocks = [slice(first + i * terms, first + (i + 1) * terms) for i in range(len(offset_of))]
    functions = np.moveaxis(harmonic_functions(q[:, list(parameters.revolute)], parameters.harmonics), 1, 0)
    offsets = columns[:, :, offset_of]
    with_rest = np.swapaxes(offsets, 1, 2) @ columns  # (N, joints, rest)
    with_left = (np.swapaxes(offsets, 1, 2) @ left[..., None])[..., 0]
    for i, block in enumerate(blocks):
        cross = functions[i].T @ with_rest[:, i]
        information[block, rest] += cross
        information[rest, block] += cross.T
        gradient[block] += functions[i].T @ with_left[:, i]
        for k in range(i, len(blocks)):
            product = (functions[i] * with_rest[:, i, offset_of[k], None]).T @ functions[k]
            information[block, blocks[k]] += product
            if k > i:
                information[blocks[k], block] += product.T
