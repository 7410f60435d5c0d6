"""Atomic output: a temporary file beside its target, renamed to it when it is complete.

It is called `.NAME.xxxxxxxx.calibtool-part` and locked by its process. One without a lock was left
by a process that was killed; the next output of the same name removes it.
"""

import contextlib
import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from calibtool.cli.interrupts import held, unfinished

if sys.platform != "win32":
    import fcntl

SUFFIX = ".calibtool-part"
_NAME_BYTES = (
    200  # of the output's name, so that the whole stays below the 255 that file systems allow
)


@dataclass(frozen=True)
class PartialFile:
    """A temporary file, open for writing, and its target."""

    stream: BinaryIO
    temporary: str
    target: Path

    def publish(self, force: bool) -> None:
        """Rename the complete file to its target.

        FileExistsError without `force` if the target exists by now.
        """
        self.stream.flush()
        _adopt_permissions(self.stream.fileno(), self.target)
        os.fsync(self.stream.fileno())
        if force:
            os.replace(self.temporary, self.target)
            return
        try:
            os.link(self.temporary, self.target)  # unlike a rename, never over another file
        except FileExistsError:
            raise
        except OSError:  # a file system without hard links
            if os.path.lexists(self.target):
                raise FileExistsError(self.target) from None
            os.replace(self.temporary, self.target)


@contextlib.contextmanager
def staged(target: Path) -> Iterator[PartialFile]:
    """A partial file for `target` in the same folder; removed when the block ends without
    `publish`.

    OSError if it cannot be made.
    """
    mark = f".{os.fsdecode(os.fsencode(target.name)[:_NAME_BYTES])}."
    remove_abandoned(target.parent, mark)
    with contextlib.ExitStack() as stack:
        while True:
            with held():  # no signal between the file and the note to remove it
                descriptor, temporary = tempfile.mkstemp(
                    dir=target.parent, prefix=mark, suffix=SUFFIX
                )
                stack.enter_context(unfinished(temporary))
            stream = os.fdopen(descriptor, "wb")
            stack.callback(_close, stream)
            with contextlib.suppress(
                OSError
            ):  # no locks on this file system: nobody removes anything either
                if sys.platform != "win32":
                    fcntl.flock(descriptor, fcntl.LOCK_EX)
            if os.path.exists(
                temporary
            ):  # else taken for abandoned by another process, just before it was locked
                break
        yield PartialFile(stream, temporary, target)


def _close(stream: BinaryIO) -> None:
    """`publish` has flushed what counts; what is still held here is of a part that failed, and
    may not fit again.
    """
    with contextlib.suppress(OSError):
        stream.close()


def remove_abandoned(folder: Path, mark: str) -> None:
    """Remove partial files of processes that have ended: those whose lock is free."""
    with contextlib.suppress(OSError):
        for name in os.listdir(folder):
            if (
                name.startswith(mark)
                and name.endswith(SUFFIX)
                and len(name) == len(mark) + 8 + len(SUFFIX)
            ):
                with contextlib.suppress(OSError):
                    _remove_unlocked(os.path.join(folder, name))


def _remove_unlocked(path: str) -> None:
    descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        if sys.platform != "win32":  # without locks nobody knows whether its process has ended
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.unlink(path)
    finally:
        os.close(descriptor)


def _adopt_permissions(descriptor: int, target: Path) -> None:
    """Permissions of the replaced file, or rw-rw-rw- without the umask."""
    try:
        old = os.stat(target)
    except OSError:
        mask = os.umask(0)
        os.umask(mask)
        os.fchmod(descriptor, 0o666 & ~mask)
        return
    with contextlib.suppress(OSError):  # another user's file: it becomes ours
        os.fchown(descriptor, old.st_uid, old.st_gid)
    os.fchmod(descriptor, old.st_mode & 0o777)
