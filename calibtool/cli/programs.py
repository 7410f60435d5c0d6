"""Controller programs at the command line: the options of a filter, which format a file is in, and its summary."""

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calibtool.cli.files import STREAM, message, read_text, same_file, shown, write_output
from calibtool.cli.options import choice

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.compensation.program import OutsidePolicy
    from calibtool.compensation.solve import Method
    from calibtool.compensation.weighed import Weights
    from calibtool.programs.compensate import ProgramOptions
    from calibtool.robot.coupling import JointValues
    from calibtool.robot.mechanism import Mechanism
    from calibtool.robot.model import Robot

_COLUMN = r"(j[1-9]\d*(_serial|_controller)?_(deg|rad|mm|m)|x_mm|x_m)"
_OBJECT = re.compile(rf"\s*\{{.*\"{_COLUMN}\"\s*:")  # a row of JSON
_HEADER = re.compile(rf"(^|[,;\s\"]){_COLUMN}($|[,;\s\"])")

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
ControllerFile = Annotated[
    str | None,
    typer.Option(
        "--controller",
        metavar="nominal|FILE",
        help="By which model the controller solves poses: "
        "URDF, UR calibration yaml, calibration.conf, DH table.",
    ),
]
Dh = Annotated[
    str | None,
    typer.Option(
        "--dh", metavar="standard|modified", help="Convention of a DH table of --controller."
    ),
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
    controller_model: "Mechanism | None",
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
        controller_model=controller_model,
    )


def controller_mechanism(given: str | None, dh: str | None, robot: "Robot") -> "Mechanism | None":
    """The kinematics that `--controller` names, None without it; says how far they are off."""
    if given is None and dh is None:
        return None
    from calibtool.controller.denavit_hartenberg import DH_CONVENTIONS, DhConvention
    from calibtool.controller.model import read_controller_model
    from calibtool.errors import UsageError

    if dh is not None:
        choice(dh, DH_CONVENTIONS, "--dh")
    if given is None or (given == "nominal" and dh is not None):
        raise UsageError(
            "--dh is for a table of DH parameters; give it with --controller TABLE.csv"
        )
    if given == "nominal":
        return robot.mechanism
    model = read_controller_model(
        read_text(given), shown(given), robot, cast("DhConvention | None", dh)
    )
    message(
        f"{shown(given)}: the controller's tool is up to {model.position * 1e3:.2f} mm and "
        f"{model.orientation * 1e3:.2f} mrad from the nominal one, over the whole joint range"
    )
    return model.mechanism


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
