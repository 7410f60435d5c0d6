"""Rank of a design: which directions a set of configurations determines."""

from dataclasses import dataclass

import numpy as np

from calibtool.identification.local_poe import directions, numerical_rank
from calibtool.identification.parameters import Parameters, State
from calibtool.measurement.observation import observation_matrix
from calibtool.measurement.setup import Setup
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.singularity import at_point, scale_rows


@dataclass(frozen=True)
class Observability:
    """Observability of one model.

    model         `local-poe` (δζ) or `complete` (δζ, δξ, δq, gravity; harmonics are functions of δq
                  and are left out)
    parameters    number of parameters of the model
    rank          number of combinations that the configurations and targets determine
    possible      number that a 6-D instrument would determine with configurations over the whole
                  joint range; the others are redundant in the model (shared by neighbouring joints)
    unobservable  descriptions of the directions between `rank` and `possible`, the clearest first
    """

    model: str
    parameters: int
    rank: int
    possible: int
    unobservable: tuple[str, ...]


def observability(
    robot: Robot, setup: Setup, q: Array, anywhere: Array, model: str
) -> Observability:
    """Rank of the error columns at configurations q (N, n), observed through the targets of a
    set-up.

    The set-up is known or registered. anywhere (M, n): configurations over the whole joint range,
    with which q is compared. Columns are scaled by their tolerances and rows to rad by the
    characteristic length, so that the rank does not depend on units.
    """
    complete = model == "complete"
    parameters = Parameters.of(robot, setup, twists=complete, gravity=complete)
    scale = parameters.prior_std()
    used = np.arange(parameters.count)
    if not complete:
        used = used[parameters.blocks["placements"]]
    names = [parameters.names[i] for i in used]
    seen = _columns(robot, setup, parameters, q, targets=True)[:, used] * scale[used]
    everything = _columns(robot, setup, parameters, anywhere, targets=False)[:, used] * scale[used]
    _, singular_values, vt = np.linalg.svd(seen, full_matrices=True)
    rank = numerical_rank(singular_values)
    possible = numerical_rank(np.linalg.svd(everything, compute_uv=False))
    return Observability(
        model, len(used), rank, possible, directions(vt[rank:], everything, names, possible - rank)
    )


def _columns(robot: Robot, setup: Setup, parameters: Parameters, q: Array, targets: bool) -> Array:
    """Columns of all configurations, reduced to the R of a QR decomposition: the same singular
    values and null space.
    """
    context = State.nominal(robot, setup).errors.context(q)
    frames, columns = context.frames, parameters.pose_columns(context)
    if targets:
        seen = observation_matrix(setup, frames.tool) @ columns / robot.length
    else:
        seen = scale_rows(at_point(columns, frames.tool[:, :3, 3]), robot.length)
    return np.asarray(np.linalg.qr(seen.reshape(-1, columns.shape[-1]), mode="r"))
