"""One fit of the complete model: Gauss–Newton to the maximum a posteriori, and what follows from
its quadratic model."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from calibtool.errormodel.tolerances import Tolerances
from calibtool.errors import NoSolutionError
from calibtool.identification.equations import NormalEquations, normal_equations, row_squares
from calibtool.identification.evidence import Solution, inverse, posterior_step
from calibtool.identification.parameters import Parameters, State
from calibtool.identification.robust import LossFunction, row_weights
from calibtool.measurement.gauss_newton import gauss_newton
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import weights
from calibtool.robot.se3 import Array

# Of the posterior standard deviations: a smaller step ends the iteration, …
CONVERGED = 1e-3
ROUGHLY = 0.1  # … and one so small is enough to choose a model
_ROUNDING = 1e-9  # m: with less noise, rounding may keep the iteration from settling
_MAX_ITERATIONS = 30
# Gauss–Newton steps in which tolerances are re-estimated; one where an earlier fit has done so
_PRIOR_STEPS = 3
_UNSURE = 0.1  # of their tolerance: less surely determined base and target coordinates are named
_WEIGHT_STEPS = 5  # in which rows may change their weights


@dataclass(frozen=True, eq=False)
class Fit:
    """A converged iteration: state, Fisher information H (p, p) of the stated noise, squared
    residuals of the rows (N,).

    row_weight (N,): factor of the squared residuals of each row
    """

    parameters: Parameters
    state: State
    prior_std: Array
    information: Array
    row_squares: Array
    row_weight: Array
    noise_factor: float
    effective: float
    iterations: int

    @cached_property
    def covariance(self) -> Array:
        """Posterior covariance (p, p) of the parameters."""
        return inverse(self.information / self.noise_factor**2 + np.diag(self.prior_std**-2.0))

    @cached_property
    def theta(self) -> Array:
        """Values (p,) of the parameters."""
        return self.state.vector(self.parameters)

    def conditional(self, dropped: np.ndarray) -> tuple[Array, Array]:
        """Step of θ (p,) to the most probable one with the parameters `dropped` at zero, and its
        covariance (p, p).

        The quadratic model of the fit is used; rows and columns of dropped ones become zero.
        """
        covariance = self.covariance
        gain = np.linalg.solve(covariance[np.ix_(dropped, dropped)], covariance[dropped]).T
        return -gain @ self.theta[dropped], covariance - gain @ covariance[dropped]

    def reduced(self, parameters: Parameters) -> State:
        """The most probable state with these of the fit's parameters alone."""
        step, _ = self.conditional(self.parameters.missing_in(parameters))
        return self.state.moved(self.parameters, step).kept(parameters)


class FitOf(Protocol):
    """A fit of some parameters to the measurements, from a state and, where there is one, another
    fit."""

    def __call__(
        self,
        parameters: Parameters,
        state: State,
        start: Fit | None,
        converged: float,
        prior_std: Array | None = None,
    ) -> Fit: ...


def smaller(fit: Fit, kept: np.ndarray, fit_of: FitOf) -> Fit:
    """The converged fit of the parameters that are kept (p,)."""
    parameters = fit.parameters.only(kept)
    return fit_of(parameters, fit.reduced(parameters), fit, CONVERGED)


def fit(
    measurements: Measurements,
    parameters: Parameters,
    tolerances: Tolerances | None,
    state: State,
    *,
    estimate_priors: bool = True,
    loss_function: LossFunction = "isolated",
    start: Fit | None = None,
    prior_std: Array | None = None,
    converged: float = CONVERGED,
) -> Fit:
    """Gauss–Newton to the maximum a posteriori; noise, tolerances and row weights are re-estimated
    at every step.

    `start` is the fit of a larger or smaller model, whose noise and tolerances are used first;
    prior_std (p,): tolerances to start from instead.
    """
    stated = parameters.prior_std(tolerances)
    noise_factor, prior_steps = (1.0, _PRIOR_STEPS) if start is None else (start.noise_factor, 1)
    if prior_std is None:
        known = (
            {} if start is None else dict(zip(start.parameters.names, start.prior_std, strict=True))
        )
        prior_std = np.array(
            [known.get(name, s) for name, s in zip(parameters.names, stated, strict=True)]
        )
    std, largest = prior_std, parameters.largest_std(stated)
    d = (weights(measurements) > 0).sum(axis=-1)
    if start is not None:
        row_weight = start.row_weight
    else:
        row_weight = row_weights(row_squares(measurements, state), d, loss_function, noise_factor)
    used, taken, resting = row_weight, 0, False
    equations: NormalEquations | None = None
    solution: Solution | None = None

    def linearise(at: State) -> tuple[NormalEquations, Array]:
        return normal_equations(measurements, parameters, at, row_weight), at.vector(parameters)

    def solve(system: tuple[NormalEquations, Array], _: float) -> tuple[Array, bool]:
        nonlocal std, noise_factor, row_weight, used, taken, resting, equations, solution
        (equations, theta), previous = system, noise_factor
        taken += 1
        # After these steps the tolerances are kept, so that the iteration can converge.
        priors = estimate_priors and taken <= prior_steps
        solution = posterior_step(
            parameters, equations, theta, std, noise_factor, largest if priors else None
        )
        std, noise_factor = solution.prior_std, solution.noise_factor
        # Weights converge linearly only, or not at all: after some steps they are kept.
        used, moving = row_weight, not resting
        if moving:
            row_weight = row_weights(equations.row_squares, d, loss_function, noise_factor)
            moving = not np.array_equal(used, row_weight)
            resting = solution.farthest < ROUGHLY or taken >= _WEIGHT_STEPS
        settled = solution.farthest < converged and abs(noise_factor / previous - 1.0) < 0.01
        return solution.step, bool(settled and (not moving or converged >= ROUGHLY))

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
        raise _not_settled(measurements, parameters, solution)
    return Fit(
        parameters,
        state,
        std,
        equations.information,
        row_squares(measurements, state),
        used,
        noise_factor,
        solution.effective,
        iterations,
    )


def _not_settled(
    measurements: Measurements, parameters: Parameters, solution: Solution
) -> NoSolutionError:
    setup = slice(parameters.blocks["base"].start, None)
    unsure = solution.std[setup] / solution.prior_std[setup]
    remedy, noise = "check units, joint order and target order", measurements.noise_position
    if noise <= _ROUNDING:
        remedy = f"the stated noise of {noise * 1e3:.3g} mm is near rounding: state a larger one"
    elif unsure.max(initial=0.0) > _UNSURE:
        name = parameters.names[setup][int(np.argmax(unsure))]
        remedy = f"the rows hardly tell {name}: measure with the tool turned in other directions"
    return NoSolutionError(f"complete: no convergence in {_MAX_ITERATIONS} iterations; {remedy}")
