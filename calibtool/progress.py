"""Progress of long loops: whoever calls may look on; the library only passes its items through."""

from collections.abc import Iterable
from typing import Protocol, TypeVar

T = TypeVar("T")


class Progress(Protocol):
    """A callback of long loops: gives back the items it gets; `what` says what they are.

    `tqdm.tqdm` is one.
    """

    def __call__(self, items: Iterable[T], what: str, /) -> Iterable[T]: ...


def silent(items: Iterable[T], what: str, /) -> Iterable[T]:
    """The default: progress is not shown."""
    return items
