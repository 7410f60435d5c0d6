"""The complete model: δζ, δξ, δq and joint-motion functions by maximum a posteriori Gauss–Newton.

Tolerances are the prior, so that no parameter has to be eliminated: those that the data do not
determine stay at their prior, and their posterior deviation shows it. Noise level,
number of harmonics and, on request, the tolerances are estimated from the evidence.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import get_args

import numpy as np

from calibtool.errormodel.families import BY_ID, FAMILIES
from calibtool.errormodel.family import Rows
from calibtool.errormodel.tolerances import Tolerances
from calibtool.errors import InputError, check_choice, check_number
from calibtool.identification.comparison import best_model
from calibtool.identification.equations import normal_equations
from calibtool.identification.evidence import inverse, widened
from calibtool.identification.fitting import CONVERGED, Fit, fit
from calibtool.identification.held_out_regions import held_out_factors
from calibtool.identification.identification import Flagged, Identification, Posterior, split_rms
from calibtool.identification.left_out import left_out_variance
from calibtool.identification.model_choice import chosen_fit, offered
from calibtool.identification.parameters import Parameters, State
from calibtool.identification.robust import LossFunction, find_flagged
from calibtool.identification.sufficiency import check_rows
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import residuals, weighted_residuals, weights
from calibtool.robot.inverse_starts import drawn
from calibtool.robot.se3 import Array, readonly

# of the largest singular value of normal equations; exact redundancies lie near 1e-8
_RANK_TOLERANCE = 1e-6
_VIEWS = 200  # times as many configurations as are needed, where a camera sees few of them


@dataclass(frozen=True)
class CompleteOptions:
    """Options of the identification of the complete model.

    tolerances       prior standard deviations, those of the robot's description unless given
    orders           of families that are not to be chosen, by id: {"harmonics": 2, "gravity": 0};
                     see `chosen_fit`
    estimate_priors  re-estimate the scale of every family of tolerances from the evidence; joint
                     motions only downwards, because many harmonics can cancel where a joint was
                     measured and grow large where it was not
    loss_function    `isolated`: rows that no noise explains weigh less, unless they are one region
                     of a joint, which may really behave differently; `squared`: all weigh the
                     same; `huber`, `cauchy`: the worse the less
    drop_flagged     leave flagged rows out of a second fit
    compared         whether a simpler model may be the result, see `best_model`;
                     never where tolerances or orders are given
    """

    tolerances: Tolerances | None = None
    orders: Mapping[str, int] = field(default_factory=dict)
    estimate_priors: bool = True
    loss_function: LossFunction = "isolated"
    drop_flagged: bool = False
    compared: bool = True

    def __post_init__(self) -> None:
        check_choice(self.loss_function, get_args(LossFunction), "loss function")
        for family, order in self.orders.items():
            check_choice(family, tuple(BY_ID), "family of errors")
            check_number(order, family, 0)


def identify_complete(
    measurements: Measurements, options: CompleteOptions | None = None
) -> Identification:
    """Identify every error that has a tolerance, from any number of configurations.

    What a joint is given beyond its geometry is chosen by evidence and by held-out rows, see
    `chosen_fit`. Where nothing of it was asked for, a simpler model is the result if it predicts
    held-out rows better, see `best_model`. Raises NoSolutionError when the
    iteration does not settle, InputError when a family is asked for and the measurements do not
    know what it depends on.
    """
    check_rows(measurements)
    options = CompleteOptions() if options is None else options
    identification, fitted = _identify(measurements, options, options.orders)
    flagged = identification.flagged
    if options.drop_flagged and flagged is not None and len(flagged.rows):
        kept = np.setdiff1d(np.arange(len(measurements)), flagged.rows)
        again = identify_complete(measurements.rows(kept), replace(options, drop_flagged=False))
        return replace(again, flagged=replace(flagged, dropped=True))
    if options.orders or options.tolerances is not None or not options.compared:
        return identification
    geometry = {family.id: 0 for family in FAMILIES if not family.always}
    return best_model(
        measurements,
        identification,
        fitted,
        lambda rows: _identify(rows, options, {})[0],
        lambda rows: _identify(rows, options, geometry)[0],
    )


def _identify(
    measurements: Measurements, options: CompleteOptions, orders: Mapping[str, int]
) -> tuple[Identification, Fit]:
    """The complete model with these orders of families, and its fit; all that `options` offers
    counts for ± of the parameters."""
    for family, order in options.orders.items():
        if order and not BY_ID[family].known(_rows(measurements)):
            raise InputError(
                f"complete: {family} cannot be identified, because the measurements do not say "
                f"what it depends on ({BY_ID[family].needs}); import or simulate them again, "
                "or leave it out"
            )
    fitted = chosen_fit(measurements, orders, partial(_fit, measurements, options))
    flagged = _flagged(measurements, fitted)
    if flagged.cluster is not None and options.loss_function == "isolated":
        squared = replace(options, loss_function="squared")
        fitted = _fit(measurements, squared, fitted.parameters, fitted.state, fitted, CONVERGED)
        flagged = _flagged(measurements, fitted)
    return _identification(measurements, options, fitted, flagged), fitted


def _fit(
    measurements: Measurements,
    options: CompleteOptions,
    parameters: Parameters,
    state: State,
    start: Fit | None,
    converged: float,
    prior_std: Array | None = None,
) -> Fit:
    return fit(
        measurements,
        parameters,
        options.tolerances,
        state,
        estimate_priors=options.estimate_priors,
        loss_function=options.loss_function,
        start=start,
        prior_std=prior_std,
        converged=converged,
    )


def _flagged(measurements: Measurements, fitted: Fit) -> Flagged:
    return find_flagged(measurements, fitted.state, fitted.row_squares, fitted.noise_factor)


def _rows(measurements: Measurements) -> Rows:
    return Rows(measurements.robot, measurements.q, measurements.conditions)


def _identification(
    measurements: Measurements, options: CompleteOptions, fitted: Fit, flagged: Flagged
) -> Identification:
    parameters = fitted.parameters
    covariance, prior_std = fitted.covariance, fitted.prior_std
    if options.estimate_priors:
        stated = parameters.prior_std(options.tolerances)
        prior_std = widened(parameters, fitted.theta, covariance, prior_std, stated)
        covariance = inverse(fitted.information / fitted.noise_factor**2 + np.diag(prior_std**-2.0))
    left_out = left_out_variance(
        measurements,
        offered(measurements, options.orders),
        options.tolerances,
        fitted,
        prior_std,
        covariance,
    )
    prior_scaled = (
        fitted.prior_std[:, None] * fitted.information * fitted.prior_std / fitted.noise_factor**2
    )
    eigenvalues = np.clip(np.linalg.eigvalsh(prior_scaled), 0.0, None)[::-1]
    d = (weights(measurements) > 0).sum(axis=-1)
    count = float(fitted.row_weight @ d)
    squares = float(fitted.row_weight @ fitted.row_squares) / fitted.noise_factor**2 + float(
        ((fitted.theta / fitted.prior_std) ** 2).sum()
    )
    log_evidence = -0.5 * (squares + float(np.log1p(eigenvalues).sum())) - count * np.log(
        fitted.noise_factor
    )
    tool = fitted.state.frames(measurements.q, measurements.conditions).tool
    residual = residuals(measurements, fitted.state.setup, tool)
    at_prior = np.sqrt(np.diag(covariance)) > 0.99 * prior_std
    names = np.array(parameters.names)
    return Identification(
        model="complete",
        errors=fitted.state.errors,
        setup=fitted.state.setup,
        singular_values=readonly(np.sqrt(eigenvalues)),
        rank=int((eigenvalues > 1.0).sum()),
        observable_rank=_observable_rank(measurements, fitted),
        unobservable=tuple(str(name) for name in names[at_prior]),
        residual_rms=split_rms(residual, measurements),
        iterations=fitted.iterations,
        posterior=Posterior(
            parameters=parameters,
            prior_std=readonly(prior_std),
            covariance=readonly(covariance),
            noise_factor=fitted.noise_factor,
            effective=fitted.effective,
            log_evidence=float(log_evidence),
            residual_factors=readonly(
                held_out_factors(measurements, fitted, _residual_factors(measurements, fitted))
            ),
            left_out=readonly(left_out),
        ),
        flagged=flagged,
    )


def _residual_factors(measurements: Measurements, fitted: Fit) -> Array:
    """Standard deviation of the residuals over the stated noise (2,), lengths and angles.

    It is corrected for the number of fitted parameters; rows that do not fit count with their
    weight.
    """
    tool = fitted.state.frames(measurements.q, measurements.conditions).tool
    squares = weighted_residuals(measurements, fitted.state.setup, tool) ** 2
    weight = fitted.row_weight[:, None] * (weights(measurements) > 0)
    freedom = max(1.0 - fitted.effective / float(weight.sum()), 1.0 / float(weight.sum()))
    lengths = measurements.setup.kind.lengths(measurements.setup)
    found = np.ones(2)
    for k, which in enumerate((lengths, ~lengths)):
        if weight[:, which].sum() > 0:
            mean = (weight * squares)[:, which].sum() / weight[:, which].sum()
            found[k] = np.sqrt(mean / freedom)
    return found


def _observable_rank(measurements: Measurements, fitted: Fit) -> int:
    """Directions of the parameters that measurements of this kind could determine: seen anywhere,
    moving to either side."""
    robot, parameters = measurements.robot, fitted.parameters
    count, rng = max(30, parameters.count // 3), np.random.default_rng(0)
    views = 1.0 if measurements.setup.kind.sees_all else _VIEWS
    q = robot.closing(drawn(robot, int(views * count), rng))
    q = q[fitted.state.errors.mechanism.closes(q)]
    anywhere = measurements.anywhere(q, rng)
    setup, frames = fitted.state.setup, fitted.state.frames(q, anywhere.conditions)
    seen = setup.kind.sees(setup, frames.tool, anywhere.place)
    anywhere = anywhere.rows(np.flatnonzero(seen)[:count]) if seen.sum() >= count else measurements
    row_weight = np.ones(len(anywhere))
    information = normal_equations(anywhere, parameters, fitted.state, row_weight).information
    eigenvalues = np.linalg.eigvalsh(fitted.prior_std[:, None] * information * fitted.prior_std)
    return int((eigenvalues > _RANK_TOLERANCE**2 * eigenvalues[-1]).sum())
