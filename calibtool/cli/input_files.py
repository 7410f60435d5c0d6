"""Measurements and calibrations from the command line's files."""

import io
from typing import TYPE_CHECKING

from calibtool.cli.files import message, read_bytes, shown
from calibtool.cli.options import choice

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.calibration.frame import FrameName
    from calibtool.measurement.measurements import Measurements


def load_measurements(path: str) -> "tuple[Measurements, bytes]":
    """Measurements of a file (`-`: stdin), and its bytes for the provenance."""
    from calibtool.storage import read_measurements

    data = read_bytes(path)
    return read_measurements(io.BytesIO(data), shown(path)), data


def load_calibration(path: str, frame: str | None = None) -> "tuple[Calibration, bytes]":
    """A calibration of a file (`-`: stdin), in the frames of --frame, and its bytes."""
    from calibtool.storage import read_calibration

    data = read_bytes(path)
    calibration = read_calibration(io.BytesIO(data), shown(path))
    return calibration if frame is None else in_frame(calibration, frame, shown(path)), data


def in_frame(contents: "Calibration | Measurements", frame: str, name: str) -> "Calibration":
    """A calibration in the frames of --frame, with a line where there is nothing to choose.

    UsageError for measurements, called `name`, or an unknown frame.
    """
    from calibtool.calibration import Calibration
    from calibtool.errors import UsageError

    chosen = frame_name(frame)
    if not isinstance(contents, Calibration):
        raise UsageError(f"--frame: {name} holds measurements; the frame is a calibration's")
    say_if_frame_is_not_free(contents, name)
    return contents.in_frame(chosen)


def frame_name(frame: str) -> "FrameName":
    """The value of --frame. UsageError for an unknown one."""
    from typing import cast

    from calibtool.calibration.frame import FRAMES, FrameName

    return cast(FrameName, choice(frame, FRAMES, "--frame"))


def say_if_frame_is_not_free(calibration: "Calibration", name: str) -> None:
    """A line where --frame has nothing to choose."""
    if calibration.frame_is_free:
        return
    known = calibration.base.setup.known
    why = "the base model is the nominal robot"
    if known:
        why = "instrument frame and targets are known"
    message(f"{name}: --frame has nothing to choose: {why}")
