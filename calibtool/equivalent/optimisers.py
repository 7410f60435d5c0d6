"""Levenberg–Marquardt and gradient descent on a `Loss`, with early stopping."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibtool.equivalent.loss import Loss
from calibtool.equivalent.regressor import Trainable
from calibtool.robot.se3 import Array, readonly

Optimiser = Literal["lm", "gd"]


@dataclass(frozen=True, eq=False)
class History:
    """One training run: E at every iteration, the first one before any step.

    training, validation   (I,) loss on the two halves (validation is NaN without validation rows)
    chosen                 iteration whose weights were kept
    reason                 why it ended
    """

    training: Array
    validation: Array
    chosen: int
    reason: str


@dataclass(frozen=True)
class Stopping:
    """When a run ends.

    max_iterations   steps at most
    patience         steps without a better validation loss
    change           relative change of the training loss below which it is taken as settled
                     (paper, after Eq. 22)
    """

    max_iterations: int
    patience: int
    change: float


_ROUNDING = 1e-16  # of the loss: a smaller decrease is ignored

LM_STOPPING = Stopping(max_iterations=200, patience=10, change=1e-7)
GD_STOPPING = Stopping(max_iterations=20_000, patience=500, change=1e-7)


def levenberg_marquardt(network: Trainable, loss: Loss) -> Iterator[tuple[Trainable, float]]:
    """Yield networks with decreasing loss; ends when no damping gives a smaller one.

    The damping follows the ratio of actual to predicted decrease (Nielsen 1999).
    """
    residual, J = loss.residual_and_jacobian(network)
    value = float(residual @ residual)
    damping, growth = 1e-2 * float((J * J).sum() / J.shape[1]), 2.0
    weights = network.weights
    while True:
        gram, gradient = J.T @ J, J.T @ residual
        while np.isfinite(damping):
            step = _damped_step(gram, damping, gradient)
            trial = network.with_weights(weights + step)
            trial_value = loss.value(trial) * len(loss.q)
            predicted = float(step @ (damping * step + gradient))
            if predicted < _ROUNDING * value:
                return
            if trial_value < value:
                break
            damping *= growth
            growth *= 2.0
        else:
            return
        ratio = (value - trial_value) / max(predicted, 1e-300)
        damping *= max(1.0 / 3.0, 1.0 - (2.0 * min(ratio, 1.0) - 1.0) ** 3)
        growth = 2.0
        network, weights = trial, trial.weights
        residual, J = loss.residual_and_jacobian(network)
        value = trial_value
        yield network, value / len(loss.q)


def gradient_descent(
    network: Trainable, loss: Loss, rate: float = 0.1
) -> Iterator[tuple[Trainable, float]]:
    """w ← w − α ∂E/∂w (Eq. 22), with the loss divided by its value without a network, so that α has
    no unit.

    α is halved where a step would increase the loss, and grows by 5 % otherwise.
    """
    unit = max(loss.without_network * len(loss.q), 1e-300)
    residual, J = loss.residual_and_jacobian(network)
    value = float(residual @ residual)
    while rate > 1e-12:
        trial = network.with_weights(network.weights + rate * 2.0 * (J.T @ residual) / unit)
        trial_residual, trial_J = loss.residual_and_jacobian(trial)
        trial_value = float(trial_residual @ trial_residual)
        if trial_value > value:
            rate /= 2.0
            continue
        network, residual, J, value = trial, trial_residual, trial_J, trial_value
        rate *= 1.05
        yield network, value / len(loss.q)


def run(
    steps: Callable[[Trainable, Loss], Iterator[tuple[Trainable, float]]],
    network: Trainable,
    training: Loss,
    validation: Loss | None,
    stopping: Stopping,
) -> tuple[Trainable, History]:
    """Run an optimiser and keep the weights with the smallest validation loss."""

    def judge(candidate: Trainable, training_value: float) -> float:
        return training_value if validation is None else validation.value(candidate)

    values = [training.value(network)]
    judged = [judge(network, values[0])]
    best, chosen = network, 0
    reason = "the loss cannot be lowered further"
    for candidate, value in steps(network, training):
        values.append(value)
        judged.append(judge(candidate, value))
        iteration = len(values) - 1
        if judged[-1] < judged[chosen]:
            best, chosen = candidate, iteration
        if iteration - chosen >= stopping.patience:
            reason = f"no better validation loss in {stopping.patience} iterations"
            break
        if values[-2] - value <= stopping.change * values[-2]:
            reason = "the training loss has settled"
            break
        if iteration >= stopping.max_iterations:
            reason = f"{stopping.max_iterations} iterations"
            break
    validated = np.full(len(values), np.nan) if validation is None else np.array(judged)
    return best, History(readonly(values), readonly(validated), chosen, reason)


def _damped_step(gram: Array, damping: float, gradient: Array) -> Array:
    from scipy.linalg.lapack import dpotrf, dpotrs

    damped = gram.copy()
    damped.flat[:: len(gram) + 1] += damping
    factor, info = dpotrf(damped, lower=True, overwrite_a=True)
    if info != 0:  # not positive definite in floating point: a longer damping will do
        return np.zeros_like(gradient)
    step: Array = dpotrs(factor, gradient, lower=True)[0]
    return step
