"""Denavit-Hartenberg parameters: from a table, from a robot, and to the placements of a chain."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from calibtool.controller.constant_placements import Step
from calibtool.errors import InputError
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.se3 import Array
from calibtool.tables import Table, unit_of
from calibtool.units import ANGLES, LENGTHS, TO_SI

DhConvention = Literal["standard", "modified"]
DH_CONVENTIONS = ("standard", "modified")

_UNITS = {"a": LENGTHS, "alpha": ANGLES, "d": LENGTHS, "theta": ANGLES}
_PARALLEL = 1e-6  # rad between two axes, m between two lines


class DhRow(NamedTuple):
    """One row: a, d in m, alpha, theta in rad.

    theta is added to the value of a revolute joint, d to that of a prismatic one.
    """

    a: float
    alpha: float
    d: float
    theta: float


class DhTable(NamedTuple):
    """The joints' rows, and constant ones before and behind them."""

    joints: list[DhRow]
    base: list[DhRow]
    tool: list[DhRow]


def dh_columns(header: Sequence[str]) -> list[str] | None:
    """The columns of a, alpha, d, theta in a header, with units; None where one is missing."""
    found = [
        next((f"{name}_{unit}" for unit in units if f"{name}_{unit}" in header), None)
        for name, units in _UNITS.items()
    ]
    return [column for column in found if column] if all(found) else None


def read_dh(table: Table) -> DhTable:
    """DH parameters from columns `a_mm alpha_deg d_mm theta_deg` (or `_m`, `_rad`).

    A column `joint` numbers the rows, 1 to n; a first row `base` and a last row `tool` are
    constant. Raises InputError for missing columns, bad cells, or rows that are not in order.
    """
    columns = dh_columns(table.header)
    if columns is None:
        raise InputError(
            f"{table.name}: no DH parameters; expected the columns joint a_mm alpha_deg d_mm "
            "theta_deg"
        )
    values = table.numbers(columns) * [TO_SI[unit_of(column)] for column in columns]
    rows = [DhRow(*row) for row in values.tolist()]
    labels = (
        table.texts("joint") if "joint" in table.header else [str(k + 1) for k in range(len(rows))]
    )
    first, last = int(labels[0] == "base"), len(rows) - int(labels[-1] == "tool")
    for k, label in enumerate(labels[first:last], start=1):
        if label != str(k):
            raise InputError(
                f"{table.place(first + k - 1)}: joint '{label}'; expected {k}: the joints in "
                "order, before them a row 'base' and behind them a row 'tool' if there are any"
            )
    return DhTable(rows[first:last], rows[:first], rows[last:])


def steps_of(table: DhTable, convention: DhConvention) -> list[list[Step]]:
    """The n + 1 products of placements of `chain_of` for a DH table.

    standard (distal): row j is Rz(θ_j + q_j) Tz(d_j) Tx(a_j) Rx(α_j). modified (Craig, proximal):
    row j, which holds a_{j−1} and α_{j−1}, is Tx(a) Rx(α) Rz(θ_j + q_j) Tz(d_j).
    """
    steps: list[list[Step]] = [[]]
    for row in table.base:
        steps[-1] += [step for part in _parts(row, convention) for step in part]
    for row in table.joints:
        before, behind = _parts(row, convention)
        steps[-1] += before
        steps.append(behind)
    for row in table.tool:
        steps[-1] += [step for part in _parts(row, convention) for step in part]
    return steps


def _parts(row: DhRow, convention: DhConvention) -> tuple[list[Step], list[Step]]:
    """What a row places before the joint's own motion about z, and what behind it."""
    if convention == "standard":
        return [Step(rpy=(0.0, 0.0, row.theta))], [Step((row.a, 0.0, row.d), (row.alpha, 0.0, 0.0))]
    return [
        Step((row.a, 0.0, 0.0), (row.alpha, 0.0, 0.0)),
        Step((0.0, 0.0, row.d), (0.0, 0.0, row.theta)),
    ], []


def standard_rows(mechanism: Mechanism, n: int) -> list[DhRow]:
    """Standard DH parameters of a chain of n revolute joints, as Universal Robots state theirs.

    The frame before axis 1 is the base, the one behind axis n the tool; θ is between −90 and 90 deg
    at q = 0, and d = 0 where axes are parallel. A chain whose frames do not stand so is not
    described by them: compare before use.
    """
    pose, jacobian = mechanism.forward_and_jacobian(np.zeros((1, n)))
    directions = jacobian[0, 3:].T
    points = np.cross(
        directions, jacobian[0, :3].T
    )  # of each axis, the one nearest to the base's origin
    x, z, origin = np.eye(3)[0], np.eye(3)[2], np.zeros(3)
    rows = []
    for j in range(1, n + 1):
        if j < n:
            z_next = directions[j]
            x_next, d, a = _common_normal(origin, x, z, points[j], z_next)
        else:
            x_next, z_next, a = pose[0, :3, 0], pose[0, :3, 2], 0.0
            d = float((pose[0, :3, 3] - origin) @ z)
        alpha = float(np.arctan2(x_next @ np.cross(z, z_next), z @ z_next))
        theta = float(np.arctan2(z @ np.cross(x, x_next), x @ x_next))
        rows.append(DhRow(a, alpha, d, theta))
        x, z, origin = x_next, z_next, origin + d * z + a * x_next
    return rows


def _common_normal(
    origin: Array, x: Array, z: Array, point: Array, z_next: Array
) -> tuple[Array, float, float]:
    """The common normal of two axes: its direction, the nearer to x; d to it along z; length a."""
    away, across = point - origin, np.cross(z, z_next)
    parallel = bool(np.linalg.norm(across) < _PARALLEL)
    if parallel:
        across = away - (away @ z) * z
        if np.linalg.norm(across) < _PARALLEL:  # one line
            across = x
    normal = across / np.linalg.norm(across)
    normal = -normal if normal @ x < 0 else normal
    if parallel:
        return normal, 0.0, float(away @ normal)
    d, a, _ = np.linalg.solve(np.column_stack([z, normal, -z_next]), away).tolist()
    return normal, d, a
