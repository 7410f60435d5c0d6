"""Whether the complete model predicts held-out rows at least as well as registration alone and
local POE; the best of the three is the result.

Mostly the complete model is far ahead: its generalised cross-validation is less than the squared
residuals of the others on the very rows that they were fitted to, and nothing is fitted again.
Otherwise the models in doubt are fitted again in folds of the rows.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.identification.equations import row_squares
from calibtool.identification.fitting import Fit
from calibtool.identification.identification import Identification, nominal_model
from calibtool.identification.local_poe import identify_local_poe
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import weights
from calibtool.measurement.registration import refine
from calibtool.robot.se3 import Array

_CLEARLY = 0.8  # of the others' squares: less needs no second fit
_HARDLY = 3.0  # coordinates per parameter of local POE: with less one row can throw it far off
_FEW = 3.0  # coordinates per determined parameter: the formula is too hopeful
_MANY = 20.0  # per parameter: the formula is exact enough
_FOLDS = 5
_JUDGED = 300  # rows that show the residuals of the simple models
_FITS = 0.5  # weight of a row: what weighs less fits no model
_SURELY = 1.0  # standard errors by which a model must predict better
_WORSE = 1.04  # of the squares: less is no reason to give up the posterior
_BAD = 0.05  # part of the rows: more are not bad, but the complete model does not fit

Model = Callable[[Measurements], Identification]


def best_model(
    measurements: Measurements, complete: Identification, fitted: Fit, again: Model
) -> Identification:
    """The complete model, or local POE where it surely predicts held-out rows better, or
    registration alone where neither surely does; `Identification.held_out` holds the figures.

    fitted: the fit of the complete model; again: the same identification of some of the rows.
    Rows that weigh little in the fit are not judged.
    """
    fitting = np.flatnonzero(fitted.row_weight > _FITS)
    if len(fitting) < (1.0 - _BAD) * len(measurements):
        fitting = np.arange(len(measurements))
    rows = measurements.rows(fitting)
    coordinates = int(_coordinates(rows).sum())
    freedom = max(1.0 - fitted.effective / coordinates, 1.0 / coordinates)
    expected = float(fitted.row_squares[fitting].sum()) / coordinates / freedom**2
    rivals: dict[str, Model] = {"nominal": registered, "local-poe": identify_local_poe}
    if coordinates < _HARDLY * _local_poe_rank(rows):
        del rivals["local-poe"]
    if coordinates > _FEW * fitted.effective:
        few = rows.rows(np.unique(np.linspace(0, len(rows) - 1, _JUDGED).astype(int)))
        simple = {name: float(_squares_after(fit, few, few).mean()) for name, fit in rivals.items()}
        rivals = {name: rivals[name] for name in rivals if expected > _CLEARLY * simple[name]}
    if not rivals:
        return complete
    squares = {name: _held_out(fit, rows) for name, fit in rivals.items()}
    if coordinates > _MANY * fitted.parameters.count:
        squares["complete"] = np.full(len(rows), expected)
    else:
        squares["complete"] = _held_out(again, rows)
    if not np.isfinite(squares["complete"]).all():
        return complete  # too few rows to leave some out
    best = "complete"
    if "local-poe" in squares and _better(_WORSE * squares["local-poe"], squares[best]):
        best = "local-poe"
    if "nominal" in squares and not _better(squares[best], squares["nominal"]):
        best = "nominal"
    told = {name: values for name, values in squares.items() if np.isfinite(values).all()}
    held_out = {name: float(np.sqrt(values.mean())) for name, values in told.items()}
    shipped = complete if best == "complete" else rivals[best](rows)
    return replace(shipped, held_out=held_out, flagged=complete.flagged)


def registered(measurements: Measurements) -> Identification:
    """The nominal robot, the unknown parts of the set-up fitted to these rows.

    Raises NoSolutionError where the iteration does not converge.
    """
    nominal = nominal_model(measurements)
    if measurements.setup.known:
        return nominal
    poses = measurements.robot.mechanism.forward(measurements.q)
    setup, cost = refine(measurements, measurements.setup, poses)
    if not np.isfinite(cost):
        raise NoSolutionError("registration does not converge")
    return nominal_model(replace(measurements, setup=setup))


def _local_poe_rank(rows: Measurements) -> float:
    """Number of parameters that local POE determines from these rows; infinite where it fails."""
    try:
        return identify_local_poe(rows).rank
    except NoSolutionError:
        return float("inf")


def _squares_after(fit: Model, rows: Measurements, judged: Measurements) -> Array:
    """Mean square (M,) of the coordinates of every judged row over the stated noise, after a fit
    to the rows; infinite where they are too few for it."""
    try:
        state = fit(rows).state if len(rows) else None
    except NoSolutionError:
        state = None
    if state is None:
        return np.full(len(judged), np.inf)
    return np.asarray(row_squares(judged, state) / np.maximum(_coordinates(judged), 1))


def _held_out(fit: Model, rows: Measurements) -> Array:
    """The same of all rows (N,), every fold predicted by the others."""
    order = np.random.default_rng(0).permutation(len(rows))
    if rows.place is not None:  # every place in every fold
        order = order[np.argsort(rows.place[order], kind="stable")]
    squares = np.empty(len(rows))
    for part in (order[k::_FOLDS] for k in range(min(_FOLDS, len(rows)))):
        squares[part] = _squares_after(fit, rows.rows(np.setdiff1d(order, part)), rows.rows(part))
    return squares


def _better(squares: Array, than: Array) -> bool:
    """Whether squares (N,) of rows are surely less than others."""
    if not np.isfinite(squares).all():
        return False
    gain = np.minimum(than, 1e300) - squares
    return bool(gain.mean() > _SURELY * gain.std() / np.sqrt(len(gain)))


def _coordinates(measurements: Measurements) -> np.ndarray:
    """Coordinates that were seen in every row (N,)."""
    return np.asarray((weights(measurements) > 0).sum(axis=-1))
