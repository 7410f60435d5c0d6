"""Lists with one measured point per line → one row per configuration, by the names."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations

from calibtool.errors import InputError
from calibtool.measurement.importing.labels import compared, label_columns, overlap
from calibtool.measurement.importing.names import named
from calibtool.measurement.importing.spatial_analyzer import in_order
from calibtool.tables import Table
from calibtool.units import count_of

_MOST_TARGETS = 12
_SPLITS = (  # of a name into configuration and target, or the other way round
    (re.compile(r"(.+)[_.\-:/ ]([^_.\-:/ ]+)"), False),
    (re.compile(r"([^_.\-:/ ]+)[_.\-:/ ]++(.+)"), True),
    (re.compile(r"(.*\d)([a-z]+\d*)", re.IGNORECASE), False),
)
Key = tuple[str, str]


def one_row_each(
    table: Table, joints: Table | None, joint_names: Sequence[str]
) -> tuple[Table, str | None]:
    """The table with one row per configuration, and how its names were read; unchanged if it is no
    list of points.

    joints: the file of the joint values, whose names or number of rows tell the configurations;
    None: they are in the table, equal in every line of a configuration. joint_names: of the URDF.
    Raises InputError where a target occurs twice in a configuration.
    """
    names = named(table, joint_names)
    unit = next((u for u in ("_mm", "_m", "_in", "") if names.has(f"{a}{u}" for a in "xyz")), None)
    labels = label_columns(table)
    if unit is None or not labels:
        return table, None
    own = [names.original[n] for n in names.original if re.fullmatch(r"j\d+(_.*)?", n)]
    chosen: list[Key] | None = None
    for keys in _readings(table, labels):
        if _plausible(table, keys, joints, own):
            chosen = keys
            break
    if chosen is None:
        return table, None
    targets = in_order(list(dict.fromkeys(target for _, target in chosen)))
    points = [names.original[f"{axis}{unit}"] for axis in "xyz"]
    return _wide(table, chosen, targets, points, labels, unit), (
        f"{table.name}: one point per line, read as {len({c for c, _ in chosen})} configurations "
        f"of {count_of(len(targets), 'target')} ({', '.join(targets)})"
    )


def _readings(table: Table, labels: Sequence[str]) -> Iterator[list[Key]]:
    """Configuration and target of every row, for each possible reading of the names."""
    for configuration, target in permutations(labels, 2):
        yield list(zip(table.texts(configuration), table.texts(target), strict=True))
    for column in labels:
        texts = table.texts(column)
        for pattern, swapped in _SPLITS:
            matches = [pattern.fullmatch(text) for text in texts]
            if all(matches):
                pairs = [(m[1], m[2]) for m in matches if m]
                yield [(b, a) for a, b in pairs] if swapped else pairs


def _plausible(table: Table, keys: list[Key], joints: Table | None, own: Sequence[str]) -> bool:
    """Whether a reading gives complete configurations that agree with the joint values."""
    configurations = list(dict.fromkeys(configuration for configuration, _ in keys))
    targets = {target for _, target in keys}
    if not all(c and t for c, t in keys) or len(set(keys)) < len(keys):
        return False
    count = len(configurations)
    if len(targets) > _MOST_TARGETS or count < 2 or 2 * len(keys) < count * len(targets):
        return False
    if joints is None:
        return len(targets) > 1 and len(own) > 0 and _constant(table, keys, own)
    for column in label_columns(joints):
        if 2 * overlap(*compared(configurations, joints.texts(column))) > count:
            direct = (
                overlap(*compared(table.texts(c), joints.texts(column)))
                for c in label_columns(table)
            )
            return len(targets) > 1 or not any(direct)
    return len(targets) > 1 and count == len(joints) and not label_columns(joints)


def _constant(table: Table, keys: list[Key], own: Sequence[str]) -> bool:
    """Whether the joint values are the same in every line of a configuration."""
    columns = [table.texts(column) for column in own]
    seen: dict[str, tuple[str, ...]] = {}
    return all(
        seen.setdefault(configuration, values) == values
        for (configuration, _), *values_ in zip(keys, *columns, strict=True)
        for values in [tuple(values_)]
    )


def _wide(
    table: Table,
    keys: list[Key],
    targets: list[str],
    points: list[str],
    labels: Sequence[str],
    unit: str,
) -> Table:
    """Rows of a configuration side by side; other columns keep the value of its first line."""
    rest = [c for c in table.header if c not in (*points, *labels)]
    header = ["name", *(f"t{i + 1}_{a}{unit}" for i in range(len(targets)) for a in "xyz"), *rest]
    twice = [c for c in rest if c and c in header[: 1 + 3 * len(targets)]]
    if twice:
        raise InputError(
            f"{table.name}: column '{twice[0]}' stands beside x, y, z of one point per line; "
            "rename it"
        )
    at = [table.header.index(column) for column in points]
    others = [i for i, column in enumerate(table.header) if column in rest]
    place = {target: i for i, target in enumerate(targets)}
    rows: dict[str, list[str]] = {}
    lines: dict[str, int] = {}
    for (configuration, target), cells, line in zip(keys, table.rows, table.lines, strict=True):
        if configuration not in rows:
            rows[configuration] = [configuration, *[""] * (3 * len(targets))]
            rows[configuration] += [cells[i] for i in others]
            lines[configuration] = line
        start = 1 + 3 * place[target]
        rows[configuration][start : start + 3] = [cells[i] for i in at]
    return replace(table, header=header, rows=list(rows.values()), lines=list(lines.values()))
