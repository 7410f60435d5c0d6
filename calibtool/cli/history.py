"""A history: a file of JSON objects, one per line, that grows by whole lines only."""

import json
import os
import sys
from functools import partial
from pathlib import Path

from calibtool.atomic_output import attempt, weaker
from calibtool.cli.files import message
from calibtool.errors import InputError, UsageError

if sys.platform != "win32":
    import fcntl


def append(path: str, entry: dict[str, object]) -> None:
    """Append one line; other processes wait for it, and a line that cannot be written is undone.

    A warning is printed where the file system gives a weaker guarantee. UsageError where the file
    cannot be written.
    """
    lacking: list[str] = []
    line = (json.dumps(entry, allow_nan=False) + "\n").encode("ascii")
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        try:
            if sys.platform != "win32":
                attempt("locks", lacking, partial(fcntl.flock, descriptor, fcntl.LOCK_EX))
            size = os.fstat(descriptor).st_size
            if size and os.pread(descriptor, 1, size - 1) != b"\n":
                line = b"\n" + line  # after a line that was cut off
            try:
                if os.write(descriptor, line) != len(line):
                    raise OSError("only a part of the line fits")
                attempt("fsync", lacking, partial(os.fsync, descriptor))
            except OSError:
                os.ftruncate(descriptor, size)
                raise
        finally:
            os.close(descriptor)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from None
    if lacking:
        message(f"note: {path}: {weaker(lacking)}")


def entries(path: str, schema: str) -> tuple[list[dict[str, object]], int]:
    """The objects of a history with this schema, and how many lines were cut off.

    An empty history where there is no file. InputError for a file that is something else.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        return [], 0
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    found: list[dict[str, object]] = []
    cut = 0
    for number, line in enumerate(text.splitlines(), 1):
        try:
            entry = json.loads(line) if line.strip() else None
        except json.JSONDecodeError:
            cut += 1
            continue
        if entry is None:
            continue
        if not isinstance(entry, dict) or entry.get("schema") != schema:
            raise InputError(f"{path}:{number}: is no line of a {schema} history")
        found.append(entry)
    return found, cut
