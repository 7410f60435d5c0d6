"""Joint values from a second file: matching of its rows with the measured rows."""

from typing import Literal, get_args

import numpy as np

from calibtool.errors import InputError
from calibtool.measurement.importing.column_map import JoinColumns, TimeColumn
from calibtool.measurement.importing.dates import seconds
from calibtool.measurement.importing.header import time_column
from calibtool.measurement.importing.labels import compared, label_pair
from calibtool.measurement.importing.names import named
from calibtool.measurement.importing.row_selection import line_ranges
from calibtool.robot.se3 import Array
from calibtool.tables import Table

Join = Literal["index", "name", "time"]
JOINS: tuple[str, ...] = get_args(Join)
JOIN_TOLERANCE = 0.1  # s between the stamps of two rows that belong together
_MOST_RANGES = 20  # number of ranges of lines in a message


def join_rows(
    measured: Table,
    joints: Table,
    how: Join,
    columns: JoinColumns | None = None,
    tolerance_s: float = JOIN_TOLERANCE,
) -> tuple[Table, Table, list[str]]:
    """The rows of both tables that match, in the order of the measured ones, and warnings about the
    others.

    how: `index` by row order (equal numbers of rows), `name` by the columns of names that agree, or
    those of `columns`, `time` by the nearest stamp, at most `tolerance_s` away. Rows without a
    match are counted in a warning, and listed by their lines where there are few. Rows of a log of
    joints between two measurements are not reported. Raises InputError when nothing matches, the
    numbers of rows differ (index), or a name occurs twice in `joints`.
    """
    if how == "index":
        if len(measured) != len(joints):
            raise InputError(
                f"{joints.name}: {len(joints)} rows, but {measured.name} has {len(measured)} "
                "configurations; by row order "
                "both need as many (--join name or --join time finds partners otherwise)"
            )
        return measured, joints, []
    partner = (
        _by_name(measured, joints, columns)
        if how == "name"
        else _by_time(measured, joints, columns, tolerance_s)
    )
    kept = np.flatnonzero(partner >= 0)
    clocks = _backwards(measured, joints, columns) if how == "time" else []
    reason = "of that name" if how == "name" else f"within {tolerance_s:g} s"
    if not len(kept):
        raise InputError(f"{measured.name}: no row has a partner {reason} in {joints.name}")
    unused = np.setdiff1d(np.arange(len(joints)), partner[kept])
    warnings = [
        f"{table.name}: {len(rows)} of {len(table)} rows have no partner {reason} in {other.name} "
        "and are left out" + _which(table, rows)
        for table, other, rows in (
            (measured, joints, np.flatnonzero(partner < 0)),
            (joints, measured, unused),
        )
        if len(rows) and not (how == "time" and table is joints and len(joints) > len(measured))
    ]
    return measured.take(kept), joints.take(partner[kept]), [*clocks, *warnings]


def _which(table: Table, rows: np.ndarray) -> str:
    """Their lines, if there are few enough to list."""
    lines = line_ranges([table.lines[int(row)] for row in rows])
    return f": line {lines}" if lines.count(",") < _MOST_RANGES else ""


def times(table: Table, column: TimeColumn) -> Array:
    """Time stamps in s, (N,), NaN where empty; ISO 8601 counts from the epoch, without a zone or
    with Z.

    Raises InputError for a stamp that cannot be read, by line.
    """
    if column.unit != "iso":
        return table.optional_numbers([column.column])[:, 0] * (
            1e-3 if column.unit == "ms" else 1.0
        )
    values, bad = seconds(table.texts(column.column))
    if bad is not None:
        text = table.texts(column.column)[bad]
        raise InputError(
            f"{table.place(bad)}: column '{column.column}' holds '{text}'; expected a date with a "
            "time such as "
            "2024-05-31T14:07:09.25 (ISO 8601, in UTC or without a zone) or 31.05.2024 14:07:09"
        )
    return values


def _by_name(measured: Table, joints: Table, columns: JoinColumns | None) -> np.ndarray:
    found = (columns.measured, columns.joints) if columns else label_pair(measured, joints)
    pair = found or ("name", "name")
    for table, column in zip((measured, joints), pair, strict=True):
        if column not in table.header:
            raise InputError(
                f"{table.name}: no column '{column}' to join by; name it so, or give [join] "
                "measured = …, joints = … in the --columns file"
            )
    wanted, known = compared(measured.texts(pair[0]), joints.texts(pair[1]))
    rows: dict[str, int] = {}
    for row, name in enumerate(known):
        if not name:
            continue
        if name in rows:
            text = joints.texts(pair[1])[row]
            raise InputError(
                f"{joints.place(row)}: '{text}' stands in line {joints.lines[rows[name]]} already; "
                "keep one"
            )
        rows[name] = row
    return np.array([rows.get(name, -1) for name in wanted])


def stamps(measured: Table, joints: Table, columns: JoinColumns | None) -> tuple[Array, Array]:
    """Time stamps (N,) and (L,) of both tables in s, NaN where empty.

    InputError where either has none.
    """
    if columns is None:
        pair = (time_column(named(measured)), time_column(named(joints)))
    elif columns.unit is None:
        raise InputError(
            "the --columns file: [join] needs unit = 's', 'ms' or 'iso' to join by time"
        )
    else:
        pair = (
            TimeColumn(column=columns.measured, unit=columns.unit),
            TimeColumn(column=columns.joints, unit=columns.unit),
        )
    found = []
    for table, column in zip((measured, joints), pair, strict=True):
        if column is None:
            raise InputError(
                f"{table.name}: no time stamps time_s, time_ms or time_iso to join by; name the "
                "column so, or give [join] measured = …, joints = …, unit = … in the --columns file"
            )
        found.append(times(table, column))
    return found[0], found[1]


def _backwards(measured: Table, joints: Table, columns: JoinColumns | None) -> list[str]:
    """A warning for each file in which later rows have earlier stamps."""
    found = []
    for table, instants in zip((measured, joints), stamps(measured, joints, columns), strict=True):
        filled = np.flatnonzero(np.isfinite(instants))
        back = filled[1:][np.diff(instants[filled]) < 0]
        if len(back):
            found.append(
                f"{table.name}: the clock runs backwards in {len(back)} of {len(instants)} rows: "
                f"first in line {table.lines[int(back[0])]}; rows are taken in the order of their "
                "stamps"
            )
    return found


def _by_time(
    measured: Table, joints: Table, columns: JoinColumns | None, tolerance_s: float
) -> np.ndarray:
    wanted, log = stamps(measured, joints, columns)
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
