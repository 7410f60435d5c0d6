"""The Gauss–Newton iteration that registration, local POE and the complete model share."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from calibtool.robot.se3 import Array

State = TypeVar("State")
System = TypeVar("System")


def gauss_newton(
    state: State,
    linearise: Callable[[State], System],
    solve: Callable[[System, float], tuple[Array, bool]],
    move: Callable[[State, Array], State],
    most: int,
    cost: Callable[[State], float] | None = None,
) -> tuple[State, int, bool]:
    """Iterate at most `most` steps; returns the state, the number of steps, and whether it
    converged.

    linearise: residuals and columns at a state. solve: the step (p,) of this system for a damping,
    which is 0 unless steps fail, and whether the step is small enough to end. move: the state after
    a step. With `cost`, a step that increases it is rejected, and the next one is damped more.
    """
    damping, now = 0.0, np.inf if cost is None else cost(state)
    for iteration in range(1, most + 1):
        step, settled = solve(linearise(state), damping)
        proposed = move(state, step)
        after = now if cost is None else cost(proposed)
        if after <= now * (1 + 1e-12) + 1e-12:
            state, now, damping = proposed, after, damping / 10 if damping > 1e-6 else 0.0
        else:
            damping = max(10 * damping, 1e-4)
        if settled:
            return state, iteration, True
    return state, most, False
