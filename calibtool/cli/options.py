"""Options that several commands share."""

from typing import Annotated

import typer

Output = Annotated[str, typer.Option("-o", "--output", metavar="FILE", help="Output file; '-' is stdout.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite an existing output.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random.")]
MeasurementsFile = Annotated[str, typer.Argument(metavar="MEASUREMENTS", help="Measurements file; '-' is stdin.")]
CalibrationFile = Annotated[str, typer.Argument(metavar="CALIBRATION", help="Calibration file; '-' is stdin.")]
CompensationMethod = Annotated[
    str, typer.Option("--method", metavar="exact|one-step", help="Solve exactly, or with the one step of Eq. 24.")
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
LargestChange = Annotated[
    float | None,
    typer.Option(
        "--largest-change-deg",
        metavar="DEG",
        help="A joint changes by no more (default: 50 times the size of the identified errors; stderr says it).",
    ),
]
RefitSetup = Annotated[
    bool,
    typer.Option("--refit-setup", help="The instrument was moved: register it again on these rows, for every method."),
]
Require = Annotated[
    list[str] | None,
    typer.Option(metavar="LIMIT", help="Acceptance limit, such as position_max_mm=0.2; exit code 5 if not met."),
]

JointValuesOption = Annotated[
    str | None,
    typer.Option(
        "--joint-values",
        metavar="serial|controller",
        help="Joint values of the serial chain (default; FANUC programs: controller), or the controller's, converted.",
    ),
]


def choice(value: str, allowed: tuple[str, ...], option: str) -> str:
    """`value` if it is allowed; UsageError with near names otherwise."""
    from calibtool.errors import check_choice

    check_choice(value, allowed, option)
    return value


def largest_change(degrees: float | None) -> float | None:
    """`--largest-change-deg` in rad; UsageError unless it is positive."""
    from math import radians

    from calibtool.errors import UsageError

    if degrees is not None and not degrees > 0.0:
        raise UsageError(f"--largest-change-deg is {degrees:g}; expected more than 0")
    return None if degrees is None else radians(degrees)
