"""Readings of points fixed to the base in a table of their own."""

import numpy as np

from calibtool.errors import InputError
from calibtool.measurement.importing.column_map import ColumnMap
from calibtool.measurement.importing.header import time_column
from calibtool.measurement.importing.joint_files import times
from calibtool.measurement.importing.labels import label_columns
from calibtool.measurement.importing.measured_columns import measured_columns, reference_columns
from calibtool.measurement.importing.names import named
from calibtool.measurement.importing.sources import SourceTable, read_source
from calibtool.measurement.importing.stated_units import Stated
from calibtool.measurement.reference_motion import ReferencePoints
from calibtool.robot.se3 import Array
from calibtool.units import TO_SI


def read_references(data: bytes | str, name: str, stated: Stated) -> tuple[ReferencePoints, bool]:
    """Readings of a table of their own, and whether by time instead of by rows.

    A column of times or `row`, the number of rows measured before; points side by side (ref1_x_mm
    …), or one per line, x_mm y_mm z_mm with its name. Raises InputError where there is neither.
    """
    source = read_source(data, name)
    table = source.table
    names = named(table)
    time = time_column(names)
    row = next((column for column in table.header if column.strip().casefold() == "row"), None)
    if time is None and row is None:
        raise InputError(
            f"{name}: neither a time (time_s, time_ms, time_iso) nor row, the number of rows "
            "measured before each reading, among the columns"
        )
    by_time = row is None
    instants = times(table, time) if by_time and time else table.numbers([str(row)])[:, 0] + 0.5
    columns = reference_columns(names, stated)
    if columns:
        points = np.stack(
            [table.optional_numbers(ref.measured) * TO_SI[ref.unit] for ref in columns], axis=1
        )
        return ReferencePoints(instants, points), by_time
    return ReferencePoints(instants, _line_by_line(source, stated, row)), by_time


def _line_by_line(source: SourceTable, stated: Stated, row: str | None) -> Array:
    """Points (M, k, 3) of lines with one point each; the column of names tells which."""
    table = source.table
    target = (
        ColumnMap().model_copy(update=measured_columns(named(table), source, stated)).targets[0]
    )
    assert target.measured is not None
    values = table.optional_numbers(target.measured) * TO_SI[target.unit]
    labels = [column for column in label_columns(table) if column != row]
    texts = table.texts(labels[0]) if labels else [""] * len(table)
    of = {text: k for k, text in enumerate(dict.fromkeys(texts))}
    points = np.full((len(table), len(of), 3), np.nan)
    points[np.arange(len(table)), [of[text] for text in texts]] = values
    return points
