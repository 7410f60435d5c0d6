"""A calibration as a table of DH parameters, standard or modified."""

from math import degrees

import numpy as np

from calibtool.calibration import Calibration
from calibtool.export.unrepresented_parts import not_held
from calibtool.export.urdf_geometry import check_without_loops, urdf_geometry
from calibtool.robot.denavit_hartenberg import DhConvention, DhRow, DhTable
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.z_axes import placements_between_z

_PARALLEL = 1e-7  # rad: the feet of the common normal would be 1e7 lengths away


def calibration_as_dh(calibration: Calibration, convention: DhConvention) -> tuple[str, list[str]]:
    """A CSV that can be read as a robot from K_0 to the tool, and a list of what it does not hold.

    The joint origins are those of `urdf_geometry`. A table with the rows `base` and `tool` holds
    any of them, except the tilt of axes that are parallel to 1e-7 rad. Each line of the list names
    a part that is lost, with its size. Raises InputError for a robot with closed loops.
    """
    check_without_loops(calibration.robot, "a table of DH parameters")
    robot, geometry = calibration.robot, urdf_geometry(calibration)
    missing = list(not_held(calibration, geometry))
    placements = placements_between_z(geometry.mechanism.placements, robot.chain.twists)
    table = dh_table(placements, robot.prismatic, convention)
    return dh_csv(table, robot, missing), missing


def dh_table(placements: Array, prismatic: list[bool], convention: DhConvention) -> DhTable:
    """The table of a chain P (n+1, 4, 4) between frames on the joints' z axes.

    Each P is Rz(θ) Tz(d) Tx(a) Rx(α) · Rz(φ) Tz(e); the last two go with the next joint, whose
    motion is about or along the same z.
    """
    steps = [_common_normal(placement) for placement in placements]
    turns, shifts = zip(*((phi, e) for _, phi, e in steps), strict=True)
    rows, n = [row for row, _, _ in steps], len(prismatic)
    if convention == "standard":  # row j: what stands behind joint j
        behind = [
            DhRow(rows[j].a, rows[j].alpha, rows[j].d + shifts[j - 1], rows[j].theta + turns[j - 1])
            for j in range(1, n + 1)
        ]
        base, tool = rows[0], DhRow(0.0, 0.0, shifts[n], turns[n])
    else:  # row j: what stands before joint j
        base = DhRow(0.0, 0.0, rows[0].d, rows[0].theta)
        later = [*rows[1:], DhRow(0.0, 0.0, 0.0, 0.0)]
        all_rows = [
            DhRow(rows[j].a, rows[j].alpha, later[j].d + shifts[j], later[j].theta + turns[j])
            for j in range(n + 1)
        ]
        behind, tool = all_rows[:n], all_rows[n]
    turned = [_wrapped(row) for row in behind]
    return DhTable(turned, [_wrapped(base)], [_wrapped(tool)], prismatic, convention)


def dh_csv(table: DhTable, robot: Robot, missing: list[str]) -> str:
    """The text of a table, with limits in deg or mm, and at its head what it does not hold."""
    head = [
        f"DH parameters of {robot.name}, calibrated; {table.convention} convention; "
        "K_0 to the tool",
        *(f"not held: {line}" for line in missing),
    ]
    lines = [f"# {line}" for line in head]
    lines.append("joint,a_mm,alpha_deg,d_mm,theta_deg,type,lower,upper,convention")
    labels = ["base", *(str(j + 1) for j in range(robot.n)), "tool"]
    for label, row in zip(labels, [*table.base, *table.joints, *table.tool], strict=True):
        kind = lower = upper = ""
        if label.isdigit():
            j = int(label) - 1
            slides = robot.prismatic[j]
            kind = "prismatic" if slides else "revolute"
            lower, upper = (
                repr(float(end[j] * 1e3 if slides else np.rad2deg(end[j])))
                for end in (robot.lower, robot.upper)
            )
        values = (row.a * 1e3, degrees(row.alpha), row.d * 1e3, degrees(row.theta))
        cells = [label, *(repr(float(value) + 0.0) for value in values), kind, lower, upper]
        lines.append(",".join([*cells, str(table.convention)]))
    return "\n".join(lines) + "\n"


def _wrapped(row: DhRow) -> DhRow:
    """The same row with θ between −π and π."""
    return row._replace(theta=float((row.theta + np.pi) % (2 * np.pi) - np.pi))


def _common_normal(placement: Array) -> tuple[DhRow, float, float]:
    """θ, d, a, α to the next z axis by the common normal, and φ, e on along that axis."""
    axis, position = placement[:3, 2], placement[:3, 3]
    sine = float(np.hypot(axis[0], axis[1]))
    if sine > _PARALLEL:
        theta, alpha = np.arctan2(axis[0], -axis[1]), np.arctan2(sine, axis[2])
    else:
        theta = np.arctan2(position[1], position[0]) if np.hypot(*position[:2]) > 1e-12 else 0.0
        alpha = 0.0 if axis[2] > 0 else np.pi
    if abs(theta) > np.pi / 2 + 1e-9:  # the other direction of the same normal
        theta, alpha = theta - np.copysign(np.pi, theta), -alpha
    normal = np.array([np.cos(theta), np.sin(theta), 0.0])
    if sine > _PARALLEL:
        feet = np.column_stack([[0.0, 0.0, 1.0], normal, axis])
        d, a, e = np.linalg.solve(feet, position)
    else:
        d, a, e = position[2], position @ normal, 0.0
    # R = Rz(θ) Rx(α) Rz(φ): its columns x and y in the frame of the normal
    across = np.array(
        [-np.sin(theta) * np.cos(alpha), np.cos(theta) * np.cos(alpha), np.sin(alpha)]
    )
    phi = np.arctan2(placement[:3, 0] @ across, placement[:3, 0] @ normal)
    return DhRow(float(a), float(alpha), float(d), float(theta)), float(phi), float(e)
