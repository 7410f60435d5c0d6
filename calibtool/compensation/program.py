"""Tables of targets: configurations to measure at, and commanded joints or poses to correct."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibtool.calibration import Calibration
from calibtool.calibration.guard import coverage
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.compensation.solve import (
    OK,
    OUTSIDE,
    UNREACHABLE,
    Compensation,
    Method,
    compensate_joints,
    compensate_poses,
)
from calibtool.errors import InputError, NoSolutionError
from calibtool.robot.coupling import JointValues
from calibtool.robot.inverse import inverse_kinematics
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array
from calibtool.tables import Table, format_table, joints_from_header, number, parse_table, poses_from_header
from calibtool.units import TO_SI

OutsidePolicy = Literal["mark", "base", "refuse"]
OUTSIDE_POLICIES = ("mark", "base", "refuse")


@dataclass(frozen=True)
class CompensatedTable:
    """text: the output CSV; remarks: a line for every row that is not plainly `ok`; unreachable: rows without joints."""

    text: str
    remarks: list[str]
    unreachable: int
    rows: int


def read_configurations(text: str, name: str, robot: Robot) -> Array:
    """Joint positions (N, n) from a table of joints, or of poses by inverse kinematics.

    Raises InputError for a bad table, NoSolutionError naming the first pose that cannot be reached.
    """
    table = parse_table(text, name)
    joints = joints_from_header(table, robot)
    if joints is not None:
        return joints[0]
    poses = poses_from_header(table)
    if poses is None:
        raise _no_targets(table)
    solved = inverse_kinematics(robot, poses[0])
    if not solved.reached.all():
        row = int(np.argmin(solved.reached))
        raise NoSolutionError(f"{table.place(row)}: the pose is unreachable; {int((~solved.reached).sum())} rows are")
    return solved.q


def compensate_table(
    calibration: Calibration,
    text: str,
    name: str,
    method: Method,
    *,
    outside: OutsidePolicy = "mark",
    uncertainty: bool = False,
    joint_values: JointValues = "serial",
) -> CompensatedTable:
    """Correct every row of a table.

    Joint columns are replaced by the corrected joints, in their units; pose columns give way to joints in degrees (mm if
    prismatic). Where a row has both, the pose is commanded and the joints choose the branch. Other columns pass through;
    a column `status` is added, for n < 6 what no joint can correct (`left_mm`, `left_mrad`), and with `uncertainty` the
    predicted standard deviations of the tool (`sd_mm`, `sd_mrad`). Rows outside the configurations of the training are
    marked, take the base model alone (`base`), or get no joints (`refuse`). joint_values: `controller` when joints come in
    and go out as the controller shows them (`Robot.to_serial`).
    """
    robot = calibration.robot
    table = parse_table(text, name)
    joints = joints_from_header(table, robot)
    poses = poses_from_header(table)
    if poses is None and joints is None:
        raise _no_targets(table)
    q_given = None if joints is None else robot.serial_from(joint_values, joints[0])
    T_given = None if poses is None else poses[0]
    result = guarded(calibration, q_given, T_given, method, outside)
    for added in ("status", "left_mm", "left_mrad", "sd_mm", "sd_mrad"):
        if added in table.header:
            raise InputError(f"{name}: a column '{added}' is there already; is this an output of compensate?")

    joint_names = robot.joint_columns if joints is None else sorted(joints[1], key=table.header.index)
    order = list(range(robot.n)) if joints is None else [joints[1].index(column) for column in joint_names]
    replaced = set(joint_names) | (set() if poses is None else set(poses[1]))
    kept = [i for i, column in enumerate(table.header) if column not in replaced]
    factors = np.array([TO_SI[column.split("_")[1]] for column in joint_names])
    values = robot.serial_as(joint_values, result.q)[:, order] / factors
    header = [*joint_names, *(table.header[i] for i in kept), "status"]
    limited = robot.n < 6
    if limited:
        header += ["left_mm", "left_mrad"]
    sure = np.full((len(table), 2), np.nan)
    if uncertainty:
        header += ["sd_mm", "sd_mrad"]
        known = np.isfinite(result.q).all(axis=-1)
        spread = predicted_uncertainty(calibration, result.q[known])
        sure[known] = np.stack([spread.position, spread.orientation], axis=-1) * 1e3
    rows = []
    for k, cells in enumerate(table.rows):
        row = [*map(number, values[k]), *(cells[i] for i in kept), str(result.status[k])]
        if limited:
            row += [f"{result.position[k] * 1e3:.6g}", f"{result.orientation[k] * 1e3:.6g}"]
        if uncertainty:
            row += [number(float(f"{value:.6g}")) for value in sure[k]]
        rows.append(row)
    return CompensatedTable(
        text=format_table(header, rows),
        remarks=_remarks(table, result),
        unreachable=int(np.isnan(result.q).any(axis=-1).sum()),
        rows=len(table),
    )


def guarded(
    calibration: Calibration, q: Array | None, T_base_tool: Array | None, method: Method, outside: OutsidePolicy
) -> Compensation:
    """Corrected joints with the extrapolation guard: q (N, n) or poses (N, 4, 4), for which q then chooses the branch."""

    def run(model: Calibration) -> Compensation:
        if T_base_tool is not None:
            return compensate_poses(model, T_base_tool, q, method)
        assert q is not None
        return compensate_joints(model, q, method)

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


def _remarks(table: Table, result: Compensation) -> list[str]:
    meaning = {
        "near-singular": "near a singularity: damped, {left:.3g} mm of the error stay",
        "out-of-limits": "the corrected joints are outside the joint limits",
        OUTSIDE: "outside the configurations of the training",
        UNREACHABLE: "the pose is unreachable: no joints are given",
    }
    return [
        f"{table.place(k)}: {meaning[status].format(left=result.position[k] * 1e3)}"
        for k, status in enumerate(result.status)
        if status != OK
    ]


def _no_targets(table: Table) -> InputError:
    return InputError(
        f"{table.name}: neither joints (j1_deg …) nor poses (x_mm y_mm z_mm with qw qx qy qz, rx_rad ry_rad rz_rad or "
        "roll_deg pitch_deg yaw_deg) among the columns"
    )
