"""Journal of finished runs on disk, one synced line each, from which a study is resumed."""

import json
import os
import stat
import sys
from functools import partial
from pathlib import Path
from types import TracebackType

from calibtool.atomic_output import attempt
from calibtool.errors import UsageError
from calibtool.evaluation.study.definition import Study
from calibtool.evaluation.study.study_table import Row, checked_row

if sys.platform != "win32":
    import fcntl

SCHEMA = "calibtool/study-journal"
_START = json.dumps({"schema": SCHEMA})[:-1].encode()
_REMEDY = "choose another output, or discard it by --force"


class Journal:
    """An append-only file of finished runs; without a path they are kept in memory alone.

    finished   rows by the index of their run
    lacking    what its file system cannot do (`atomic_output.weaker`)

    Opening reads what is there. Raises UsageError when the file belongs to another study (unless it
    may be discarded), is in use, cannot be written, or is a link, a pipe or a device.
    """

    def __init__(self, path: Path | None, study: Study, *, discard: bool = False) -> None:
        self.path, self.study = path, study
        self.finished: dict[int, list[Row]] = {}
        self.lacking: list[str] = []
        self._file: int | None = None
        if path is not None:
            try:
                self._file = self._open(path, discard)
            except OSError as error:
                raise self._unwritable(error) from None

    def add(self, index: int, rows: list[Row]) -> None:
        """Keep the rows of a run; when this returns they are on the disk."""
        if self._file is not None:
            try:
                self._write(json.dumps({"run": index, "rows": rows}, allow_nan=False))
            except OSError as error:
                raise self._unwritable(error) from None
        self.finished[index] = rows

    def rows(self) -> tuple[Row, ...]:
        """All rows in the order of the runs."""
        return tuple(row for index in sorted(self.finished) for row in self.finished[index])

    def remove(self) -> None:
        """Remove the journal after the study was written."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        if self._file is not None:
            if not self.finished:
                self.remove()
            os.close(self._file)
            self._file = None

    def _open(self, path: Path, discard: bool) -> int:
        if path.is_symlink():  # whose target would be cut off
            raise UsageError(f"{path}: is a link; {_REMEDY.partition(',')[0]}")
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND
        flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        file = os.open(path, flags, 0o666)
        try:
            if not stat.S_ISREG(os.fstat(file).st_mode):
                raise UsageError(f"{path}: is no regular file; {_REMEDY.partition(',')[0]}")
            if sys.platform != "win32":  # no such locks there
                lock = partial(fcntl.flock, file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                attempt("locks", self.lacking, lock)
            with open(file, "rb", closefd=False) as stream:
                data = stream.read()
            # a line that was cut off by an interruption is dropped
            whole = data[: data.rfind(b"\n") + 1]
            try:
                if not data.startswith(_START[: len(data)]):
                    raise UsageError(f"{path}: is no journal of calibtool study; {_REMEDY}")
                self._read(whole.decode("utf-8", "replace").splitlines(), path)
            except UsageError:
                if not discard:
                    raise
                self.finished, whole = {}, b""
            if len(whole) < len(data):  # some file systems cannot truncate
                os.ftruncate(file, len(whole))
            self._file = file
            if not whole:
                self._write(json.dumps({"schema": SCHEMA, "study": self.study.key}))
        except BlockingIOError:
            os.close(file)
            raise UsageError(f"{path}: another calibtool is working on this study") from None
        except BaseException:
            os.close(file)
            raise
        return file

    def _read(self, lines: list[str], path: Path) -> None:
        if not lines:
            return
        try:
            key = str(json.loads(lines[0])["study"])
        except (ValueError, KeyError, TypeError, RecursionError):
            raise UsageError(f"{path}:1: damaged; {_REMEDY}") from None
        if key != self.study.key:
            raise UsageError(
                f"{path}: holds the finished runs of another study ({key}, this one is "
                f"{self.study.key}); finish that one, or {_REMEDY}"
            )
        for number, line in enumerate(lines[1:], start=2):
            try:
                entry = json.loads(line)
                if type(entry["run"]) is not int or not 0 <= entry["run"] < self.study.count:
                    raise ValueError("no run of this study")
                self.finished[entry["run"]] = [checked_row(row) for row in entry["rows"]]
            except (ValueError, KeyError, TypeError, RecursionError):
                raise UsageError(f"{path}:{number}: damaged; {_REMEDY}") from None

    def _write(self, line: str) -> None:
        assert self._file is not None
        data = memoryview((line + "\n").encode())
        while data:
            data = data[os.write(self._file, data) :]
        attempt("fsync", self.lacking, partial(os.fsync, self._file))

    def _unwritable(self, error: OSError) -> UsageError:
        return UsageError(f"{self.path}: cannot be written: {error.strerror or error}")
