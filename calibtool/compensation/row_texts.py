"""Rows of commanded and corrected targets as text: CSV and newline-delimited JSON."""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from calibtool.compensation.decimals import DECIMALS, decimal_rows
from calibtool.errors import InputError
from calibtool.robot.se3 import Array
from calibtool.tables import Table, csv_lines, number


@dataclass(frozen=True, eq=False)
class CorrectedRows:
    """A batch: table, columns that are kept, corrected joints in its units, added columns."""

    table: Table
    kept: list[int]
    joint_names: list[str]
    values: Array
    added: dict[str, list[str]]


def csv_text(corrected: CorrectedRows, with_header: bool) -> str:
    """The rows of a batch as lines of CSV: joints, columns that stay, columns that are added."""
    table, kept = corrected.table, corrected.kept
    units = [name.rsplit("_", 1)[1] for name in corrected.joint_names]
    numbers = decimal_rows(corrected.values, max(DECIMALS[unit] for unit in units))
    columns = list(corrected.added.values())
    rest = (
        columns[0]
        if len(columns) == 1
        else [",".join(cells) for cells in zip(*columns, strict=True)]
    )
    if kept:
        others = csv_lines([row[i] for i in kept] for row in table.rows)
        rest = [f"{other},{added}" for other, added in zip(others, rest, strict=True)]
    lines = [f"{a},{b}\n" for a, b in zip(numbers, rest, strict=True)]
    if with_header:
        header = [*corrected.joint_names, *(table.header[i] for i in kept), *corrected.added]
        lines.insert(0, next(csv_lines([header])) + "\n")
    return "".join(lines)


def read_objects(
    lines: Iterable[str], name: str, batch: int
) -> Iterator[tuple[Table, list[dict[str, object]]]]:
    """Objects, one per line, with the keys of the first as columns of a table."""
    header: list[str] = []
    part: list[tuple[int, dict[str, object]]] = []

    def table() -> tuple[Table, list[dict[str, object]]]:
        objects = [found for _, found in part]
        cells = [
            ["" if found[key] is None else str(found[key]) for key in header] for found in objects
        ]
        return Table(name, header, cells, [line for line, _ in part], ",", "."), objects

    for line, text in enumerate(lines, start=1):
        text = text.removeprefix("\ufeff").strip()
        if not text:
            continue
        try:
            found = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise InputError(
                f"{name}:{line}: not JSON: {error}; expected one object per line"
            ) from None
        if not isinstance(found, dict):
            raise InputError(f"{name}:{line}: expected one JSON object per line")
        header = header or list(found)
        if set(found) != set(header):
            different = sorted(set(found) ^ set(header))
            raise InputError(
                f"{name}:{line}: key '{different[0]}' is not in every object; keys must be the same"
            )
        part.append((line, found))
        if len(part) == batch:
            yield table()
            part = []
    if part:
        yield table()
    elif not header:
        raise InputError(f"{name}: empty; expected one JSON object per line")


def objects_text(corrected: CorrectedRows, objects: list[dict[str, object]]) -> str:
    """The rows of a batch as JSON objects, one per line, with the values that stay."""
    table = corrected.table
    convert: dict[str, Callable[[str], object]] = {"status": str}
    lines = []
    result: dict[str, object]
    for k, given in enumerate(objects):
        joints = [
            None if np.isnan(value) else float(number(value)) for value in corrected.values[k]
        ]
        result = dict(zip(corrected.joint_names, joints, strict=True))
        result |= {table.header[i]: given[table.header[i]] for i in corrected.kept}
        for column, cells in corrected.added.items():
            as_value = convert.get(column, float)
            result[column] = None if cells[k] == "" else as_value(cells[k])
        lines.append(json.dumps(result, ensure_ascii=False) + "\n")
    return "".join(lines)
