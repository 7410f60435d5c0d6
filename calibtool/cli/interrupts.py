"""Handling of SIGINT, SIGTERM and SIGHUP: commands end at once and leave no incomplete files.

The handler cleans up and exits by itself. An exception would have to pass through modules that are
being imported and callbacks of compiled libraries, which suppress or replace it.
"""

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_unfinished: set[str] = set()  # temporary files, gone when the process is ended
_held: list[
    int
] = []  # 0 for every block that must not be broken off, then the signals that arrived in it


@contextlib.contextmanager
def leaving_at_once() -> Iterator[None]:
    """In this block, SIGINT, SIGTERM and SIGHUP end the process with 128 + their number
    (130, 143, 129).

    Ignored signals stay ignored (`nohup`, background jobs of a shell). No effect outside the main
    thread.
    """
    before = {}
    with contextlib.suppress(ValueError):  # not the main thread
        for number in _SIGNALS:
            if signal.getsignal(number) != signal.SIG_IGN:
                before[number] = signal.signal(number, _leave)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """In this block Ctrl-C raises an exception, for commands that print something when stopped."""
    before = None
    with contextlib.suppress(ValueError):  # not the main thread
        before = signal.signal(signal.SIGINT, _raise)
    try:
        yield
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def unfinished(path: str) -> Iterator[None]:
    """A temporary file that is removed however the block ends, except by SIGKILL."""
    _unfinished.add(path)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            os.unlink(path)
        _unfinished.discard(path)


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


def _raise(number: int, frame: FrameType | None) -> None:
    if 0 in _held:
        _held.append(number)
        return
    raise KeyboardInterrupt


def _leave(number: int, frame: FrameType | None) -> None:
    if 0 in _held:
        _held.append(number)
        return
    for path in _unfinished:
        with contextlib.suppress(OSError):
            os.unlink(path)
    with contextlib.suppress(OSError, AttributeError, ValueError):
        if sys.stderr.isatty():  # a progress line may stand there, with the cursor hidden
            told = b"interrupted; no file is half written\n" if number == signal.SIGINT else b""
            os.write(sys.stderr.fileno(), b"\r\x1b[K\x1b[?25h" + told)
    os._exit(128 + number)
