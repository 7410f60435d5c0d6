"""Train the learned model of the equivalent robot on the residuals of a base model."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from calibtool.equivalent.bayesian import BayesianRun, train_bayesian
from calibtool.equivalent.gaussian_process import GaussianProcess, fit_gaussian_process
from calibtool.equivalent.loss import Loss, joint_loss, task_loss
from calibtool.equivalent.network import Network
from calibtool.equivalent.optimisers import (
    GD_STOPPING,
    LM_STOPPING,
    History,
    Optimiser,
    gradient_descent,
    levenberg_marquardt,
    run,
)
from calibtool.equivalent.regressor import Regressor
from calibtool.equivalent.regressors import REGRESSORS
from calibtool.errors import UsageError, check_choice, check_number, check_whole
from calibtool.progress import Progress, silent
from calibtool.robot.se3 import Array

_ITERATIONS = {"lm": (levenberg_marquardt, LM_STOPPING), "gd": (gradient_descent, GD_STOPPING)}

LossName = Literal["task", "joint"]
Regularisation = Literal["bayes", "early-stopping"]


@dataclass(frozen=True)
class TrainingOptions:
    """How a network is trained.

    loss            `task`: error of the target points (Eq. 20); `joint`: joint motions,
                    all alike (Eq. 21)
    optimiser       `lm`: Levenberg and Marquardt; `gd`: gradient descent (Eq. 22)
    regularisation  `bayes`: all rows train, every restart is a member of an ensemble that is
                    averaged; `early-stopping` (the published method): a validation part stops the
                    training and chooses the best restart; None: `early-stopping` for `gd` and on
                    the nominal robot, `bayes` on every other base model (`resolved`)
    regressor       learned model: `tanh`, the published network, or `gaussian-process`, which
                    takes `bayes`; None: with `bayes` the one that predicts held-out rows better,
                    otherwise the network
    hidden          nodes of a network, √(6n) unless given; points of a Gaussian process
    validation      part of the configurations for early stopping
    restarts        networks trained
    folds           of the cross-validation that decides whether the networks are used (bayes)
    seed            of splits and starting weights
    """

    loss: LossName = "task"
    optimiser: Optimiser = "lm"
    regularisation: Regularisation | None = None
    regressor: str | None = None
    hidden: int | None = None
    validation: float = 0.5
    restarts: int = 5
    folds: int = 5
    seed: int = 0

    def __post_init__(self) -> None:
        check_choice(self.loss, get_args(LossName), "loss")
        check_choice(self.optimiser, get_args(Optimiser), "optimiser")
        if self.regularisation is not None:
            check_choice(self.regularisation, get_args(Regularisation), "regularisation")
        if self.regularisation == "bayes" and self.optimiser == "gd":
            raise UsageError(
                "gradient descent takes early stopping; bayes needs second derivatives"
            )
        if self.regressor is not None:
            check_choice(self.regressor, tuple(REGRESSORS), "regressor")
        if self.regressor == GaussianProcess.id and self.optimiser == "gd":
            raise UsageError("gradient descent trains a network; a Gaussian process takes bayes")
        if self.regressor == GaussianProcess.id and self.regularisation == "early-stopping":
            raise UsageError("early stopping trains a network; a Gaussian process takes bayes")
        check_number(1 if self.hidden is None else self.hidden, "hidden nodes", 1)
        check_number(self.validation, "validation part", 0, below=1)
        check_whole(self.restarts, "restarts", 1)
        check_whole(self.folds, "folds", 2)
        check_whole(self.seed, "seed", 0)

    def resolved(self, base_model: str) -> "TrainingOptions":
        """The same with the regularisation that None stands for on a base model of this name."""
        if self.regularisation is not None:
            return self
        paper = self.optimiser == "gd" or base_model == "nominal"
        paper = paper and self.regressor != GaussianProcess.id
        return replace(self, regularisation="early-stopping" if paper else "bayes")

    @property
    def candidates(self) -> "tuple[TrainingOptions, ...]":
        """The same for every learned model that may be used, the network first."""
        if self.regressor is not None:
            return (self,)
        kinds = REGRESSORS if self.regularisation == "bayes" else (Network.id,)
        return tuple(replace(self, regressor=kind) for kind in kinds)


@dataclass(frozen=True, eq=False)
class TrainingReport:
    """Report of a training.

    history        of the best restart
    training_rows, validation_rows   indices of the configurations
    restart_losses (restarts,) validation loss of each (training loss without validation rows)
    loss_without   the same loss without a network
    effective      effective number of weights γ, mean of the networks (bayes),
                   otherwise all of them
    regressor, loss, optimiser, regularisation, hidden   the options as used
    """

    history: History
    training_rows: np.ndarray
    validation_rows: np.ndarray
    restart_losses: Array
    loss_without: float
    effective: float
    regressor: str
    loss: LossName
    optimiser: Optimiser
    regularisation: Regularisation
    hidden: int

    @property
    def loss_units(self) -> str:
        """E is weighted by the stated noise (task), or in joint motions (joint)."""
        return "1" if self.loss == "task" else "rad², m²"


def split_rows(
    count: int, validation: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Sorted indices (k,) and (count − k,) of the training and validation rows."""
    order = rng.permutation(count)
    held = round(count * validation)
    return np.sort(order[held:]), np.sort(order[:held])


def train_networks(
    q: Array,
    G: Array,
    y: Array,
    options: TrainingOptions,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> tuple[tuple[Regressor, ...], TrainingReport]:
    """Fit N to y ≈ G N. Returns an ensemble of networks (bayes), one network or Gaussian process,
    or none where it does not help.

    q (K, n) in rad or m; G (K, d, p) = Σ^(−1/2) P J_ρ; y (K, d) weighted residuals of the base
    model.
    """
    regularisation = options.regularisation or "early-stopping"
    bayes = regularisation == "bayes"
    training_rows, validation_rows = split_rows(len(q), 0.0 if bayes else options.validation, rng)
    loss = (task_loss if options.loss == "task" else joint_loss)(q, G, y)
    training = loss.rows(training_rows)
    validation = loss.rows(validation_rows) if len(validation_rows) else None
    output_scale = _output_scale(G[training_rows], y[training_rows])
    if options.regressor == GaussianProcess.id:
        runs = [fit_gaussian_process(training, output_scale, options.hidden)]
    else:
        runs = _trained_networks(training, validation, output_scale, options, rng, progress)
    histories = [member.history for member in runs]
    scores = np.array(
        [(h.training if validation is None else h.validation)[h.chosen] for h in histories]
    )
    best = int(np.argmin(scores))
    without = (training if validation is None else validation).without_network
    report = TrainingReport(
        history=histories[best],
        training_rows=training_rows,
        validation_rows=validation_rows,
        restart_losses=scores,
        loss_without=without,
        effective=float(np.mean([member.effective for member in runs])),
        regressor=runs[0].network.id,
        loss=options.loss,
        optimiser=options.optimiser,
        regularisation=regularisation,
        hidden=runs[0].network.hidden,
    )
    if bayes:
        return tuple(member.network for member in runs if member.effective > 0.0), report
    return ((runs[best].network,) if scores[best] < without else ()), report


def _trained_networks(
    training: Loss,
    validation: Loss | None,
    output_scale: Array,
    options: TrainingOptions,
    rng: np.random.Generator,
    progress: Progress,
) -> list[BayesianRun]:
    """A network from every start; all weights are effective where no evidence says otherwise."""
    n = training.q.shape[1]
    hidden = Network.size_for(n) if options.hidden is None else options.hidden
    streams = rng.spawn(options.restarts)
    starts = [Network.initial(training.q, output_scale, hidden, stream) for stream in streams]
    if options.regularisation == "bayes":
        return [train_bayesian(start, training) for start in progress(starts, "networks")]
    steps, stopping = _ITERATIONS[options.optimiser]
    found = []
    for start in progress(starts, "networks"):
        network, history = run(steps, start, training, validation, stopping)
        found.append(BayesianRun(network, history, float(len(start.weights)), 1.0))
    return found


def _output_scale(G: Array, y: Array) -> Array:
    """Typical magnitude (p,) of each joint motion error: RMS of a damped solution."""
    transposed = np.swapaxes(G, -1, -2)
    gram = transposed @ G
    size = np.trace(gram, axis1=-2, axis2=-1)[:, None, None] / gram.shape[-1]
    damped = np.linalg.solve(
        gram + 1e-2 * size * np.eye(gram.shape[-1]), transposed @ y[..., None]
    )[..., 0]
    typical: Array = np.sqrt(np.mean(damped**2, axis=0))
    return np.maximum(typical, 1e-9)
