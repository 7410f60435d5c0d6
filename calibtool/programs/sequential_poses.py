"""Poses that depend on each other: each is solved near the previous one, but all in batches.

Newton's method from the previous solution decides the branch. Long sequences are cut into parts
that are solved in parallel, each from a guess. Then the cuts are checked: a part with another start
is solved again, as far as that changes anything. In the end every solution is the one from the
solution before it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibtool.robot.se3 import Array

_PART = 96  # number of consecutive poses in a part
_SAME = 1e-6  # rad or m: starts that differ by less lead to the same answer

# Rows and where to start from (N, n) → joint positions (N, n); a row without an answer
# keeps its start.
Solver = Callable[[np.ndarray, Array], Array]


@dataclass(frozen=True, eq=False)
class Forest:
    """Rows, each after its parent: parents (N,), -1 for none, and the order in which
    parents come first.

    depth  (N,) how many rows are before it
    """

    parents: np.ndarray
    order: np.ndarray
    depth: np.ndarray


def forest(before: Sequence[Sequence[int]], fixed: Sequence[bool]) -> Forest:
    """One parent for each row: the first that can be reached from a row that is fixed, or that has
    none before it.

    before: rows that may precede each row. Rows that only follow themselves have no parent.
    """
    count = len(before)
    after: list[list[int]] = [[] for _ in range(count)]
    for row, rows in enumerate(before):
        for other in rows:
            after[other].append(row)
    parents = np.full(count, -1)
    depth = np.zeros(count, dtype=int)
    seen = [fixed[row] or not before[row] for row in range(count)]
    order = [row for row in range(count) if seen[row]]
    roots, at = iter(range(count)), 0
    while len(order) < count or at < len(order):
        if at == len(order):
            row = next(row for row in roots if not seen[row])
            seen[row] = True
            order.append(row)
        row = order[at]
        at += 1
        for other in after[row]:
            if not seen[other]:
                seen[other] = True
                parents[other], depth[other] = row, depth[row] + 1
                order.append(other)
    return Forest(parents, np.array(order, dtype=int), depth)


def follow_forest(trees: Forest, q: Array, solver: Solver) -> Array:
    """Solutions (N, n) of all rows: each from the solution of its parent.

    q (N, n): the start of a row without parent; otherwise a guess from which a part begins.
    """
    q = q.copy()
    parents, depth = trees.parents, trees.depth
    guesses, step = q.copy(), depth % _PART
    by_step: list[list[int]] = [[] for _ in range(min(_PART, int(depth.max(initial=0)) + 1))]
    for row in trees.order:
        by_step[step[row]].append(row)
    for k, group in enumerate(by_step):
        rows = np.array(group, dtype=int)
        start = guesses[rows] if k == 0 else q[parents[rows]]
        q[rows] = solver(rows, start)
    children: list[list[int]] = [[] for _ in q]
    for row in trees.order:
        if parents[row] >= 0:
            children[parents[row]].append(row)
    cuts = np.flatnonzero((step == 0) & (parents >= 0))
    rows = cuts[np.abs(q[parents[cuts]] - guesses[cuts]).max(axis=-1, initial=0.0) > _SAME]
    while len(rows):
        new = solver(rows, q[parents[rows]])
        changed = np.abs(new - q[rows]).max(axis=-1) > _SAME
        q[rows[changed]] = new[changed]
        rows = np.array([c for row in rows[changed] for c in children[row]], dtype=int)
    return q
