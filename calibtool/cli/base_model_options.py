"""Options of the base model, shared by `identify` and `train`."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from calibtool.cli.options import choice
from calibtool.errors import UsageError

if TYPE_CHECKING:
    from calibtool.calibration.fit import BaseOptions
    from calibtool.robot.robot import Robot


@dataclass(frozen=True)
class BaseModelOptions:
    """Families, tolerances and weights of rows; all but the defaults are of the complete model."""

    harmonics: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=8,
            help="Harmonics per joint of the complete model, 0 to 8 (default: found from the "
            "measurements, up to 128).",
        ),
    ] = None
    gravity: Annotated[
        bool | None,
        typer.Option(
            "--gravity/--no-gravity",
            help="Wind-up under gravity (default: where the measurements show it).",
        ),
    ] = None
    backlash: Annotated[
        bool | None,
        typer.Option(
            "--backlash/--no-backlash",
            help="Backlash, from the order of the rows (default: where the measurements show it).",
        ),
    ] = None
    without: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FAMILY",
            help="Leave a family of errors out of the complete model: bending, wobble, payload, "
            "temperature, …; repeatable.",
        ),
    ] = None
    fixed_tolerances: Annotated[
        bool,
        typer.Option(
            "--fixed-tolerances",
            help="Take the tolerances as they are; by default their scales are estimated.",
        ),
    ] = False
    tolerance_mm: Annotated[
        float | None,
        typer.Option(
            "--tolerance-mm",
            min=1e-6,
            help="Expected size of length errors (default: the robot's, 1).",
        ),
    ] = None
    tolerance_mrad: Annotated[
        float | None,
        typer.Option(
            "--tolerance-mrad",
            min=1e-6,
            help="Expected size of angle errors (default: the robot's, 1).",
        ),
    ] = None
    loss_function: Annotated[
        str,
        typer.Option(
            "--loss-function",
            metavar="isolated|squared|huber|cauchy",
            help="Which rows get less weight. isolated: those that no noise explains, unless they "
            "form a region; squared: none; huber, cauchy: all, the more the worse they fit.",
        ),
    ] = "isolated"
    drop_flagged: Annotated[
        bool,
        typer.Option("--drop-flagged", help="Leave rows that do not fit out of the final fit."),
    ] = False

    def of(self, model: str, robot: "Robot") -> "BaseOptions":
        """The library's options; UsageError for options of the complete model with another one."""
        from calibtool.calibration.fit import BaseOptions
        from calibtool.errormodel.families import FAMILIES
        from calibtool.errormodel.tolerances import Tolerances
        from calibtool.identification.complete import CompleteOptions
        from calibtool.identification.robust import LOSS_FUNCTIONS, LossFunction

        choice(self.loss_function, LOSS_FUNCTIONS, "--loss-function")
        without = self.without or []
        for family in without:
            choice(family, tuple(f.id for f in FAMILIES if not f.always), "--without")
        if model != "complete":
            if replace(self, without=self.without or None) != BaseModelOptions():
                raise UsageError(
                    f"'{model}' takes no options of the complete model (families such as backlash, "
                    "tolerances, bad rows)"
                )
            return BaseOptions(model)
        given = {"length": self.tolerance_mm, "angle": self.tolerance_mrad}
        changed: dict[str, Any] = {
            name: value * 1e-3 for name, value in given.items() if value is not None
        }
        orders = {
            "harmonics": self.harmonics,
            "gravity": self.gravity,
            "backlash": self.backlash,
            **dict.fromkeys(without, 0),
        }
        return BaseOptions(
            model,
            CompleteOptions(
                tolerances=replace(Tolerances.of_robot(robot), **changed) if changed else None,
                orders={
                    family: int(order) for family, order in orders.items() if order is not None
                },
                estimate_priors=not self.fixed_tolerances,
                loss_function=cast(LossFunction, self.loss_function),
                drop_flagged=self.drop_flagged,
            ),
        )
