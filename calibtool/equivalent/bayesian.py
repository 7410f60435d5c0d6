"""Bayesian regularisation of a network (MacKay 1992; Foresee and Hagan 1997)."""

from dataclasses import dataclass

import numpy as np

from calibtool.equivalent.loss import Loss
from calibtool.equivalent.optimisers import History
from calibtool.equivalent.regressor import Regressor, Trainable
from calibtool.robot.se3 import readonly

_MAX_ITERATIONS = 100
_SETTLED = 1e-4


@dataclass(frozen=True, eq=False)
class BayesianRun:
    """One training: learned model, history, γ effective weights, noise over the stated (1/√β)."""

    network: Regressor
    history: History
    effective: float
    noise_factor: float


def train_bayesian(network: Trainable, loss: Loss) -> BayesianRun:
    """Minimise β |t − R N|² + α |w|², both precisions re-estimated from γ = W − α
    tr(H⁻¹) at every step.

    H = β JᵀJ + α I is the Gauss–Newton Hessian; its eigenvalues give the step, γ and the effect
    of every damping.
    """
    from scipy.linalg import eigh

    weights = network.weights
    residual, J = loss.residual_and_jacobian(network)
    squares = float(residual @ residual)
    count, size = len(residual), len(weights)
    alpha, beta, damping = (
        0.1 * size / max(float(weights @ weights), 1e-300),
        count / max(squares, 1e-300),
        1e-3,
    )
    perfect = max(1e-16 * squares, 1e-300)  # a fit to the last digit leaves no noise to estimate
    values = [squares / len(loss.q)]
    effective, reason = float(size), f"{_MAX_ITERATIONS} iterations"
    for _ in range(_MAX_ITERATIONS):
        eigenvalues, vectors = eigh(beta * (J.T @ J), check_finite=False, driver="evd")
        eigenvalues = np.maximum(eigenvalues, 0.0)
        gradient = vectors.T @ (beta * (J.T @ residual) - alpha * weights)
        cost = beta * squares + alpha * float(weights @ weights)
        accepted = False
        while damping < 1e10:
            step = vectors @ (
                gradient / (eigenvalues + alpha + damping * (alpha + eigenvalues.mean()))
            )
            trial = network.with_weights(weights + step)
            trial_squares = loss.value(trial) * len(loss.q)
            trial_cost = beta * trial_squares + alpha * float(np.sum((weights + step) ** 2))
            if trial_cost < cost:
                accepted = True
                break
            damping *= 5.0
        if not accepted:
            reason = "the regularised loss cannot be lowered further"
            break
        damping = max(damping / 5.0, 1e-9)
        network, weights = trial, trial.weights
        residual, J = loss.residual_and_jacobian(network)
        squares = float(residual @ residual)
        values.append(squares / len(loss.q))
        previous = effective
        effective = float((eigenvalues / (eigenvalues + alpha)).sum())
        alpha = min(effective / max(float(weights @ weights), 1e-300), 1e12)
        beta = max(count - effective, 1.0) / max(squares, perfect)
        if cost - trial_cost < _SETTLED * cost and abs(effective - previous) < 0.01 * max(
            effective, 1.0
        ):
            reason = "the regularised loss has settled"
            break
    history = History(
        readonly(values), readonly(np.full(len(values), np.nan)), len(values) - 1, reason
    )
    return BayesianRun(network, history, effective, float(1.0 / np.sqrt(beta)))
