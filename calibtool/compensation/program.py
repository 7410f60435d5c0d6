"""Tables of targets: configurations to measure at, and commanded joints or poses to correct."""

from dataclasses import dataclass

import numpy as np

from calibtool.calibration import Calibration
from calibtool.compensation.solve import OK, UNREACHABLE, Compensation, Method, compensate_joints, compensate_poses
from calibtool.errors import InputError, NoSolutionError
from calibtool.robot.inverse import inverse_kinematics
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array
from calibtool.tables import Table, format_table, joints_from_header, number, parse_table, poses_from_header
from calibtool.units import TO_SI


@dataclass(frozen=True)
class CompensatedTable:
    """text: the output CSV; remarks: a line for every row that is not plainly `ok`; unreachable: how many rows of `rows`."""

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


def compensate_table(calibration: Calibration, text: str, name: str, method: Method) -> CompensatedTable:
    """Correct every row of a table.

    Joint columns are replaced by the corrected joints, in their units; pose columns give way to joints in degrees (mm if
    prismatic). Where a row has both, the pose is commanded and the joints choose the branch. Other columns pass through;
    a column `status` is added, and for n < 6 what no joint can correct (`left_mm`, `left_mrad`).
    """
    robot = calibration.robot
    table = parse_table(text, name)
    joints = joints_from_header(table, robot)
    poses = poses_from_header(table)
    if poses is not None:
        result = compensate_poses(calibration, poses[0], None if joints is None else joints[0], method)
    elif joints is not None:
        result = compensate_joints(calibration, joints[0], method)
    else:
        raise _no_targets(table)
    for added in ("status", "left_mm", "left_mrad"):
        if added in table.header:
            raise InputError(f"{name}: a column '{added}' is there already; is this an output of compensate?")

    joint_names = robot.joint_columns if joints is None else sorted(joints[1], key=table.header.index)
    order = list(range(robot.n)) if joints is None else [joints[1].index(column) for column in joint_names]
    replaced = set(joint_names) | (set() if poses is None else set(poses[1]))
    kept = [i for i, column in enumerate(table.header) if column not in replaced]
    factors = np.array([TO_SI[column.split("_")[1]] for column in joint_names])
    values = result.q[:, order] / factors
    header = [*joint_names, *(table.header[i] for i in kept), "status"]
    limited = robot.n < 6
    if limited:
        header += ["left_mm", "left_mrad"]
    rows = []
    for k, cells in enumerate(table.rows):
        row = [*map(number, values[k]), *(cells[i] for i in kept), str(result.status[k])]
        if limited:
            row += [f"{result.position[k] * 1e3:.6g}", f"{result.orientation[k] * 1e3:.6g}"]
        rows.append(row)
    return CompensatedTable(
        text=format_table(header, rows),
        remarks=_remarks(table, result),
        unreachable=int((result.status == UNREACHABLE).sum()),
        rows=len(table),
    )


def _remarks(table: Table, result: Compensation) -> list[str]:
    meaning = {
        "near-singular": "near a singularity: damped, {left:.3g} mm of the error stay",
        "out-of-limits": "the corrected joints are outside the joint limits",
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
