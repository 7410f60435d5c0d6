"""Progress of long commands: a line on the terminal that is removed at the end."""

import contextlib
import sys
from collections.abc import Callable, Iterable, Iterator, Sized
from typing import TYPE_CHECKING, TypeVar

from calibtool.cli.verbosity import detail, is_quiet, seconds

if TYPE_CHECKING:
    from rich.progress import Progress

T = TypeVar("T")

# A terminal has one live display: a loop within a loop gets a line below it.
_live: "Progress | None" = None


def counted(items: Iterable[T], what: str, step: int = 1, total: int | None = None) -> Iterator[T]:
    """The items, with their number on stderr if that is a terminal; `step` of `what` for each item.

    It is the argument `progress` of library functions; the length of the items is the total.
    """
    if total is None and isinstance(items, Sized):
        total = len(items) * step
    begun, count = seconds(), 0
    with _line(what, total) as show:
        show(0)
        for item in items:
            yield item
            count += step
            show(count)
    detail(f"{count:,} {what}: {seconds() - begun:.2f} s")


@contextlib.contextmanager
def working(what: str) -> Iterator[None]:
    """A line with the elapsed time while something runs whose duration is unknown."""
    begun = seconds()
    with _line(what):
        yield
    detail(f"{what}: {seconds() - begun:.2f} s")


@contextlib.contextmanager
def _line(what: str, total: int | None = None) -> Iterator[Callable[[int], None]]:
    """A line on the terminal and a function that updates it; neither without a terminal."""
    global _live
    # rich puts its own stream before a terminal
    if is_quiet() or (_live is None and not sys.stderr.isatty()):
        yield lambda count: None
        return
    live = outer = _live
    if live is None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
        live = _live = Progress(
            *columns, console=Console(stderr=True), transient=True, redirect_stdout=False
        )
        live.start()
    of = "" if total is None else f" of {total:,}"
    task = live.add_task(what, total=total)
    try:
        # The first picture at once, also when the end comes before the next.
        yield lambda count: live.update(
            task, completed=count, description=f"{count:,}{of} {what}", refresh=not count
        )
    finally:
        live.remove_task(task)
        if outer is None:
            live.stop()
            _live = None
