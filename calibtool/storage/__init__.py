"""HDF5 files: measurements, calibrations and tables of studies to bytes and back.

Formats: docs/file-formats.md. The same contents give the same bytes: no time stamps, no pickles,
groups and datasets in a fixed order.
"""

import io
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, BinaryIO, TypeVar

import h5py

from calibtool import __version__
from calibtool.calibration.calibration import Calibration
from calibtool.errors import CalibtoolError, InputError
from calibtool.measurement.measurements import Measurements
from calibtool.storage.calibration_groups import build_calibration, write_calibration
from calibtool.storage.file_checks import SIGNATURE, check_bytes, check_contents, with_digest
from calibtool.storage.measurement_groups import build_measurements, write_measurements
from calibtool.storage.shared_groups import write_robot
from calibtool.storage.texts import put_string, string

if TYPE_CHECKING:
    from calibtool.storage.studies import StudyFile

MEASUREMENTS = "calibtool/measurements"
CALIBRATION = "calibtool/calibration"
STUDY = "calibtool/study"
_WORDS = {
    MEASUREMENTS: "measurements",
    CALIBRATION: "a calibration",
    STUDY: "the table of a study",
}
SCHEMA_VERSION = 1
_LOOK = 1000  # number of bytes by which text is distinguished from other data

T = TypeVar("T")
Builders = Mapping[str, Callable[[h5py.File], T]]


def to_bytes(contents: Measurements | Calibration) -> bytes:
    """The HDF5 file of measurements or of a calibration."""

    def fill(file: h5py.File) -> None:
        write_robot(file, contents.robot)
        if isinstance(contents, Measurements):
            write_measurements(file, contents)
        else:
            write_calibration(file, contents)
        provenance = file.create_group("provenance")
        for name, text in sorted(contents.provenance.items()):
            put_string(provenance, name, text)

    return new_file(MEASUREMENTS if isinstance(contents, Measurements) else CALIBRATION, fill)


def new_file(schema: str, fill: Callable[[h5py.File], None]) -> bytes:
    """An HDF5 file of a schema, with its version, its creator and what `fill` writes into it."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=("v110", "v110")) as file:
        put_string(file, "schema", schema)
        file.attrs["schema_version"] = SCHEMA_VERSION
        put_string(file, "creator", "calibtool")
        put_string(file, "creator_version", __version__)
        fill(file)
    return with_digest(buffer.getvalue())


def read_measurements(stream: BinaryIO, name: str) -> Measurements:
    """Measurements from a binary stream; `name` is used in messages.

    Raises InputError for anything else.
    """
    return _read(stream, name, {MEASUREMENTS: build_measurements})


def read_calibration(stream: BinaryIO, name: str) -> Calibration:
    """A calibration from a binary stream; `name` is used in messages.

    Raises InputError for anything else.
    """
    return _read(stream, name, {CALIBRATION: build_calibration})


def read_study(stream: BinaryIO, name: str) -> "StudyFile":
    """The table of a study from a binary stream; `name` is used in messages.

    Raises InputError for anything else.
    """
    return _read(stream, name, {STUDY: _build_study})


def read_any(stream: BinaryIO, name: str) -> Measurements | Calibration:
    """Whichever of the two kinds the stream holds."""
    build: Builders[Measurements | Calibration] = {
        MEASUREMENTS: build_measurements,
        CALIBRATION: build_calibration,
    }
    return _read(stream, name, build)


def read_every(stream: BinaryIO, name: str) -> "Measurements | Calibration | StudyFile":
    """Whichever kind of file of calibtool the stream holds."""
    build: Builders[Measurements | Calibration | StudyFile] = {
        MEASUREMENTS: build_measurements,
        CALIBRATION: build_calibration,
        STUDY: _build_study,
    }
    return _read(stream, name, build)


def _build_study(file: h5py.File) -> "StudyFile":
    from calibtool.storage.studies import build_study  # the definition of a study is slow to import

    return build_study(file)


def _read(stream: BinaryIO, name: str, builders: Builders[T]) -> T:
    """The object of a file, made by the function of its schema."""
    data = stream.read()
    if not data:
        raise InputError(
            f"{name}: empty; expected a calibtool HDF5 file (did the command before fail?)"
        )
    try:
        check_bytes(data)
        with h5py.File(io.BytesIO(data), "r") as file:
            check_contents(file, len(data))
            found = _schema(file)
            if found == STUDY and STUDY not in builders:
                raise InputError(
                    f"{name}: the table of a study; calibtool info and any HDF5 reader open it"
                )
            if found not in (MEASUREMENTS, CALIBRATION, STUDY):
                raise InputError(
                    f"{name}: an HDF5 file, but not one of calibtool (no schema {MEASUREMENTS} or "
                    f"{CALIBRATION})"
                )
            version = int(file.attrs.get("schema_version", 0))
            if version > SCHEMA_VERSION:
                raise InputError(
                    f"{name}: written in format version {version}, this calibtool reads up to "
                    f"{SCHEMA_VERSION}; install a newer calibtool"
                )
            if found not in builders:
                expected = " or ".join(_WORDS[schema] for schema in builders)
                raise InputError(f"{name}: holds {_WORDS[found]}; expected {expected}")
            return builders[found](file)
    except InputError as error:
        raise error if str(error).startswith(name) else InputError(f"{name}: {error}") from None
    except CalibtoolError:
        raise
    except OSError:
        raise InputError(f"{name}: {_what_it_is(data)}") from None
    except (
        KeyError,
        ValueError,
        TypeError,
        RuntimeError,
        IndexError,
        AttributeError,
        OverflowError,
    ) as error:
        raise InputError(f"{name}: damaged: {' '.join(str(error).split())}") from None


def _what_it_is(data: bytes) -> str:
    """The kind of a file that HDF5 cannot read, and the command that reads it."""
    expected = "expected a file that calibtool wrote"
    if data.startswith(SIGNATURE):
        return f"an HDF5 file that is cut off or damaged; {expected}"
    text = data.lstrip()[:_LOOK]
    if text.startswith(b"<"):
        return f"not an HDF5 file but XML; {expected} (calibtool robots reads a URDF)"
    if b"\0" not in text:
        return f"not an HDF5 file but text; {expected} (calibtool import reads tables)"
    return f"not an HDF5 file; {expected}"


def _schema(file: h5py.File) -> str:
    try:
        return string(file, "schema", "")
    except ValueError:
        return ""
