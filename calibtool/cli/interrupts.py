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

from calibtool.unfinished_files import put_off, remove_unfinished

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


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


def _raise(number: int, frame: FrameType | None) -> None:
    if not put_off(number):
        raise KeyboardInterrupt


def _leave(number: int, frame: FrameType | None) -> None:
    if put_off(number):
        return
    remove_unfinished()
    with contextlib.suppress(OSError, AttributeError, ValueError):
        if sys.stderr.isatty():  # a progress line may stand there, with the cursor hidden
            text = b"interrupted; no file is half written\n" if number == signal.SIGINT else b""
            os.write(sys.stderr.fileno(), b"\r\x1b[K\x1b[?25h" + text)
    os._exit(128 + number)
