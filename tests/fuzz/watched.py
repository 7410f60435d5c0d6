"""What Python opens, runs or connects to while a file is read: nothing but the file itself."""

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType

import numpy as np

_RUNNING = (
    "os.system",
    "os.exec",
    "os.fork",
    "os.forkpty",
    "os.posix_spawn",
    "os.spawn",
    "subprocess.Popen",
    "pty.spawn",
)
_CHANGING = (
    "os.remove",
    "os.rename",
    "os.mkdir",
    "os.rmdir",
    "os.link",
    "os.symlink",
    "os.truncate",
    "os.chmod",
)
_REACHING = (
    "socket.connect",
    "socket.bind",
    "socket.getaddrinfo",
    "urllib.Request",
    "ctypes.dlopen",
    "exec",
)
EVENTS = frozenset(("open", *_RUNNING, *_CHANGING, *_REACHING))

# Folders that are made for the moment: Pinocchio is given a URDF as a file, a journal is one.
_OWN = tuple(f"{tempfile.gettempdir()}/{prefix}" for prefix in ("calibtool-", "tmp"))
# Where modules are, which are imported when they are needed first.
_MODULES = tuple(str(path) for path in (sys.prefix, sys.base_prefix, Path(np.__path__[0]).parent))

_seen: list[str] | None = None


def _note(event: str, arguments: tuple[object, ...]) -> None:
    """An audit hook (PEP 578), which stays for the life of the process."""
    if _seen is None or event not in EVENTS:
        return
    what = arguments[0] if arguments else ""
    where = what.co_filename if isinstance(what, CodeType) else str(what)
    imported = where.startswith(_MODULES) and where.endswith((".py", ".pyc", ".so"))
    emptied = (
        event in ("os.remove", "os.rmdir") and arguments[-1] != -1
    )  # inside a folder that is open
    opened = where.isdigit()  # already, as a descriptor
    nameless = event == "open" and where == tempfile.gettempdir()  # O_TMPFILE: nothing stays
    if not (imported or emptied or opened or nameless or where.startswith(_OWN)):
        _seen.append(f"{event} {where}")


sys.addaudithook(_note)


@contextmanager
def watched() -> Iterator[list[str]]:
    """A list that grows with everything of EVENTS until the end.

    Calls of C libraries are not seen.
    """
    global _seen
    _seen = found = []
    try:
        yield found
    finally:
        _seen = None
