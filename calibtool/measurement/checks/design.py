"""Checks of the joint positions alone: the design of the experiment."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from calibtool.measurement.checks.finding import Finding, listed
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, log3

MOVES = 1e-3  # rad or m: a joint that moves less stands still
REPEATS = 1e-3  # rad or m: configurations that differ by less are the same one, driven to again
_FLAT = 0.01  # extent across the plane over the largest one along it
_TURNS = 0.05  # rad: a tool that turns less about an axis has a constant orientation about it
_ALONE = 0.8  # part of the rows in which at most one joint is away from its usual position


def design_findings(robot: Robot, q: Array) -> list[Finding]:
    """Joints that never move, equal columns, joints that move one at a time, repeated rows, tool
    positions in a plane, and a tool that turns about at most one axis.

    q (N, n), rad or m.
    """
    found = [
        _still(q),
        *_equal_joints(q),
        _one_at_a_time(robot, q),
        _repeated(q),
        _plane(robot, q),
        _one_orientation(robot, q),
    ]
    return [finding for finding in found if finding is not None]


def repeated_groups(q: Array) -> np.ndarray:
    """Number (N,) of the configuration of each row of q (N, n); rows within REPEATS are equal."""
    pairs = cKDTree(q).query_pairs(REPEATS, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(q), len(q)))
    groups: np.ndarray = connected_components(links, directed=False)[1]
    return groups


def equal_columns(values: Array) -> list[tuple[int, int]]:
    """Pairs of columns of (N, c) that hold the same numbers and do vary."""
    moving = np.flatnonzero(
        np.ptp(np.where(np.isnan(values), _first_seen(values), values), axis=0) > 1e-6
    )
    pairs = [(int(a), int(b)) for k, a in enumerate(moving) for b in moving[k + 1 :]]
    return [
        (a, b)
        for a, b in pairs
        if np.allclose(values[:, a], values[:, b], rtol=0, atol=1e-9, equal_nan=True)
    ]


def _first_seen(values: Array) -> Array:
    """The first number of every column of (N, c), 0 where there is none."""
    seen = ~np.isnan(values)
    first = values[seen.argmax(axis=0), np.arange(values.shape[1])]
    return np.where(seen.any(axis=0), first, 0.0)


def _still(q: Array) -> Finding | None:
    still = np.flatnonzero(np.ptp(q, axis=0) < MOVES)
    if not len(still):
        return None
    message = (
        f"joint {listed(still)} never moves: errors that depend on it cannot be determined; "
        "measure with it moved"
        if len(still) == 1
        else f"joints {listed(still)} never move: errors that depend on them cannot be determined; "
        "measure with them moved"
    )
    return Finding("joint_never_moves", "warning", message, {"joints": [int(j) + 1 for j in still]})


def _equal_joints(q: Array) -> list[Finding]:
    if len(q) < 3:
        return []
    return [
        Finding(
            "duplicate_columns",
            "warning",
            f"joints {a + 1} and {b + 1} hold the same numbers in every row; a column "
            "was taken twice",
            {"joints": [a + 1, b + 1]},
        )
        for a, b in equal_columns(q)
    ]


def _one_at_a_time(robot: Robot, q: Array) -> Finding | None:
    if robot.n < 3 or len(q) < 3 * robot.n:
        return None
    away = (np.abs(q - np.median(q, axis=0)) > MOVES).sum(axis=-1)
    part = float((away <= 1).mean())
    if part < _ALONE or (np.ptp(q, axis=0) > MOVES).sum() < 3:
        return None
    message = (
        f"in {100 * part:.0f} % of the rows at most one joint has left its usual position: errors "
        "that appear only when joints move together cannot be determined; add configurations with "
        "all joints moved"
    )
    return Finding("one_joint_at_a_time", "warning", message, {"rows_percent": 100 * part})


def _repeated(q: Array) -> Finding | None:
    groups = repeated_groups(q)
    repeated = len(q) - int(groups.max()) - 1
    if not repeated:
        return None
    message = (
        f"{repeated} rows repeat the joint positions of another row; they lower the noise, "
        "but add no new information"
    )
    return Finding(
        "repeated_configurations",
        "note",
        message,
        {"rows": repeated, "configurations": len(q) - repeated},
    )


def _plane(robot: Robot, q: Array) -> Finding | None:
    if robot.n < 6 or len(q) <= 3:
        return None
    points = robot.mechanism.forward(q)[:, :3, 3]
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if extents[2] >= _FLAT * extents[0]:
        return None
    message = "all tool positions lie in one plane; errors across it are hardly determined"
    return Finding(
        "flat_design",
        "warning",
        message,
        {"extent_ratio": float(extents[2] / max(extents[0], 1e-300))},
    )


def _one_orientation(robot: Robot, q: Array) -> Finding | None:
    """The spread of the tool's orientations about the axes of least and middle spread."""
    if robot.n < 6 or len(q) <= 3:
        return None
    rotations = robot.mechanism.forward(q)[:, :3, :3]
    turns = log3(rotations @ rotations[0].T)
    spread = np.linalg.svd(turns - turns.mean(axis=0), compute_uv=False) / np.sqrt(len(q))
    if not spread[1] < _TURNS:
        return None
    still, where = (
        ("keeps one orientation", "in any direction")
        if spread[0] < _TURNS
        else ("turns about one axis only", "along that axis")
    )
    message = (
        f"the tool {still}: the places of unknown targets on it and the place of the base cannot "
        f"be separated {where}, and targets stay near the tool frame; measure with the tool turned "
        "differently, too"
    )
    return Finding("one_orientation", "warning", message, {"spread_rad": spread.tolist()})
