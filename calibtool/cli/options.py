"""Options that several commands share."""

from math import isfinite, radians
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calibtool.errors import UsageError, check_choice

if TYPE_CHECKING:
    from calibtool.robot.coupling import JointValues

Output = Annotated[
    str, typer.Option("-o", "--output", metavar="FILE", help="Output file; '-' is stdout.")
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite an existing output.")]
RobotArgument = Annotated[
    str, typer.Argument(metavar="ROBOT", help="A built-in robot, or the path of a description.")
]
WorkspaceName = Annotated[
    str | None,
    typer.Option(
        help="A named workspace of the robot (default: its first); 'full' is the joint range."
    ),
]
ReportingOutput = Annotated[
    str | None,
    typer.Option(
        "-o",
        "--output",
        metavar="FILE",
        help="Output file; '-' is stdout (default without --json).",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random.")]
MeasurementsFile = Annotated[
    str, typer.Argument(metavar="MEASUREMENTS", help="Measurements file; '-' is stdin.")
]
CalibrationFile = Annotated[
    str, typer.Argument(metavar="CALIBRATION", help="Calibration file; '-' is stdin.")
]
CompensationMethod = Annotated[
    str,
    typer.Option(
        "--method", metavar="exact|one-step", help="Solve exactly, or by one damped step."
    ),
]
EXACT = "exact"
Outside = Annotated[
    str,
    typer.Option(
        "--outside",
        metavar="mark|base|refuse",
        help="Rows unlike the training: mark, use the base model alone, or refuse.",
    ),
]
TakeUpBacklash = Annotated[
    bool,
    typer.Option(
        "--backlash/--no-backlash", help="Take up backlash; --no-backlash: the rows are no path."
    ),
]
LargestChange = Annotated[
    float | None,
    typer.Option(
        "--largest-change-deg",
        metavar="DEG",
        help="A joint changes by no more (default: 50 times the size of the identified errors; "
        "stderr reports it).",
    ),
]
FrameOption = Annotated[
    str | None,
    typer.Option(
        "--frame",
        metavar="fitted|taught",
        help="Unknown instrument and targets: base and tool as fitted, or those that move "
        "taught poses least (default: the calibration's, a new one's is taught).",
    ),
]

JointValuesOption = Annotated[
    str | None,
    typer.Option(
        "--joint-values",
        metavar="serial|controller",
        help="Whose joint values are read and written; "
        "needed where they differ and no header or program format states it.",
    ),
]


def joint_values_of(value: str | None) -> "JointValues | None":
    """Value of `--joint-values`; UsageError for another word."""
    from calibtool.robot.coupling import JOINT_VALUES

    return (
        None
        if value is None
        else cast("JointValues", choice(value, JOINT_VALUES, "--joint-values"))
    )


def choice(value: str, allowed: tuple[str, ...], option: str) -> str:
    """`value` if it is allowed; UsageError with near names otherwise."""
    check_choice(value, allowed, option)
    return value


def finite(value: float, option: str) -> float:
    """The number of an option; UsageError for NaN and infinity."""
    if not isfinite(value):
        raise UsageError(f"{option}: {value} is no finite number")
    return value


def comma_numbers(text: str) -> list[float]:
    """Numbers with commas between them; none where a part is no number."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        return []


def check_one_stdout(output: str | None, json: bool) -> None:
    """UsageError where both --json and the output want stdout."""
    if json and output == "-":
        raise UsageError("--json and -o - both want stdout; give -o FILE")


def report_target(output: str | None, json: bool) -> str | None:
    """Output path: with --json stdout is used, and a file is written only if one is named."""
    check_one_stdout(output, json)
    return output if output is not None or json else "-"


def check_solving(method: str, outside: str) -> None:
    """UsageError for an unknown value of --method or --outside."""
    from calibtool.compensation.targets import OUTSIDE_POLICIES

    choice(method, ("exact", "one-step"), "--method")
    choice(outside, OUTSIDE_POLICIES, "--outside")


def largest_change(degrees: float | None) -> float | None:
    """`--largest-change-deg` in rad; UsageError unless it is positive."""
    if degrees is not None and not degrees > 0.0:
        raise UsageError(f"--largest-change-deg is {degrees:g}; expected more than 0")
    return None if degrees is None else radians(degrees)
