"""The local-POE baseline (Eqs. 8–11): initial relative poses δζ by Gauss–Newton with minimum-norm steps.

What the data cannot tell apart is reported instead of hidden: rank, singular values and unobservable directions.
"""

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.identification.columns import placement_columns
from calibtool.identification.model import Identification, split_rms
from calibtool.identification.parameters import COMPONENTS
from calibtool.measurement.measurements import Measurements, Setup
from calibtool.measurement.observation import observation_matrix, residuals, target_columns, weights
from calibtool.measurement.registration import update_setup
from calibtool.robot.geometry import GeometricErrors
from calibtool.robot.mechanism import Frames
from calibtool.robot.motion import JointMotion
from calibtool.robot.se3 import Array, readonly

RANK_TOLERANCE = 1e-8  # of the largest singular value; the exact redundancies lie near 1e-16


def identify_local_poe(measurements: Measurements, max_iterations: int = 30) -> Identification:
    """Fit δζ_1…δζ_{n+1} (and unknown targets in place of δζ_{n+1}) to the measured coordinates, weighted by 1/σ.

    Raises NoSolutionError when the configurations are too few for the parameters, or the iteration does not settle.
    """
    robot, q = measurements.robot, measurements.q
    setup = measurements.setup
    weight = weights(measurements)
    geometry = GeometricErrors.none(robot.n)
    names = _parameter_names(robot.n, setup)

    rng = np.random.default_rng(0)
    anywhere = robot.lower + (robot.upper - robot.lower) * rng.random((100, robot.n))
    seen_anywhere = _matrix(geometry.frames(robot.chain, anywhere), setup, weight.max(axis=0))
    observable_rank = numerical_rank(np.linalg.svd(seen_anywhere, compute_uv=False))
    # Points of a rigid tool show no more than six things of a configuration.
    shown = measurements.points.shape[1] * 3 if setup.R_tool_sensor is None else 6
    shown = min(shown, 6) if setup.targets_known else shown
    equations = len(q) * shown
    if equations < observable_rank:
        needed = -(-observable_rank // shown)
        raise NoSolutionError(
            f"local-poe: {len(q)} configurations give {equations} equations for {observable_rank} identifiable parameters; "
            f"measure at least {needed} (twice as many for a useful result)"
        )

    rank = 0
    singular_values, null_space = np.zeros(0), np.zeros((0, 0))
    for iteration in range(1, max_iterations + 1):
        frames = geometry.frames(robot.chain, q)
        A = _matrix(frames, setup, weight)
        left = (residuals(measurements, setup, frames.tool) * weight).ravel()
        u, s, vt = np.linalg.svd(A, full_matrices=False)
        if iteration == 1:  # the rank is that of the nominal design: errors must not make it look better
            rank, singular_values, null_space = numerical_rank(s), s, vt[numerical_rank(s) :]
        step = vt[:rank].T @ ((u[:, :rank].T @ left) / s[:rank])
        geometry, setup = _moved(geometry, setup, step)
        if np.abs(step).max() < 1e-10:
            break
    else:
        raise NoSolutionError(
            f"local-poe: no convergence in {max_iterations} iterations, the last step was {np.abs(step).max():.1e}; "
            "check units, joint order and the order of the targets"
        )
    final = residuals(measurements, setup, geometry.frames(robot.chain, q).tool)
    return Identification(
        model="local-poe",
        geometry=geometry,
        motion=JointMotion.none(robot.n),
        setup=setup,
        singular_values=readonly(singular_values),
        rank=rank,
        observable_rank=observable_rank,
        unobservable=directions(null_space, seen_anywhere, names, observable_rank - rank),
        residual_rms=split_rms(final, measurements),
        iterations=iteration,
    )


def _matrix(frames: Frames, setup: Setup, weight: Array) -> Array:
    """Weighted identification matrix (N·d, p)."""
    columns = observation_matrix(setup, frames.tool) @ placement_columns(frames)
    if not setup.targets_known:  # free targets take the place of the tool's own error, the two cannot be told apart
        columns = np.concatenate([columns[:, :, :-6], target_columns(setup, frames.tool)], axis=-1)
    return (columns * weight[..., None]).reshape(-1, columns.shape[-1])


def _moved(geometry: GeometricErrors, setup: Setup, step: Array) -> tuple[GeometricErrors, Setup]:
    size = geometry.placements.size
    if setup.targets_known:
        return geometry.moved_placements(step.reshape(-1, 6)), setup
    placements = np.concatenate([step[: size - 6], np.zeros(6)]).reshape(-1, 6)
    return geometry.moved_placements(placements), update_setup(setup, None, step[size - 6 :])


def numerical_rank(singular_values: np.ndarray) -> int:
    """How many singular values (p,), the largest first, are above RANK_TOLERANCE of the largest."""
    return int((singular_values > RANK_TOLERANCE * singular_values[0]).sum())


def _parameter_names(n: int, setup: Setup) -> list[str]:
    joints = n + 1 if setup.targets_known else n
    names = [f"ζ{j + 1}.{c}" for j in range(joints) for c in COMPONENTS]
    if not setup.targets_known:
        names += [f"target{i + 1}.{c}" for i in range(len(setup.targets)) for c in COMPONENTS[:3]]
        names += [f"sensor.{c}" for c in COMPONENTS[3:]] if setup.R_tool_sensor is not None else []
    return names


def directions(null_space: Array, seen_anywhere: Array, names: list[str], missing: int) -> tuple[str, ...]:
    """Text for the directions that these configurations do not show but others would, clearest there first.

    The null space (k, p) holds the exact redundancies too; they stay invisible in `seen_anywhere` (M, p), the matrix of
    configurations all over the joint range.
    """
    if missing <= 0 or not len(null_space):
        return ()
    _, _, vt = np.linalg.svd(seen_anywhere @ null_space.T, full_matrices=False)
    texts = []
    for vector in (vt @ null_space)[:missing]:
        largest = np.argsort(-np.abs(vector))[:3]
        texts.append(" ".join(f"{vector[i]:+.2f}·{names[i]}" for i in largest))
    return tuple(texts)
