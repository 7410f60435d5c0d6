"""The paper's figures: the training curve (Fig. 4) and errors per configuration, methods side by side (Fig. 5)."""

import io
from typing import Literal

import matplotlib
import numpy as np

matplotlib.use("Agg")

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from calibtool.calibration import Calibration
from calibtool.errors import InputError, UsageError
from calibtool.evaluation.arm_picture import arm_figure
from calibtool.evaluation.compare import Evaluation
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array

ImageFormat = Literal["png", "svg"]

# Okabe and Ito's colours, told apart by colour-blind readers; the nominal robot is grey.
_COLOURS = ("#777777", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def image_format(name: str) -> ImageFormat:
    """The format that a file's name asks for. UsageError unless it is .png or .svg."""
    for image in ("png", "svg"):
        if name.lower().endswith(f".{image}"):
            return image
    raise UsageError(f"{name}: plots are written as .png or .svg")


def draw_training(calibrations: list[tuple[str, Calibration]], image: ImageFormat) -> bytes:
    """Loss on the training and the validation rows over the iterations, one panel per calibration."""
    trained = [(name, c.training) for name, c in calibrations if c.training is not None]
    if not trained:
        raise InputError(f"{calibrations[0][0]}: has no network, so there is no training to draw")
    figure = Figure(figsize=(6.4 * len(trained), 4.0), layout="constrained")
    panels = figure.subplots(1, len(trained), squeeze=False)[0]
    for panel, (name, training) in zip(panels, trained, strict=True):
        history = training.history
        iterations = np.arange(len(history.training))
        panel.semilogy(iterations, history.training, color=_COLOURS[1], label="training")
        if len(training.validation_rows):
            panel.semilogy(iterations, history.validation, color=_COLOURS[2], label="validation")
        panel.axhline(training.loss_without, color=_COLOURS[0], linestyle=":", label="without network")
        panel.axvline(history.chosen, color=_COLOURS[3], linestyle="--", label=f"kept: iteration {history.chosen}")
        weighted = "weighted squared error" if training.loss == "task" else "squared joint error"
        panel.set(
            title=f"{name}: {training.loss} loss, {training.optimiser}", xlabel="iteration", ylabel=f"mean {weighted}"
        )
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
        panel.grid(alpha=0.3)
        panel.legend()
    return _save(figure, image)


def draw_errors(evaluation: Evaluation, image: ImageFormat) -> bytes:
    """Position and orientation error of every configuration, and their distribution, methods side by side."""
    oriented = evaluation.methods[0].orientation is not None
    figure = Figure(figsize=(10.0, 6.4 if oriented else 3.6), layout="constrained")
    panels = figure.subplots(2 if oriented else 1, 2, squeeze=False, width_ratios=(3, 1))
    positions = [(m.name, m.position_size * 1e3) for m in evaluation.methods]
    _panel_row(panels[0], positions, "position error, mm")
    if oriented:
        turns = [(m.name, m.orientation_size * 1e3) for m in evaluation.methods if m.orientation_size is not None]
        _panel_row(panels[1], turns, "orientation error, mrad")
    panels[-1][0].set_xlabel("configuration")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 5))
    return _save(figure, image)


def draw_arm(robot: Robot, image: ImageFormat) -> bytes:
    """The arm at the home of its default workspace, see `arm_picture`."""
    return _save(arm_figure(robot), image)


def _panel_row(panels: np.ndarray, methods: list[tuple[str, Array]], label: str) -> None:
    points: Axes = panels[0]
    boxes: Axes = panels[1]
    size = 3.0 if len(methods[0][1]) <= 200 else 1.2
    for i, (name, values) in enumerate(methods):
        style = {"color": _COLOURS[i % len(_COLOURS)], "marker": _MARKERS[i % len(_MARKERS)]}
        points.semilogy(np.arange(1, len(values) + 1), values, linestyle="none", markersize=size, label=name, **style)
    boxes.boxplot([values for _, values in methods], whis=(0, 100), widths=0.6, medianprops={"color": "black"})
    boxes.set(yscale="log", ylim=points.get_ylim())
    boxes.set_xticks(
        range(1, len(methods) + 1), [name for name, _ in methods], rotation=30, ha="right", fontsize="small"
    )
    points.set_ylabel(label)
    for panel in (points, boxes):
        panel.grid(alpha=0.3, which="both", linewidth=0.4)


def _save(figure: Figure, image: ImageFormat) -> bytes:
    """The picture's bytes; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "calibtool", "svg.fonttype": "none"}):
        figure.savefig(buffer, format=image, dpi=150, metadata={"Date": None} if image == "svg" else {"Software": None})
    return buffer.getvalue()
