"""Train the network of the equivalent robot on what a base model leaves over (METHOD §6)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibtool.equivalent.loss import joint_loss, task_loss
from calibtool.equivalent.network import Network, initial_network, rule_of_thumb
from calibtool.equivalent.optimisers import (
    GD_STOPPING,
    LM_STOPPING,
    History,
    Optimiser,
    gradient_descent,
    levenberg_marquardt,
    run,
)
from calibtool.robot.se3 import Array

LossName = Literal["task", "joint"]


@dataclass(frozen=True)
class TrainingOptions:
    """hidden: nodes, √(6n) unless given. restarts: networks tried, the best on the validation rows is kept."""

    loss: LossName = "task"
    optimiser: Optimiser = "lm"
    hidden: int | None = None
    validation: float = 0.5
    restarts: int = 5
    seed: int = 0


@dataclass(frozen=True, eq=False)
class TrainingReport:
    """How a network came about.

    history        of the best restart
    training_rows, validation_rows   indices of the configurations
    restart_losses (restarts,) validation loss of each (training loss without validation rows)
    loss_without   the same loss without a network
    loss, optimiser, hidden   the options as used
    """

    history: History
    training_rows: np.ndarray
    validation_rows: np.ndarray
    restart_losses: Array
    loss_without: float
    loss: LossName
    optimiser: Optimiser
    hidden: int

    @property
    def loss_units(self) -> str:
        """E is weighted by the stated noise (task), or in joint motions (joint)."""
        return "1" if self.loss == "task" else "rad², m²"


def split_rows(count: int, validation: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Training and validation rows of `count` configurations, both sorted."""
    order = rng.permutation(count)
    held = round(count * validation)
    return np.sort(order[held:]), np.sort(order[:held])


def train_network(
    q: Array,
    G: Array,
    y: Array,
    training_rows: np.ndarray,
    validation_rows: np.ndarray,
    options: TrainingOptions,
    rng: np.random.Generator,
) -> tuple[Network | None, TrainingReport]:
    """Fit N to y ≈ G N; None in place of the network where it is no better than none at all.

    q (K, n) in rad or m; G (K, d, p) = Σ^(−1/2) P J_ρ; y (K, d) weighted residuals of the base model.
    """
    loss = (task_loss if options.loss == "task" else joint_loss)(q, G, y)
    training = loss.rows(training_rows)
    validation = loss.rows(validation_rows) if len(validation_rows) else None
    steps = levenberg_marquardt if options.optimiser == "lm" else gradient_descent
    stopping = LM_STOPPING if options.optimiser == "lm" else GD_STOPPING
    output_scale = _output_scale(G[training_rows], y[training_rows])
    hidden = rule_of_thumb(q.shape[1]) if options.hidden is None else options.hidden
    runs: list[tuple[Network, History]] = []
    scores: list[float] = []
    for stream in rng.spawn(options.restarts):
        network, history = run(
            steps, initial_network(q[training_rows], output_scale, hidden, stream), training, validation, stopping
        )
        runs.append((network, history))
        scores.append(
            float(history.training[history.chosen] if validation is None else history.validation[history.chosen])
        )
    best = int(np.argmin(scores))
    without = (training if validation is None else validation).without_network
    report = TrainingReport(
        history=runs[best][1],
        training_rows=training_rows,
        validation_rows=validation_rows,
        restart_losses=np.array(scores),
        loss_without=without,
        loss=options.loss,
        optimiser=options.optimiser,
        hidden=hidden,
    )
    return runs[best][0] if scores[best] < without else None, report


def _output_scale(G: Array, y: Array) -> Array:
    """Typical size of each joint motion error: RMS of a damped solution, which a near-singular row cannot spoil. (p,)"""
    transposed = np.swapaxes(G, -1, -2)
    gram = transposed @ G
    size = np.trace(gram, axis1=-2, axis2=-1)[:, None, None] / gram.shape[-1]
    damped = np.linalg.solve(gram + 1e-2 * size * np.eye(gram.shape[-1]), transposed @ y[..., None])[..., 0]
    return np.maximum(np.sqrt(np.mean(damped**2, axis=0)), 1e-9)
