"""Normal equations of a model for a Gauss–Newton step, accumulated over any number of rows."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calibtool.errormodel.family import Context, JointFunctions
from calibtool.identification.parameters import Parameters, State
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import linearised, weighted_residuals, weights
from calibtool.robot.se3 import Array

_CHUNK = 1000  # configurations whose columns are in memory together


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Sum of weighted squares at a state: squares − 2 gᵀx + xᵀH x, from `equations` residuals.

    information  H = AᵀA (p, p) and gradient g = Aᵀr (p,) of the residuals divided by
                 the stated noise
    row_squares  (N,) squared residuals of every configuration divided by the stated noise,
                 before row weights
    """

    information: Array
    gradient: Array
    squares: float
    equations: float
    row_squares: Array


def row_squares(measurements: Measurements, state: State) -> Array:
    """Squared residuals of every configuration over the stated noise, (N,)."""
    frames = state.frames(measurements.q, measurements.conditions)
    residual = weighted_residuals(measurements, state.setup, frames.tool)
    squared: Array = (residual**2).sum(axis=-1)
    return squared


def normal_equations(
    measurements: Measurements, parameters: Parameters, state: State, row_weight: Array
) -> NormalEquations:
    """H and g at the state, in chunks, the squares of row k times `row_weight` (N,).

    A joint function's column is that of its joint's offset times a function of the row, o_j f(q_j):
    its products are weighted sums of functions and need neither the columns nor their memory.
    """
    p = parameters.count
    functions_of = [block for _, block in parameters.function_parts()]
    rest = np.delete(np.arange(p), np.r_[*functions_of] if functions_of else [])
    information, gradient = np.zeros((p, p)), np.zeros(p)
    squares, equations = np.empty(len(measurements)), 0.0
    for rows, part, context in _chunks(measurements, state):
        scale = np.sqrt(row_weight[rows])[:, None]
        pose_columns = parameters.pose_columns(context, functions=False)
        if functions_of:
            pose_columns = np.concatenate([context.offset_columns, pose_columns], axis=-1)
        columns, residual = linearised(
            part, state.setup, context.frames.tool, pose_columns, bool(parameters.targets)
        )
        squares[rows] = (residual**2).sum(axis=-1)
        columns *= scale[..., None]
        residual *= scale
        offsets, own = np.split(columns, [columns.shape[-1] - len(rest)], axis=-1)
        A, r = np.ascontiguousarray(own).reshape(-1, len(rest)), residual.ravel()
        information[np.ix_(rest, rest)] += A.T @ A
        gradient[rest] += A.T @ r
        equations += float(row_weight[rows] @ (weights(part) > 0).sum(axis=-1))
        if functions_of:
            _add_functions(information, gradient, parameters, context, rest, own, offsets, residual)
    return NormalEquations(information, gradient, float(squares @ row_weight), equations, squares)


def linearised_rows(
    measurements: Measurements, parameters: Parameters, state: State
) -> tuple[Array, Array]:
    """Columns (N, d, p) and residuals (N, d) of every configuration over the stated noise, at a
    state."""
    context = state.errors.context(measurements.q, measurements.conditions)
    return linearised(
        measurements,
        state.setup,
        context.frames.tool,
        parameters.pose_columns(context),
        bool(parameters.targets),
    )


def _chunks(
    measurements: Measurements, state: State
) -> Iterator[tuple[np.ndarray, Measurements, Context]]:
    """Measurements some rows at a time, and the state's frames there."""
    for start in range(0, len(measurements), _CHUNK):
        rows = np.arange(start, min(start + _CHUNK, len(measurements)))
        part = measurements.rows(rows)
        yield rows, part, state.errors.context(part.q, part.conditions)


def _add_functions(
    information: Array,
    gradient: Array,
    parameters: Parameters,
    context: Context,
    rest: np.ndarray,
    own: Array,
    offsets: Array,
    residual: Array,
) -> None:
    """Rows and columns of the joint functions, from products of the offset columns (N, d, n)."""
    functions = _by_joint(parameters, context)
    with_own = np.swapaxes(offsets, 1, 2) @ own  # (N, n, rest)
    with_offsets = np.swapaxes(offsets, 1, 2) @ offsets
    with_residual = (np.swapaxes(offsets, 1, 2) @ residual[..., None])[..., 0]
    for i, (j, block, values) in enumerate(functions):
        cross = values.T @ with_own[:, j]
        information[np.ix_(block, rest)] += cross
        information[np.ix_(rest, block)] += cross.T
        gradient[block] += values.T @ with_residual[:, j]
        for k, other, others in functions[i:]:
            product = (values * with_offsets[:, j, k, None]).T @ others
            information[np.ix_(block, other)] += product
            if k != j:
                information[np.ix_(other, block)] += product.T


def _by_joint(parameters: Parameters, context: Context) -> list[tuple[int, np.ndarray, Array]]:
    """Joints with functions, indices of their parameters (k,) and the functions' values (N, k)."""
    n, count = parameters.robot.n, len(context.moved)
    joints: list[list[tuple[np.ndarray, Array]]] = [[] for _ in range(n)]
    for part, block in parameters.function_parts():
        assert isinstance(part.family, JointFunctions)
        values = part.family.functions(part.shape, context.rows).reshape(count, -1)
        joint = part.elements // (values.shape[1] // n)
        for j in np.unique(joint):
            chosen = joint == j
            joints[j].append(
                (block.start + np.flatnonzero(chosen), values[:, part.elements[chosen]])
            )
    return [
        (
            j,
            np.concatenate([index for index, _ in own]),
            np.concatenate([values for _, values in own], axis=-1),
        )
        for j, own in enumerate(joints)
        if own
    ]
