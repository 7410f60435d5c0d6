"""Style of the figures and their files: one type size, one palette, no dates."""

import io
import warnings
from contextlib import AbstractContextManager
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from calibtool.errors import UsageError

ImageFormat = Literal["png", "svg", "pdf"]
IMAGE_FORMATS: tuple[ImageFormat, ...] = ("png", "svg", "pdf")

WIDTH_MM = 180.0  # two columns of most journals; one column is 85 mm
MM = 1 / 25.4

INK, GRID, SHADE = "#1b1c1d", "#c9cacb", "#e1e2e3"
# Okabe and Ito's colours, which colour-blind readers can distinguish; the nominal robot is grey.
COLOURS = ("#777777", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

MANY = 1000  # with more marks than this in a panel, they become an image inside the drawing

_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same font on every machine
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "figure.titlesize": 8,
    "axes.linewidth": 0.6,
    "axes.axisbelow": True,
    "lines.linewidth": 1.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "grid.linewidth": 0.4,
    "grid.color": GRID,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "boxplot.boxprops.color": INK,
    "boxplot.whiskerprops.color": INK,
    "boxplot.capprops.color": INK,
    "boxplot.medianprops.color": INK,
    "boxplot.flierprops.markeredgecolor": INK,
    "svg.hashsalt": "calibtool",
    "pdf.fonttype": 42,  # whole TrueType letters, as journals ask
    "savefig.dpi": 300,
}
# Program names and dates that the formats would contain.
_NO_METADATA = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def image_format(name: str) -> ImageFormat:
    """The format that a file's name asks for. UsageError unless it is .png, .svg or .pdf."""
    for image in IMAGE_FORMATS:
        if name.lower().endswith(f".{image}"):
            return image
    raise UsageError(f"{name}: plots are written as .png, .svg or .pdf")


def styled() -> AbstractContextManager[None]:
    """The style, while figures are drawn and saved."""
    return matplotlib.rc_context({**matplotlib.rcParamsDefault, **_STYLE, "backend": "agg"})


def sheet(width_mm: float, height_mm: float) -> Figure:
    """An empty figure."""
    return Figure(figsize=(width_mm * MM, height_mm * MM), layout="constrained")


def panels(
    width_mm: float, count: int, panel_mm: tuple[float, float], head_mm: float = 8.0
) -> tuple[Figure, list[Axes]]:
    """Equal panels of at least panel_mm (width, height); head_mm is kept for a legend."""
    across = max(1, min(count, int(width_mm // panel_mm[0])))
    down = -(-count // across)
    figure = sheet(width_mm, down * panel_mm[1] + head_mm)
    axes = list(figure.subplots(down, across, squeeze=False).flat)
    for empty in axes[count:]:
        empty.remove()
    return figure, axes[:count]


def mark(i: int) -> dict[str, Any]:
    """Colour and marker of the i-th method; 0 is the nominal robot."""
    return {"color": colour(i), "marker": MARKERS[i % len(MARKERS)]}


def colour(i: int) -> str:
    """Colour of the i-th method; 0 is the nominal robot."""
    return COLOURS[0] if i == 0 else COLOURS[1 + (i - 1) % (len(COLOURS) - 1)]


def line(i: int) -> dict[str, Any]:
    """Colour and line style of the i-th method."""
    return {"color": colour(i), "linestyle": ("-", "--", "-.", ":")[i % 4]}


def label(name: str, longest: int = 28) -> str:
    """A name from a file as matplotlib shows it: no mathematics ($), not hidden (_), not long."""
    shown = name if len(name) <= longest else f"{name[: longest - 1]}…"
    return f"{' ' if shown.startswith('_') else ''}{shown}".replace("$", r"\$")


def legend(figure: Figure, axes: Axes, across: int = 4) -> None:
    """One legend above all panels."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside upper center",
        ncols=max(1, min(len(labels), across)),
        markerscale=2,
    )


def log_scale(axes: Axes, axis: Literal["x", "y"], values: list[np.ndarray]) -> None:
    """A logarithmic axis with plain numbers if a value is above zero; values: (N,) or (N, m)."""
    every = np.concatenate([np.ravel(v) for v in values])
    positive = every[np.isfinite(every) & (every > 0)]
    if not len(positive):
        return
    (axes.set_xscale if axis == "x" else axes.set_yscale)("log")
    decades = np.log10(positive.max() / positive.min())
    subs = tuple(range(1, 10)) if decades < 0.7 else (1.0, 2.0, 5.0) if decades < 3 else (1.0,)
    chosen = axes.xaxis if axis == "x" else axes.yaxis
    chosen.set_major_locator(LogLocator(subs=subs, numticks=12))
    chosen.set_minor_locator(NullLocator())
    chosen.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def to_bytes(figure: Figure, image: ImageFormat, *, letters: bool = False) -> bytes:
    """The picture, always the same bytes. letters: text of an SVG stays text."""
    buffer = io.BytesIO()
    with (
        warnings.catch_warnings(),
        matplotlib.rc_context({"svg.fonttype": "none" if letters else "path"}),
    ):
        warnings.filterwarnings(
            "ignore", message="Glyph .* missing"
        )  # names of files can contain any character
        figure.savefig(buffer, format=image, metadata=_NO_METADATA[image], transparent=letters)
    return buffer.getvalue()
