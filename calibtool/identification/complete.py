"""The complete model: δζ, δξ, δq and joint-motion functions by maximum a posteriori Gauss–Newton (METHOD §7).

Tolerances are the prior, so nothing is eliminated and no rank is decided: what the data do not determine stays at its
prior, and the posterior says so. Noise level, number of harmonics and, on request, the tolerances come from the evidence.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotrf, dpotri

from calibtool.errors import NoSolutionError
from calibtool.identification.model import Flagged, Identification, Posterior, split_rms
from calibtool.identification.parameters import ErrorState, Parameters, Tolerances
from calibtool.identification.robust import LossFunction, find_flagged, row_weights
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import observation_matrix, residuals, target_columns, weights
from calibtool.robot.se3 import Array, readonly

MAX_HARMONICS = 3
_CHUNK = 1000  # configurations whose columns are in memory together
_PSEUDO_OBSERVATIONS = 10.0  # the stated noise counts as so many residuals
_MAX_ITERATIONS = 30
_EVIDENCE_SETTLED = 0.03
_EVIDENCE_ROUNDS = 10  # per Gauss–Newton step
_PRIOR_STEPS = 3  # Gauss–Newton steps in which tolerances are re-estimated
_OCCAM = 3.0  # nats by which a larger model must be more probable
_CONVERGED = 1e-3  # a step this small against the posterior's standard deviations changes nothing


@dataclass(frozen=True)
class CompleteOptions:
    """How the complete model is identified.

    tolerances       prior standard deviations, those of the robot's description unless given
    harmonics        orders per joint; None: chosen by evidence, 0 … MAX_HARMONICS
    gravity          wind-up under gravity; None: chosen by evidence
    twists           errors δξ of the joint twists; None: chosen by evidence
    estimate_priors  re-estimate the scale of every family of tolerances from the evidence
    loss_function    `squared`, or down-weight rows that do not fit: `huber`, `cauchy`
    drop_flagged     leave flagged rows out of a second fit
    """

    tolerances: Tolerances | None = None
    harmonics: int | None = None
    gravity: bool | None = None
    twists: bool | None = None
    estimate_priors: bool = True
    loss_function: LossFunction = "squared"
    drop_flagged: bool = False


@dataclass(frozen=True, eq=False)
class _Fit:
    """A converged iteration: state, Fisher information H (p, p) of the stated noise, squared sizes of rows (N,)."""

    parameters: Parameters
    state: ErrorState
    prior_std: Array
    information: Array
    row_sizes: Array
    noise_factor: float
    effective: float
    iterations: int

    @property
    def precision(self) -> Array:
        return self.information / self.noise_factor**2 + np.diag(self.prior_std**-2.0)


def identify_complete(measurements: Measurements, options: CompleteOptions | None = None) -> Identification:
    """Identify every error that a tolerance is given for, from any number of configurations.

    Joint-motion functions are chosen by the Savage–Dickey density ratio: one fit with all of them tells how likely each
    smaller model is. Raises NoSolutionError when the iteration does not settle.
    """
    options = CompleteOptions() if options is None else options
    robot, setup = measurements.robot, measurements.setup
    candidates = _candidates(measurements, options)
    fit = _fit(measurements, candidates[-1], options, ErrorState.nominal(robot, setup))
    chosen = _most_probable(fit, candidates)
    if chosen != fit.parameters:
        fit = _fit(measurements, chosen, options, _restricted(fit.state, fit.parameters, chosen), fit)
    flagged = find_flagged(measurements, fit.state, fit.row_sizes)
    if options.drop_flagged and len(flagged.rows):
        kept = np.setdiff1d(np.arange(len(measurements)), flagged.rows)
        again = identify_complete(measurements.rows(kept), replace(options, drop_flagged=False))
        return replace(again, flagged=replace(flagged, dropped=True))
    return _identification(measurements, fit, flagged)


def _fit(
    measurements: Measurements,
    parameters: Parameters,
    options: CompleteOptions,
    state: ErrorState,
    start: "_Fit | None" = None,
) -> _Fit:
    """Gauss–Newton to the maximum a posteriori; noise and tolerances are re-estimated at every step.

    `start` is the fit of a larger model, whose noise and tolerances are taken over.
    """
    prior_std = parameters.prior_std(measurements.robot, options.tolerances or Tolerances.of(measurements.robot))
    noise_factor, d = 1.0, (weights(measurements) > 0).sum(axis=-1)
    if start is not None:
        inside = np.isin(start.parameters.names, parameters.names)
        prior_std, noise_factor = start.prior_std[inside], start.noise_factor
    row_weight = np.ones(len(measurements))
    state = state.moved(parameters, np.zeros(parameters.count))
    for iteration in range(1, _MAX_ITERATIONS + 1):
        information, gradient, sizes = _normal_equations(measurements, parameters, state, row_weight)
        equations = _Quadratic(information, gradient, float(sizes @ row_weight), float(d @ row_weight))
        theta = state.vector(parameters)
        previous = noise_factor
        priors = options.estimate_priors and iteration <= _PRIOR_STEPS  # then they rest, so that the steps can converge
        solution = _posterior(parameters, equations, theta, prior_std, noise_factor, priors)
        prior_std, noise_factor = solution.prior_std, solution.noise_factor
        state = state.moved(parameters, solution.step)
        if options.loss_function != "squared":
            row_weight = row_weights(sizes, d, options.loss_function)
        settled = np.abs(solution.step / np.sqrt(np.diag(solution.covariance))).max() < _CONVERGED
        if settled and abs(noise_factor / previous - 1.0) < 0.01:
            break
    else:
        if not np.abs(solution.step / np.sqrt(np.diag(solution.covariance))).max() < 1.0:
            raise NoSolutionError(
                f"complete: no convergence in {_MAX_ITERATIONS} iterations; check units, joint order and target order"
            )
    _, _, sizes = _normal_equations(measurements, parameters, state, row_weight, sizes_only=True)
    return _Fit(parameters, state, prior_std, information, sizes, noise_factor, solution.effective, iteration)


@dataclass(frozen=True, eq=False)
class _Quadratic:
    """The sum of squares round a state: squares − 2 gᵀx + xᵀH x, from `equations` residuals."""

    information: Array
    gradient: Array
    squares: float
    equations: float


@dataclass(frozen=True, eq=False)
class _Solution:
    step: Array
    covariance: Array
    prior_std: Array
    noise_factor: float
    effective: float


def _posterior(
    parameters: Parameters, quadratic: _Quadratic, theta: Array, prior_std: Array, noise_factor: float, priors: bool
) -> _Solution:
    """Maximum a posteriori step from θ with noise and, if `priors`, tolerances at their evidence maximum (MacKay).

    The quadratic model is kept, so a round costs one factorisation and no kinematics.
    """
    H, g = quadratic.information, quadratic.gradient
    for _ in range(_EVIDENCE_ROUNDS):
        covariance = _inverse(H / noise_factor**2 + np.diag(prior_std**-2.0))
        step = covariance @ (g / noise_factor**2 - theta / prior_std**2)
        effective = float(np.sum(H * covariance)) / noise_factor**2
        squares = max(quadratic.squares - 2 * float(g @ step) + float(step @ H @ step), 0.0)
        freedom = max(quadratic.equations - effective, 0.0)
        noise = float(np.sqrt((squares + _PSEUDO_OBSERVATIONS) / (freedom + _PSEUDO_OBSERVATIONS)))
        scaled = _re_estimated(parameters, theta + step, covariance, prior_std) if priors else prior_std
        change = max(abs(noise / noise_factor - 1.0), float(np.abs(scaled / prior_std - 1.0).max()))
        noise_factor, prior_std = noise, scaled
        if change < _EVIDENCE_SETTLED:
            break
    return _Solution(step, covariance, prior_std, noise_factor, effective)


def _inverse(matrix: Array) -> Array:
    """Inverse of a symmetric positive definite matrix, scaled to unit diagonal first: m and rad mix."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    factor, _ = dpotrf(matrix * np.outer(scale, scale), lower=True, clean=True)
    half, _ = dpotri(factor, lower=True)
    inverse: Array = (half + np.tril(half, -1).T) * np.outer(scale, scale)
    return inverse


def _normal_equations(
    measurements: Measurements,
    parameters: Parameters,
    state: ErrorState,
    row_weight: Array,
    sizes_only: bool = False,
) -> tuple[Array, Array, Array]:
    """AᵀA (p, p) and Aᵀr (p,) of the weighted residuals at the state, and |r_k|² of every row (N,), in chunks."""
    robot, setup = measurements.robot, state.setup
    p = parameters.count
    information, gradient = np.zeros((p, p)), np.zeros(p)
    sizes = np.empty(len(measurements))
    for start in range(0, len(measurements), _CHUNK):
        rows = np.arange(start, min(start + _CHUNK, len(measurements)))
        part = measurements.rows(rows)
        weight = weights(part)
        frames = state.frames(robot, part.q)
        left = residuals(part, setup, frames.tool) * weight
        sizes[rows] = (left**2).sum(axis=-1)
        if sizes_only:
            continue
        columns = observation_matrix(setup, frames.tool) @ parameters.pose_columns(robot, state, frames, part.q)
        if parameters.targets:
            columns = np.concatenate([columns, target_columns(setup, frames.tool)], axis=-1)
        scale = np.sqrt(row_weight[rows])[:, None]
        A = (columns * (weight * scale)[..., None]).reshape(-1, p)
        information += A.T @ A
        gradient += A.T @ (left * scale).ravel()
    return information, gradient, sizes


def _candidates(measurements: Measurements, options: CompleteOptions) -> list[Parameters]:
    """Every model that the options leave open, the one with everything last."""
    orders = range(MAX_HARMONICS + 1) if options.harmonics is None else [options.harmonics]
    return [
        Parameters.of(measurements.robot, measurements.setup, twists, harmonics, gravity)
        for twists in ([False, True] if options.twists is None else [options.twists])
        for harmonics in orders
        for gravity in ([False, True] if options.gravity is None else [options.gravity])
    ]


def _most_probable(fit: _Fit, candidates: list[Parameters]) -> Parameters:
    """The smallest candidate whose p(θ_dropped = 0 | data) / p(θ_dropped = 0) is near the largest (Savage and Dickey)."""
    covariance = _inverse(fit.precision)
    theta = fit.state.vector(fit.parameters)
    names = np.array(fit.parameters.names)

    def log_evidence(candidate: Parameters) -> float:
        dropped = np.flatnonzero(~np.isin(names, candidate.names))
        return _log_density_ratio(theta[dropped], covariance[np.ix_(dropped, dropped)], fit.prior_std[dropped])

    evidence = [log_evidence(candidate) for candidate in candidates]
    good = [c for c, e in zip(candidates, evidence, strict=True) if e > max(evidence) - _OCCAM]
    return min(good, key=lambda candidate: candidate.count)


def _log_density_ratio(theta: Array, covariance: Array, prior_std: Array) -> float:
    """ln N(0; θ, C) − ln N(0; 0, S): the evidence for the model without these parameters against the one with them."""
    if not len(theta):
        return 0.0
    factor = cho_factor(covariance, lower=True)
    log_det = 2.0 * np.log(np.diag(factor[0])).sum()
    return float(-0.5 * (log_det + theta @ cho_solve(factor, theta)) + np.log(prior_std).sum())


def _restricted(state: ErrorState, old: Parameters, new: Parameters) -> ErrorState:
    """The state without the parameters that a smaller model does not have."""
    geometry, motion = state.geometry, state.motion
    if old.twists and not new.twists:
        geometry = replace(geometry, twists=readonly(np.zeros_like(geometry.twists)))
    compliance = motion.compliance.copy()
    compliance[[j for j in old.gravity if j not in new.gravity]] = 0.0
    motion = replace(
        motion, harmonics=readonly(motion.harmonics[:, : 2 * new.harmonics]), compliance=readonly(compliance)
    )
    return replace(state, geometry=geometry, motion=motion)


def _re_estimated(parameters: Parameters, theta: Array, covariance: Array, prior_std: Array) -> Array:
    """One factor per family and kind of element (lengths, angles): s² ← Σ θ² / γ, tolerances keep their ratios."""
    result = prior_std.copy()
    determined = 1.0 - np.diag(covariance) / prior_std**2
    for chosen in parameters.families:
        gamma = float(determined[chosen].sum())
        if gamma < 0.5:  # nothing was learned about this family
            continue
        factor = np.sqrt(float(((theta[chosen] / prior_std[chosen]) ** 2).sum()) / gamma)
        result[chosen] = prior_std[chosen] * np.clip(factor, 0.3, 3.0)
    return result


def _identification(measurements: Measurements, fit: _Fit, flagged: Flagged) -> Identification:
    robot, parameters = measurements.robot, fit.parameters
    covariance = _inverse(fit.precision)
    prior_scaled = fit.prior_std[:, None] * fit.information * fit.prior_std / fit.noise_factor**2
    eigenvalues = np.clip(np.linalg.eigvalsh(prior_scaled), 0.0, None)[::-1]
    theta = fit.state.vector(parameters)
    count = measurements.equations
    squares = float(fit.row_sizes.sum()) / fit.noise_factor**2 + float(((theta / fit.prior_std) ** 2).sum())
    log_evidence = -0.5 * (squares + float(np.log1p(eigenvalues).sum())) - count * np.log(fit.noise_factor)
    left = residuals(measurements, fit.state.setup, fit.state.frames(robot, measurements.q).tool)
    at_prior = np.sqrt(np.diag(covariance)) > 0.99 * fit.prior_std
    names = np.array(parameters.names)
    return Identification(
        model="complete",
        geometry=fit.state.geometry,
        motion=fit.state.motion,
        setup=fit.state.setup,
        singular_values=readonly(np.sqrt(eigenvalues)),
        rank=int((eigenvalues > 1.0).sum()),
        observable_rank=parameters.count,
        unobservable=tuple(str(name) for name in names[at_prior]),
        residual_rms=split_rms(left, measurements),
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
