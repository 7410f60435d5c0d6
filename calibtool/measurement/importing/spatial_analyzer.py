"""SpatialAnalyzer's ASCII points, one measured target per line, brought into one row
per configuration.

A line is `Collection Group Target x y z`, separated by commas or blanks; `//` starts a
comment; columns after z (offsets, tolerances) are not used. Which name means the configuration
and which the target:

| layout    | configuration         | target               | taken without being asked when    |
|-----------|-----------------------|----------------------|-----------------------------------|
| `names`   | name before `_ - .`   | the number after it  | every name ends in one (p12_1)    |
| `groups`  | collection and group  | target name          | otherwise: several groups         |
| `order`   | a run of lines        | target name          | otherwise: names repeat           |
| `single`  | every line            | one                  | otherwise                         |
| `targets` | target name           | collection and group | only when asked for               |

In `order` a configuration ends where a target is not further on in the order of first appearance.
Configurations stay in their order of appearance; targets stand in the order of the numbers at the
end of their names if all have different ones, otherwise in their order of appearance.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan
from typing import Literal, get_args

from calibtool.errors import InputError
from calibtool.tables import LONG_LINE, Table, split_lines, text_lines
from calibtool.units import number_in

Layout = Literal["names", "groups", "order", "single", "targets"]
LAYOUTS: tuple[str, ...] = get_args(Layout)
_NUMBERED = re.compile(r"(.+)[_.-](\d{1,18})")
_REMEDY = f"say what the names mean with --layout {'|'.join(LAYOUTS)}"


@dataclass(frozen=True)
class _Point:
    line: int
    group: tuple[str, str]
    name: str
    xyz: list[str]


@dataclass(frozen=True)
class PointList:
    """The table of a list of points: `name`, then `<target> x`, `… y`, `… z` per target."""

    table: Table
    targets: tuple[str, ...]
    layout: str

    @property
    def columns(self) -> list[list[str]]:
        """The three columns of every target."""
        return [[f"{target} {axis}" for axis in "xyz"] for target in self.targets]


def looks_like_points(text: str) -> bool:
    """Whether the first line is a point: three names, of which not all are numbers, x, y, z."""
    for line in text_lines(text):
        cells = _cells(line)
        if cells:
            return (
                len(cells) >= 6
                and all(map(_is_number, cells[3:6]))
                and not all(map(_is_number, cells[:3]))
            )
    return False


def parse_points(text: str, name: str, layout: str | None = None) -> PointList:
    """The points of a text, one row per configuration with empty cells for missing targets.

    Raises InputError with the line for a bad line, a target that a configuration repeats, or names
    that do not fit.
    """
    points = _points(text, name)
    chosen = layout or _layout(points, name)
    keys = _keys(points, chosen, name)
    configurations: dict[tuple[str, ...], dict[str, _Point]] = {}
    for point, (configuration, target) in zip(points, keys, strict=True):
        seen = configurations.setdefault(configuration, {})
        if target in seen:
            raise InputError(
                f"{name}:{point.line}: target '{target}' of configuration '{configuration[-1]}' "
                f"stands in line {seen[target].line} already; keep one, or {_REMEDY}"
            )
        seen[target] = point
    targets = in_order(list(dict.fromkeys(target for _, target in keys)))
    if layout is None and len(targets) > max(len(configurations), 3):
        raise InputError(
            f"{name}: read as {len(configurations)} configurations of {len(targets)} "
            f"targets; {_REMEDY}"
        )
    header = ["name", *(f"{target} {axis}" for target in targets for axis in "xyz")]
    rows = [
        [
            label,
            *(
                text
                for target in targets
                for text in (seen[target].xyz if target in seen else ["", "", ""])
            ),
        ]
        for label, seen in zip(_labels(list(configurations)), configurations.values(), strict=True)
    ]
    lines = [next(iter(seen.values())).line for seen in configurations.values()]
    return PointList(Table(name, header, rows, lines, ",", "."), tuple(targets), chosen)


def _points(text: str, name: str) -> list[_Point]:
    points = []
    for number, line in enumerate(text_lines(text), start=1):
        cells = _cells(line)
        if not cells:
            continue
        if len(cells) < 6:
            raise InputError(
                f"{name}:{number}: {len(cells)} columns; expected Collection Group Target x y z"
            )
        for axis, cell in zip("xyz", cells[3:6], strict=True):
            if not _is_number(cell):
                raise InputError(
                    f"{name}:{number}: {axis} holds '{cell}'; expected a number after "
                    "Collection Group Target (names with blanks need commas between the columns)"
                )
        points.append(_Point(number, (cells[0], cells[1]), cells[2], cells[3:6]))
    if not points:
        raise InputError(f"{name}: empty; expected lines of Collection Group Target x y z")
    return points


def _cells(line: str) -> list[str]:
    line = line.partition("//")[0].strip()
    if len(line) > LONG_LINE:  # more than csv takes
        return line.split(",")
    if ";" in line:  # an export where the comma is the decimal sign
        cells = next(split_lines([line], ";"))
        return cells[:3] + [cell.replace(",", ".") for cell in cells[3:]]
    return next(split_lines([line], "," if "," in line else " ")) if line else []


def _is_number(cell: str) -> bool:
    return not isnan(number_in(cell))


def _layout(points: list[_Point], name: str) -> str:
    numbered = [_NUMBERED.fullmatch(point.name) is not None for point in points]
    if all(numbered):
        return "names"
    if any(numbered):
        other = points[numbered.index(False)]
        raise InputError(
            f"{name}:{other.line}: target '{other.name}' does not end in a number as '"
            f"{points[numbered.index(True)].name}' does; {_REMEDY}"
        )
    if len({point.group for point in points}) > 1:
        return "groups"
    return "order" if len({point.name for point in points}) < len(points) else "single"


def _keys(points: list[_Point], layout: str, name: str) -> list[tuple[tuple[str, ...], str]]:
    """Configuration and target of every point."""
    if layout == "groups":
        return [(point.group, point.name) for point in points]
    if layout == "single":
        return [((*point.group, point.name), "t1") for point in points]
    if layout == "targets":
        labels = dict(
            zip(
                groups := list(dict.fromkeys(p.group for p in points)), _labels(groups), strict=True
            )
        )
        return [((point.name,), labels[point.group]) for point in points]
    keys: list[tuple[tuple[str, ...], str]] = []
    if layout == "names":
        for point in points:
            match = _NUMBERED.fullmatch(point.name)
            if match is None:
                raise InputError(
                    f"{name}:{point.line}: target '{point.name}' does not end in _ and a number"
                )
            keys.append(((*point.group, match[1]), f"t{int(match[2])}"))
        return keys
    rank = {target: i for i, target in enumerate(dict.fromkeys(point.name for point in points))}
    count, last = 0, len(rank)
    for point in points:
        count += rank[point.name] <= last
        last = rank[point.name]
        keys.append(((str(count),), point.name))
    return keys


def _labels(keys: Sequence[tuple[str, ...]]) -> list[str]:
    """The shortest ends of the keys that are distinct, joined as SpatialAnalyzer does."""
    for length in range(1, len(keys[0])):
        if len({key[-length:] for key in keys}) == len(keys):
            return ["::".join(key[-length:]) for key in keys]
    return ["::".join(key) for key in keys]


def in_order(targets: list[str]) -> list[str]:
    """Targets in the order of the numbers at the end of their names, if these differ."""
    numbers = [re.search(r"\d{1,18}$", target) for target in targets]
    values = [int(match[0]) for match in numbers if match]
    if len(set(values)) < len(targets):
        return targets
    return [target for _, target in sorted(zip(values, targets, strict=True))]
