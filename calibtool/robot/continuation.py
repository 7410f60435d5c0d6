"""Newton's method on closed loops, and continuation to rows far from closed configurations."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibtool.robot.closure import Closure
from calibtool.robot.loops import Tree
from calibtool.robot.se3 import Array, readonly

# θ (N, J) and row numbers (N,) → for some of these rows (k,) and their passive joints (k, p): ends,
# columns, equations.
At = Callable[[np.ndarray, Array], tuple[Array, Array, Closure]]
Equations = Callable[[Array, np.ndarray], At]

_ITERATIONS = 12
_ARRIVED = 1e-12  # rad: after a step smaller than this, the remaining error is below its square
_ROUNDED = 1e-9  # rad: after _MANY steps, a step smaller than this is rounding near a singularity
_MANY = 7
_LONGEST = 0.5  # rad, or lengths: the equations are not linear over longer steps
_DIFFERENCE = 1e-4  # rad, or lengths: step of the numerical derivatives
_CELLS = 4096  # largest number of starts
_ALONG = 64  # largest number along a joint: with one motor they are reached one after another
# Larger corrections of a prediction (rad, or lengths) end in another assembly mode.
_JUMP = 0.25
_OF_WAY = 0.5  # of the way: larger corrections of a prediction also end in another assembly mode


@dataclass(frozen=True, eq=False)
class Closing:
    """State of Newton's method for N rows.

    theta     (N, J) all joints, rad or m, after the last step
    ok        (N,) whether the loops are closed there
    last      (N, p) the last step of the passive joints, which the other fields do not include
    ends      (N, 2L + 1, 4, 3) cut frames and tool
    jacobian  (N, J, 6) spatial columns of the joints
    follow    (N, p, n) ∂θ_p/∂q = −C_p⁻¹ C_a
    """

    theta: Array
    ok: np.ndarray
    last: Array
    ends: Array
    jacobian: Array
    follow: Array

    @classmethod
    def of(cls, tree: Tree, theta: Array) -> Self:
        """Nothing closed yet, at θ (N, J)."""
        count, ends = len(theta), len(tree.carriers) + 1
        return cls(
            theta.copy(),
            np.zeros(count, dtype=bool),
            np.zeros((count, tree.p)),
            np.zeros((count, ends, 4, 3)),
            np.zeros((count, tree.joints, 6)),
            np.zeros((count, tree.p, tree.n)),
        )

    def put(self, rows: np.ndarray, other: Self) -> None:
        """Write the rows (k,) of another one."""
        for name in ("theta", "ok", "last", "ends", "jacobian", "follow"):
            getattr(self, name)[rows] = getattr(other, name)


def newton(
    equations: Equations,
    tree: Tree,
    theta: Array,
    rows: np.ndarray,
    reach: Array,
    sign: float | None = None,
) -> Closing:
    """Close the loops from θ (N, J), with the actuated joints fixed; rows are their numbers (N,).

    A row is given up when a passive joint is farther than reach (N,), in rad or lengths, from its
    start, and where det C_p has the other sign: beyond a singularity of the passive joints the
    mechanism is in another assembly mode.
    """
    found = Closing.of(tree, theta)
    at = equations(theta, rows)
    theta, start = found.theta, theta[:, tree.passive]
    scale = tree.joint_scale[tree.passive]
    active = np.flatnonzero(np.isfinite(theta).all(axis=-1))
    for k in range(_ITERATIONS):
        if not len(active):
            break
        ends, jacobian, now = at(active, theta[active, tree.passive])
        C_p = now.columns[:, :, tree.passive]
        step = -solved(C_p, now.residual[..., None])[..., 0]
        size = np.abs(step / scale).max(axis=-1, initial=0.0)
        done = size < (_ARRIVED if k < _MANY else _ROUNDED)
        step[~done] *= np.minimum(1.0, _LONGEST / size[~done])[:, None]
        theta[active, tree.passive] += step
        far = np.abs((theta[active, tree.passive] - start[active]) / scale).max(-1, initial=0.0)
        near = far <= reach[active]  # not where a step is not a number
        kept = np.flatnonzero(done & near)
        if sign is not None:
            kept = kept[np.linalg.slogdet(C_p[kept])[0] == sign]
        arrived = active[kept]
        found.ok[arrived] = True
        found.last[arrived], found.ends[arrived] = step[kept], ends[kept]
        found.jacobian[arrived] = jacobian[kept]
        found.follow[arrived] = -solved(C_p[kept], now.columns[kept, :, : tree.n])
        active = active[near & ~done]
    return found


def advanced(
    equations: Equations,
    tree: Tree,
    begin: Array,
    q: Array,
    rows: np.ndarray,
    steps: int,
    sign: float | None,
) -> Closing:
    """Close the loops at q (N, n) through closed configurations from θ = begin (N, J)."""
    found = newton(equations, tree, begin, rows, np.full(len(q), _JUMP), sign)
    way = q - begin[:, : tree.n]
    for k in range(1, steps + 1):
        theta = found.theta.copy()
        theta[~found.ok] = np.nan
        moved = (begin[:, : tree.n] + way * (k / steps)) - theta[:, : tree.n]
        predicted = (found.follow @ moved[..., None])[..., 0]
        theta[:, : tree.n] += moved
        theta[:, tree.passive] += predicted
        found = newton(equations, tree, theta, rows, _reach(tree, moved, predicted), sign)
    return found


def _reach(tree: Tree, moved: Array, predicted: Array) -> Array:
    """Largest distance of a closed configuration from its prediction: (N,) rad or lengths."""
    scale = tree.joint_scale
    actuated = np.abs(moved / scale[: tree.n]).max(axis=-1, initial=0.0)
    passive = np.abs(predicted / scale[tree.passive]).max(axis=-1, initial=0.0)
    reach: Array = np.minimum(_JUMP, 0.01 + _OF_WAY * np.maximum(actuated, passive))
    return reach


def solved(matrices: Array, right: Array) -> Array:
    """M⁻¹ R of (N, p, p), (N, p, k); not a number where a matrix is singular."""
    if not matrices.shape[-1]:
        return np.zeros(right.shape)
    answer: Array = np.full(right.shape, np.nan)
    try:
        answer[:] = np.linalg.solve(matrices, right)
    except np.linalg.LinAlgError:
        for k, (matrix, column) in enumerate(zip(matrices, right, strict=True)):
            try:
                answer[k] = np.linalg.solve(matrix, column)
            except np.linalg.LinAlgError:
                continue
    return answer


@dataclass(frozen=True, eq=False)
class Starts:
    """Closed configurations on one assembly mode, one for each cell of a grid over the limits of
    the actuated joints.

    They are reached from the closed configuration of the description, cell by cell, near the
    straight line to each. A cell that is not reached has the start of the nearest one that is.

    tree   the mechanism's
    theta  (k, J) closed configurations, rad or m
    follow (k, p, n) ∂θ_p/∂q there
    curve  (k, p, n n) half of its own derivative
    sign   of det C_p on this assembly mode
    cells  (c_1, …, c_n) the number of the start of each cell
    """

    tree: Tree
    theta: Array
    follow: Array
    curve: Array
    sign: float
    cells: np.ndarray

    @classmethod
    def of(cls, equations: Equations, tree: Tree) -> Self:
        """The starts of a mechanism that closes at `Tree.closed_at` (J,)."""
        n = tree.n
        shape = (max(1, min(_ALONG, int(_CELLS ** (1.0 / n) + 1e-9))),) * n
        low, width = tree.lower[:n], (tree.upper[:n] - tree.lower[:n]) / np.array(shape)
        every = np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=-1)
        centres = low + (every + 0.5) * width
        home = _cell(tree, tree.closed_at[None, :n], shape)[0]
        _, _, at = equations(tree.closed_at[None], home[:1])(
            home[:1] * 0, tree.closed_at[None, tree.passive]
        )
        sign = float(np.linalg.slogdet(at.columns[0][:, tree.passive])[0])
        rings = np.abs(every - home).max(axis=-1)
        theta, follow = (
            np.full((len(every), tree.joints), np.nan),
            np.zeros((len(every), tree.p, n)),
        )
        for ring in range(rings.max() + 1):
            own = np.flatnonzero(rings == ring)
            if ring == 0:
                begin = np.tile(tree.closed_at, (len(own), 1))
            else:  # one cell nearer to home, on the straight way
                before = np.rint(home + (every[own] - home) * (1.0 - 1.0 / ring)).astype(int)
                begin = theta[np.ravel_multi_index(tuple(before.T), shape)]
            own, begin = own[(ok := np.isfinite(begin).all(axis=-1))], begin[ok]
            closed = advanced(equations, tree, begin, centres[own], own, 4, sign)
            theta[own[closed.ok]] = closed.theta[closed.ok]
            follow[own] = closed.follow
        reached = np.flatnonzero(np.isfinite(theta).all(axis=-1))
        if not len(reached):
            reached = np.array([np.ravel_multi_index(tuple(home), shape)])
            theta[reached] = tree.closed_at
            closed = newton(equations, tree, theta[reached], reached, np.full(1, _JUMP))
            follow[reached] = closed.follow
        number = np.empty(len(every), dtype=int)
        for first in range(0, len(every), 256):
            part = every[first : first + 256, None] - every[reached]
            number[first : first + 256] = (part**2).sum(axis=-1).argmin(axis=-1)
        theta, follow = readonly(theta[reached]), readonly(follow[reached])
        curve = readonly(_curve(equations, tree, theta, follow))
        return cls(tree, theta, follow, curve, sign, number.reshape(shape))

    def nearest(self, q: Array) -> tuple[Array, Array]:
        """Closed configurations near actuated joints q (N, n), and predictions at q: (N, J)."""
        n = self.tree.n
        cell = _cell(self.tree, np.where(np.isfinite(q), q, 0.0), self.cells.shape)
        number = self.cells[tuple(cell.T)]
        begin: Array = self.theta[number]
        near = begin.copy()
        moved = (q - begin[:, :n])[..., None]
        near[:, :n] = q
        pairs = (moved * np.swapaxes(moved, 1, 2)).reshape(len(q), n * n, 1)
        change = self.follow[number] @ moved + self.curve[number] @ pairs
        near[:, self.tree.passive] += change[..., 0]
        return begin, near

    def reach(self, begin: Array, near: Array) -> Array:
        """Largest distance of closed configurations from predictions (N, J): (N,), see `newton`."""
        moved = near - begin
        return _reach(self.tree, moved[:, : self.tree.n], moved[:, self.tree.passive])


def _curve(equations: Equations, tree: Tree, theta: Array, follow: Array) -> Array:
    """Half of the second derivative of the passive joints, by differences: (k, p, n n)."""
    n, p = tree.n, tree.p
    curve = np.zeros((len(theta), p, n, n))
    for j in range(n):
        step = _DIFFERENCE * tree.joint_scale[j]
        near = theta.copy()
        near[:, j] += step
        near[:, tree.passive] += step * follow[:, :, j]
        closed = newton(equations, tree, near, np.arange(len(near)), np.full(len(near), _JUMP))
        slope = (closed.follow - follow) / step
        curve[closed.ok, :, :, j] = slope[closed.ok] / 2
    return curve.reshape(len(theta), p, n * n)


def _cell(tree: Tree, q: Array, shape: tuple[int, ...]) -> np.ndarray:
    """The cell of the grid (N, n) that positions q (N, n) are in, or nearest to."""
    low, high = tree.lower[: tree.n], tree.upper[: tree.n]
    cell = np.floor((q - low) / (high - low) * np.array(shape)).astype(int)
    inside: np.ndarray = np.clip(cell, 0, np.array(shape) - 1)
    return inside
