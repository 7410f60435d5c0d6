"""Picture of an arm at home: three views with joint axes, frames and targets."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from calibtool.evaluation.plots.style import ImageFormat, styled, to_bytes
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, transform_points
from calibtool.robot.skeleton import skeleton

# Colours of Okabe and Ito, for colour-blind readers; shapes differ, too.
_LINK, _AXIS, _TARGET = "#777777", "#CC79A7", "#E69F00"
_FRAME = (("x", "#D55E00"), ("y", "#009E73"), ("z", "#0072B2"))
# horizontal, vertical axis of K_0
_VIEWS = (
    ("from the side", 0, 2),
    ("from the front", 1, 2),
    ("from above", 0, 1),
)

# where labels may go
_AROUND = np.array([[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [1.3, 0.0], [-1.3, 0.0]])


@dataclass(frozen=True, eq=False)
class _Arm:
    """Points and directions in K_0, mm. links: a line through every joint; marks: joints."""

    prismatic: list[bool]
    links: Array
    marks: Array
    axes: tuple[Array, Array]  # both ends of every joint's axis; of a slide its stroke
    tool: Array  # (4, 4)
    targets: Array
    size: float


def draw_arm(robot: Robot, image: ImageFormat) -> bytes:
    """The arm at the home of its default workspace."""
    with styled():
        return to_bytes(arm_figure(robot), image)


def arm_figure(robot: Robot) -> Figure:
    """The nominal arm in orthogonal views of K_0, mm: x–z, y–z and x–y."""
    workspace = robot.workspace()
    q = workspace.home
    arm = _arm(robot, q)
    figure = Figure(figsize=(13.0, 5.6), layout="constrained")
    panels = figure.subplots(1, 3)
    shown = q * robot.display_factors
    home = ", ".join(
        f"{column} {value:.4g}" for column, value in zip(robot.joint_columns, shown, strict=True)
    )
    figure.suptitle(f"{robot.name} at the home of {workspace.name}: {home}", fontsize="medium")
    for panel, (name, across, up) in zip(panels, _VIEWS, strict=True):
        _draw(panel, arm, [across, up])
        panel.set(title=name, xlabel=f"{'xyz'[across]}, mm", ylabel=f"{'xyz'[up]}, mm")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize="small")
    return figure


def _arm(robot: Robot, q: Array) -> _Arm:
    frames = robot.mechanism.frames(q[None])
    n = robot.n  # of closed loops the joints that have a motor
    before, after, tool = frames.before[0, :n], frames.after[0, :n], frames.tool[0]
    twists = robot.chain.twists[:n]
    twists = np.where(np.array(robot.prismatic)[:, None], twists[:, :3], twists[:, 3:])
    direction = (before[:, :3, :3] @ twists[..., None])[..., 0]
    marks = after[:, :3, 3]
    targets = transform_points(tool, robot.targets)
    links = skeleton(frames, robot.chain.placed_on)[0]
    slides = np.array(robot.prismatic)[:, None]
    strokes = [
        np.where(slides, before[:, :3, 3] + direction * end[:, None], marks)
        for end in (robot.lower, robot.upper)
    ]
    size = float(np.ptp(np.concatenate([links, targets, *strokes]), axis=0).max())
    reach = np.where(slides, 0.0, 0.09 * size * direction)
    ends = [strokes[0] - reach, strokes[1] + reach]
    tool = tool.copy()
    tool[:3, 3] *= 1e3
    return _Arm(
        robot.prismatic,
        links * 1e3,
        marks * 1e3,
        (ends[0] * 1e3, ends[1] * 1e3),
        tool,
        targets * 1e3,
        size * 1e3,
    )


def _draw(panel: Axes, arm: _Arm, plane: list[int]) -> None:
    panel.plot(
        *arm.links[:, plane].T,
        color=_LINK,
        linewidth=3.5,
        solid_capstyle="round",
        zorder=1,
        label="links",
    )
    for j, (start, end) in enumerate(zip(*arm.axes, strict=True)):
        axis = _once("joint axis; of a slide its stroke", j == 0)
        panel.plot(
            *np.stack([start, end])[:, plane].T,
            color=_AXIS,
            linewidth=1.6,
            linestyle="--",
            zorder=2,
            **axis,
        )
    for prismatic, marker, name in ((False, "o", "revolute joint"), (True, "s", "prismatic joint")):
        chosen = arm.marks[np.array(arm.prismatic) == prismatic][:, plane]
        if len(chosen):
            panel.plot(
                *chosen.T,
                marker,
                color="white",
                markeredgecolor="black",
                markersize=7,
                zorder=4,
                label=name,
            )
    _frame(panel, np.eye(4), arm.size, plane)
    _frame(panel, arm.tool, arm.size, plane)
    panel.plot(
        *arm.targets[:, plane].T,
        "*",
        color=_TARGET,
        markeredgecolor="black",
        ms=11,
        zorder=7,
        label="targets",
    )
    panel.set_aspect("equal", adjustable="datalim")
    panel.margins(0.25)
    panel.grid(alpha=0.3)
    _name_points(panel, arm, plane)


def _frame(panel: Axes, pose: Array, size: float, plane: list[int]) -> None:
    """The axes of a frame with their letters; one that points at the reader is left out."""
    start = pose[:3, 3][plane]
    for axis, (name, colour) in enumerate(_FRAME):
        along = pose[:3, axis][plane]
        if np.linalg.norm(along) < 0.1:
            continue
        end = start + along * size * 0.13
        panel.plot(*np.stack([start, end]).T, color=colour, linewidth=2.4, zorder=5)
        _text(
            panel,
            name,
            start + along * size * 0.16,
            color=colour,
            ha="center",
            va="center",
            fontweight="bold",
        )


def _name_points(panel: Axes, arm: _Arm, plane: list[int]) -> None:
    """Names beside base, joints and tool, with the most space; coinciding points share one."""
    points = np.concatenate([np.zeros((1, 3)), arm.marks, arm.tool[None, :3, 3]])[:, plane]
    names = ["base", *(f"j{j + 1}" for j in range(len(arm.marks))), "tool"]
    groups: list[tuple[Array, list[str]]] = []
    for point, name in zip(points, names, strict=True):
        near = [
            members for place, members in groups if np.linalg.norm(place - point) <= 0.03 * arm.size
        ]
        if near:
            near[0].append(name)
        else:
            groups.append((point, [name]))
    arrows = [
        pose[:3, 3] + pose[:3, :3].T * arm.size * along
        for pose in (np.eye(4), arm.tool)
        for along in (0.08, 0.16)
    ]
    taken = np.concatenate([points, arm.targets[:, plane], np.concatenate(arrows)[:, plane]])
    for point, members in groups:
        text = ", ".join(members)
        width = 0.025 * len(text) * arm.size
        places = point + _AROUND * 0.05 * arm.size
        spots = places[:, None] + np.sign(_AROUND[:, :1, None]) * np.array([0.0, 0.5, 1.0])[
            :, None
        ] * [width, 0.0]
        room = np.linalg.norm(spots[:, :, None] - taken, axis=-1).min(axis=(1, 2))
        best = int(room.argmax())
        _text(
            panel, text, places[best], ha="left" if _AROUND[best, 0] > 0 else "right", va="center"
        )
        taken = np.concatenate([taken, spots[best]])


def _text(panel: Axes, text: str, point: Array, **style: Any) -> None:
    halo = [withStroke(linewidth=2.5, foreground="white")]
    panel.annotate(
        text,
        (float(point[0]), float(point[1])),
        fontsize="small",
        zorder=8,
        path_effects=halo,
        **style,
    )


def _once(label: str, first: bool) -> dict[str, Any]:
    return {"label": label} if first else {}
