"""Random configurations to measure: reachable, inside the limits, away from singularities."""

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.robot.inverse import solve_poses
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6
from calibtool.robot.singularity import MIN_SINGULARITY_DISTANCE
from calibtool.robot.workspace import Workspace


def sample_configurations(
    robot: Robot, workspace: Workspace | str | None, count: int, rng: np.random.Generator
) -> Array:
    """Joint positions (count, n) of a workspace, in rad or m; None is the robot's default one.

    With a box: poses uniform in its box and cone, solved by inverse kinematics from its home; for
    n < 6 the reachable pose nearest to the drawn one. `full`: uniform over the joint range.
    Configurations outside the limits or nearer to a singularity than MIN_SINGULARITY_DISTANCE are
    drawn again.

    Raises NoSolutionError when hardly any pose of the workspace is reachable.
    """
    workspace = robot.workspace(workspace)
    accepted: list[Array] = []
    found = tried = 0
    while found < count:
        batch = max(2 * (count - found), 50)
        drawn = (
            _poses(robot, workspace, batch, rng)
            if workspace.bounded
            else robot.anywhere(batch, rng)
        )
        tried += batch
        while len(drawn) and found < count:  # no more of them are solved than are needed
            part, drawn = np.split(drawn, [min(max(count - found, 50), len(drawn))])
            q = _solved(robot, workspace, part) if workspace.bounded else part
            q = q[robot.within_limits(q)]
            q = q[robot.singularity_distance(q) >= MIN_SINGULARITY_DISTANCE]
            accepted.append(q)
            found += len(q)
        if tried > 2000 and found < 0.01 * tried:
            raise NoSolutionError(
                f"{robot.name}: only {found} of {tried} poses of the workspace can be reached "
                "inside the joint limits; make it smaller or move its home"
            )
    return np.concatenate(accepted)[:count]


def spread_rows(count: int, most: int) -> np.ndarray:
    """Indices (k,) of at most `most` of `count` rows, evenly spread from the first to the last."""
    return np.linspace(0, count - 1, min(count, most)).astype(int)


def _poses(robot: Robot, workspace: Workspace, count: int, rng: np.random.Generator) -> Array:
    """T_base_tool (count, 4, 4), uniform in the box and cone round the home."""
    home = workspace.home
    T_base_home = robot.mechanism.forward(home[None])[0]
    cone, roll = workspace.cone, workspace.roll

    # Tilts of the tool axis uniform over the cap of the cone, then a turn about the axis.
    tilt = np.arccos(1.0 - rng.random(count) * (1.0 - np.cos(cone)))
    direction = rng.uniform(-np.pi, np.pi, count)
    turn = rng.uniform(-roll, roll, count)
    tilts = np.zeros((count, 6))
    tilts[:, 3], tilts[:, 4] = tilt * np.cos(direction), tilt * np.sin(direction)
    turns = np.zeros((count, 6))
    turns[:, 5] = turn
    target: Array = T_base_home @ exp6(tilts) @ exp6(turns)
    target[:, :3, 3] = T_base_home[:3, 3] + workspace.box * rng.uniform(-0.5, 0.5, (count, 3))
    return target


def _solved(robot: Robot, workspace: Workspace, target: Array) -> Array:
    """Joints for poses of the box and cone (N, 4, 4), without rows that are not reached."""
    home = workspace.home
    solved = solve_poses(
        robot.mechanism.forward_and_jacobian,
        target,
        np.tile(home, (len(target), 1)),
        length=robot.length,
        lower=robot.lower,
        upper=robot.upper,
        tolerance=1e-8,
    )
    q: Array
    if robot.n >= 6:
        q = solved.q[solved.reached]
        return q
    # At a joint limit the nearest pose is the end of the arm's range, not the projection
    # of the drawn one.
    q = solved.q[solved.converged]
    q = q[((q > robot.lower + 1e-6) & (q < robot.upper - 1e-6)).all(axis=-1)]
    centre = robot.mechanism.forward(home[None])[0, :3, 3]
    inside = np.abs(robot.mechanism.forward(q)[:, :3, 3] - centre) <= workspace.box / 2 + 1e-9
    q = q[inside.all(axis=-1)]
    return q
