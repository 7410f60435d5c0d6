"""Progress on a terminal: a line on stderr while something longer runs, gone without a trace when it ends."""

import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")


def counted(items: Iterable[T], what: str, step: int = 1, total: int | None = None) -> Iterator[T]:
    """The items, with their number on stderr while they come if that is a terminal; `step` of `what` for each item."""
    if not sys.stderr.isatty():
        yield from items
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True)
    bar = [BarColumn(), TimeRemainingColumn()] if total is not None else []
    with Progress(
        TextColumn("{task.completed:,.0f} " + what), *bar, TimeElapsedColumn(), console=console, transient=True
    ) as p:
        task = p.add_task(what, total=total)
        for item in items:
            yield item
            p.advance(task, step)
