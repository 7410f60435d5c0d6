"""Tables for people, on stderr, and JSON objects for programs, on stdout."""

import contextlib
import json
import sys
from collections.abc import Sequence

from calibtool.cli.files import write_stdout
from calibtool.cli.verbosity import is_quiet
from calibtool.errors import printable

_LONGEST = 24  # elements of a list that people are shown


def print_json(value: dict[str, object]) -> None:
    """One JSON object on stdout."""
    write_stdout((json.dumps(value, allow_nan=False) + "\n").encode("ascii"))


def print_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table on stderr; the first column is left-aligned text.

    Colour only on a terminal without NO_COLOR. With --quiet there is none.
    """
    if is_quiet():
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console(
        stderr=True, width=None if sys.stderr.isatty() else 140, highlight=False, markup=False
    )
    table = Table(
        title=printable(title), title_justify="left", box=box.SIMPLE_HEAD, title_style="bold"
    )
    for i, name in enumerate(header):
        table.add_column(printable(name), justify="left" if i == 0 else "right")
    for row in rows:
        table.add_row(*map(printable, row))
    with contextlib.suppress(OSError):  # as in `message`
        console.print(table)


def lines(summary: dict[str, object], indent: str = "") -> list[str]:
    """A nested summary as `key: value` lines."""
    result = []
    for key, value in summary.items():
        if isinstance(value, dict):
            result += [f"{indent}{key}:", *lines(value, indent + "  ")]
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            result.append(f"{indent}{key}:")
            for item in value:
                result.append(
                    f"{indent}  - " + ", ".join(f"{k} {_text(v)}" for k, v in item.items())
                )
        else:
            result.append(f"{indent}{key}: {_text(value)}")
    return list(map(printable, result))


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        more = [f"… {len(value)} in all"] if len(value) > _LONGEST else []
        return "[" + ", ".join([*map(_text, value[:_LONGEST]), *more]) + "]"
    return "none" if value is None else str(value)
