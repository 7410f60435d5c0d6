"""The table of a study as HDF5: one dataset per column, which says its units."""

import io
from typing import BinaryIO

import h5py
import numpy as np

from calibtool import __version__
from calibtool.errors import InputError
from calibtool.evaluation.study.table import COLUMNS, COUNTS, TEXTS, Cell, StudyTable, table_of
from calibtool.storage import STUDY
from calibtool.storage.parts import put
from calibtool.storage.texts import put_text

SCHEMA_VERSION = 1


def study_to_bytes(table: StudyTable, definition: str) -> bytes:
    """The file of a study; `definition` is its definition as JSON. A cell without a number is NaN, or -1 for a count."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=("v110", "v110")) as file:
        file.attrs["schema"] = STUDY
        file.attrs["schema_version"] = SCHEMA_VERSION
        file.attrs["creator"] = "calibtool"
        file.attrs["creator_version"] = __version__
        file.attrs["study"] = table.key
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
                values = np.array([np.nan if cell is None else cell for cell in column], dtype=float)
                put(group, name, values, _units(name), long_name, "", "row")
    return buffer.getvalue()


def read_study(stream: BinaryIO, name: str) -> StudyTable:
    """A table that `study_to_bytes` wrote; `name` stands in messages. Raises InputError for anything else."""
    try:
        with h5py.File(stream, "r") as file:
            if file.attrs.get("schema") != STUDY:
                raise InputError(f"{name}: not a study's table")
            version = int(file.attrs["schema_version"])
            if version > SCHEMA_VERSION:
                raise InputError(f"{name}: written in format version {version}; install a newer calibtool")
            key = str(file.attrs["study"])
            columns = [_column(file["table"], column) for column in COLUMNS[1:]]
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError) as error:
        raise InputError(f"{name}: not an HDF5 file that calibtool study wrote, or damaged: {error}") from None
    return table_of([(key, *cells) for cells in zip(*columns, strict=True)], name)


def _column(group: h5py.Group, name: str) -> list[Cell]:
    if name in TEXTS:
        return list(group[name].asstr()[()])
    values = group[name][()]
    if name in COUNTS:
        return [None if value == -1 else int(value) for value in values]
    return [None if np.isnan(value) else float(value) for value in values]


def _units(name: str) -> str:
    unit = name.rsplit("_", 1)[1]
    return {"mm": "mm", "mrad": "mrad", "percent": "percent"}.get(unit, "1")
