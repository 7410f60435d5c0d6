"""The local-POE baseline (Eqs. 8–11): initial relative poses δζ by Gauss–Newton with minimum-norm
steps.

Rank, singular values and unobservable directions are reported.
"""

from dataclasses import replace

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.identification.identification import Identification, split_rms
from calibtool.identification.parameters import Parameters, State
from calibtool.measurement.gauss_newton import gauss_newton
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import (
    linearised,
    observation_matrix,
    residuals,
    target_columns,
    weighted_residuals,
    weights,
)
from calibtool.measurement.setup import Setup
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly

# 1 over m and rad: a direction is shown where its standard deviation is below 10 mm and 10 mrad
_SHOWN = 100.0
# m and rad: a step that ends the iteration; after the usual number of steps, where directions that
# are hardly seen come near their end slowly, 0.1 µm and 0.1 µrad do
_SETTLED, _USUAL, _SETTLED_LATE = 1e-10, 30, 1e-7
_ITERATIONS = 100  # at most
RANK_TOLERANCE = 1e-8  # of the largest singular value; the exact redundancies lie near 1e-16


def identify_local_poe(measurements: Measurements) -> Identification:
    """Fit δζ_1…δζ_{n+1} to the measured coordinates, weighted by 1/σ.

    Unknown targets take the place of δζ_{n+1}. Directions that the noise hides are not estimated;
    where that does not settle, those neither that are hidden by what the formula leaves. Raises
    NoSolutionError when the configurations are too few for the parameters, or the iteration does
    not converge.
    """
    q, setup = measurements.q, measurements.setup
    state = State.nominal(measurements.robot, setup)
    parameters = _placements(measurements.robot, setup)
    seen_anywhere = _seen_anywhere(measurements, state, parameters)
    observable_rank = numerical_rank(np.linalg.svd(seen_anywhere, compute_uv=False))
    # A rigid tool shows no more than six things of a configuration.
    shown = measurements.coordinates
    shown = min(shown, 6) if setup.targets_known else shown
    equations = len(q) * shown
    if equations < observable_rank:
        needed = -(-observable_rank // shown)
        raise NoSolutionError(
            f"local-poe: {len(q)} configurations give {equations} equations for {observable_rank} "
            f"identifiable parameters; measure at least {needed} (twice as many for a "
            "useful result)"
        )

    loops = measurements.robot.chain.tree is not None
    rank, steps, last = 0, 0, np.inf
    noise, least = 1.0, np.inf  # over the stated one: taken for granted, and what a state leaves
    singular_values, null_space = np.zeros(0), np.zeros((0, 0))

    def linearise(at: State) -> tuple[Array, Array]:
        context = at.errors.context(q)
        return linearised(
            measurements,
            at.setup,
            context.frames.tool,
            parameters.pose_columns(context),
            bool(parameters.targets),
        )

    def solve(system: tuple[Array, Array], damping: float) -> tuple[Array, bool]:
        nonlocal rank, steps, last, least, singular_values, null_space
        u, s, vt = np.linalg.svd(system[0].reshape(-1, parameters.count), full_matrices=False)
        if not rank:  # that of the nominal design: errors must not make it look better
            rank = int((s > max(RANK_TOLERANCE * s[0], _SHOWN * noise)).sum())
            singular_values, null_space = s, vt[rank:]
        gains = s[:rank] + damping * s[0] ** 2 / s[:rank]
        step = vt[:rank].T @ ((u[:, :rank].T @ system[1].ravel()) / gains)
        last, steps = np.abs(step).max(), steps + 1
        least = min(least, float(np.sqrt((system[1] ** 2).mean())))
        return step, bool(last < (_SETTLED if steps <= _USUAL else _SETTLED_LATE))

    def cost(at: State) -> float:
        """With closed loops a step can be too long: rows would not close any more."""
        pose = at.frames(q).tool
        if np.isnan(pose).any():
            return np.inf
        return float((weighted_residuals(measurements, at.setup, pose) ** 2).sum())

    nominal = state
    for _ in range(2):
        rank, steps = 0, 0
        state, iterations, settled = gauss_newton(
            nominal,
            linearise,
            solve,
            lambda at, step: at.moved(parameters, step),
            _ITERATIONS,
            cost if loops else None,
        )
        if settled or not 1.0 < least < 1.0 / (_SHOWN * measurements.noise_position):
            break  # points that are off by more than 10 mm are those of something else
        noise = least  # of what the formula cannot describe: fewer directions stand out of it
    if not settled:
        raise NoSolutionError(
            f"local-poe: no convergence in {_ITERATIONS} iterations, the last step "
            f"was {last:.1e}; check units, joint order and the order of the targets"
        )
    final = residuals(measurements, state.setup, state.frames(q).tool)
    return Identification(
        model="local-poe",
        errors=state.errors,
        setup=state.setup,
        singular_values=readonly(singular_values),
        rank=rank,
        observable_rank=observable_rank,
        unobservable=directions(
            null_space, seen_anywhere, parameters.names, observable_rank - rank
        ),
        residual_rms=split_rms(final, measurements),
        iterations=iterations,
    )


def _placements(robot: Robot, setup: Setup) -> Parameters:
    """δζ; free targets take the place of the tool's own error, the two cannot be told apart."""
    every = Parameters.of(robot, setup)
    part = next(part for part in every.parts if part.family.id == "placements")
    part = replace(part, elements=part.elements if setup.targets_known else part.elements[:-6])
    return replace(every, parts=(part,), frame_free=False)


def _seen_anywhere(measurements: Measurements, state: State, parameters: Parameters) -> Array:
    """Weighted identification matrix (M, p) of configurations all over the joint range."""
    robot, rng = measurements.robot, np.random.default_rng(0)
    context = state.errors.context(robot.closing(robot.anywhere(100, rng)))
    columns = observation_matrix(state.setup, context.frames.tool) @ parameters.pose_columns(
        context
    )
    if parameters.targets:
        columns = np.concatenate(
            [columns, target_columns(state.setup, context.frames.tool)], axis=-1
        )
    weight = weights(measurements).max(axis=0)
    return np.asarray((columns * weight[:, None]).reshape(-1, parameters.count))


def numerical_rank(singular_values: np.ndarray) -> int:
    """How many singular values (p,), the largest first, are above RANK_TOLERANCE of the largest."""
    return int((singular_values > RANK_TOLERANCE * singular_values[0]).sum())


def directions(
    null_space: Array, seen_anywhere: Array, names: list[str], missing: int
) -> tuple[str, ...]:
    """Text for the directions that these configurations do not show but others would,
    clearest there first.

    The null space (k, p) holds the exact redundancies too; they stay invisible in `seen_anywhere`
    (M, p), the matrix of configurations all over the joint range.
    """
    if missing <= 0 or not len(null_space):
        return ()
    _, _, vt = np.linalg.svd(seen_anywhere @ null_space.T, full_matrices=False)
    texts = []
    for vector in (vt @ null_space)[:missing]:
        largest = np.argsort(-np.abs(vector))[:3]
        texts.append(" ".join(f"{vector[i]:+.2f}·{names[i]}" for i in largest))
    return tuple(texts)
