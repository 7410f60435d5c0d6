"""Rows that do not fit: weights of robust loss functions, flags, regions of flagged rows."""

from typing import Literal

import numpy as np

from calibtool.identification.identification import Flagged
from calibtool.identification.parameters import State
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import residuals, weights
from calibtool.robot.se3 import Array

LossFunction = Literal["isolated", "squared", "huber", "cauchy"]
LOSS_FUNCTIONS = ("isolated", "squared", "huber", "cauchy")

_HUBER, _CAUCHY = 1.5, 2.5  # in typical residuals of a row
_FALSE_ALARM = 0.01  # chance that any row of a clean set is flagged
_CLUSTER_SIGNIFICANCE = 0.001  # a region gives its rows their weight back: seldom by chance


def row_weights(
    squares: Array, d: np.ndarray, loss_function: LossFunction, noise_factor: float = 1.0
) -> Array:
    """Weight of each row's squared residuals (N,), 1 for rows that fit; squares (N,) of d (N,)
    coordinates, noise_factor: noise of the fit over the stated one.

    `isolated` leaves all rows alone but those that would be flagged: clean data lose nothing, and
    the farther a row is off the less it counts, until it does not count at all.
    """
    if loss_function == "squared":
        return np.ones(len(squares))
    if loss_function == "isolated":
        limit = _limit(squares, d, noise_factor)
        return np.minimum(1.0, (limit / np.maximum(squares, 1e-30)) ** 2)
    relative: Array = np.sqrt(squares / d) / _robust_scale(squares, d)
    if loss_function == "huber":
        return np.minimum(1.0, _HUBER / np.maximum(relative, 1e-12))
    return 1.0 / (1.0 + (relative / _CAUCHY) ** 2)


def find_flagged(
    measurements: Measurements, state: State, squares: Array, noise_factor: float
) -> Flagged:
    """Rows whose residual no noise explains, at a false alarm rate of 1 % for the whole set;
    nothing is changed. noise_factor: noise of the fit over the stated one."""
    d = (weights(measurements) > 0).sum(axis=-1)
    scale = max(_robust_scale(squares, d), noise_factor)
    rows = np.flatnonzero(squares > _limit(squares, d, noise_factor))
    residual = residuals(
        measurements, state.setup, state.frames(measurements.q, measurements.conditions).tool
    )
    setup = measurements.setup
    lengths = setup.kind.lengths(setup)
    seen = weights(measurements)[:, lengths] > 0
    squared = (residual[:, lengths] ** 2).sum(axis=-1)
    axes = 3 if setup.kind.of_points else 1
    return Flagged(
        rows=rows,
        deviation=np.sqrt(squares[rows] / d[rows]) / scale,
        position=np.sqrt(squared[rows] * axes / seen[rows].sum(axis=-1)),
        cluster=_cluster(measurements, rows),
    )


def _limit(squares: Array, d: np.ndarray, noise_factor: float) -> Array:
    """Squares (N,) above which a row is flagged: chance has one in a hundred clean sets exceed
    them.

    The median row is blind to bad ones, and the noise of the fit to residuals that are small only
    because as much was fitted as was measured: the larger counts.
    """
    # scipy.stats takes as long to import as everything else together
    from scipy.special import chdtri

    scale = max(_robust_scale(squares, d), noise_factor)
    limit: Array = chdtri(d, _FALSE_ALARM / len(squares)) * scale**2
    return limit


def _robust_scale(squares: Array, d: np.ndarray) -> float:
    """Noise over the stated one, from the median row: half of the rows may be bad."""
    from scipy.special import chdtri

    return float(np.sqrt(max(np.median(squares / chdtri(d, 0.5)), 1e-30)))


def at_least(take: int, count: int, inside: int, flagged: int) -> float:
    """Chance that `take` or more of `flagged` rows, drawn from `count`, are among `inside` special
    ones (hypergeometric).
    """
    k = np.arange(max(take, flagged - (count - inside)), min(inside, flagged) + 1)
    log = (
        _log_choose(inside, k)
        + _log_choose(count - inside, flagged - k)
        - _log_choose(count, flagged)
    )
    return float(np.exp(log).sum())


def _log_choose(n: int, k: np.ndarray | int) -> Array:
    from scipy.special import betaln

    result: Array = -np.log(n + 1.0) - betaln(n - k + 1.0, k + 1.0)
    return result


def _cluster(measurements: Measurements, rows: np.ndarray) -> str | None:
    """The joint and its interval in which flagged rows concentrate (hypergeometric test)."""
    count, flagged = len(measurements), len(rows)
    if flagged < 3:
        return None
    best: tuple[float, int, float, float, int, int] | None = None
    for j in range(measurements.robot.n):
        values = measurements.q[:, j]
        own = np.sort(values[rows])
        # most of the flagged rows; stragglers may lie elsewhere
        take = max(3, int(np.ceil(0.7 * flagged)))
        for start in range(flagged - take + 1):
            low, high = own[start], own[start + take - 1]
            inside = int(((values >= low) & (values <= high)).sum())
            chance = at_least(take, count, inside, flagged)
            if best is None or chance < best[0]:
                best = (chance, j, low, high, take, inside)
    assert best is not None
    chance, j, low, high, take, inside = best
    tests = measurements.robot.n * flagged
    if chance * tests > _CLUSTER_SIGNIFICANCE:
        return None
    factor, unit = measurements.robot.display_unit(j)
    return (
        f"{take} of {flagged} flagged rows have joint {j + 1} between {low * factor:.4g} and "
        f"{high * factor:.4g} {unit}, where {inside} of all {count} rows are: look at joint "
        f"{j + 1} there before calling them outliers"
    )
