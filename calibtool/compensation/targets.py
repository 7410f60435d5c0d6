"""Commanded targets: from tables to joints, and correction with extrapolation guard."""

from dataclasses import replace
from typing import Literal

import numpy as np

from calibtool.calibration import Calibration
from calibtool.calibration.guard import coverage
from calibtool.compensation.bounds import Bounds
from calibtool.compensation.one_step import default_bounds
from calibtool.compensation.solve import Compensation, Method, compensate_joints, compensate_poses
from calibtool.compensation.status import OK, OUTSIDE
from calibtool.errormodel.operating_conditions import Conditions
from calibtool.errors import InputError, NoSolutionError, check_choice
from calibtool.joint_and_pose_columns import joints_from_header, poses_from_header
from calibtool.robot.coupling import JointValues
from calibtool.robot.inverse import inverse_kinematics
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.tables import Table, parse_table

OutsidePolicy = Literal["mark", "base", "refuse"]
OUTSIDE_POLICIES = ("mark", "base", "refuse")
_NAMED = 8  # number of columns that are shown of a header without targets


def read_configurations(
    text: str, name: str, robot: Robot, joint_values: JointValues | None = None
) -> Array:
    """Joint positions (N, n) of the serial chain from a table of joints, or of poses by inverse
    kinematics from home.

    joint_values: whose they are where the header does not state it. Raises UsageError where nothing
    states it and it matters, InputError for a bad table, NoSolutionError naming the first pose that
    cannot be reached.
    """
    table = parse_table(text, name)
    joints = joints_from_header(table, robot, joint_values)
    if joints is not None:
        return joints.q
    poses = poses_from_header(table)
    if poses is None:
        raise no_targets(table)
    solved = inverse_kinematics(robot, poses[0], robot.workspace().home)
    if not solved.reached.all():
        row = int(np.argmin(solved.reached))
        raise NoSolutionError(
            f"{table.place(row)}: the pose is unreachable; {int((~solved.reached).sum())} rows are"
        )
    return solved.q


def guarded(
    calibration: Calibration,
    q: Array | None,
    T_base_tool: Array | None,
    method: Method,
    outside: OutsidePolicy,
    bounds: Bounds | None = None,
    conditions: Conditions | None = None,
) -> Compensation:
    """Corrected joints with the extrapolation guard, for q (N, n) or poses (N, 4, 4).

    With poses, q chooses the branch; poses with q (n,) or None are a path: see `compensate_poses`.
    Rows unlike the configurations of the training are marked, are corrected by the base model alone
    (`base`), or get no joints (`refuse`).

    bounds: by default `default_bounds`. conditions: payload and temperature of all rows; by default
    those of the calibration.
    """
    check_choice(outside, OUTSIDE_POLICIES, "outside")
    bounds = default_bounds(calibration) if bounds is None else bounds

    def run(model: Calibration) -> Compensation:
        model = model if conditions is None else model.at(conditions)
        if T_base_tool is not None:
            return compensate_poses(model, T_base_tool, q, method, bounds=bounds)
        assert q is not None
        return compensate_joints(model, q, method, bounds=bounds)

    result = run(calibration)
    rows = np.flatnonzero(np.isfinite(result.q).all(axis=-1))
    far = rows[coverage(calibration, result.q[rows]).outside]
    if outside == "base" and len(far) and calibration.networks:
        alone = run(replace(calibration, networks=()))
        for field in ("q", "status", "position", "orientation"):
            getattr(result, field)[far] = getattr(alone, field)[far]
    result.status[far[result.status[far] == OK]] = OUTSIDE
    if outside == "refuse":
        result.q[far] = np.nan
        result.status[far] = OUTSIDE
    return result


def no_targets(table: Table) -> InputError:
    """The error for a table without joints and poses."""
    shown = ", ".join(table.header[:_NAMED]) + (" …" if len(table.header) > _NAMED else "")
    return InputError(
        f"{table.name}: neither joints (j1_deg …) nor poses (x_mm y_mm z_mm with qw qx qy qz, "
        "rx_rad ry_rad rz_rad or roll_deg pitch_deg yaw_deg) among the columns, which are: "
        f"{shown}; name them so, with their units"
    )
