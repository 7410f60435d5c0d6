"""The paper's figures: the training curve (Fig. 4) and errors per configuration, methods side by side (Fig. 5)."""

import io
from typing import Literal

import matplotlib
import numpy as np

matplotlib.use("Agg")

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator

from calibtool.calibration import Calibration
from calibtool.errors import InputError, UsageError
from calibtool.evaluation.compare import Evaluation
from calibtool.evaluation.study.summary import GROUP, groups, numbers
from calibtool.evaluation.study.table import Cell, StudyTable
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


_GROUPING = ("robot", "errors", "error_scale", "noise_mm", "configurations")


def draw_study(table: StudyTable, image: ImageFormat) -> bytes:
    """Mean and largest error of every run as boxes, methods side by side, one block of boxes per combination.

    Boxes span the quartiles, whiskers 5 % to 95 %; every other run is a dot.
    """
    rows = groups(table)
    methods = list(dict.fromkeys(str(cells[GROUP.index("method")]) for cells in rows))
    blocks = list(dict.fromkeys(cells[:-1] for cells in rows))
    oriented = any(cell is not None for cell in table.column("orientation_max_mrad"))
    quantities = [("position", "mm"), ("orientation", "mrad")] if oriented else [("position", "mm")]
    width = min(max(5.0, 1.6 + 0.55 * len(methods) * len(blocks)), 16.0)
    figure = Figure(figsize=(min(2 * width, 16.0), 3.4 * len(quantities)), layout="constrained")
    panels = figure.subplots(len(quantities), 2, squeeze=False, sharex=True, sharey="row")
    for row, (quantity, unit) in zip(panels, quantities, strict=True):
        for panel, statistic in zip(row, ("mean", "max"), strict=True):
            column = f"{quantity}_{statistic}_{unit}"
            for i, method in enumerate(methods):
                values = [numbers(rows[*block, method], column) for block in blocks]
                _boxes(panel, values, i, len(methods))
            panel.set(yscale="log", title=f"{'largest' if statistic == 'max' else 'mean'} {quantity} error of a run")
            panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            panel.tick_params(labelleft=True)
            panel.grid(axis="y", alpha=0.3, which="both", linewidth=0.4)
        row[0].set_ylabel(unit)
    _name_blocks(panels[-1], blocks, methods)
    names = ", ".join(dict.fromkeys(map(str, table.column("robot"))))
    figure.suptitle(f"{names}: {len(next(iter(rows.values())))} robots" + (" each" if len(blocks) > 1 else ""))
    if len(blocks) > 1:
        handles = [
            Patch(facecolor=_COLOURS[i % len(_COLOURS)], alpha=0.55, edgecolor="black", label=method)
            for i, method in enumerate(methods)
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=min(len(methods), 6))
    return _save(figure, image)


def _boxes(panel: Axes, values: list[list[float]], place: int, count: int) -> None:
    """The boxes of one method, one per block."""
    colour, marker = _COLOURS[place % len(_COLOURS)], _MARKERS[place % len(_MARKERS)]
    positions = [(count + 1) * block + place + 1 for block in range(len(values))]
    panel.boxplot(
        values,
        positions=positions,
        widths=0.7,
        whis=(5, 95),
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": colour, "alpha": 0.55},
        medianprops={"color": "black"},
        flierprops={"marker": marker, "markersize": 2.5, "markerfacecolor": colour, "markeredgecolor": "none"},
    )


def _name_blocks(panels: np.ndarray, blocks: list[tuple[Cell, ...]], methods: list[str]) -> None:
    """Ticks: the methods' names when there is one block, otherwise what distinguishes the blocks."""
    if len(blocks) == 1:
        ticks, names = [place + 1.0 for place in range(len(methods))], methods
    else:
        ticks = [(len(methods) + 1) * block + (len(methods) + 1) / 2 for block in range(len(blocks))]
        places = [GROUP.index(name) for name in _GROUPING if len({block[GROUP.index(name)] for block in blocks}) > 1]
        names = ["\n".join(_named(GROUP[place], block[place]) for place in places) for block in blocks]
    for panel in panels:
        panel.set_xticks(
            ticks, names, fontsize="small", **({"rotation": 20, "ha": "right"} if len(blocks) == 1 else {})
        )


def _named(name: str, cell: Cell) -> str:
    if isinstance(cell, str):
        return cell
    return {"error_scale": f"errors × {cell:g}", "noise_mm": f"noise {cell:g} mm"}.get(name, f"{cell} configurations")
