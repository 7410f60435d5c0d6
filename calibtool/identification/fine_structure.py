"""Fine structure of the joint motions: which joints, and up to which order, before anything of it
is fitted.

Of a fit without it, the evidence for more harmonics of one joint needs only their products with
the residuals and the columns. A hundred orders of every joint cost less than one step of a fit that
has them.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibtool.errormodel.families import BY_ID
from calibtool.errormodel.harmonics import FINE_ORDERS, LOW_ORDERS, harmonic_functions
from calibtool.errormodel.pairs import pair_functions
from calibtool.identification.equations import linearised_rows
from calibtool.identification.fitting import Fit
from calibtool.identification.parameters import Parameters
from calibtool.measurement.measurements import Measurements
from calibtool.robot.se3 import Array

_CHUNK = 1000  # configurations whose columns are in memory together
_CLEAR = 3.0  # nats by which finer harmonics must make the data more probable
WORTHWHILE = 0.95  # of the squared residuals of new rows: with fine structure they have to be less
_ROWS = 2.0  # waves per configuration, at most
_NOISES = np.geomspace(0.4, 1.1, 6)  # noise over that of the fit
_HANDFUL, _FEW = 20, 200  # configurations
_SIZES = np.geomspace(3e-6, 3e-4, 9)  # rad, of their coefficients


def finer(measurements: Measurements, fit: Fit, highest: int) -> tuple[np.ndarray, Array]:
    """Orders of harmonics per joint (n,) that the residuals of a fit support, and the size of the
    coefficients that are added (n,) in rad.

    At least those that the fit has, nothing new below 20 configurations, and at most two waves per
    configuration; three coordinates count as a configuration where a row has fewer, such as a
    distance.
    """
    has = harmonic_orders(fit.parameters)
    orders, sizes = has.copy(), np.zeros(len(has))
    turning = [j for j, slides in enumerate(measurements.robot.prismatic) if not slides]
    count = _configurations(measurements)
    steps = [h for h in FINE_ORDERS if h <= min(highest, _ROWS * count)]
    if not steps or not turning or count < _HANDFUL:
        return orders, sizes
    products = _Products.of(measurements, fit)
    few = count <= _FEW
    # A joint with clear fine structure has a size of its own; with few rows the other joints are
    # tried together.
    for joints in (*([j] for j in turning), turning if has.max() <= LOW_ORDERS and few else []):
        asking = [j for j in joints if orders[j] == has[j] and 2 * steps[-1] > 2 * has[j]]
        if not asking:
            continue
        functions = [_functions(measurements.q[:, j], has[j], steps[-1]) for j in asking]
        order = np.concatenate([values[0] for values in functions])
        information, gradient = products.given_the_fit(asking, [f for _, f in functions])
        best = max(
            (*_gain(information[np.ix_(k, k)], gradient[k], products.squares, products.freedom), h)
            for h, k in ((h, np.flatnonzero(order <= h)) for h in steps)
            if len(k)
        )
        if best[0] > (_CLEAR if len(joints) == 1 else -np.inf):
            orders[asking], sizes[asking] = best[2], best[1]
    return np.maximum(orders, has), sizes


def paired(measurements: Measurements, fit: Fit) -> Array:
    """Size of the functions of pairs of joints of every joint (n,) in rad; 0 where the residuals
    of a fit do not support them.

    None with fewer configurations than such functions, or where they hardly promise to predict new
    rows better.
    """
    robot, sizes = measurements.robot, np.zeros(measurements.robot.n)
    family = BY_ID["pairs"]
    free = family.free(robot, family.shape(robot.n))
    if _configurations(measurements) < max(free.sum(axis=1).max(initial=0), _HANDFUL):
        return sizes
    functions = pair_functions(measurements.q)
    products = _Products.of(measurements, fit)
    for j in map(int, np.flatnonzero(free.any(axis=1))):
        information, gradient = products.given_the_fit([j], [functions[:, free[j]]])
        gain, size = _gain(information, gradient, products.squares, products.freedom)
        sizes[j] = size if gain > _CLEAR else 0.0
    joints = [int(j) for j in np.flatnonzero(sizes)]
    if joints:
        products_of = products.given_the_fit(joints, [functions[:, free[j]] for j in joints])
        std = np.repeat(sizes[joints], free[joints].sum(axis=1))
        if _expected(*products_of, std, products.squares, products.freedom) > WORTHWHILE:
            return np.zeros(robot.n)
    return sizes


def _configurations(measurements: Measurements) -> int:
    """Number of configurations, of at least three coordinates each."""
    return min(len(measurements), int(measurements.equations) // 3)


@dataclass(frozen=True, eq=False)
class _Products:
    """Of a fit, over its noise: products of the columns o_j (N, d) of the joint offsets.

    with_fit (N, n, p) with the columns of the fit, with_offsets (N, n, n) with each other,
    with_residual (N, n) with the residuals, whose sum of squares is `squares` with so many degrees
    of `freedom`; covariance (p, p) of the fit
    """

    with_fit: Array
    with_offsets: Array
    with_residual: Array
    squares: float
    freedom: float
    covariance: Array

    @classmethod
    def of(cls, measurements: Measurements, fit: Fit) -> Self:
        with_fit, with_offsets, with_residual, squares = [], [], [], 0.0
        for start in range(0, len(measurements), _CHUNK):
            rows = np.arange(start, min(start + _CHUNK, len(measurements)))
            columns, residual = linearised_rows(measurements.rows(rows), fit.parameters, fit.state)
            scale = np.sqrt(fit.row_weight[rows])[:, None] / fit.noise_factor
            columns, residual = columns * scale[..., None], residual * scale
            offsets = np.swapaxes(columns[..., fit.parameters.blocks["offsets"]], 1, 2)
            with_fit.append(offsets @ columns)
            with_offsets.append(offsets @ np.swapaxes(offsets, 1, 2))
            with_residual.append((offsets @ residual[..., None])[..., 0])
            squares += float((residual**2).sum())
        count = len(measurements) * residual.shape[1]
        return cls(
            np.concatenate(with_fit),
            np.concatenate(with_offsets),
            np.concatenate(with_residual),
            squares,
            max(count - fit.effective, 1.0),
            fit.covariance,
        )

    def given_the_fit(self, joints: list[int], functions: list[Array]) -> tuple[Array, Array]:
        """Information (k, k) and gradient (k,) of functions (N, k_j) of some joints, when the
        parameters of the fit follow."""
        both = np.concatenate([f.T @ self.with_fit[:, j] for j, f in _pairs(joints, functions)])
        information = np.block(
            [
                [(f * self.with_offsets[:, j, k, None]).T @ g for k, g in _pairs(joints, functions)]
                for j, f in _pairs(joints, functions)
            ]
        )
        gradient = np.concatenate(
            [f.T @ self.with_residual[:, j] for j, f in _pairs(joints, functions)]
        )
        return information - both @ self.covariance @ both.T, gradient


def _pairs(joints: list[int], functions: list[Array]) -> list[tuple[int, Array]]:
    return list(zip(joints, functions, strict=True))


def _functions(q: Array, has: int, highest: int) -> tuple[np.ndarray, Array]:
    """Orders (k,) and values (N, k) of the harmonics that a joint does not have yet, q (N,)."""
    first = 2 * max(has, LOW_ORDERS)
    values = harmonic_functions(q, highest)[:, first:]
    return (first + np.arange(values.shape[1])) // 2 + 1, values


def harmonic_orders(parameters: Parameters) -> np.ndarray:
    """Highest order of harmonics of every joint (n,), 0 where it has none."""
    orders = np.zeros(parameters.robot.n, dtype=int)
    for part in parameters.parts:
        if part.family.id == "harmonics":
            for j, row in enumerate(part.free):
                orders[j] = (np.flatnonzero(row)[-1] // 2 + 1) if row.any() else 0
    return orders


def _expected(
    information: Array, gradient: Array, std: Array, squares: float, freedom: float
) -> float:
    """Squared residuals of new rows over those without parameters of these deviations (k,), by
    generalised cross-validation (Golub, Heath and Wahba 1979).
    """
    values, vectors = np.linalg.eigh(std[:, None] * information * std)
    values, along = np.maximum(values, 0.0), (vectors.T @ (std * gradient)) ** 2
    explained = float((along * (2.0 + values) / (1.0 + values) ** 2).sum())
    effective = float((values / (1.0 + values)).sum())
    return (1.0 - explained / squares) / (1.0 - effective / freedom) ** 2


def _gain(
    information: Array, gradient: Array, squares: float, freedom: float
) -> tuple[float, float]:
    """The most that parameters of one size add to the log evidence, nats, and that size in rad.

    Size and noise are both varied: the noise is less where the parameters explain a part of it.
    `squares` are the squared residuals over the noise so far, with that many degrees of `freedom`.
    """
    values, vectors = np.linalg.eigh(information)
    values, along = np.maximum(values, 0.0), (vectors.T @ gradient) ** 2
    noise, size = _NOISES[:, None, None] ** 2, _SIZES[:, None] ** 2
    spread = 1.0 + size * values / noise
    explained = (size * along / noise**2 / spread - np.log(spread)).sum(axis=-1)
    kept = squares / noise[..., 0] + freedom * np.log(noise[..., 0])
    gains = 0.5 * (explained - kept)
    before = -0.5 * (squares / noise[..., 0] + freedom * np.log(noise[..., 0])).min()
    best = np.unravel_index(gains.argmax(), gains.shape)
    return float(gains[best] - before), float(_SIZES[best[1]])
