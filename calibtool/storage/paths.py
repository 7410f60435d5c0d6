"""Measurements and calibrations read from and written to paths, for scripts."""

import os
import tempfile
from contextlib import suppress
from pathlib import Path

from calibtool.calibration.calibration import Calibration
from calibtool.errors import InputError, UsageError
from calibtool.measurement.measurements import Measurements
from calibtool.storage import read_any, to_bytes


def read(path: str | os.PathLike[str]) -> Measurements | Calibration:
    """The measurements or the calibration that a file of calibtool holds.

    Raises UsageError if there is no such file, InputError if it is damaged or something else.
    """
    try:
        with open(path, "rb") as stream:
            return read_any(stream, os.fspath(path))
    except FileNotFoundError:
        raise UsageError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None


def write(
    contents: Measurements | Calibration, path: str | os.PathLike[str], *, force: bool = False
) -> None:
    """Write an HDF5 file, whole or not at all; an existing one is replaced only with `force`.

    Raises UsageError if the file exists or cannot be written.
    """
    target = Path(path)
    if target.exists() and not force:
        raise UsageError(
            f"{path}: exists already; choose another name, or overwrite it with force=True"
        )
    data = to_bytes(contents)
    temporary: str | None = None
    try:
        descriptor, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, target)
    except OSError as error:
        if temporary is not None:
            with suppress(OSError):
                os.unlink(temporary)
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from None
