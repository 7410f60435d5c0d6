"""calibtool compensate: poses or joints in, corrected joints out."""

from typing import Annotated

import typer

from calibtool.cli.files import check_output, message, one_stdin, read_text, shown, write_output
from calibtool.cli.load import load_calibration
from calibtool.cli.options import (
    EXACT,
    CalibrationFile,
    CompensationMethod,
    Force,
    JointValuesOption,
    Output,
    Outside,
    choice,
)

_LISTED = 10  # rows named one by one on stderr


def compensate(
    calibration: CalibrationFile,
    targets: Annotated[
        str,
        typer.Argument(metavar="[TARGETS]", help="CSV with joints (j1_deg …) or poses (x_mm … qw …); '-' is stdin."),
    ] = "-",
    output: Output = "-",
    method: CompensationMethod = EXACT,
    outside: Outside = "mark",
    joint_values: JointValuesOption = None,
    uncertainty: Annotated[
        bool, typer.Option("--uncertainty", help="Add predicted standard deviations of the tool: sd_mm, sd_mrad.")
    ] = False,
    force: Force = False,
) -> None:
    """Correct commanded poses or joint positions.

    The output has the corrected joints, the input's other columns and a status: ok, outside (of the training's
    configurations), near-singular, out-of-limits or unreachable (empty joints, exit code 4; the other rows are written all
    the same).

    Example: calibtool compensate calibration.h5 targets.csv -o corrected.csv
    """
    check_output(output, force)
    one_stdin(calibration, targets)
    choice(method, ("exact", "one-step"), "--method")
    from typing import cast

    from calibtool.compensation.program import OUTSIDE_POLICIES, OutsidePolicy, compensate_table
    from calibtool.compensation.solve import Method
    from calibtool.errors import NoSolutionError
    from calibtool.robot.coupling import JOINT_VALUES, JointValues

    values = choice(joint_values or "serial", JOINT_VALUES, "--joint-values")
    choice(outside, OUTSIDE_POLICIES, "--outside")
    loaded, _ = load_calibration(calibration)
    policy = cast(OutsidePolicy, outside)
    result = compensate_table(
        loaded,
        read_text(targets),
        shown(targets),
        cast(Method, method),
        outside=policy,
        uncertainty=uncertainty,
        joint_values=cast(JointValues, values),
    )
    write_output(output, result.text, force)
    for line in result.remarks[:_LISTED]:
        message(line)
    if len(result.remarks) > _LISTED:
        message(f"… and {len(result.remarks) - _LISTED} more rows; see the column status")
    if result.unreachable:
        raise NoSolutionError(
            f"{shown(targets)}: {result.unreachable} of {result.rows} rows have no joints, unreachable or refused; "
            "the others are written"
        )
