"""Tables for people, on stderr, and JSON objects for programs, on stdout."""

import json
import os
import sys
from collections.abc import Sequence

from calibtool.cli.files import stderr_width, wrapped, write_stdout
from calibtool.cli.verbosity import is_quiet, tell
from calibtool.errors import printable
from calibtool.units import minus

_GAP = "  "  # between two columns
_WIDTH = 80  # characters in a line of a summary
_LONGEST = 24  # number of elements up to which a list is printed
_LONG_TEXT = 60  # characters from which an element gets lines of its own


def print_json(value: dict[str, object]) -> None:
    """One JSON object on stdout."""
    write_stdout((json.dumps(value, allow_nan=False) + "\n").encode("ascii"))


Table = tuple[Sequence[str], Sequence[Sequence[str]]]  # header and rows


def print_tables(title: str, tables: Sequence[Table], keys: int = 1) -> None:
    """Tables under a title, on stderr; their first column is left-aligned text.

    They are as wide as the terminal, 80 columns elsewhere: columns that do not fit follow below,
    beginning with the first `keys` columns again. Bold only on a terminal without NO_COLOR. With
    --quiet there is none.
    """
    if is_quiet():
        return
    bold = sys.stderr.isatty() and "NO_COLOR" not in os.environ
    first, *rest = wrapped(printable(title), stderr_width())
    found = [f"\x1b[1m{first}\x1b[0m" if bold else first, *rest]
    for header, rows in tables:
        found += table_lines(header, [list(map(minus, row)) for row in rows], stderr_width(), keys)
    tell([*found, ""])


def table_lines(
    header: Sequence[str], rows: Sequence[Sequence[str]], width: int, keys: int = 1
) -> list[str]:
    """Lines of a table without blanks at their ends, `width` wide where a column allows it."""
    from rich.cells import cell_len

    cells = [list(map(printable, row)) for row in (header, *rows)]
    sizes = [max(map(cell_len, column)) for column in zip(*cells, strict=True)]
    result = []
    for columns in _blocks(sizes, width, keys):

        def line(row: Sequence[str], columns: list[int] = columns) -> str:
            parts = []
            for k in columns:
                blanks = " " * (sizes[k] - cell_len(row[k]))
                parts.append(row[k] + blanks if k == 0 else blanks + row[k])
            return f"  {_GAP.join(parts)}".rstrip()

        rule = "─" * (sum(sizes[k] for k in columns) + len(_GAP) * (len(columns) - 1) + 2)
        result += ["", line(cells[0]), f" {rule}", *map(line, cells[1:])]
    return result


def _blocks(sizes: list[int], width: int, keys: int) -> list[list[int]]:
    """Columns of every block: the keys, and as many of the others as fit."""
    first = list(range(keys))
    blocks = [list(first)]
    for k in range(keys, len(sizes)):
        own = [*blocks[-1], k]
        wide = 3 + sum(sizes[c] for c in own) + len(_GAP) * (len(own) - 1)
        if wide > width and len(blocks[-1]) > keys:
            blocks.append([*first, k])
        else:
            blocks[-1].append(k)
    return blocks


def print_summary(summary: dict[str, object]) -> None:
    """A nested summary as text on stdout, see `lines`."""
    write_stdout(("\n".join(lines(summary)) + "\n").encode())


def lines(summary: dict[str, object], indent: str = "") -> list[str]:
    """A nested summary as `key: value` lines; lists of entries become tables."""
    result = []
    for key, value in summary.items():
        if isinstance(value, dict):
            result += [f"{indent}{key}:", *lines(value, indent + "  ")]
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            result += [f"{indent}{key}:", *_rows(value, indent)]
        elif isinstance(value, list) and any(len(str(item)) > _LONG_TEXT for item in value):
            result.append(f"{indent}{key}:")
            for item in value:
                result += wrapped(f"{indent}  - {_text(item)}", _WIDTH)
        else:
            result.append(f"{indent}{key}: {_text(value)}")
    return list(map(printable, result))


def _rows(items: list[dict[str, object]], indent: str) -> list[str]:
    """Items as rows under the names of their entries, in 80 columns; of many the first ones."""
    header = list(dict.fromkeys(key for item in items for key in item))
    rows = [[_text(item.get(key, ""), 4) for key in header] for item in items[:_LONGEST]]
    found = [indent + line for line in table_lines(header, rows, _WIDTH - len(indent)) if line]
    more = len(items) > _LONGEST
    return [*found, f"{indent}  … {len(items)} in all (--json)"] if more else found


def _text(value: object, digits: int = 6) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.{digits}g}"
    if isinstance(value, list):
        more = [f"… {len(value)} in all"] if len(value) > _LONGEST else []
        return "[" + ", ".join([*map(_text, value[:_LONGEST]), *more]) + "]"
    return "none" if value is None else str(value)
