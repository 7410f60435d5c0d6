"""Figures of errors: per configuration (Fig. 5), distribution, in the workspace, ISO 9283."""

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibtool.errors import InputError
from calibtool.evaluation.acceptance import Limit
from calibtool.evaluation.compare import Evaluation
from calibtool.evaluation.plots.style import (
    COLOURS,
    INK,
    MANY,
    colour,
    label,
    legend,
    line,
    log_scale,
    mark,
    panels,
    sheet,
)
from calibtool.measurement.sampling import spread_rows
from calibtool.robot.se3 import Array

_ARROWS = 150  # number of arrows in a panel
_LONG = 0.08  # of the box: largest length of the median arrow
_STEPS = (1, 1.5, 2, 3, 4, 5, 6, 8)
_WIDE_MM = 120.0
_BOTTOM_MM = 10.0
_NOISE = "noise of the measurement"

Errors = list[tuple[str, Array]]
Floors = Mapping[str, float | None]


def _quantities(evaluation: Evaluation) -> list[tuple[str, str, Errors]]:
    """Name, axis label and errors (N,) of every method in mm and, if measured, mrad."""
    result = [
        (
            "position",
            "position error, mm",
            [(m.name, m.position_size * 1e3) for m in evaluation.methods],
        )
    ]
    turns = [
        (m.name, m.orientation_size * 1e3)
        for m in evaluation.methods
        if m.orientation_size is not None
    ]
    return [*result, ("orientation", "orientation error, mrad", turns)] if turns else result


def errors(evaluation: Evaluation, width_mm: float, floors: Floors) -> Figure:
    """Position and orientation errors of every configuration and their spread.

    floors: what the noise alone gives, in mm and mrad, None where it is not in the errors.
    """
    quantities = _quantities(evaluation)
    wide = width_mm >= _WIDE_MM
    rows = len(quantities) if wide else 2 * len(quantities)
    figure = sheet(width_mm, 50.0 * rows + _BOTTOM_MM)
    grid = figure.subplots(
        rows, 2 if wide else 1, squeeze=False, width_ratios=(3, 1) if wide else None
    )
    for k, (quantity, axis, errors) in enumerate(quantities):
        points, boxes = grid[k] if wide else grid[2 * k : 2 * k + 2, 0]
        _points_and_boxes(points, boxes, errors, axis)
        _floor((points.axhline, boxes.axhline), floors.get(quantity))
        if not wide or k == len(quantities) - 1:
            points.set_xlabel("configuration")
    legend(figure, grid[0][0], 5 if wide else 2)
    return figure


def _points_and_boxes(points: Axes, boxes: Axes, errors: Errors, axis: str) -> None:
    count = len(errors[0][1])
    for i, (name, values) in enumerate(errors):
        points.plot(
            np.arange(1, count + 1),
            values,
            linestyle="none",
            markersize=2.5 if count <= 200 else 1.2,
            markeredgewidth=0,
            label=label(name),
            rasterized=count > MANY,
            **mark(i),
        )
    drawn = boxes.boxplot(
        [values for _, values in errors], whis=(0, 100), widths=0.6, patch_artist=True
    )
    for i, box in enumerate(drawn["boxes"]):
        box.set_facecolor(colour(i))
    boxes.set_xticks(
        range(1, len(errors) + 1), [label(name, 14) for name, _ in errors], rotation=30, ha="right"
    )
    for panel in (points, boxes):
        log_scale(panel, "y", [values for _, values in errors])
        panel.grid(axis="y")
    boxes.set_ylim(points.get_ylim())
    points.set_ylabel(axis)


def _floor(draw: tuple[Callable[..., object], ...], value: float | None) -> None:
    """Mark what the noise alone gives, by axhline or axvline of panels."""
    for each in draw if value is not None else ():
        each(value, color=COLOURS[0], linestyle=(0, (6, 3)), linewidth=0.8, zorder=0, label=_NOISE)


def distribution(
    evaluation: Evaluation, limits: tuple[Limit, ...], width_mm: float, floors: Floors
) -> Figure:
    """Which part of the configurations has at most which error, with the limits and floors."""
    quantities = _quantities(evaluation)
    figure, axes = panels(width_mm, len(quantities), (80.0, 58.0), _BOTTOM_MM)
    for panel, (quantity, axis, errors) in zip(axes, quantities, strict=True):
        own = [limit for limit in limits if limit.quantity == quantity]
        for i, (name, values) in enumerate(errors):
            part = np.arange(1, len(values) + 1) / len(values) * 100
            panel.step(np.sort(values), part, where="post", **line(i), label=label(name))
        _floor((panel.axvline,), floors.get(quantity))
        for limit in own:
            panel.axvline(limit.value, color=INK, linestyle=":")
            text = f"{limit.statistic} ≤ {limit.value:g} {limit.unit}"
            panel.annotate(
                text, (limit.value, 3), (2, 0), textcoords="offset points", rotation=90, fontsize=6
            )
        log_scale(
            panel,
            "x",
            [values for _, values in errors] + [np.array([limit.value for limit in own])],
        )
        panel.set(xlabel=axis, ylabel="configurations, %", ylim=(0, 101))
        panel.grid()
    legend(figure, axes[0], 5 if width_mm >= _WIDE_MM else 2)
    return figure


def vectors(evaluation: Evaluation, position: Array, width_mm: float) -> Figure:
    """Magnified errors as arrows at tool positions (N, 3), m in K_0, in three views."""
    methods = evaluation.methods
    figure = sheet(width_mm, len(methods) * (width_mm / 3.1 + 6.0))
    grid = figure.subplots(len(methods), 3, squeeze=False)
    rows = spread_rows(len(position), _ARROWS)
    extent = max(float(np.ptp(position, axis=0).max()), 1e-3)
    for i, method in enumerate(methods):
        error = method.position.mean(axis=1)
        factor = magnification(extent, error)
        for panel, (a, b) in zip(grid[i], ((0, 1), (0, 2), (1, 2)), strict=True):
            arrows = (
                position[rows, a],
                position[rows, b],
                factor * error[rows, a],
                factor * error[rows, b],
            )
            panel.quiver(
                *arrows,
                angles="xy",
                scale_units="xy",
                scale=1,
                color=colour(i),
                width=0.005,
                headwidth=4,
                headlength=4,
            )
            tips_a, tips_b = (position[rows, k] + factor * error[rows, k] for k in (a, b))
            panel.update_datalim(np.column_stack([tips_a, tips_b]))
            panel.autoscale_view()
            panel.set_aspect("equal", adjustable="datalim")
            panel.grid()
            if i == len(methods) - 1:
                panel.set_xlabel(f"{'xyz'[a]}, m")
            panel.set_ylabel(f"{'xyz'[b]}, m")
        grid[i][1].set_title(f"{label(method.name)}: errors × {factor:,g}")
    return figure


def magnification(extent: float, error: Array) -> float:
    """A round factor, at least 1, that makes the median of errors (N, 3) 5 to 8 % of the extent."""
    median = float(np.median(np.linalg.norm(error, axis=-1)))
    if not median > 0:
        return 1.0
    wanted = max(_LONG * extent / median, 1.0)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(step for step in _STEPS if step * power <= wanted * (1 + 1e-9)))


def pose_test(evaluation: Evaluation, width_mm: float) -> Figure:
    """Pose accuracy AP of every method and repeatability RP at every repeated pose.

    InputError where nothing is repeated.
    """
    test = evaluation.pose_test
    if test is None:
        raise InputError(
            "no configuration was measured at least three times, so there is no AP and RP "
            "after ISO 9283"
        )
    shown = [("position, mm", test.accuracy, test.repeatability)]
    if test.accuracy_turn is not None and test.repeatability_turn is not None:
        shown.append(("orientation, mrad", test.accuracy_turn, test.repeatability_turn))
    figure, axes = panels(width_mm, len(shown), (80.0, 58.0), _BOTTOM_MM)
    x = np.arange(len(test.poses))
    few = len(x) <= 12
    for panel, (axis, accuracy, repeatability) in zip(axes, shown, strict=True):
        for i, name in enumerate(test.methods):
            shift = (i - (len(test.methods) - 1) / 2) * 0.6 / len(test.methods)
            panel.plot(
                x + shift,
                accuracy[i] * 1e3,
                linestyle="none",
                markersize=4,
                label=f"AP {label(name)}",
                **mark(i),
            )
        panel.plot(
            x, repeatability * 1e3, "_", color=INK, markersize=12, markeredgewidth=1.5, label="RP"
        )
        log_scale(panel, "y", [accuracy * 1e3, repeatability * 1e3])
        panel.set_ylabel(axis)
        panel.grid(axis="y")
        if few:
            panel.set_xticks(
                x,
                [pose.name for pose in test.poses],
                rotation=0 if len(test.poses[0].name) < 4 else 30,
            )
        else:
            panel.set_xlabel("repeated pose")
    legend(figure, axes[0], 5 if width_mm >= _WIDE_MM else 2)
    return figure
