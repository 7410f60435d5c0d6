"""Figures of calibrations: training (Fig. 4), motions, parameters, rank, coverage."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from calibtool.calibration import Calibration
from calibtool.equivalent.gaussian_process import GaussianProcess
from calibtool.errormodel.harmonics import harmonic_functions
from calibtool.errors import InputError
from calibtool.evaluation.plots.style import (
    COLOURS,
    INK,
    MANY,
    SHADE,
    colour,
    label,
    legend,
    line,
    log_scale,
    mark,
    panels,
)
from calibtool.evaluation.wording import OPTIMISERS
from calibtool.identification.local_poe import RANK_TOLERANCE
from calibtool.identification.report import parameter_rows
from calibtool.measurement.sampling import spread_rows
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

Named = Sequence[tuple[str, Calibration]]
_DOTS = 500  # joint motions shown per joint
_LEAST = 1e-4  # of the limit: smaller singular values are drawn at this height
_NAMED = 45  # number of parameters that can be named along an axis


def training(calibrations: Named, width_mm: float) -> Figure:
    """Loss of networks on the training and the validation rows over the iterations.

    InputError where none was trained.
    """
    trained = [
        (f"{label(name)}{'' if c.networks else ' (not used)'}", c.training, bool(c.networks))
        for name, c in calibrations
        if c.training is not None and c.training.regressor != GaussianProcess.id
    ]
    if not trained:
        raise InputError("no network was trained, so there is no training to draw")
    figure, axes = panels(width_mm, len(trained), (80.0, 62.0), 2.0)
    for panel, (name, report, used) in zip(axes, trained, strict=True):
        history = report.history
        iterations = np.arange(len(history.training))
        curves = [history.training]
        panel.plot(iterations, history.training, color=COLOURS[1], label="training")
        if len(report.validation_rows):
            panel.plot(
                iterations, history.validation, color=COLOURS[2], linestyle="-.", label="validation"
            )
            curves.append(history.validation)
        panel.axhline(report.loss_without, color=COLOURS[0], linestyle=":", label="without network")
        panel.axvline(
            history.chosen,
            color=COLOURS[3],
            linestyle="--",
            label=f"{'kept' if used else 'best'}: iteration {history.chosen}",
        )
        log_scale(panel, "y", [*curves, np.array([report.loss_without])])
        weighted = "weighted squared error" if report.loss == "task" else "squared joint error"
        what = "pose" if report.loss == "task" else "joint"
        panel.set_title(f"{name}: {what} error, {OPTIMISERS[report.optimiser]}")
        panel.set(xlabel="iteration", ylabel=f"mean {weighted}")
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
        panel.grid()
        panel.legend()
    return figure


def joint_motions(calibration: Calibration, q: Array) -> Array:
    """δρ of the actuated joints (N, n) at q (N, n), rad or m, without constant offsets."""
    motion = calibration.base.errors.motion(q, calibration.conditions)
    return (
        motion
        if calibration.network is None
        else motion + calibration.network(q)[:, : calibration.robot.n]
    )


def motions(calibrations: Named, width_mm: float) -> Figure:
    """δρ of each joint against its position, at the configurations of the training; lines are the
    harmonics alone.

    InputError where no calibration has joint motions.
    """
    moving = [(i, name, c) for i, (name, c) in enumerate(calibrations, 1) if _moves(c)]
    if not moving:
        raise InputError(
            "no calibration has joint motions: neither harmonics nor gravity nor a network"
        )
    robot = moving[0][2].robot
    figure, axes = panels(width_mm, robot.n, (55.0, 42.0))
    for j, panel in enumerate(axes):
        factor, unit = robot.display_unit(j)
        for i, name, calibration in moving:
            q = calibration.q[spread_rows(len(calibration.q), _DOTS)]
            found = joint_motions(calibration, q)[:, j] * 1e3
            panel.plot(
                q[:, j] * factor,
                found,
                linestyle="none",
                markersize=1.8,
                markeredgewidth=0,
                label=label(name),
                rasterized=len(q) * len(moving) > MANY,
                **mark(i),
            )
            harmonics = calibration.base.errors["harmonics"]
            if harmonics[j].any():
                along = np.linspace(q[:, j].min(), q[:, j].max(), 300)
                curve = (
                    harmonic_functions(along[:, None], harmonics.shape[1] // 2)[:, 0] @ harmonics[j]
                )
                panel.plot(along * factor, curve * 1e3, color=colour(i), linewidth=0.8)
        panel.axhline(0, color=INK, linewidth=0.4)
        panel.set(
            xlabel=f"joint {j + 1}, {unit}",
            ylabel=f"δρ{j + 1}, {'mm' if robot.prismatic[j] else 'mrad'}",
        )
        panel.grid()
    legend(figure, axes[0])
    return figure


def _moves(calibration: Calibration) -> bool:
    return calibration.network is not None or bool(calibration.base.errors.beyond_geometry)


def parameters(calibrations: Named, width_mm: float) -> Figure:
    """Identified parameters ± 2 standard deviations, by family.

    InputError where no calibration has a posterior.
    """
    known = [(i, name, parameter_rows(c.base)) for i, (name, c) in enumerate(calibrations, 1)]
    known = [(i, name, rows) for i, name, rows in known if rows]
    if not known:
        raise InputError("only a complete model knows the uncertainty of its parameters")
    families: dict[tuple[str, str], list[str]] = {}
    for row in (row for _, _, rows in known for row in rows if row.family is not None):
        names = families.setdefault((str(row.family), row.unit), [])
        if row.name not in names:
            names.append(row.name)
    figure, axes = panels(width_mm, len(families), (max(80.0, width_mm * 0.45), 40.0))
    for panel, ((family, unit), names) in zip(axes, families.items(), strict=True):
        place = {name: k for k, name in enumerate(names)}
        for number, (i, name, rows) in enumerate(known):
            own = [row for row in rows if row.name in place and row.unit == unit]
            x = [
                place[row.name] + (number - (len(known) - 1) / 2) * 0.7 / len(known) for row in own
            ]
            bars = [2 * row.std for row in own]
            panel.errorbar(
                x,
                [row.value for row in own],
                bars,
                fmt=mark(i)["marker"],
                color=colour(i),
                markersize=2.2,
                markeredgewidth=0,
                elinewidth=0.7,
                label=label(name),
            )
        panel.axhline(0, color=INK, linewidth=0.4)
        panel.set_ylabel(f"{family}, {unit}")
        panel.grid(axis="y")
        if len(names) <= _NAMED:
            panel.set_xticks(range(len(names)), names, rotation=90, fontsize=5.5)
        else:
            panel.set_xlabel(f"{len(names)} parameters, {names[0]} … {names[-1]}")
    legend(figure, axes[0])
    return figure


def observability(calibrations: Named, width_mm: float) -> Figure:
    """Singular values of the identification, and the value below which nothing is determined.

    InputError without any.
    """
    known = [(i, name, c.base) for i, (name, c) in enumerate(calibrations, 1) if c.base.parameters]
    if not known:
        raise InputError("no base model was identified, so there are no singular values")
    figure, axes = panels(width_mm, len(known), (80.0, 55.0), 2.0)
    for panel, (i, name, base) in zip(axes, known, strict=True):
        s = base.singular_values
        floor = 1.0 if base.posterior is not None else RANK_TOLERANCE * float(s[0])
        shown = np.maximum(s, floor * _LEAST)
        panel.plot(
            np.arange(1, len(s) + 1),
            shown,
            linestyle="none",
            markersize=2.5,
            markeredgewidth=0,
            **mark(i),
        )
        panel.axhline(
            floor,
            color=INK,
            linestyle=":",
            label="above: determined" if floor == 1 else "limit of the rank",
        )
        log_scale(panel, "y", [shown])
        panel.set_title(
            f"{label(name)}: rank {base.rank} of {base.observable_rank}, "
            f"{base.parameters} parameters"
        )
        if (shown > s).any():
            panel.axhline(
                floor * _LEAST, color=INK, linewidth=0.4, label=f"{floor * _LEAST:.1g} or less"
            )
        panel.set(xlabel="combination of parameters", ylabel="singular value")
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
        panel.grid(axis="y")
        panel.legend(loc="upper right")
    return figure


def coverage(calibrations: Named, robot: Robot, judged: Array, width_mm: float) -> Figure:
    """Joints of the training (lines) and judged ones (N, n) (shade), between the limits."""
    figure, axes = panels(width_mm, robot.n, (55.0, 34.0))
    sets: list[tuple[int, str, Array]] = []
    for i, (name, calibration) in enumerate(calibrations, 1):
        same = next(
            (k for k, (_, _, q) in enumerate(sets) if np.array_equal(q, calibration.q)), None
        )
        if same is None:
            sets.append((i, name, calibration.q))
        else:
            sets[same] = (sets[same][0], f"{sets[same][1]}, {name}", calibration.q)
    for j, panel in enumerate(axes):
        factor, unit = robot.display_unit(j)
        every = np.concatenate([judged[:, j], *(q[:, j] for _, _, q in sets)]) * factor
        low, high = (
            min(robot.lower[j] * factor, every.min()),
            max(robot.upper[j] * factor, every.max()),
        )
        bins = np.linspace(low, high, 41).tolist()
        share = [
            np.full(len(judged), 100 / len(judged)),
            *(np.full(len(q), 100 / len(q)) for _, _, q in sets),
        ]
        panel.hist(judged[:, j] * factor, bins, weights=share[0], color=SHADE, label="judged")
        for k, ((i, name, q), weight) in enumerate(zip(sets, share[1:], strict=True)):
            panel.hist(
                q[:, j] * factor,
                bins,
                weights=weight,
                histtype="step",
                label=f"training of {label(name, 60)}",
                **{**line(k), "color": colour(i)},
            )
        panel.set(xlabel=f"joint {j + 1}, {unit}", xlim=(low, high))
        panel.set_ylabel("rows, %")
    legend(figure, axes[0], 3)
    return figure
