"""Measurements and calibrations from the command line's files."""

import io
from typing import TYPE_CHECKING

from calibtool.cli.files import read_bytes, shown

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.measurement.measurements import Measurements


def load_measurements(path: str) -> "tuple[Measurements, bytes]":
    """Measurements of a file (`-`: stdin), and its bytes for the provenance."""
    from calibtool.storage import read_measurements

    data = read_bytes(path)
    return read_measurements(io.BytesIO(data), shown(path)), data


def load_calibration(path: str) -> "tuple[Calibration, bytes]":
    """A calibration of a file (`-`: stdin), and its bytes for the provenance."""
    from calibtool.storage import read_calibration

    data = read_bytes(path)
    return read_calibration(io.BytesIO(data), shown(path)), data
