"""Whether the complete model predicts held-out rows at least as well as simpler ones: registration
alone, local POE, and geometry and joint offsets without anything beyond them.

Mostly the complete model is far ahead: its generalised cross-validation is less than the squared
residuals of the others on the very rows that they were fitted to, and nothing is fitted again.
Otherwise the models in doubt are fitted again in folds of the rows.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.identification.equations import row_squares
from calibtool.identification.fitting import Fit
from calibtool.identification.held_out import better
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
# Folds of the rows, and of so few rows that without a fifth they would determine clearly less
_FOLDS, _FOLDS_OF_FEW = 5, 10
_FEW_ROWS = 30
_ENOUGH = 10  # rows after which folds may end, where the complete model …
_FAR_AHEAD, _BEYOND_DOUBT = 0.5, 3.0  # … leaves so much of the squares, by so many standard errors
_JUDGED = 300  # rows that show the residuals of the simple models
_FITS = 0.5  # weight of a row: what weighs less fits no model
# Standard errors by which local POE must predict better than the complete model, and that better
# than geometry alone
_SURELY, _MORE = 1.0, 0.5
# Coordinates per parameter that geometry alone determines: with less, what goes beyond geometry
# cannot be told from noise
_HIDDEN = 2.0
_WORSE = 1.04  # of the squares: less is no reason to give up the posterior
_BAD = 0.05  # part of the rows: more are not bad, but the complete model does not fit
# Times the mean square of the other model: a row of a fold that is fitted badly counts for no more
_MOST = 2.0

Model = Callable[[Measurements], Identification]


def best_model(
    measurements: Measurements,
    complete: Identification,
    fitted: Fit,
    again: Model,
    geometry: Model,
) -> Identification:
    """The model that predicts held-out rows best; `Identification.held_out` holds the figures.

    The complete model gives way to registration alone where it does not predict better; where rows
    are so few that geometry takes up most of what they show, to geometry alone unless it clearly
    predicts better; to local POE, which has no posterior, only where that surely does.

    fitted: the fit of the complete model; again, geometry: the identification of some of the rows,
    as the complete one and without what goes beyond geometry and joint offsets. Rows that weigh
    little in the fit are not judged.
    """
    fitting = np.flatnonzero(fitted.row_weight > _FITS)
    if len(fitting) < (1.0 - _BAD) * len(measurements):
        fitting = np.arange(len(measurements))
    rows = measurements.rows(fitting)
    coordinates = int(_coordinates(rows).sum())
    freedom = max(1.0 - fitted.effective / coordinates, 1.0 / coordinates)
    expected = float(fitted.row_squares[fitting].sum()) / coordinates / freedom**2
    rivals: dict[str, Model] = {"nominal": registered, "local-poe": identify_local_poe}
    local_poe, alone = _settled(identify_local_poe, rows), None
    if local_poe is None or coordinates < _HARDLY * local_poe.rank:
        del rivals["local-poe"]
    if coordinates > _FEW * fitted.effective:
        few = rows.rows(np.unique(np.linspace(0, len(rows) - 1, _JUDGED).astype(int)))
        simple = {name: float(_squares_after(fit, few, few).mean()) for name, fit in rivals.items()}
        rivals = {name: rivals[name] for name in rivals if expected > _CLEARLY * simple[name]}
    else:
        alone = _settled(geometry, rows)
        if alone is not None and coordinates < _HIDDEN * _effective(alone):
            rivals["geometry"] = geometry
    if not rivals:
        return complete
    formula = expected if coordinates > _MANY * fitted.parameters.count else None
    squares = _held_out(rows, rivals, again, formula)
    finite = {name: values for name, values in squares.items() if np.isfinite(values).all()}
    best = "complete"
    if "geometry" in finite and not better(squares[best], squares["geometry"], _MORE, _MOST):
        best = "geometry"
    if best not in finite:
        return complete  # too few rows to leave some out
    if "local-poe" in squares and better(
        _WORSE * squares["local-poe"], squares[best], _SURELY, _MOST
    ):
        best = "local-poe"
    if "nominal" in squares and not better(squares[best], squares["nominal"], 0.0, _MOST):
        best = "nominal"
    held_out = {name: float(np.sqrt(values.mean())) for name, values in finite.items()}
    fits = {"complete": complete, "geometry": alone, "local-poe": local_poe}
    shipped = fits.get(best) or rivals[best](rows)
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


def _effective(identification: Identification) -> float:
    """Number of parameters that the rows determine."""
    posterior = identification.posterior
    return 0.0 if posterior is None else posterior.effective


def _settled(fit: Model, rows: Measurements) -> Identification | None:
    """A fit to the rows; None where they are too few for it."""
    try:
        return fit(rows) if len(rows) else None
    except NoSolutionError:
        return None


def _squares_after(fit: Model, rows: Measurements, judged: Measurements) -> Array:
    """Mean square (M,) of the coordinates of every judged row over the stated noise, after a fit
    to the rows; infinite where they are too few for it."""
    found = _settled(fit, rows)
    if found is None:
        return np.full(len(judged), np.inf)
    return np.asarray(row_squares(judged, found.state) / np.maximum(_coordinates(judged), 1))


def _held_out(
    rows: Measurements, rivals: dict[str, Model], complete: Model, formula: float | None
) -> dict[str, Array]:
    """Of every model, the mean square (M,) of the coordinates of rows over the stated noise, every
    fold predicted by the others. All rows are judged, or those of the first folds where these
    leave no doubt. formula: the mean square of the complete model, where it need not be fitted.
    """
    found: dict[str, list[Array]] = {name: [] for name in (*rivals, "complete")}
    for part, others in _folds(rows):
        for name, fit in rivals.items():
            found[name].append(_squares_after(fit, others, part))
        own = np.full(len(part), formula)
        if formula is None:
            own = _squares_after(complete, others, part)
        found["complete"].append(own)
        squares = {name: np.concatenate(values) for name, values in found.items()}
        if len(squares["complete"]) >= _ENOUGH and all(
            better(squares["complete"], _FAR_AHEAD * squares[name], _BEYOND_DOUBT, _MOST)
            for name in rivals
        ):
            break
    return squares


def _folds(rows: Measurements) -> Iterator[tuple[Measurements, Measurements]]:
    """Folds of the rows, and the other rows of each."""
    order = np.random.default_rng(0).permutation(len(rows))
    if rows.place is not None:  # every place in every fold
        order = order[np.argsort(rows.place[order], kind="stable")]
    folds = min(_FOLDS_OF_FEW if len(rows) <= _FEW_ROWS else _FOLDS, len(rows))
    for part in (order[k::folds] for k in range(folds)):
        yield rows.rows(part), rows.rows(np.setdiff1d(order, part))


def _coordinates(measurements: Measurements) -> np.ndarray:
    """Coordinates that were seen in every row (N,)."""
    return np.asarray((weights(measurements) > 0).sum(axis=-1))
