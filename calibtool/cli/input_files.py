"""Measurements and calibrations from the command line's files."""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calibtool.cli.files import message, read_bytes, shown
from calibtool.cli.options import choice
from calibtool.errors import UsageError
from calibtool.units import count_of

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.calibration.frame import FrameName
    from calibtool.measurement.measurements import Measurements
    from calibtool.robot.robot import Robot


@dataclass(frozen=True)
class RobotOptions:
    """How the description of a robot is read."""

    tool: Annotated[
        str | None,
        typer.Option(
            "--tool",
            metavar="FRAME",
            help="The tool frame of a bare URDF, where its names do not tell it.",
        ),
    ] = None
    allow: Annotated[
        list[str] | None,
        typer.Option(
            "--allow",
            metavar="FOLDER",
            help="A folder, besides its own, whose files the robot's description may name; "
            "repeatable.",
        ),
    ] = None

    def load(self, name: str) -> "Robot":
        """The robot of a ROBOT argument, with a warning for what is assumed or implausible."""
        robot = self.load_unchecked(name)
        say_doubts(robot)
        return robot

    def load_unchecked(self, name: str) -> "Robot":
        """The same without warnings; UsageError for an --allow that is no folder."""
        from calibtool.robot.catalogue import load_robot

        folders = tuple(Path(folder) for folder in self.allow or [])
        for folder in folders:
            if not folder.is_dir():
                raise UsageError(f"--allow: {folder}: no such folder")
        return load_robot(name, self.tool, folders)


def say_doubts(robot: "Robot") -> None:
    """Warn of what was assumed without a robot.toml, and of implausible values."""
    from calibtool.robot.plausibility import implausible

    assumed = robot.source.description.assumed
    for line in [*([assumed] if assumed else []), *implausible(robot)]:
        message(f"warning: {robot.name}: {line}")


def load_measurements(path: str) -> "tuple[Measurements, bytes]":
    """Measurements of a file (`-`: stdin), and its bytes for the provenance.

    The findings of their import are reported again.
    """
    from calibtool.storage import read_measurements

    data = read_bytes(path)
    measurements = read_measurements(io.BytesIO(data), shown(path))
    say_doubts(measurements.robot)
    for finding in measurements.findings:
        message(f"warning: {shown(path)}: {finding}")
    return measurements, data


def measurements_words(measurements: "Measurements") -> str:
    """Description of measurements, for the line after they were written."""
    kind = measurements.setup.kind.words.format(m=measurements.points.shape[1])
    count = count_of(len(measurements), "configuration")
    seen = kind.replace("1 target points", "1 target point")
    return f"{count} of {measurements.robot.name}, {seen}"


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

    chosen = frame_name(frame)
    if not isinstance(contents, Calibration):
        raise UsageError(f"--frame: {name} holds measurements; the frame is a calibration's")
    say_if_frame_is_not_free(contents, name)
    return contents.in_frame(chosen)


def frame_name(frame: str) -> "FrameName":
    """The value of --frame. UsageError for an unknown one."""
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
