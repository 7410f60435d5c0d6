"""The closed configuration that a description chooses, and others near it."""

import numpy as np

from calibtool.errors import InputError
from calibtool.robot.closed import ClosedMechanism
from calibtool.robot.closure import Closure
from calibtool.robot.loops import Tree
from calibtool.robot.reduction import RANK, Sample, check_freedom
from calibtool.robot.se3 import Array

_SAMPLES = 6
_APART = 0.05  # rad, or lengths: how far samples are from the closed configuration
# A closed_at that is farther from a closed configuration (rad, or lengths) is a mistake.
_OPEN = 0.05
_STEPS = 60
# Largest |r| (rad, or lengths) of a closed configuration: equations that say the same twice
# contradict each other by the rounding of a CAD program's numbers.
_CLOSED = 1e-5
_AT_LIMIT = 1e-6  # rad or m: rounding of a written position
_STARTS = 100  # number of starts of the search for a closed configuration
_HELD = 0.02  # smallest singular value of C_p, of the largest, at a configuration that is chosen


def closed_configuration(
    mechanism: ClosedMechanism, tree: Tree, names: tuple[str, ...], place: str
) -> Array:
    """The closed configuration (J,) next to the given one, with the actuated joints as given.

    Raises InputError where there is none next to it.
    """
    start = tree.closed_at.copy()
    for follower in tree.followers:
        start[follower.joint] = follower.factor * start[follower.leader] + follower.offset
    free = np.arange(tree.joints) >= tree.n
    theta, residual = _nearest_closed(mechanism, tree, start, free)
    scale = tree.joint_scale
    if not residual < _CLOSED:
        anywhere, lowest = _nearest_closed(mechanism, tree, start, np.ones(tree.joints, dtype=bool))
        if lowest < _CLOSED:
            check_freedom(tree, closed_samples(mechanism, tree, anywhere), names, place)
        raise InputError(
            f"{place}: {_worst_loop(mechanism, tree, start)} at kinematics.closed_at, and does not "
            "come together while the actuators stay there; correct link lengths and frames, or "
            "give positions at which the mechanism is closed"
        )
    moved = np.abs((theta - start) / scale)
    if moved.max(initial=0.0) > _OPEN:
        values = ", ".join(
            f"{names[j]} = {theta[j]:.6g}" for j in np.flatnonzero(free & (moved > 1e-6))[:8]
        )
        raise InputError(
            f"{place}: {_worst_loop(mechanism, tree, start)} at kinematics.closed_at, which "
            "chooses the assembly mode; a "
            f"closed configuration from there is {values}: write it there if that is the one"
        )
    outside = np.flatnonzero(outside_limits(tree, theta))
    if len(outside):
        j = int(outside[0])
        raise InputError(
            f"{place}: kinematics.closed_at: the passive joint '{names[j]}' is at {theta[j]:g} "
            f"{'m' if tree.slides[j] else 'rad'}, outside of its limits {tree.lower[j]:g} to "
            f"{tree.upper[j]:g}; correct the limits, or give another closed configuration"
        )
    return theta


def outside_limits(tree: Tree, theta: Array) -> np.ndarray:
    """Which joints are beyond their limits at θ (J,): (J,) bool."""
    return (theta < tree.lower - _AT_LIMIT) | (theta > tree.upper + _AT_LIMIT)


def first_closed(mechanism: ClosedMechanism, tree: Tree) -> Array | None:
    """A closed configuration (J,) where the description states none; None where none is found.

    First the one next to `closed_at` with the actuated joints fixed; then, with all joints free,
    from there and from random starts at increasing distance, inside the limits of the joints. A
    configuration at which the actuated joints determine the passive ones is preferred.
    """
    rng, n, found = np.random.default_rng(0), tree.n, None
    low, high = (
        np.nan_to_num(end, nan=0.0, posinf=np.pi, neginf=-np.pi) for end in (tree.lower, tree.upper)
    )
    for k in range(_STARTS):
        spread = max(0, k - 1) / _STARTS  # ever farther away
        start = tree.closed_at + spread * (rng.uniform(low, high) - tree.closed_at)
        free = np.arange(tree.joints) >= (0 if k else n)
        theta, residual = _nearest_closed(mechanism, tree, start, free)
        turned = (theta + np.pi) % (2 * np.pi) - np.pi
        theta = np.where(tree.slides | (np.abs(theta) <= np.pi), theta, turned)
        if residual < _CLOSED and not outside_limits(tree, theta).any():
            C = _equations(mechanism, theta).columns[0] * tree.row_scale[:, None]
            sizes, held = (
                np.linalg.svd(part, compute_uv=False)
                for part in (C * tree.joint_scale, (C * tree.joint_scale)[:, n:])
            )
            rank = int((sizes > RANK * sizes.max(initial=1e-300)).sum())
            found = theta if found is None else found
            if len(held) >= rank and held[rank - 1] > _HELD * held[0]:
                return theta
    return found


def _nearest_closed(
    mechanism: ClosedMechanism, tree: Tree, theta: Array, free: np.ndarray
) -> tuple[Array, float]:
    """Least-squares steps of the free joints (J,) to r = 0 from θ (J,), and the largest |r|."""
    theta = theta.copy()
    scale = np.where(free, tree.joint_scale, 0.0)
    residual = np.inf
    for _ in range(_STEPS):
        at = _equations(mechanism, theta)
        r = at.residual[0] * tree.row_scale
        residual = float(np.abs(r).max(initial=0.0))
        if residual < 1e-14:
            break
        step = -np.linalg.lstsq(at.columns[0] * tree.row_scale[:, None] * scale, r, rcond=1e-9)[0]
        size = float(np.abs(step).max(initial=0.0))
        theta += step * scale * min(1.0, 0.2 / max(size, 1e-300))
        if size < 1e-13:
            break
    return theta, residual


def _equations(mechanism: ClosedMechanism, theta: Array) -> Closure:
    """Equations of one row, θ (J,)."""
    row = np.zeros(1, dtype=int)
    return mechanism.equations(theta[None], row)(row, theta[None, mechanism.tree.passive])[2]


def _worst_loop(mechanism: ClosedMechanism, tree: Tree, theta: Array) -> str:
    """The loop with the largest opening at θ (J,), and the opening, in words."""
    at = _equations(mechanism, theta)
    r = at.residual[0]
    sizes = [float(np.abs((r * tree.row_scale)[rows]).max()) for rows in tree.row_blocks]
    if not sizes:
        return "a mimic joint is not where it should be"
    k = int(np.argmax(sizes))
    rows, kept = r[tree.row_blocks[k]], np.array(tree.loops[k].rows)
    apart = np.linalg.norm(rows[kept < 3]) * 1e3
    turned = np.rad2deg(np.linalg.norm(rows[kept >= 3]))
    text = f"loop '{tree.loops[k].name}' does not close: its frames are {apart:.3g} mm apart"
    return text + (f" and {turned:.3g} deg turned" if turned > 1e-3 else "")


def closed_samples(mechanism: ClosedMechanism, tree: Tree, theta: Array) -> list[Sample]:
    """Derivatives at closed configurations near θ (J,), reached along the null space of C."""
    rng, row = np.random.default_rng(0), np.zeros(1, dtype=int)
    everything, scale = np.ones(tree.joints, dtype=bool), tree.joint_scale
    samples = []
    for k in range(_SAMPLES):
        at = theta
        if k:
            C = _equations(mechanism, theta).columns[0] * tree.row_scale[:, None] * scale
            sizes, vt = np.linalg.svd(C)[1:]
            rank = int((sizes > RANK * sizes.max(initial=1e-300)).sum())
            null = vt[rank:]
            move = rng.uniform(-1.0, 1.0, len(null)) @ null
            move *= _APART / max(float(np.abs(move).max(initial=0.0)), 1e-300)
            at, residual = _nearest_closed(mechanism, tree, theta + move * scale, everything)
            if not residual < _CLOSED:
                continue
        passive = at[None, tree.passive]
        ends, jacobian, equations = mechanism.equations(at[None], row)(row, passive)
        at_tool = (jacobian[0] * tree.tool_support[:, None] * scale[:, None]).T
        at_tool[:3] -= np.cross(ends[0, -1, 3], at_tool[3:].T).T
        at_tool[:3] /= tree.length
        columns = equations.columns[0].copy()
        for loop, rows, axes in zip(tree.loops, tree.row_blocks, ends[0, :-1:2, :3], strict=True):
            if loop.rows[:3] == (0, 1, 2):  # `closure` has them in K_0, rows that are kept are in A
                first = slice(rows.start, rows.start + 3)
                columns[first] = axes @ columns[first]
        samples.append(Sample(columns * tree.row_scale[:, None] * scale, at_tool))
    return samples
