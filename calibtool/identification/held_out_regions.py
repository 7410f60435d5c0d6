"""How far a fit is off where it has no rows: residuals of regions of the joints that are held out.

A row between others is predicted better than a region near which there is no row. An error that the
model does not describe changes slowly with the joints, so that only the second case shows it.
"""

import warnings

import numpy as np

from calibtool.identification.equations import linearised_rows, normal_equations
from calibtool.identification.fitting import Fit
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import weights
from calibtool.measurement.sampling import spread_rows
from calibtool.robot.se3 import Array

_REGIONS = 12
_HELD_OUT = 0.1  # of the rows are held out together at least: a region and its surroundings
_JUDGED = 25  # rows of a region, evenly spread
_SHARE, _DEVIATIONS = 0.95, 1.96  # so many normal residuals lie within so many deviations
_FITS = 0.5  # least weight of a row that is judged: the others do not fit, and are flagged


def held_out_factors(measurements: Measurements, fit: Fit, least: Array) -> Array:
    """Standard deviation of a coordinate over the stated noise (2,), lengths and angles, beside the
    uncertainty of the parameters; nowhere less than `least` (2,).

    With it 95 % of the residuals of held-out regions lie within 1.96 predicted deviations. Each
    region k is predicted by the quadratic model of the fit to the other rows: residuals
    r_k + A_k C g_k/σ² with the covariance A_k C A_kᵀ of the parameters. C is the posterior
    covariance without the rows that are held out, g_k the gradient of those rows.
    """
    beyond = []
    for region, held in _regions(measurements.q):
        judged = region[fit.row_weight[region] >= _FITS]
        judged = judged[spread_rows(len(judged), _JUDGED)]
        if len(judged):
            beyond.append(_beyond(measurements, fit, judged, held))
    lengths = measurements.setup.kind.lengths(measurements.setup)
    found = least.copy()
    for k, which in enumerate((lengths, ~lengths)):
        squares = np.concatenate([each[:, which].ravel() for each in beyond] or [np.zeros(0)])
        squares = squares[np.isfinite(squares)]
        if len(squares):
            found[k] = np.sqrt(max(np.quantile(squares, _SHARE), least[k] ** 2))
    return found


def _beyond(measurements: Measurements, fit: Fit, judged: np.ndarray, held: np.ndarray) -> Array:
    """What (M, d) a variance over the stated one must be for every coordinate of the rows `judged`
    to lie within 1.96 deviations, where rows `held` are held out; NaN where nothing was seen."""
    from scipy.linalg import LinAlgError, cholesky, solve_triangular

    rows, noise = measurements.rows(held), fit.noise_factor**2
    own = normal_equations(rows, fit.parameters, fit.state, fit.row_weight[held])
    # In units of the tolerances the prior is the identity.
    std = fit.prior_std
    precision = (fit.information - own.information) * (std * std[:, None] / noise)
    precision.flat[:: len(std) + 1] += 1.0
    part = measurements.rows(judged)
    columns, residual = linearised_rows(part, fit.parameters, fit.state)
    both = np.column_stack([columns.reshape(-1, len(std)).T, own.gradient / noise])
    try:
        root = cholesky(precision, lower=True, overwrite_a=True)
    except LinAlgError:  # singular to rounding
        return np.full_like(residual, np.nan)
    across = solve_triangular(root, std[:, None] * both, lower=True, overwrite_b=True)
    columns, gradient = across[:, :-1], across[:, -1]
    off = residual + (gradient @ columns).reshape(residual.shape)
    variance = (columns**2).sum(axis=0).reshape(residual.shape)
    beyond = (off / _DEVIATIONS) ** 2 - variance
    return np.where(weights(part) > 0, beyond, np.nan)


def _regions(q: Array) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows of every region of the joints, and the rows held out with it: the region and what is
    near it. q (N, n)."""
    from scipy.cluster.vq import kmeans2

    spread = q.std(axis=0)
    scaled = (q - q.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    with warnings.catch_warnings(), np.errstate(invalid="ignore"):
        warnings.simplefilter("ignore", UserWarning)  # a region without rows is no region
        _, label = kmeans2(scaled, min(_REGIONS, len(q)), minit="++", rng=0)
    result = []
    for number in np.unique(label):
        region = np.flatnonzero(label == number)
        distance = ((scaled - scaled[region].mean(axis=0)) ** 2).sum(axis=-1)
        near = np.argsort(distance, kind="stable")[: round(_HELD_OUT * len(q))]
        result.append((region, np.union1d(region, near)))
    return result
