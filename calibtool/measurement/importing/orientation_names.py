"""Columns of orientations under the name of their object: `RB QX`, `t-mac q0`, `STS Roll`, `Rigid
Body 1 Rotation X`, `Rx from Y (deg)`.
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

from calibtool.measurement.importing.spelling import spelt, split_unit, with_unit

_SENSE = re.compile(r" (?:from|about|around|um) [xyz]$")  # SpatialAnalyzer's Rx from Y
_QUATERNION = re.compile(
    r"(?P<who>.*?) ?\b(?:q|quat|quaternion|rot|rotation|orientation) ?(?P<part>[wxyz]|[0-4])"
)
_ANGLE = re.compile(
    r"(?P<who>.*?) ?\b(?:(?:r|rot|rotation|orientation) ?(?P<part>[xyz])|(?P<word>roll|pitch|yaw))"
)
_PARTS = ("wxyz", "0xyz", "0123", "1234")  # of a quaternion, scalar first
_THREE = (("rx", "ry", "rz"), ("roll", "pitch", "yaw"))


class Turned(NamedTuple):
    """Words before the names of an orientation, and the meaning of its columns."""

    who: frozenset[str]
    columns: dict[str, str]


def orientation_names(columns: Sequence[str]) -> list[Turned]:
    """Whole orientations: quaternions as `qw qx qy qz`, three angles as `rx …` or `roll …` with
    their unit.
    """
    found: list[Turned] = []
    for parts in _grouped(columns, _QUATERNION):
        four = next((p for p in _PARTS if set(parts.columns) == set(p)), None)
        if four is not None:
            named = {parts.columns[p]: f"q{axis}" for p, axis in zip(four, "wxyz", strict=True)}
            found.append(Turned(parts.who, named))
    taken = {column for turned in found for column in turned.columns}
    for parts in _grouped([c for c in columns if c not in taken], _ANGLE):
        for three in _THREE:
            if all(name in parts.columns for name in three):
                named = {
                    (c := parts.columns[name]): with_unit(name, split_unit(c)[1]) for name in three
                }
                found.append(Turned(parts.who, named))
    return found


def _grouped(columns: Sequence[str], pattern: re.Pattern[str]) -> list[Turned]:
    """Columns by the part of the orientation that they hold, for each owner."""
    groups: dict[str, dict[str, str]] = {}
    for column in columns:
        match = pattern.fullmatch(_SENSE.sub("", spelt(column)))
        if match is None:
            continue
        part = match.groupdict().get("word") or match["part"]
        name = f"r{part}" if pattern is _ANGLE and len(part) == 1 else part
        groups.setdefault(match["who"].strip(), {})[name] = column
    return [Turned(frozenset(who.split()), parts) for who, parts in groups.items()]
