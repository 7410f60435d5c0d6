"""Measurements and calibrations read from and written to paths, for scripts."""

import os

from calibtool.atomic_output import staged, written_at
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
    """Write an HDF5 file, completely or not at all; an existing one is replaced only with `force`.

    A file system without fsync, locks or hard links gives a weaker guarantee (docs/reliability.md).
    Raises UsageError if the file exists or cannot be written.
    """
    target = written_at(path)
    try:
        if target.exists() and not force:
            raise FileExistsError
        with staged(target) as part:
            part.stream.write(to_bytes(contents))
            part.publish(force)
    except FileExistsError:
        raise UsageError(
            f"{path}: exists already; choose another name, or overwrite it with force=True"
        ) from None
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from None
