"""Options by which calibrations are judged on measurements: of `evaluate`, `report` and `plot`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, cast

import typer

from calibtool.cli.files import message
from calibtool.cli.options import EXACT, CompensationMethod, FrameOption, Outside, check_solving
from calibtool.errors import AcceptanceError

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.evaluation.acceptance import Limit
    from calibtool.evaluation.compare import Evaluation
    from calibtool.measurement.measurements import Measurements

CalibrationFiles = Annotated[
    list[str],
    typer.Argument(metavar="CALIBRATION...", help="Calibration files; one may be '-'."),
]
JudgedOn = Annotated[
    str,
    typer.Option(
        "--on",
        metavar="MEASUREMENTS",
        help="Measurements to judge on, best ones no fit has seen.",
    ),
]


@dataclass(frozen=True)
class Judging:
    """How calibrations are judged."""

    method: CompensationMethod = EXACT
    outside: Outside = "mark"
    refit_setup: Annotated[
        bool,
        typer.Option(
            "--refit-setup",
            help="The instrument was moved: register it again on these rows, for every method.",
        ),
    ] = False
    require: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LIMIT",
            help="Acceptance limit, such as position_max_mm=0.2 or ap_max_mm=0.1; exit "
            "code 5 if not met.",
        ),
    ] = None
    frame: FrameOption = None
    before: Annotated[
        str | None,
        typer.Option(
            "--before",
            metavar="MEASUREMENTS",
            help="The same commands measured before the correction, where --on was measured after "
            "it.",
        ),
    ] = None

    def limits(self) -> "tuple[Limit, ...]":
        """The limits of --require; UsageError for an unknown value of any option."""
        from calibtool.evaluation.acceptance import parse_limit

        check_solving(self.method, self.outside)
        return tuple(parse_limit(text) for text in self.require or [])

    def evaluation(
        self,
        named: "list[tuple[str, Calibration]]",
        measurements: "Measurements",
        before: "Measurements | None",
    ) -> "Evaluation":
        """The calibrations side by side on the measurements. before: those of --before."""
        from calibtool.calibration import moved_instrument
        from calibtool.compensation.solve import Method
        from calibtool.compensation.targets import OutsidePolicy
        from calibtool.evaluation.compare import evaluate

        for name, calibration in [] if self.refit_setup else named:
            if line := moved_instrument(calibration, measurements):
                message(f"warning: {name}: {line}")
        return evaluate(
            named,
            measurements,
            method=cast(Method, self.method),
            refit_setup=self.refit_setup,
            outside=cast(OutsidePolicy, self.outside),
            before=before,
        )


def require_met(evaluation: "Evaluation", limits: "Sequence[Limit]") -> None:
    """AcceptanceError for the first limit that a calibration does not meet."""
    from calibtool.evaluation.acceptance import broken_limits

    broken = broken_limits(evaluation.methods[1:], list(limits), evaluation.pose_tests[1:])
    if broken:
        raise AcceptanceError(broken[0])
