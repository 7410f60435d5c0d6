"""Controller programs at the command line: the options of a filter, which format a file is in, and its summary."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.files import STREAM, message, read_text, same_file, shown, write_output
from calibtool.cli.options import choice

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.programs.compensate import ProgramOptions

Format = Annotated[
    str,
    typer.Option(
        "--format",
        metavar="auto|fanuc-ls|kuka-krl|abb-rapid|ur-script|ros2-trajectory|csv|ndjson",
        help="What the input is; a controller program keeps everything but the numbers of its targets.",
    ),
]
OnError = Annotated[
    str,
    typer.Option(
        "--on-error", metavar="stop|skip", help="Targets of a program without an answer: write nothing, or leave them."
    ),
]
JointValues = Annotated[
    str,
    typer.Option(
        "--joint-values",
        metavar="controller|serial",
        help="Joint values of FANUC programs: J3 against the horizontal (controller), or those of the serial chain.",
    ),
]
FramesFile = Annotated[
    str | None,
    typer.Option("--frames", metavar="FRAMES.toml", help="Frames and tools that poses of a program refer to."),
]


def program_format(asked: str, path: str, data: bytes) -> str:
    """The format of the input: the one asked for, or what its contents and name say. UsageError if it is unknown."""
    from calibtool.programs.formats import FORMATS, detected

    choice(asked, FORMATS, "--format")
    return detected(data.decode("latin-1"), "" if path == STREAM else path) if asked == "auto" else asked


def program_options(
    method: str, outside: str, on_error: str, joint_values: str, frames: str | None
) -> "ProgramOptions":
    """The options of a program, checked. UsageError for an unknown choice, InputError for a bad frames file."""
    from typing import cast

    from calibtool.compensation.program import OutsidePolicy
    from calibtool.compensation.solve import Method
    from calibtool.programs.compensate import JOINT_VALUES, ON_ERROR, ProgramOptions
    from calibtool.programs.frames import Frames, read_frames

    return ProgramOptions(
        method=cast(Method, method),
        outside=cast(OutsidePolicy, outside),
        on_error=choice(on_error, ON_ERROR, "--on-error"),
        joint_values=choice(joint_values, JOINT_VALUES, "--joint-values"),
        frames=Frames() if frames is None else read_frames(read_text(frames), shown(frames)),
    )


def check_not_input(output: str, *inputs: str) -> None:
    """UsageError when a program would be written over itself, or over the calibration; --force does not allow it."""
    from calibtool.errors import UsageError

    for path in inputs:
        if STREAM in (output, path) or not Path(output).exists() or not Path(path).exists():
            continue
        if same_file(output, path) or os.path.samefile(output, path):
            raise UsageError(f"{output}: is the input; a program is never overwritten, give another name")


def compensate_file(
    calibration: "Calibration", data: bytes, path: str, kind: str, output: str, force: bool, options: "ProgramOptions"
) -> None:
    """Write the corrected program, and the summary on stderr."""
    from calibtool.programs.compensate import compensate_program

    result = compensate_program(calibration, data, shown(path), kind, options)
    write_output(output, result.data, force, text=True)
    for line in result.summary(shown(path)):
        message(line)
