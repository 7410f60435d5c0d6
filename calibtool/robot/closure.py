"""Equations of closed loops and their derivatives, for many rows at once (docs/closed-loops.md).

For loop ℓ with frames A and B, E = T_A⁻¹ T_B: the residual r is the translation of E and what of
its rotation the cut joint forbids; its derivative is C_ℓ = W_ℓ (σ_ℓ ∘ J), J the spatial columns of
the joints and W_ℓ the forbidden components of a twist in the axes of A at the origin of B. Where
all three components of the translation are forbidden, the axes of K_0 do as well.
"""

from dataclasses import dataclass

import numpy as np

from calibtool.robot.loops import Loop, Tree
from calibtool.robot.se3 import Array, log3

_TRANSLATION, _ROTATION = {0, 1, 2}, {3, 4, 5}


@dataclass(frozen=True, eq=False)
class Closure:
    """Equations of N rows: m of the loops, then one for every follower; all in m and rad.

    residual  r (N, m + f)
    twists    W (N, m, 6): what an equation sees of a twist of B against A
    columns   C (N, m + f, J) = ∂r/∂θ
    """

    residual: Array
    twists: Array
    columns: Array


def closure(tree: Tree, cuts: Array, jacobian: Array, theta: Array) -> Closure:
    """Equations of N rows.

    cuts (N, 2L, 4, 3): axes x, y, z and origin of the cut frames in K_0; jacobian (N, J, 6):
    spatial columns of the joints as rows; theta (N, J) in rad or m.
    """
    count = len(theta)
    m, f = len(tree.row_signs), len(tree.followers)
    r, W = np.empty((count, m + f)), np.zeros((count, m, 6))
    C = np.zeros((count, m + f, tree.joints))
    for loop, rows, A, B in zip(
        tree.loops,
        tree.row_blocks,
        np.moveaxis(cuts[:, ::2], 1, 0),
        np.moveaxis(cuts[:, 1::2], 1, 0),
        strict=True,
    ):
        _equations(loop, A, B, r[:, rows], W[:, rows])
    if m:
        np.matmul(W, np.swapaxes(jacobian, 1, 2), out=C[:, :m])
        C[:, :m] *= tree.row_signs
    for k, follower in enumerate(tree.followers, start=m):
        C[:, k, follower.joint], C[:, k, follower.leader] = 1.0, -follower.factor
        led = follower.factor * theta[:, follower.leader] + follower.offset
        r[:, k] = theta[:, follower.joint] - led
    return Closure(r, W, C)


def _equations(loop: Loop, A: Array, B: Array, r: Array, W: Array) -> None:
    """Residual (N, k) and twists (N, k, 6) of a loop, written into r, W; A, B as in `closure`."""
    apart, p = B[:, 3] - A[:, 3], B[:, 3]
    kept = set(loop.rows)
    whole = kept >= _TRANSLATION
    turn = None
    if kept >= _ROTATION:  # log3(R_Aᵀ R_B), in the axes of A
        turn = log3(A[:, :3] @ np.swapaxes(B[:, :3], 1, 2))
    for k, row in enumerate(loop.rows):
        if row < 3 and whole:
            i, j = (row + 1) % 3, (row + 2) % 3
            r[:, k], W[:, k, row] = apart[:, row], 1.0
            W[:, k, 3 + i], W[:, k, 3 + j] = p[:, j], -p[:, i]  # p × e
        elif row < 3:
            axis = A[:, row]
            r[:, k], W[:, k, :3] = _dot(apart, axis), axis
            W[:, k, 3:] = np.cross(p, axis)
        elif turn is not None:
            r[:, k], W[:, k, 3:] = turn[:, row - 3], A[:, row - 3]
        elif row == 5:
            r[:, k] = np.arctan2(
                _dot(A[:, 1], B[:, 0]) - _dot(A[:, 0], B[:, 1]),
                _dot(A[:, 0], B[:, 0]) + _dot(A[:, 1], B[:, 1]),
            )
            W[:, k, 3:] = A[:, 2]
        else:  # of the axes z alone: rx is −y_A · z_B, ry is x_A · z_B
            axis = -A[:, 1] if row == 3 else A[:, 0]
            r[:, k] = _dot(axis, B[:, 2])
            W[:, k, 3:] = np.cross(B[:, 2], axis)


def _dot(a: Array, b: Array) -> Array:
    product: Array = (a * b).sum(axis=-1)
    return product
