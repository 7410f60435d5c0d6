"""Options of the base model, shared by `identify` and `train`."""

from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.options import choice

if TYPE_CHECKING:
    from calibtool.calibration.fit import BaseOptions
    from calibtool.robot.robot import Robot

Harmonics = Annotated[
    int | None,
    typer.Option(
        min=0,
        max=8,
        help="Harmonics per joint of the complete model, 0 to 8 (default: found from the "
        "measurements, up to 128).",
    ),
]
Gravity = Annotated[
    bool | None,
    typer.Option(
        "--gravity/--no-gravity",
        help="Wind-up under gravity (default: where the measurements show it).",
    ),
]
Backlash = Annotated[
    bool | None,
    typer.Option(
        "--backlash/--no-backlash",
        help="Backlash, from the order of the rows (default: where the measurements show it).",
    ),
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        metavar="FAMILY",
        help="Leave a family of errors out of the complete model: bending, wobble, payload, "
        "temperature, …; repeatable.",
    ),
]
FixedTolerances = Annotated[
    bool,
    typer.Option(
        "--fixed-tolerances",
        help="Take the tolerances as they are; by default their scales are estimated.",
    ),
]
LengthTolerance = Annotated[
    float | None,
    typer.Option(
        "--tolerance-mm", min=1e-6, help="Expected size of length errors (default: the robot's, 1)."
    ),
]
AngleTolerance = Annotated[
    float | None,
    typer.Option(
        "--tolerance-mrad",
        min=1e-6,
        help="Expected size of angle errors (default: the robot's, 1).",
    ),
]
LossFunction = Annotated[
    str,
    typer.Option(
        "--loss-function",
        metavar="isolated|squared|huber|cauchy",
        help="Which rows get less weight. isolated: those that no noise explains, unless they form "
        "a region; squared: none; huber, cauchy: all, the more the worse they fit.",
    ),
]
DropFlagged = Annotated[
    bool, typer.Option("--drop-flagged", help="Leave rows that do not fit out of the final fit.")
]


def base_options(
    model: str,
    robot: "Robot",
    harmonics: int | None,
    gravity: bool | None,
    backlash: bool | None,
    without: list[str] | None,
    fixed_tolerances: bool,
    tolerance_mm: float | None,
    tolerance_mrad: float | None,
    loss_function: str,
    drop_flagged: bool,
) -> "BaseOptions":
    """Options for the library; UsageError for options of the complete model with another model."""
    from dataclasses import replace
    from typing import cast

    from calibtool.calibration.fit import BaseOptions
    from calibtool.errormodel.families import FAMILIES
    from calibtool.errormodel.tolerances import Tolerances
    from calibtool.errors import UsageError
    from calibtool.identification.complete import CompleteOptions
    from calibtool.identification.robust import LOSS_FUNCTIONS
    from calibtool.identification.robust import LossFunction as LossFunctionName

    choice(loss_function, LOSS_FUNCTIONS, "--loss-function")
    orders = {"harmonics": harmonics, "gravity": gravity, "backlash": backlash}
    for family in without or ():
        choice(family, tuple(f.id for f in FAMILIES if not f.always), "--without")
    if model != "complete":
        if (
            any(value is not None for value in (*orders.values(), tolerance_mm, tolerance_mrad))
            or fixed_tolerances
            or without
            or loss_function != "isolated"
            or drop_flagged
        ):
            raise UsageError(
                f"'{model}' takes no options of the complete model (families such as backlash, "
                "tolerances, bad rows)"
            )
        return BaseOptions(model)
    tolerances = None
    if tolerance_mm is not None or tolerance_mrad is not None:
        tolerances = Tolerances.of_robot(robot)
    if tolerances is not None and tolerance_mm is not None:
        tolerances = replace(tolerances, length=tolerance_mm * 1e-3)
    if tolerances is not None and tolerance_mrad is not None:
        tolerances = replace(tolerances, angle=tolerance_mrad * 1e-3)
    return BaseOptions(
        model,
        CompleteOptions(
            tolerances=tolerances,
            orders={
                **{family: int(order) for family, order in orders.items() if order is not None},
                **dict.fromkeys(without or (), 0),
            },
            estimate_priors=not fixed_tolerances,
            loss_function=cast(LossFunctionName, loss_function),
            drop_flagged=drop_flagged,
        ),
    )
