"""The complete model: δζ, δξ, δq and joint-motion functions by maximum a posteriori Gauss–Newton.

Tolerances are the prior, so that nothing is eliminated and no rank is decided: parameters that the
data do not determine stay at their prior, and their posterior deviation shows it. Noise level,
number of harmonics and, on request, the tolerances are estimated from the evidence.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import get_args

import numpy as np

from calibtool.errormodel.families import BY_ID, FAMILIES
from calibtool.errormodel.family import Rows
from calibtool.errormodel.harmonics import LOW_ORDERS
from calibtool.errormodel.tolerances import Tolerances
from calibtool.errors import InputError, NoSolutionError, check_choice, check_number
from calibtool.identification.equations import (
    NormalEquations,
    held_out_squares,
    normal_equations,
    row_squares,
)
from calibtool.identification.evidence import Solution, inverse, most_probable, posterior_step
from calibtool.identification.identification import Flagged, Identification, Posterior, split_rms
from calibtool.identification.parameters import Parameters, State
from calibtool.identification.robust import LossFunction, find_flagged, row_weights
from calibtool.identification.sufficiency import check_rows
from calibtool.measurement.gauss_newton import gauss_newton
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import residuals, weights
from calibtool.measurement.sampling import spread_rows
from calibtool.robot.inverse_starts import drawn
from calibtool.robot.se3 import Array, readonly

MANY_HARMONICS = (*BY_ID["harmonics"].orders, 6, 9, 12, 16, 20, 24, 28, 32)
_UNEXPLAINED = 1.2  # times the stated noise: more than this left over, and more harmonics are tried
_PARSIMONY = 3.0  # nats by which a larger model with few harmonics must be more probable
_WORTHWHILE = 0.95  # of the held-out squares: a larger model has to leave less than that
_JUDGED = 500  # configurations on which many harmonics are judged
_MAX_ITERATIONS = 30
_PRIOR_STEPS = (
    3  # Gauss–Newton steps in which tolerances are re-estimated; one where a fit before has done so
)
_CONVERGED = 1e-3  # a step this small against the posterior's standard deviations changes nothing
_RANK_TOLERANCE = (
    1e-6  # of the largest singular value of normal equations; exact redundancies lie near 1e-8
)
_VIEWS = 200  # times as many configurations as are needed, where a camera sees few of them
_ROUGHLY = 0.1  # and this small a one not the choice of a model


@dataclass(frozen=True)
class CompleteOptions:
    """Options of the identification of the complete model.

    tolerances       prior standard deviations, by default those of the robot's description
    orders           of families that evidence is not to choose, by id: {"harmonics": 2, "gravity":
                     0}; the others are chosen from `Family.orders`, harmonics also from
                     MANY_HARMONICS if those are too few
    estimate_priors  re-estimate the scale of every family of tolerances from the evidence; those of
                     joint motions are only reduced, because many harmonics can cancel where a joint
                     was measured and grow large where it was not
    loss_function    `squared`, or reduce the weight of rows that do not fit: `huber`, `cauchy`
    drop_flagged     leave flagged rows out of a second fit
    """

    tolerances: Tolerances | None = None
    orders: Mapping[str, int] = field(default_factory=dict)
    estimate_priors: bool = True
    loss_function: LossFunction = "squared"
    drop_flagged: bool = False

    def __post_init__(self) -> None:
        check_choice(self.loss_function, get_args(LossFunction), "loss function")
        for family, order in self.orders.items():
            check_choice(family, tuple(BY_ID), "family of errors")
            check_number(order, family, 0)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A converged iteration.

    State, Fisher information H (p, p) for the stated noise, squared residuals of rows (N,).
    """

    parameters: Parameters
    state: State
    prior_std: Array
    information: Array
    row_squares: Array
    noise_factor: float
    effective: float
    iterations: int

    @cached_property
    def covariance(self) -> Array:
        return inverse(self.information / self.noise_factor**2 + np.diag(self.prior_std**-2.0))

    @property
    def theta(self) -> Array:
        return self.state.vector(self.parameters)


def identify_complete(
    measurements: Measurements, options: CompleteOptions | None = None
) -> Identification:
    """Identify every error that has a tolerance, from any number of configurations.

    Joint-motion functions are chosen by the Savage–Dickey density ratio: one fit with all of them
    gives the probability of each smaller model. Raises NoSolutionError when the iteration does not
    converge, InputError when backlash is requested and the directions of motion are not known.
    """
    check_rows(measurements)
    options = CompleteOptions() if options is None else options
    for family, order in options.orders.items():
        if order and not BY_ID[family].known(_rows(measurements)):
            raise InputError(
                f"complete: {family} cannot be identified, because the measurements do not say "
                f"what it depends on ({BY_ID[family].needs}); import or simulate them again, "
                "or leave it out"
            )
    robot, setup = measurements.robot, measurements.setup
    few = BY_ID["harmonics"].orders
    fit = _most_probable_fit(measurements, options, few, State.nominal(robot, setup), None)
    if "harmonics" not in options.orders and _may_leave_structure(fit, measurements.equations):
        many = _most_probable_fit(measurements, options, MANY_HARMONICS, fit.state, fit)
        if _predicts_better(measurements, many, fit):
            fit = many
    if "backlash" not in options.orders and "backlash" in fit.parameters.orders:
        smaller = fit.parameters.without("backlash")
        without = _fit(measurements, smaller, options, _reduced(fit, smaller), fit)
        if not _predicts_better(measurements, fit, without):
            fit = without
    flagged = find_flagged(measurements, fit.state, fit.row_squares)
    if options.drop_flagged and len(flagged.rows):
        kept = np.setdiff1d(np.arange(len(measurements)), flagged.rows)
        again = identify_complete(measurements.rows(kept), replace(options, drop_flagged=False))
        return replace(again, flagged=replace(flagged, dropped=True))
    return _identification(measurements, fit, flagged)


def _most_probable_fit(
    measurements: Measurements,
    options: CompleteOptions,
    harmonics: tuple[int, ...],
    state: State,
    start: "_Fit | None",
) -> _Fit:
    """Fit of all families that the options leave open, reduced to the most probable model.

    With few harmonics a doubtful one is dropped; many harmonics are kept for prediction.
    """
    rows = _rows(measurements)
    choices = {family.id: family.orders if family.known(rows) else (0,) for family in FAMILIES}
    choices |= {family.id: (1,) for family in FAMILIES if family.always} | {"harmonics": harmonics}
    choices |= {family: (order,) for family, order in options.orders.items()}
    candidates = [
        Parameters.of(
            measurements.robot, measurements.setup, **dict(zip(choices, orders, strict=True))
        )
        for orders in product(*choices.values())
    ]
    rough = _fit(measurements, candidates[-1], options, state, start, _ROUGHLY)
    parsimony = _PARSIMONY if harmonics == BY_ID["harmonics"].orders else 0.0
    chosen = most_probable(
        rough.parameters, rough.theta, rough.covariance, rough.prior_std, candidates, parsimony
    )
    return _fit(measurements, chosen, options, _reduced(rough, chosen), rough)


def _may_leave_structure(fit: _Fit, equations: int) -> bool:
    """Whether the noise may exceed the stated one for want of harmonics: within its own two
    standard errors.
    """
    freedom = max(equations - fit.effective, 1.0)
    most = fit.noise_factor * (1.0 + 2.0 / np.sqrt(2.0 * freedom))
    return fit.parameters.orders.get("harmonics") == LOW_ORDERS or bool(most > _UNEXPLAINED)


def _predicts_better(measurements: Measurements, larger: _Fit, smaller: _Fit) -> bool:
    """Whether held-out configurations are predicted better, by enough to be worth more parameters.

    The evidence alone takes joints that repeat badly for fine structure, or for backlash where the
    order of the rows is not that of the motion: its noise has no such thing.
    """
    rows = spread_rows(len(measurements), _JUDGED)
    part = measurements.rows(rows)
    before, after = (
        held_out_squares(part, fit.parameters, fit.state, fit.covariance, fit.noise_factor)
        for fit in (smaller, larger)
    )
    return bool(after.mean() < _WORTHWHILE * before.mean())


def _fit(
    measurements: Measurements,
    parameters: Parameters,
    options: CompleteOptions,
    state: State,
    start: "_Fit | None" = None,
    converged: float = _CONVERGED,
) -> _Fit:
    """Gauss–Newton to the maximum a posteriori; noise and tolerances are
    re-estimated at every step.

    `start` is the fit of a larger or smaller model, whose noise and tolerances are taken over.
    """
    tolerances = parameters.prior_std(options.tolerances)
    prior_std, noise_factor = tolerances, 1.0
    if start is not None:
        known = dict(zip(start.parameters.names, start.prior_std, strict=True))
        prior_std = np.array(
            [known.get(name, s) for name, s in zip(parameters.names, tolerances, strict=True)]
        )
        noise_factor = start.noise_factor
    known_before = start is not None and not len(parameters.missing_in(start.parameters))
    prior_steps, largest = 1 if known_before else _PRIOR_STEPS, parameters.largest_std(tolerances)
    d = (weights(measurements) > 0).sum(axis=-1)
    row_weight = np.ones(len(measurements))
    taken = 0
    equations: NormalEquations | None = None
    solution: Solution | None = None

    def linearise(at: State) -> tuple[NormalEquations, Array]:
        return normal_equations(measurements, parameters, at, row_weight), at.vector(parameters)

    def solve(system: tuple[NormalEquations, Array], _: float) -> tuple[Array, bool]:
        nonlocal prior_std, noise_factor, row_weight, taken, equations, solution
        (equations, theta), previous = system, noise_factor
        taken += 1
        priors = (
            options.estimate_priors and taken <= prior_steps
        )  # then they rest, so that the steps can converge
        solution = posterior_step(
            parameters, equations, theta, prior_std, noise_factor, largest if priors else None
        )
        prior_std, noise_factor = solution.prior_std, solution.noise_factor
        if options.loss_function != "squared":
            row_weight = row_weights(equations.row_squares, d, options.loss_function)
        return solution.step, bool(
            solution.farthest < converged and abs(noise_factor / previous - 1.0) < 0.01
        )

    state, iterations, settled = gauss_newton(
        state.moved(parameters, np.zeros(parameters.count)),
        linearise,
        solve,
        lambda at, step: at.moved(parameters, step),
        _MAX_ITERATIONS,
    )
    assert equations is not None
    assert solution is not None
    if not settled and not solution.farthest < 1.0:
        raise NoSolutionError(
            f"complete: no convergence in {_MAX_ITERATIONS} iterations; check units, joint order "
            "and target order"
        )
    squares = row_squares(measurements, state)
    return _Fit(
        parameters,
        state,
        prior_std,
        equations.information,
        squares,
        noise_factor,
        solution.effective,
        iterations,
    )


def _reduced(fit: _Fit, smaller: Parameters) -> State:
    """The most probable state without the parameters that `smaller` does not have, by the fit's own
    quadratic model.
    """
    larger, covariance = fit.parameters, fit.covariance
    dropped = larger.missing_in(smaller)
    step = -covariance[:, dropped] @ np.linalg.solve(
        covariance[np.ix_(dropped, dropped)], fit.theta[dropped]
    )
    return fit.state.moved(larger, step).kept(smaller)


def _rows(measurements: Measurements) -> Rows:
    return Rows(measurements.robot, measurements.q, measurements.conditions)


def _identification(measurements: Measurements, fit: _Fit, flagged: Flagged) -> Identification:
    parameters = fit.parameters
    covariance = fit.covariance
    prior_scaled = fit.prior_std[:, None] * fit.information * fit.prior_std / fit.noise_factor**2
    eigenvalues = np.clip(np.linalg.eigvalsh(prior_scaled), 0.0, None)[::-1]
    count = measurements.equations
    squares = float(fit.row_squares.sum()) / fit.noise_factor**2 + float(
        ((fit.theta / fit.prior_std) ** 2).sum()
    )
    log_evidence = -0.5 * (squares + float(np.log1p(eigenvalues).sum())) - count * np.log(
        fit.noise_factor
    )
    tool = fit.state.frames(measurements.q, measurements.conditions).tool
    residual = residuals(measurements, fit.state.setup, tool)
    at_prior = np.sqrt(np.diag(covariance)) > 0.99 * fit.prior_std
    names = np.array(parameters.names)
    return Identification(
        model="complete",
        errors=fit.state.errors,
        setup=fit.state.setup,
        singular_values=readonly(np.sqrt(eigenvalues)),
        rank=int((eigenvalues > 1.0).sum()),
        observable_rank=_observable_rank(measurements, fit),
        unobservable=tuple(str(name) for name in names[at_prior]),
        residual_rms=split_rms(residual, measurements),
        iterations=fit.iterations,
        posterior=Posterior(
            parameters=parameters,
            prior_std=readonly(fit.prior_std),
            covariance=readonly(covariance),
            noise_factor=fit.noise_factor,
            effective=fit.effective,
            log_evidence=float(log_evidence),
        ),
        flagged=flagged,
    )


def _observable_rank(measurements: Measurements, fit: _Fit) -> int:
    """Directions of the parameters that measurements of this kind could determine: seen anywhere,
    moving to either side.
    """
    robot, parameters = measurements.robot, fit.parameters
    count, rng = max(30, parameters.count // 3), np.random.default_rng(0)
    views = 1.0 if measurements.setup.kind.sees_all else _VIEWS
    q = robot.closing(drawn(robot, int(views * count), rng))
    q = q[fit.state.errors.mechanism.closes(q)]
    anywhere = measurements.anywhere(q, rng)
    setup, frames = fit.state.setup, fit.state.frames(q, anywhere.conditions)
    seen = setup.kind.sees(setup, frames.tool, anywhere.place)
    anywhere = anywhere.rows(np.flatnonzero(seen)[:count]) if seen.sum() >= count else measurements
    row_weight = np.ones(len(anywhere))
    information = normal_equations(anywhere, parameters, fit.state, row_weight).information
    eigenvalues = np.linalg.eigvalsh(fit.prior_std[:, None] * information * fit.prior_std)
    return int((eigenvalues > _RANK_TOLERANCE**2 * eigenvalues[-1]).sum())
