"""The part of the set-up that a table, its map and the options give."""

from dataclasses import replace

import numpy as np

from calibtool.errors import InputError
from calibtool.measurement.importing.column_map import ColumnMap
from calibtool.measurement.sampling import spread_rows
from calibtool.measurement.setup import Setup, check_targets
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly

_ROWS = 200  # rows that show whether the targets are on one line


def known_setup(
    columns: ColumnMap,
    robot: Robot,
    points: Array,
    robot_targets: bool,
    name: str,
    labels: tuple[str, ...] = (),
) -> Setup:
    """The known part of the set-up; unknown parts are zero until they are registered.

    points (N, m, 3): measured targets. Raises InputError for targets that the robot does not have,
    or that do not determine an orientation (collinear, two the same).
    """
    m = points.shape[1]
    targets, known = np.zeros((m, 3)), False
    if robot_targets:
        if columns.pose is not None or len(robot.targets) != m:
            raise InputError(
                f"{name}: {m} measured targets, but {robot.name} describes {len(robot.targets)}"
            )
        targets, known = robot.targets, True
    elif columns.targets and columns.targets[0].on_tool_mm is not None:
        targets, known = np.array([target.on_tool_mm for target in columns.targets]) * 1e-3, True
    if known:
        check_targets(targets, name)
    # Measured points show a collinear set too, whatever is known of the targets.
    whole = points[~np.isnan(points[..., 0]).any(axis=-1)]
    if len(whole):
        _check_measured(whole[spread_rows(len(whole), _ROWS)], name)
    places = len(labels) or 1
    setup = Setup(
        T_instrument_base=readonly(np.eye(4)),
        targets=readonly(targets),
        frame_known=columns.instrument.frame == "base" and places == 1,
        targets_known=known,
        places=labels,
    )
    if columns.lengths is not None or (columns.pose is not None and columns.pose.of == "board"):
        return _of_other_kinds(columns, replace(setup, frame_known=False), places)
    frames = np.broadcast_to(np.eye(4), (places - 1, 4, 4))
    return replace(
        setup,
        R_tool_sensor=readonly(np.eye(3)) if columns.pose is not None else None,
        further_frames=readonly(frames.copy()) if places > 1 else None,
    )


def _check_measured(points: Array, name: str) -> None:
    """InputError where the targets are on one line, or two the same, in most of the rows
    (N, m, 3): a few may be mistakes.
    """
    wrong: list[InputError] = []
    for row in points:
        try:
            check_targets(row, f"{name}: measured points")
        except InputError as error:
            wrong.append(error)
    if 2 * len(wrong) <= len(points):
        return
    still = np.flatnonzero((np.ptp(points, axis=0) == 0.0).all(axis=-1)) + 1
    if len(points) > 1 and len(still):
        raise InputError(
            f"{name}: measured points: the coordinates of target {', '.join(map(str, still))} are "
            "the same in every row; where nothing was seen, leave the cells empty"
        )
    raise wrong[0]


def _of_other_kinds(columns: ColumnMap, setup: Setup, places: int) -> Setup:
    """The set-up of distances, heights above planes and spheres, or boards, with nothing known."""
    if columns.lengths is None:
        boards = np.broadcast_to(np.eye(4), (places, 4, 4))
        return replace(
            setup, T_tool_camera=readonly(np.eye(4)), T_base_boards=readonly(boards.copy())
        )
    if columns.lengths.of in ("sphere", "centre"):
        radius = 1.0 if columns.lengths.of == "sphere" else 0.0
        return replace(setup, spheres=readonly(np.tile([0.0, 0.0, 0.0, radius], (places, 1))))
    if columns.lengths.of == "plane":
        return replace(setup, planes=readonly(np.tile([0.0, 0.0, 1.0, 0.0], (places, 1))))
    return replace(setup, anchors=readonly(np.zeros((len(columns.lengths.columns), 3))))
