"""Reduction of a mechanism with closed loops: independent equations, idle joints, and missing
actuators.

At closed configurations near the given one, C holds the derivatives of all equations, C_p those by
the joints that are not actuated. Equations that depend on others are dropped: of a revolute cut in
a planar loop x and y remain. A null vector of C_p is a motion with fixed actuators. If it moves the
tool, an actuator is missing; if not, one of its joints is idle.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibtool.errors import InputError
from calibtool.robot.loops import Loop, Tree
from calibtool.robot.se3 import Array

RANK = 1e-5  # of the largest singular value or pivot; CAD programs round numbers to 1e-6


@dataclass(frozen=True, eq=False)
class Sample:
    """Equations at one closed configuration, in rad: C (m, J), and columns at the tool (6, J)."""

    columns: Array
    at_tool: Array


@dataclass(frozen=True)
class Reduced:
    """The result: the loops with their independent rows, and the idle joints."""

    loops: tuple[Loop, ...]
    idle: tuple[int, ...]


def reduced(tree: Tree, samples: list[Sample], names: tuple[str, ...], place: str) -> Reduced:
    """Independent rows and passive joints, p of each. tree: all joints but the actuated ones
    passive, all rows kept.

    names of the joints, and place, are for messages. Raises InputError for a loop in which the
    actuators are not independent, and for a motion of the tool that no actuator commands.
    """
    n = tree.n
    ranks = [_rank(sample.columns[:, n:]) for sample in samples]
    rank, generic = max(ranks), samples[int(np.argmax(ranks))]
    check_freedom(tree, samples, names, place)
    idle: list[int] = []
    C_p, moving = generic.columns[:, n:].copy(), generic.at_tool[:, n:]
    while C_p.shape[1] - len(idle) > rank:
        free = [j for j in range(C_p.shape[1]) if j not in idle]
        null = np.linalg.svd(C_p[:, free])[2][rank:]
        tool = moving[:, free] @ null.T
        if np.abs(tool).max() > 1e-6 * max(1.0, float(np.abs(moving).max())):
            vector = null[int(np.abs(tool).max(axis=0).argmax())]
            joints = ", ".join(f"'{names[n + free[k]]}'" for k in _suspects(tree, free, vector))
            raise InputError(
                f"{place}: the tool moves while every actuator stands still, by joints such as "
                f"{joints}: name what has a "
                "motor in kinematics.actuated, or add the loop that holds them"
            )
        idle.append(free[int(np.abs(null).max(axis=0).argmax())])
    used = [j for j in range(C_p.shape[1]) if j not in idle]
    kept = _independent(C_p[:, used], rank)
    blocks, loops = tree.row_blocks, []
    for loop, block in zip(tree.loops, blocks, strict=True):
        rows = tuple(
            row
            for row, number in zip(loop.rows, range(block.start, block.stop), strict=True)
            if number in kept
        )
        loops.append(replace(loop, rows=rows))
    return Reduced(tuple(loops), tuple(n + j for j in idle))


def _suspects(tree: Tree, free: list[int], vector: Array) -> list[int]:
    """Free passive joints that move by `vector` and are most similar to actuated ones, at most
    three.

    They are as deep in the tree as an actuated one and of the same kind; where there are none,
    those that move most.
    """

    def place_of(joint: int) -> tuple[int, bool]:
        return int(tree.support(joint).sum()), bool(tree.slides[joint])

    known = {place_of(joint) for joint in range(tree.n)}
    moving = [int(k) for k in np.argsort(-np.abs(vector)) if abs(vector[k]) > 1e-3]
    alike = [k for k in moving if place_of(tree.n + free[k]) in known]
    return (alike or moving)[:3]


def mobility(samples: list[Sample], joints: int) -> int:
    """Independent motions of all joints together: J less the rank of C."""
    return joints - max(_rank(sample.columns) for sample in samples)


def check_freedom(tree: Tree, samples: list[Sample], names: tuple[str, ...], place: str) -> None:
    """InputError where actuators are not independent: the rank of C is higher than that of C_p."""
    rank = max(_rank(sample.columns[:, tree.n :]) for sample in samples)
    whole = max(_rank(sample.columns) for sample in samples)
    if whole <= rank:
        return
    moves = tree.joints - whole
    suspects: list[Loop] = []
    for loop, block in zip(tree.loops, tree.row_blocks, strict=True):
        rest = [k for k in range(len(samples[0].columns)) if not block.start <= k < block.stop]
        without = max(_rank(s.columns[rest]) for s in samples)
        without_p = max(_rank(s.columns[rest][:, tree.n :]) for s in samples)
        if without - without_p < whole - rank:
            suspects.append(loop)
    most = max((len(loop.rows) for loop in suspects), default=0)
    named = ", ".join(f"'{loop.name}'" for loop in suspects if len(loop.rows) == most)
    held = _held(tree, samples) if moves >= tree.n else []
    which = f", and '{names[held[0]]}' cannot move" if held else ""
    raise InputError(
        f"{place}: {f'loop {named}' if named else 'the loops'}: over-constrained: the mechanism "
        f"has {moves} independent motions for {tree.n} actuators{which}; let the cut joint forbid "
        "less, or take a joint out of kinematics.actuated"
    )


def _held(tree: Tree, samples: list[Sample]) -> list[int]:
    """Actuated joints that cannot move at all at any of the samples."""
    moves = np.zeros(tree.n)
    for sample in samples:
        vt = np.linalg.svd(sample.columns)[2]
        free = vt[_rank(sample.columns) :, : tree.n]
        moves = np.maximum(moves, np.abs(free).max(axis=0, initial=0.0))
    return [int(j) for j in np.flatnonzero(moves < RANK)]


def _rank(matrix: Array) -> int:
    if not matrix.size:
        return 0
    sizes = np.linalg.svd(matrix, compute_uv=False)
    return int((sizes > RANK * max(sizes[0], 1e-300)).sum())


def _independent(columns: Array, rank: int) -> set[int]:
    """`rank` independent rows of (m, p), by pivoting, the first of nearly equal ones."""
    remaining, kept = columns.copy(), set[int]()
    while len(kept) < rank:
        sizes = np.linalg.norm(remaining, axis=1)
        best = int(np.flatnonzero(sizes > 0.999 * sizes.max())[0])
        direction = remaining[best] / sizes[best]
        remaining -= np.outer(remaining @ direction, direction)
        kept.add(best)
    return kept
