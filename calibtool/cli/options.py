"""Options that several commands share."""

from typing import TYPE_CHECKING, Annotated, cast

import typer

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.robot.coupling import JointValues

Output = Annotated[
    str, typer.Option("-o", "--output", metavar="FILE", help="Output file; '-' is stdout.")
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite an existing output.")]
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
RefitSetup = Annotated[
    bool,
    typer.Option(
        "--refit-setup",
        help="The instrument was moved: register it again on these rows, for every method.",
    ),
]
Require = Annotated[
    list[str] | None,
    typer.Option(
        metavar="LIMIT",
        help="Acceptance limit, such as position_max_mm=0.2 or ap_max_mm=0.1; exit "
        "code 5 if not met.",
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

Before = Annotated[
    str | None,
    typer.Option(
        "--before",
        metavar="MEASUREMENTS",
        help="The same commands measured before the correction, where --on was measured after it.",
    ),
]

ToolOption = Annotated[
    str | None,
    typer.Option(
        "--tool",
        metavar="FRAME",
        help="The tool frame of a bare URDF, where its names do not tell it.",
    ),
]

AllowOption = Annotated[
    list[str] | None,
    typer.Option(
        "--allow",
        metavar="FOLDER",
        help="A folder, besides its own, whose files the robot's description may name; repeatable.",
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


PayloadKg = Annotated[
    float | None,
    typer.Option("--payload-kg", min=0, help="Mass at the tool, for a calibration that knows it."),
]
TemperatureC = Annotated[
    float | None,
    typer.Option(
        "--temperature-c",
        min=-273.15,
        help="Temperature of the links, for a calibration that knows it.",
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
    from calibtool.errors import check_choice

    check_choice(value, allowed, option)
    return value


def under(
    calibration: "Calibration", payload_kg: float | None, temperature_c: float | None
) -> "Calibration":
    """The calibration for a payload and a temperature.

    UsageError for a condition without a family of errors in the calibration.
    """
    from calibtool.errormodel.operating_conditions import Conditions
    from calibtool.errors import UsageError
    from calibtool.robot.se3 import readonly

    present = {family.id for family in calibration.base.errors.present}
    given = {"payload": payload_kg, "temperature": temperature_c}
    for family, value in given.items():
        if value is not None and family not in present:
            option = "--payload-kg" if family == "payload" else "--temperature-c"
            raise UsageError(
                f"{option}: this calibration does not know what the {family} does; identify it "
                f"from measurements with a column {option[2:].replace('-', '_')}"
            )
    known = {name: None if value is None else readonly(value) for name, value in given.items()}
    conditions = Conditions(payload_kg=known["payload"], temperature_c=known["temperature"])
    conditions.check((0, calibration.robot.n), "options")
    return calibration.at(conditions)


def largest_change(degrees: float | None) -> float | None:
    """`--largest-change-deg` in rad; UsageError unless it is positive."""
    from math import radians

    from calibtool.errors import UsageError

    if degrees is not None and not degrees > 0.0:
        raise UsageError(f"--largest-change-deg is {degrees:g}; expected more than 0")
    return None if degrees is None else radians(degrees)
