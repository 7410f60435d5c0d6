"""Atomic output: a temporary file beside its target, renamed to it when it is complete.

It is called `.NAME.xxxxxxxx.calibtool-part` and locked by its process. One without a lock was left
by a process that was killed; the next output of the same name removes it.
"""

import contextlib
import errno
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import BinaryIO

from calibtool.unfinished_files import held, unfinished

if sys.platform != "win32":
    import fcntl

SUFFIX = ".calibtool-part"
# Of the output's name, so that the whole stays below the 255 that file systems allow
_NAME_BYTES = 200


# What FAT sticks and network shares answer to calls that they do not know.
_UNKNOWN = {
    errno.EPERM,
    errno.EACCES,
    errno.EINVAL,
    errno.ENOSYS,
    errno.ENOTSUP,
    errno.ENOLCK,
    errno.ENOTTY,
}
# What is lost where one of them is missing.
_LOSS = {
    "locks": "nobody tells what a killed process left behind",
    "permissions": "the file has those that the system gives it",
    "fsync": "a power cut may lose it",
    "hard links": "a file made under the same name in the same moment would be replaced",
}


@dataclass(frozen=True)
class PartialFile:
    """A temporary file, open for writing, and its target.

    lacking  what the file system cannot do, of `_LOSS`: the guarantee is weaker then
    """

    stream: BinaryIO
    temporary: str
    target: Path
    lacking: list[str] = field(default_factory=list)

    def publish(self, force: bool) -> None:
        """Rename the complete file to its target.

        FileExistsError without `force` if the target exists by now.
        """
        self.stream.flush()
        descriptor = self.stream.fileno()
        attempt("permissions", self.lacking, lambda: _adopt_permissions(descriptor, self.target))
        attempt("fsync", self.lacking, lambda: os.fsync(descriptor))
        if force:
            os.replace(self.temporary, self.target)
            return
        try:
            os.link(self.temporary, self.target)  # unlike a rename, never over another file
        except FileExistsError:
            raise
        except OSError:
            if os.path.lexists(self.target):
                raise FileExistsError(self.target) from None
            os.replace(self.temporary, self.target)
            self.lacking.append("hard links")


def attempt(what: str, lacking: list[str], call: Callable[[], object]) -> None:
    """Call what some file systems do not know; then `what` is noted in `lacking`, once."""
    try:
        call()
    except OSError as error:
        if error.errno not in _UNKNOWN:
            raise
        if what not in lacking:
            lacking.append(what)


def weaker(lacking: list[str]) -> str:
    """A line about a file that was written all the same."""
    parts = ", ".join(f"no {what} ({_LOSS[what]})" for what in lacking)
    return f"written with a weaker guarantee: the file system knows {parts}"


def written_at(path: str | os.PathLike[str]) -> Path:
    """The file that is written: the target of a symbolic link."""
    return Path(os.path.realpath(path)) if os.path.islink(path) else Path(path)


def encoded(contents: bytes | str) -> bytes:
    """The bytes to write: text as UTF-8.

    File names that are none, which Python keeps as surrogates, become the replacement character.
    """
    if isinstance(contents, bytes):
        return contents
    return contents.encode("utf-8", "surrogateescape").decode("utf-8", "replace").encode("utf-8")


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
            lacking: list[str] = []  # without locks no process removes abandoned files
            if sys.platform != "win32":
                attempt("locks", lacking, partial(fcntl.flock, descriptor, fcntl.LOCK_EX))
            # else taken for abandoned by another process, just before it was locked
            if os.path.exists(temporary):
                break
        yield PartialFile(stream, temporary, target, lacking)


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
        if sys.platform != "win32":  # without locks it is unknown whether its process has ended
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
