"""Medians and quantiles over the runs of every combination and method."""

from collections.abc import Iterable

import numpy as np

from calibtool.evaluation.metrics import STATISTICS
from calibtool.evaluation.study.table import COLUMNS, OK, REDUCTIONS, Cell, Row, StudyTable

GROUP = ("robot", "workspace", "errors", "error_scale", "noise_mm", "configurations", "fresh", "method")
QUANTILES = {"min": 0.0, "q05": 0.05, "q25": 0.25, "median": 0.5, "q75": 0.75, "q95": 0.95, "max": 1.0}


def groups(table: StudyTable) -> dict[tuple[Cell, ...], list[Row]]:
    """Rows by the cells of GROUP, in the order of the table."""
    places = [COLUMNS.index(name) for name in GROUP]
    result: dict[tuple[Cell, ...], list[Row]] = {}
    for row in table.rows:
        result.setdefault(tuple(row[place] for place in places), []).append(row)
    return result


def study_summary(table: StudyTable) -> dict[str, object]:
    """The object that `study --json` prints: one entry per combination and method.

    `position_mm`, `orientation_mrad` and `reduction_percent` hold statistics over the configurations of a run, and each
    of those its quantiles over the runs; None where no run has a number.
    """
    entries = []
    for cells, rows in groups(table).items():
        good = [row for row in rows if row[COLUMNS.index("status")] == OK]
        entries.append(
            {
                **dict(zip(GROUP, cells, strict=True)),
                "runs": len(rows),
                "failed": len(rows) - len(good),
                "position_mm": {s: _spread(good, f"position_{s}_mm") for s in STATISTICS},
                "orientation_mrad": {s: _spread(good, f"orientation_{s}_mrad") for s in STATISTICS},
                "reduction_percent": {
                    f"{part}_{s}": _spread(good, f"{part}_{s}_reduction_percent")
                    for part in ("position", "orientation")
                    for s in REDUCTIONS
                },
            }
        )
    return {
        "schema": "calibtool/study",
        "schema_version": 1,
        "study": table.key,
        "rows": len(table.rows),
        "failed": sum(status != OK for status in table.column("status")),
        "groups": entries,
    }


def numbers(rows: Iterable[Row], column: str) -> list[float]:
    """The numbers of a column, without empty cells."""
    place = COLUMNS.index(column)
    return [float(row[place]) for row in rows if row[place] is not None]  # type: ignore[arg-type]


def _spread(rows: list[Row], column: str) -> dict[str, float] | None:
    values = numbers(rows, column)
    if not values:
        return None
    return dict(zip(QUANTILES, map(float, np.quantile(values, list(QUANTILES.values()))), strict=True))
