"""Joint values from a second file: which of its rows belongs to which measured row."""

import re
from typing import Literal, get_args

import numpy as np

from calibtool.errors import InputError
from calibtool.measurement.importing.column_map import JoinColumns, TimeColumn
from calibtool.measurement.importing.header import time_column
from calibtool.measurement.importing.row_selection import line_ranges
from calibtool.robot.se3 import Array
from calibtool.tables import Table

Join = Literal["index", "name", "time"]
JOINS: tuple[str, ...] = get_args(Join)
JOIN_TOLERANCE = 0.1  # s
_ISO = re.compile(r"(\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:[.,]\d+)?)?)Z?")


def join_rows(
    measured: Table,
    joints: Table,
    how: Join,
    columns: JoinColumns | None = None,
    tolerance_s: float = JOIN_TOLERANCE,
) -> tuple[Table, Table, list[str]]:
    """Both tables with the rows that found a partner, in the order of the measured ones, and
    warnings about the others.

    how: `index` by row order (equally many rows), `name` by a shared column (`name` unless
    `columns` says which), `time` by the nearest stamp at most `tolerance_s` away. Every row without
    a partner is named by its line in a warning. Raises InputError when nothing fits, the numbers of
    rows differ (index), or a name stands twice in `joints`.
    """
    if how == "index":
        if len(measured) != len(joints):
            raise InputError(
                f"{joints.name}: {len(joints)} rows, but {measured.name} has {len(measured)} "
                "configurations; by row order both need as many (--join name or --join time finds "
                "partners otherwise)"
            )
        return measured, joints, []
    partner = (
        _by_name(measured, joints, columns)
        if how == "name"
        else _by_time(measured, joints, columns, tolerance_s)
    )
    kept = np.flatnonzero(partner >= 0)
    reason = "of that name" if how == "name" else f"within {tolerance_s:g} s"
    if not len(kept):
        raise InputError(f"{measured.name}: no row has a partner {reason} in {joints.name}")
    unused = np.setdiff1d(np.arange(len(joints)), partner[kept])
    warnings = [
        f"{table.name}: {len(rows)} of {len(table)} rows have no partner {reason} in {other.name} "
        "and are left out: line " + line_ranges([table.lines[int(row)] for row in rows])
        for table, other, rows in (
            (measured, joints, np.flatnonzero(partner < 0)),
            (joints, measured, unused),
        )
        if len(rows)
    ]
    return measured.take(kept), joints.take(partner[kept]), warnings


def times(table: Table, column: TimeColumn) -> Array:
    """Time stamps in s, (N,), NaN where empty; ISO 8601 counts from the epoch, without
    a zone or with Z.

    Raises InputError for a stamp that cannot be read, by line.
    """
    if column.unit != "iso":
        return table.optional_numbers([column.column])[:, 0] * (
            1e-3 if column.unit == "ms" else 1.0
        )
    values = np.full(len(table), np.nan)
    for row, text in enumerate(table.texts(column.column)):
        if not text:
            continue
        match = _ISO.fullmatch(text)
        try:
            if match is None:
                raise ValueError
            values[row] = (
                float(np.datetime64(match[1].replace(",", "."), "us").astype(np.int64)) * 1e-6
            )
        except ValueError:
            raise InputError(
                f"{table.place(row)}: column '{column.column}' holds '{text}'; expected an ISO "
                "8601 time such as 2024-05-31T14:07:09.25, in UTC or without a zone"
            ) from None
    return values


def _by_name(measured: Table, joints: Table, columns: JoinColumns | None) -> np.ndarray:
    pair = (columns.measured, columns.joints) if columns else ("name", "name")
    for table, column in zip((measured, joints), pair, strict=True):
        if column not in table.header:
            raise InputError(
                f"{table.name}: no column '{column}' to join by; name it so, or give [join] "
                "measured = …, joints = … in the --columns file"
            )
    rows: dict[str, int] = {}
    for row, name in enumerate(joints.texts(pair[1])):
        if not name:
            continue
        if name in rows:
            raise InputError(
                f"{joints.place(row)}: '{name}' stands in line {joints.lines[rows[name]]} "
                "already; keep one"
            )
        rows[name] = row
    return np.array([rows.get(name, -1) for name in measured.texts(pair[0])])


def _by_time(
    measured: Table, joints: Table, columns: JoinColumns | None, tolerance_s: float
) -> np.ndarray:
    if columns is None:
        pair = (time_column(measured), time_column(joints))
    elif columns.unit is None:
        raise InputError(
            "the --columns file: [join] needs unit = 's', 'ms' or 'iso' to join by time"
        )
    else:
        pair = (
            TimeColumn(column=columns.measured, unit=columns.unit),
            TimeColumn(column=columns.joints, unit=columns.unit),
        )
    stamps = []
    for table, column in zip((measured, joints), pair, strict=True):
        if column is None:
            raise InputError(
                f"{table.name}: no time stamps time_s, time_ms or time_iso to join by; name the "
                "column so, or give [join] measured = …, joints = …, unit = … in the --columns file"
            )
        stamps.append(times(table, column))
    wanted, log = stamps
    filled = np.flatnonzero(~np.isnan(log))
    order = filled[np.argsort(log[filled], kind="stable")]
    if not len(order):
        raise InputError(f"{joints.name}: no row has a time stamp")
    after = (
        np.searchsorted(log[order], wanted).clip(1, len(order) - 1)
        if len(order) > 1
        else np.zeros(len(wanted), int)
    )
    before = np.maximum(after - 1, 0)
    nearer = np.abs(log[order[before]] - wanted) <= np.abs(log[order[after]] - wanted)
    partner = order[np.where(nearer, before, after)]
    near = np.abs(log[partner] - wanted) <= tolerance_s  # False for NaN
    return np.where(near, partner, -1)
