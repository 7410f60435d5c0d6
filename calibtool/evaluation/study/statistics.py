"""Medians and quantiles over the runs of every combination and method."""

from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np

from calibtool.evaluation.metrics import STATISTICS
from calibtool.evaluation.study.study_table import COLUMNS, OK, REDUCTIONS, Cell, Row, StudyTable

GROUP = (
    "robot",
    "workspace",
    "errors",
    "error_scale",
    "noise_mm",
    "configurations",
    "fresh",
    "method",
)
QUANTILES = {
    "min": 0.0,
    "q05": 0.05,
    "q25": 0.25,
    "median": 0.5,
    "q75": 0.75,
    "q95": 0.95,
    "max": 1.0,
}
_TOLD = (
    *(
        f"{part}_{s}_{unit}"
        for part, unit in (("position", "mm"), ("orientation", "mrad"))
        for s in ("mean", "max")
    ),
    *(f"{part}_max_reduction_percent" for part in ("position", "orientation")),
)


def groups(table: StudyTable) -> dict[tuple[Cell, ...], list[Row]]:
    """Rows by the cells of GROUP, in the order of the table."""
    places = [COLUMNS.index(name) for name in GROUP]
    result: dict[tuple[Cell, ...], list[Row]] = {}
    for row in table.rows:
        result.setdefault(tuple(row[place] for place in places), []).append(row)
    return result


def study_summary(table: StudyTable) -> dict[str, object]:
    """The object that `study --json` prints: one entry per combination and method.

    `position_mm`, `orientation_mrad` and `reduction_percent` hold statistics over the
    configurations of a run, and each of those its quantiles over the runs; None where no
    run has a number.
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


def study_contents(table: StudyTable, definition: Mapping[str, object] | None) -> dict[str, object]:
    """Summary of a study for `info`: what was varied, how many runs have a result, and the medians
    over the runs.

    definition: the keys of its definition, None for a table without one (CSV).
    """

    def varied(name: str) -> list[Cell]:
        return list(dict.fromkeys(table.column(name)))

    methods = varied("method")
    failures = Counter(str(status) for status in table.column("status") if status != OK)
    several = [name for name in GROUP if len(varied(name)) > 1 and name != "method"]
    medians = [
        {
            "method": cells[GROUP.index("method")],
            **{name: cells[GROUP.index(name)] for name in several},
            **{name: _median(rows, name) for name in _TOLD},
        }
        for cells, rows in groups(table).items()
    ]
    return {
        "kind": "study",
        "schema_version": 1,
        "study": table.key,
        **{f"{name}s": varied(name) for name in ("robot", "workspace", "method")},
        **{
            name: varied(name)
            for name in ("errors", "error_scale", "noise_mm", "configurations", "fresh")
        },
        "runs": len(table.rows) // max(len(methods), 1),
        "rows": len(table.rows),
        "finished": len(table.rows) - failures.total(),
        "failed": failures.total(),
        **({"reasons": dict(failures)} if failures else {}),
        "medians": medians,
        **({} if definition is None else {"definition": dict(definition)}),
    }


def _median(rows: list[Row], column: str) -> float | None:
    values = numbers(rows, column)
    return float(f"{np.median(values):.4g}") if values else None


def numbers(rows: Iterable[Row], column: str) -> list[float]:
    """The numbers of a column, without empty cells."""
    place = COLUMNS.index(column)
    return [float(row[place]) for row in rows if row[place] is not None]  # type: ignore[arg-type]


def _spread(rows: list[Row], column: str) -> dict[str, float] | None:
    values = numbers(rows, column)
    if not values:
        return None
    return dict(
        zip(QUANTILES, map(float, np.quantile(values, list(QUANTILES.values()))), strict=True)
    )
