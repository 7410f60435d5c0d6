"""A picture of an arm at the home of its default workspace: three views, joint axes, base and tool frames, targets."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibtool.robot.model import Robot
from calibtool.robot.poe import poe_frames
from calibtool.robot.se3 import Array, transform_points

# Okabe and Ito's colours, told apart by colour-blind readers; kinds differ in marker and line as well.
_LINK, _REVOLUTE, _PRISMATIC, _TARGET = "#444444", "#0072B2", "#D55E00", "#CC79A7"
_X, _Y, _Z = "#D55E00", "#009E73", "#0072B2"
_VIEWS = (("front", 0, 2), ("side", 1, 2), ("top", 0, 1))  # name, horizontal and vertical axis of K_0


def arm_figure(robot: Robot) -> Figure:
    """The nominal arm in orthogonal views of K_0, mm: front x–z, side y–z, top x–y."""
    workspace_name, workspace = robot.workspace(None)
    q = robot.home(workspace)
    frames = poe_frames(robot.chain.placements, robot.chain.twists, q[None])
    before, tool = frames.before[0], frames.tool[0]
    origins = np.concatenate([np.zeros((1, 3)), frames.after[0, :, :3, 3], tool[None, :3, 3]])
    twists = np.where(np.array(robot.prismatic)[:, None], robot.chain.twists[:, :3], robot.chain.twists[:, 3:])
    axes = (before[:, :3, :3] @ twists[..., None])[..., 0]
    targets = transform_points(tool, robot.targets)
    size = float(np.ptp(np.concatenate([origins, targets]), axis=0).max())

    figure = Figure(figsize=(13.0, 5.4), layout="constrained")
    panels = figure.subplots(1, 3)
    home = ", ".join(
        f"{column} {value:.4g}" for column, value in zip(robot.joint_columns, _shown(robot, q), strict=True)
    )
    figure.suptitle(f"{robot.name} at home of {workspace_name}: {home}", fontsize="medium")
    for panel, (name, across, up) in zip(panels, _VIEWS, strict=True):
        _view(panel, robot, origins, axes, tool, targets, size, (across, up))
        panel.set(title=name, xlabel=f"{'xyz'[across]} of K_0, mm", ylabel=f"{'xyz'[up]} of K_0, mm")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize="small")
    return figure


def _view(
    panel: Axes,
    robot: Robot,
    origins: Array,
    axes: Array,
    tool: Array,
    targets: Array,
    size: float,
    plane: tuple[int, int],
) -> None:
    flat = origins[:, plane] * 1e3
    panel.plot(*flat.T, color=_LINK, linewidth=3.0, solid_capstyle="round", zorder=1, label="links")
    named: set[str] = set()
    for j, prismatic in enumerate(robot.prismatic):
        kind, colour, marker = ("prismatic", _PRISMATIC, "s") if prismatic else ("revolute", _REVOLUTE, "o")
        point, along = flat[j + 1], axes[j][list(plane)] * size * 1e3 * 0.09
        label: dict[str, Any] = {"label": f"{kind} joint and axis"} if kind not in named else {}
        named.add(kind)
        panel.plot(*np.stack([point - along, point + along]).T, color=colour, linewidth=1.4, zorder=2, linestyle="--")
        panel.plot(
            *point,
            marker=marker,
            color=colour,
            markeredgecolor="white",
            markersize=7,
            zorder=3,
            linestyle="none",
            **label,
        )
    panel.plot(
        *(targets[:, plane] * 1e3).T,
        marker="*",
        color=_TARGET,
        markeredgecolor="black",
        markeredgewidth=0.5,
        markersize=11,
        linestyle="none",
        zorder=4,
        label="targets",
    )
    _frame(panel, np.eye(4), size, plane, named_axes=True)
    _frame(panel, tool, size, plane, named_axes=False)
    panel.set_aspect("equal", adjustable="datalim")
    panel.margins(0.15)
    panel.grid(alpha=0.3)
    _label_points(panel, flat, robot.n)


def _frame(panel: Axes, pose: Array, size: float, plane: tuple[int, int], named_axes: bool) -> None:
    """The axes of a frame as arrows, x y z in colours that the legend names."""
    start = pose[:3, 3][list(plane)] * 1e3
    for axis, (name, colour) in enumerate(zip("xyz", (_X, _Y, _Z), strict=True)):
        end = start + pose[:3, axis][list(plane)] * size * 1e3 * 0.13
        style: dict[str, Any] = {"label": f"{name} of base and tool frame"} if named_axes else {}
        panel.plot(*np.stack([start, end]).T, color=colour, linewidth=2.2, zorder=5, **style)


def _label_points(panel: Axes, flat: Array, n: int) -> None:
    """Names beside the points; those of points that coincide in this view share one label."""
    names = ["base", *(f"j{j + 1}" for j in range(n)), "tool"]
    near = 0.02 * float(np.ptp(flat, axis=0).max())
    groups: list[tuple[Array, list[str]]] = []
    for point, name in zip(flat, names, strict=True):
        for place, members in groups:
            if np.linalg.norm(place - point) <= near:
                members.append(name)
                break
        else:
            groups.append((point, [name]))
    for point, members in groups:
        panel.annotate(
            ", ".join(members),
            (float(point[0]), float(point[1])),
            xytext=(9, 7),
            textcoords="offset points",
            fontsize="small",
            zorder=6,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.75},
        )


def _shown(robot: Robot, q: Array) -> Array:
    """Joint positions in mm or deg."""
    return q * np.where(robot.prismatic, 1e3, 180.0 / np.pi)
