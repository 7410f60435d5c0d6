"""Files that must not stay behind when the process is ended, and steps that must not be cut.

The command line removes them in its signal handlers (`cli/interrupts.py`).
"""

import contextlib
import os
import shutil
import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path

_unfinished: set[str] = set()  # temporary files and folders, gone when the process is ended
# 0 for every block that must not be interrupted, then the signals that arrived in it.
_held: list[int] = []


@contextlib.contextmanager
def unfinished(path: str) -> Iterator[None]:
    """A temporary file that is removed however the block ends, except by SIGKILL."""
    _unfinished.add(path)
    try:
        yield
    finally:
        _remove(path)
        _unfinished.discard(path)


@contextlib.contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder that is removed with all that is in it, in the same way."""
    with contextlib.ExitStack() as stack:
        with held():  # no signal between the folder and the note to remove it
            folder = tempfile.mkdtemp(prefix="calibtool-")
            stack.enter_context(unfinished(folder))
        yield Path(folder)


def remove_unfinished() -> None:
    """Remove all of them: the process ends."""
    for path in _unfinished:
        _remove(path)


@contextlib.contextmanager
def held() -> Iterator[None]:
    """Signals wait until the end of the block, for steps that must not be separated."""
    _held.append(0)
    try:
        yield
    finally:
        _held.remove(0)
        if 0 not in _held and _held:
            number = _held.pop()
            handler = signal.getsignal(number)
            assert callable(handler)  # it was one that put the signal there
            handler(number, None)


def put_off(number: int) -> bool:
    """Whether a signal has to wait for the end of a block; it is handled then."""
    if 0 in _held:
        _held.append(number)
        return True
    return False


def _remove(path: str) -> None:
    if os.path.isdir(path) and not os.path.islink(path):
        shutil.rmtree(path, ignore_errors=True)
        return
    with contextlib.suppress(OSError):
        os.unlink(path)
