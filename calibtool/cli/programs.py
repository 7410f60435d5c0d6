"""Controller programs at the command line: the options of a filter, which format a file is in, and its summary."""

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.files import STREAM, message, read_text, same_file, shown, write_output

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.compensation.program import OutsidePolicy
    from calibtool.compensation.solve import Method
    from calibtool.compensation.weighed import Weights
    from calibtool.programs.compensate import ProgramOptions
    from calibtool.robot.coupling import JointValues

_OBJECT = re.compile(r"\s*\{.*\"(j[1-9]\d*_(deg|rad|mm|m)|x_mm|x_m)\"\s*:")  # a row of JSON
_HEADER = re.compile(r"(^|[,;\s\"])(j[1-9]\d*_(deg|rad|mm|m)|x_mm|x_m)($|[,;\s\"])")

ROWS = ("csv", "ndjson")
FORMATS = ("auto", *ROWS, "fanuc-ls", "kuka-krl", "abb-rapid", "ur-script", "ros2-trajectory")
Format = Annotated[
    str,
    typer.Option(
        "--format",
        metavar="auto|csv|ndjson|fanuc-ls|kuka-krl|abb-rapid|ur-script|ros2-trajectory",
        help="Rows (CSV, JSON objects one per line), or a controller program, which keeps all but its targets' numbers.",
    ),
]
OnError = Annotated[
    str,
    typer.Option(
        "--on-error", metavar="stop|skip", help="Targets of a program without an answer: write nothing, or leave them."
    ),
]
FramesFile = Annotated[
    str | None,
    typer.Option("--frames", metavar="FRAMES.toml", help="Frames and tools that poses of a program refer to."),
]


def recognised(path: str, head: bytes) -> str:
    """The format of the input from its name and first bytes: `csv`, `ndjson` or a controller program's."""
    text = head.decode("latin-1").removeprefix("\xef\xbb\xbf")
    first = next((line for line in text.splitlines() if line.strip()), "")
    suffix = "" if path == STREAM else Path(path).suffix.lower()
    if suffix in (".ndjson", ".jsonl") or _OBJECT.match(first):
        return "ndjson"
    if suffix in (".csv", ".tsv") or _HEADER.search(first):
        return "csv"
    from calibtool.programs.formats import detected

    return detected(text, "" if path == STREAM else path) or "csv"


def program_options(
    method: "Method",
    outside: "OutsidePolicy",
    on_error: str,
    joint_values: "JointValues | None",
    frames: str | None,
    backlash: bool,
    largest_change: float | None,
    weights: "Weights | None",
) -> "ProgramOptions":
    """The options of a program. InputError for a bad frames file."""
    from calibtool.programs.compensate import ProgramOptions
    from calibtool.programs.frames import Frames, read_frames

    return ProgramOptions(
        method=method,
        outside=outside,
        on_error=on_error,
        joint_values=joint_values,
        frames=Frames() if frames is None else read_frames(read_text(frames), shown(frames)),
        backlash=backlash,
        largest_change=largest_change,
        weights=weights,
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
    for k, line in enumerate(result.summary(shown(path))):
        message(line, important=k > 0)  # after the counts: what was left alone, or needs a look
