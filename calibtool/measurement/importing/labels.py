"""Names of rows: the columns that hold them, and equal names of two files."""

import re
from collections.abc import Sequence

from calibtool.measurement.importing.spelling import spelt
from calibtool.tables import Table

_WORDS = """
    name, point, punkt, pointname, point name, punktname, pose, posename, pose name, id, label,
    configuration, config, konfiguration, target, measurement, messung, nr, no, number, nummer,
    row, index, #, pt, point id, point no, punkt nr, punktnummer, feature, feature name, element,
    element name, merkmal, nome, nombre
"""
LABELS = {word.strip() for word in _WORDS.split(",")}


def label_columns(table: Table) -> list[str]:
    """Columns that name the point or the configuration of a row."""
    return [column for column in table.header if spelt(column) in LABELS]


def label_keys(texts: Sequence[str]) -> list[str]:
    """Names for comparison, without capitals and leading zeros. Empty names stay empty."""
    return [re.sub(r"0*(\d+)", r"\1", text.strip().casefold()) for text in texts]


def numbers_alone(keys: Sequence[str]) -> list[str]:
    """The number at the end of each name, or the name without one: `p7` and `7` are equal."""
    return [match[1] if (match := re.search(r"(\d+)$", key)) else key for key in keys]


def compared(one: Sequence[str], other: Sequence[str]) -> tuple[list[str], list[str]]:
    """The names of two files in the form in which more of the first are in the second.

    Only their numbers are compared if this keeps the names of each file distinct.
    """
    exact = list(one), list(other)
    plain = label_keys(one), label_keys(other)
    bare = numbers_alone(plain[0]), numbers_alone(plain[1])
    forms = [exact, plain]
    if all(len(set(b)) == len(set(p)) for b, p in zip(bare, plain, strict=True)):
        forms.append(bare)
    return max(forms, key=lambda form: overlap(*form))


def overlap(one: Sequence[str], other: Sequence[str]) -> int:
    """How many of the first names are among the others."""
    known = set(other) - {""}
    return sum(name in known for name in one)


def label_pair(measured: Table, joints: Table) -> tuple[str, str] | None:
    """The columns of two tables whose names agree most; `name` in both has priority."""
    if "name" in measured.header and "name" in joints.header:
        return "name", "name"
    pairs = [(a, b) for a in label_columns(measured) for b in label_columns(joints)]
    scored = [(overlap(*compared(measured.texts(a), joints.texts(b))), (a, b)) for a, b in pairs]
    best = max(scored, key=lambda item: item[0], default=(0, None))
    return best[1] if best[0] else None
