"""Evidence: noise, tolerances and model choice from a Gaussian approximation."""

from dataclasses import dataclass

import numpy as np

from calibtool.errors import NoSolutionError
from calibtool.identification.equations import NormalEquations
from calibtool.identification.parameters import Parameters
from calibtool.robot.se3 import Array

_PSEUDO_OBSERVATIONS = 10.0  # the stated noise counts as so many residuals
_SETTLED = 0.03
_ROUNDS = 10  # per Gauss–Newton step
_ROUNDING = 1e-12  # of the largest eigenvalue: a smaller negative one is zero


@dataclass(frozen=True, eq=False)
class Solution:
    """Step of the parameters (p,), their deviations, tolerances, noise and γ at maximum
    evidence."""

    step: Array
    std: Array
    prior_std: Array
    noise_factor: float
    effective: float

    @property
    def farthest(self) -> float:
        """Largest element of the step in standard deviations of the posterior."""
        return float(np.abs(self.step / self.std).max())


def posterior_step(
    parameters: Parameters,
    equations: NormalEquations,
    theta: Array,
    prior_std: Array,
    noise_factor: float,
    largest_std: Array | None,
) -> Solution:
    """Maximum a posteriori step from θ (p,), with noise and tolerances re-estimated.

    The quadratic model is kept, so that an iteration costs one factorisation and no kinematics.
    largest_std (p,): upper limits of the tolerances; None: the tolerances are not changed.
    """
    H, g = equations.information, equations.gradient
    for _ in range(_ROUNDS):
        # In units of the tolerances the prior is the identity.
        scaled = H * prior_std
        scaled *= (prior_std / noise_factor**2)[:, None]
        scaled.flat[:: len(prior_std) + 1] += 1.0
        root = _root_of_inverse(scaled, on_the_way=True)
        gradient = prior_std * g / noise_factor**2 - theta / prior_std
        step = prior_std * (root.T @ (root @ gradient))
        remaining = np.einsum("ij,ij->j", root, root)  # of the variance of every tolerance
        effective = float(len(remaining) - remaining.sum())
        squares = max(equations.squares - 2 * float(g @ step) + float(step @ H @ step), 0.0)
        freedom = max(equations.equations - effective, 0.0)
        noise = float(np.sqrt((squares + _PSEUDO_OBSERVATIONS) / (freedom + _PSEUDO_OBSERVATIONS)))
        std, scaled_std = np.sqrt(remaining) * prior_std, prior_std
        if largest_std is not None:
            scaled_std = np.minimum(
                _re_estimated(parameters, theta + step, remaining, prior_std), largest_std
            )
        change = max(
            abs(noise / noise_factor - 1.0), float(np.abs(scaled_std / prior_std - 1.0).max())
        )
        noise_factor, prior_std = noise, scaled_std
        if change < _SETTLED:
            break
    return Solution(step, std, prior_std, noise_factor, effective)


def most_probable(
    theta: Array,
    covariance: Array,
    prior_std: Array,
    sections: list[np.ndarray],
    parsimony: list[float],
) -> np.ndarray:
    """Which parameters (p,) bool remain when sections go whose absence is more probable than their
    presence.

    The worst first, by p(θ_s = 0 | data) / p(θ_s = 0) (Savage and Dickey) of the Gaussian N(θ,
    covariance) over all of
    them, which is conditioned on every section that has gone. A section stays that earns more than
    its `parsimony` in nats.
    """
    theta, covariance, kept = theta.copy(), covariance.copy(), np.ones(len(theta), dtype=bool)
    remaining = list(zip(sections, parsimony, strict=True))
    while remaining:
        gains = [
            log_density_ratio(theta[s], covariance[np.ix_(s, s)], prior_std[s]) + least
            for s, least in remaining
        ]
        worst = int(np.argmax(gains))
        if gains[worst] < 0.0:
            break
        s, _ = remaining.pop(worst)
        gain = np.linalg.solve(covariance[np.ix_(s, s)], covariance[s]).T
        theta -= gain @ theta[s]
        covariance -= gain @ covariance[s]
        kept[s] = False
    return kept


def inverse(matrix: Array, on_the_way: bool = False) -> Array:
    """Inverse of a symmetric positive definite matrix (p, p), scaled to unit diagonal first.

    Raises NoSolutionError where the matrix is not finite, or not positive definite to rounding, for
    example because the noise is far too small for the tolerances. on_the_way: see
    `_root_of_inverse`.
    """
    with np.errstate(all="ignore"):
        scale = 1.0 / np.sqrt(np.diag(matrix))
        root = _root_of_inverse(matrix * np.outer(scale, scale), on_the_way) * scale
    result: Array = root.T @ root
    return result


def _root_of_inverse(matrix: Array, on_the_way: bool) -> Array:
    """W (p, p) with WᵀW the inverse of a symmetric positive definite matrix (p, p).

    on_the_way: in an iteration, rounded negative eigenvalues are replaced, since the noise is
    estimated again afterwards; NoSolutionError otherwise.
    """
    from scipy.linalg.lapack import dpotrf, dtrtri

    if not np.isfinite(matrix).all():
        raise _singular()
    factor, failed = dpotrf(matrix.T, lower=True, clean=True)
    if not failed:
        root, failed = dtrtri(factor, lower=True, overwrite_c=True)
    if failed:
        eigenvalues, vectors = np.linalg.eigh(matrix)
        if not on_the_way or eigenvalues[0] < -_ROUNDING * eigenvalues[-1]:
            raise _singular()
        eigenvalues = np.maximum(
            eigenvalues, len(eigenvalues) * np.finfo(float).eps * eigenvalues[-1]
        )
        root = (vectors / np.sqrt(eigenvalues)).T
    result: Array = root
    return result


def _singular() -> NoSolutionError:
    return NoSolutionError(
        "the equations for the parameters are singular to rounding: the stated noise is too "
        "small beside the tolerances; state a larger noise"
    )


def log_density_ratio(theta: Array, covariance: Array, prior_std: Array) -> float:
    """ln N(0; θ, C) − ln N(0; 0, S): the evidence for the model without these parameters against
    the one with them.

    theta θ (k,), covariance C (k, k), prior_std the root of the diagonal of S (k,).
    """
    if not len(theta):
        return 0.0
    from scipy.linalg.lapack import dpotrf, dpotrs

    factor, failed = dpotrf(covariance, lower=True)
    if failed:
        raise _singular()
    log_det = 2.0 * np.log(np.diag(factor)).sum()
    return float(
        -0.5 * (log_det + theta @ dpotrs(factor, theta, lower=True)[0]) + np.log(prior_std).sum()
    )


def widened(
    parameters: Parameters, theta: Array, covariance: Array, prior_std: Array, stated: Array
) -> Array:
    """Tolerances (p,) for ± of the parameters, where `prior_std` was estimated from them.

    An estimated scale is uncertain itself, and a family of which little is determined may have
    come out far too small: the stated tolerance counts as one more parameter that was determined,
    s² ← (Σ θ² + stated²) / (γ + 1), which only enlarges. Fine structure has no stated size.
    """
    result = prior_std.copy()
    determined = 1.0 - np.diag(covariance) / prior_std**2
    fine = parameters.fine_structure
    for chosen in parameters.groups:
        if fine[chosen].any():
            continue
        squares = float(((theta[chosen] / prior_std[chosen]) ** 2).sum())
        squares += float((stated[chosen[0]] / prior_std[chosen[0]]) ** 2)
        scale = np.sqrt(squares / (float(determined[chosen].sum()) + 1.0))
        result[chosen] *= max(float(scale), 1.0)
    return np.minimum(result, np.maximum(prior_std, stated))


def _re_estimated(
    parameters: Parameters, theta: Array, remaining: Array, prior_std: Array
) -> Array:
    """One factor per family and kind of element (lengths, angles): s² ← Σ θ² / γ, tolerances
    keep their ratios. remaining (p,): variance of θ over that of its tolerance.
    """
    result = prior_std.copy()
    determined = 1.0 - remaining
    for chosen in parameters.groups:
        gamma = float(determined[chosen].sum())
        if gamma < 0.5:  # nothing was learned about this family
            continue
        factor = np.sqrt(float(((theta[chosen] / prior_std[chosen]) ** 2).sum()) / gamma)
        result[chosen] = prior_std[chosen] * np.clip(factor, 0.3, 3.0)
    return result
