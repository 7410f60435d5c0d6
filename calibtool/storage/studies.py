"""The table of a study as HDF5: one dataset per column, with its unit."""

import json
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from calibtool.evaluation.study.study_table import (
    COLUMNS,
    COUNTS,
    TEXTS,
    Cell,
    StudyTable,
    checked_row,
)
from calibtool.storage import STUDY, new_file
from calibtool.storage.stored_numbers import get_with_gaps, put
from calibtool.storage.texts import put_string, put_text, string, text, texts


@dataclass(frozen=True)
class StudyFile:
    """A finished study: its table, and the keys of its definition."""

    table: StudyTable
    definition: dict[str, Any]


def study_to_bytes(table: StudyTable, definition: str) -> bytes:
    """The file of a study; `definition` is its definition as JSON. A cell without a number is NaN,
    or -1 for a count.
    """

    def fill(file: h5py.File) -> None:
        put_string(file, "study", table.key)
        put_text(file, "definition", definition, "definition of the study, JSON")
        group = file.create_group("table")
        for name in COLUMNS[1:]:
            column, long_name = table.column(name), name.replace("_", " ")
            if name in TEXTS:
                put_text(group, name, [str(cell) for cell in column], long_name)
            elif name in COUNTS:
                counts = np.array([-1 if cell is None else cell for cell in column], dtype=np.int64)
                put(group, name, counts, "1", long_name, "", "row")
            else:
                values = np.array(
                    [np.nan if cell is None else cell for cell in column], dtype=float
                )
                put(group, name, values, _units(name), long_name, "", "row")

    return new_file(STUDY, fill)


def build_study(file: h5py.File) -> StudyFile:
    """Read the table of a study. KeyError or ValueError for anything else."""
    group = file["table"]
    columns = [_column(group, name) for name in COLUMNS[1:]]
    if len({len(column) for column in columns}) != 1:
        raise ValueError("its columns differ in length")
    try:
        definition = json.loads(text(file, "definition"))
    except RecursionError:
        raise ValueError("its definition is nested too deeply") from None
    if not isinstance(definition, dict):
        raise ValueError("its definition is none")
    key = string(file, "study")
    return StudyFile(
        StudyTable(key, tuple(checked_row((key, *cells)) for cells in zip(*columns, strict=True))),
        definition,
    )


def _column(group: h5py.Group, name: str) -> list[Cell]:
    if name in TEXTS:
        return list(texts(group, name))
    values = get_with_gaps(group, name, -1, below=np.inf)
    if name in COUNTS:
        if group[name].dtype.kind not in "iu":
            raise ValueError(
                f"{group.name}/{name} holds {group[name].dtype}; expected whole numbers"
            )
        # seeds of 53 bits stay exact
        return [None if value == -1 else int(value) for value in group[name][()]]
    return [None if np.isnan(value) else float(value) for value in values]


def _units(name: str) -> str:
    unit = name.rsplit("_", 1)[1]
    return {"mm": "mm", "mrad": "mrad", "percent": "percent"}.get(unit, "1")
