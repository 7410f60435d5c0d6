"""A study's errors as boxes: methods side by side, a block per combination."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from calibtool.evaluation.plots.style import (
    WIDTH_MM,
    ImageFormat,
    colour,
    log_scale,
    mark,
    sheet,
    styled,
    to_bytes,
)
from calibtool.evaluation.study.statistics import GROUP, groups, numbers
from calibtool.evaluation.study.study_table import Cell, StudyTable

_GROUPING = ("robot", "errors", "error_scale", "noise_mm", "configurations")


def draw_study(table: StudyTable, image: ImageFormat) -> bytes:
    """The boxes as the bytes of a picture."""
    with styled():
        return to_bytes(study_figure(table), image)


def study_figure(table: StudyTable) -> Figure:
    """Mean and largest error of every run as boxes, methods side by side, one block of boxes
    per combination.

    Boxes span the quartiles, whiskers 5 % to 95 %; every other run is a dot.
    """
    rows = groups(table)
    methods = list(dict.fromkeys(str(cells[GROUP.index("method")]) for cells in rows))
    blocks = list(dict.fromkeys(cells[:-1] for cells in rows))
    oriented = any(cell is not None for cell in table.column("orientation_max_mrad"))
    quantities = [("position", "mm"), ("orientation", "mrad")] if oriented else [("position", "mm")]
    figure = sheet(
        float(np.clip(35 + 14 * len(methods) * len(blocks), WIDTH_MM, 400)), 65.0 * len(quantities)
    )
    panels = figure.subplots(len(quantities), 2, squeeze=False, sharex=True, sharey="row")
    for row, (quantity, unit) in zip(panels, quantities, strict=True):
        shown = [
            np.array(numbers(table.rows, f"{quantity}_{statistic}_{unit}"))
            for statistic in ("mean", "max")
        ]
        for panel, statistic in zip(row, ("mean", "max"), strict=True):
            column = f"{quantity}_{statistic}_{unit}"
            for i, method in enumerate(methods):
                values = [numbers(rows[*block, method], column) for block in blocks]
                _boxes(panel, values, i, len(methods))
            panel.set_title(
                f"{'largest' if statistic == 'max' else 'mean'} {quantity} error of a run"
            )
            log_scale(panel, "y", shown)
            panel.tick_params(labelleft=True)
            panel.grid(axis="y")
        row[0].set_ylabel(unit)
    _name_blocks(panels[-1], blocks, methods)
    names = ", ".join(dict.fromkeys(map(str, table.column("robot"))))
    figure.suptitle(
        f"{names}: {len(next(iter(rows.values())))} robots" + (" each" if len(blocks) > 1 else "")
    )
    if len(blocks) > 1:
        handles = [
            Patch(facecolor=colour(i), alpha=0.55, edgecolor="black", label=method)
            for i, method in enumerate(methods)
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=min(len(methods), 6))
    return figure


def _boxes(panel: Axes, values: list[list[float]], place: int, count: int) -> None:
    """The boxes of one method, one per block."""
    positions = [(count + 1) * block + place + 1 for block in range(len(values))]
    panel.boxplot(
        values,
        positions=positions,
        widths=0.7,
        whis=(5, 95),
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": colour(place), "alpha": 0.55},
        medianprops={"color": "black"},
        flierprops={
            "marker": mark(place)["marker"],
            "markersize": 2.5,
            "markerfacecolor": colour(place),
            "markeredgecolor": "none",
        },
    )


def _name_blocks(panels: np.ndarray, blocks: list[tuple[Cell, ...]], methods: list[str]) -> None:
    """Ticks: names of methods for one block, otherwise what distinguishes the blocks."""
    if len(blocks) == 1:
        ticks, names = [place + 1.0 for place in range(len(methods))], methods
    else:
        ticks = [
            (len(methods) + 1) * block + (len(methods) + 1) / 2 for block in range(len(blocks))
        ]
        places = [
            GROUP.index(name)
            for name in _GROUPING
            if len({block[GROUP.index(name)] for block in blocks}) > 1
        ]
        names = [
            "\n".join(_named(GROUP[place], block[place]) for place in places) for block in blocks
        ]
    for panel in panels:
        panel.set_xticks(
            ticks,
            names,
            fontsize="small",
            **({"rotation": 20, "ha": "right"} if len(blocks) == 1 else {}),
        )


def _named(name: str, cell: Cell) -> str:
    if isinstance(cell, str):
        return cell
    return {"error_scale": f"errors × {cell:g}", "noise_mm": f"noise {cell:g} mm"}.get(
        name, f"{cell} configurations"
    )
