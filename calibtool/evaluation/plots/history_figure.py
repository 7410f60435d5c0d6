"""Chart of a monitored arm: residuals of every check over what is expected, alarms marked."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calibtool.evaluation.plots.style import (
    COLOURS,
    WIDTH_MM,
    ImageFormat,
    label,
    sheet,
    styled,
    to_bytes,
)

_NAMED = 20  # number of checks whose dates fit below the axis


def draw_history(entries: list[dict[str, Any]], image: ImageFormat) -> bytes:
    """The chart of lines of a history (`monitor --json`), as the bytes of a picture."""
    with styled():
        return to_bytes(history_figure(entries), image)


def history_figure(entries: list[dict[str, Any]]) -> Figure:
    """Residual rms per coordinate of every check, in mm, beside the expected one; an alarm has a
    cross and the name of its likely cause.
    """
    figure = sheet(WIDTH_MM, 75.0)
    panel = figure.subplots()
    x = np.arange(1, len(entries) + 1)
    residual = np.array([entry["residual_rms_mm"] for entry in entries])
    expected = np.array([entry["expected_rms_mm"] for entry in entries])
    alarm = np.array([bool(entry["alarm"]) for entry in entries])
    panel.plot(x, expected, color=COLOURS[0], linestyle="--", label="expected", marker="_")
    panel.plot(x, residual, color=COLOURS[1], marker="o", markersize=4, label="residual")
    if alarm.any():
        panel.plot(
            x[alarm],
            residual[alarm],
            "X",
            color=COLOURS[2],
            markersize=8,
            label="alarm",
            linestyle="none",
        )
    for k in np.flatnonzero(alarm):
        text = " or ".join(entries[k]["likely"][:2])
        panel.annotate(
            label(text), (x[k], residual[k]), (0, 6), textcoords="offset points", ha="center"
        )
    names = [label(str(entry.get("date") or k + 1), 12) for k, entry in enumerate(entries)]
    step = -(-len(names) // _NAMED)
    panel.set_xticks(x[::step], names[::step], rotation=30 if len(names) > 6 else 0)
    panel.set(ylabel="residual rms per coordinate, mm", xlabel="check")
    panel.margins(x=0.08, y=0.15)
    panel.set_ylim(bottom=0)
    panel.set_title(label(str(entries[-1]["robot"])))
    panel.grid(axis="y")
    panel.legend(loc="upper left")
    return figure
