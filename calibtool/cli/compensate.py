"""calibtool compensate: poses or joints in, corrected joints out."""

from typing import Annotated

import typer

from calibtool.cli.files import check_output, decoded, message, one_stdin, read_bytes, shown, write_output
from calibtool.cli.load import load_calibration
from calibtool.cli.options import EXACT, CalibrationFile, CompensationMethod, Force, Output, Outside, choice
from calibtool.cli.programs import (
    Format,
    FramesFile,
    JointValues,
    OnError,
    check_not_input,
    compensate_file,
    program_format,
    program_options,
)

_LISTED = 10  # rows named one by one on stderr


def compensate(
    calibration: CalibrationFile,
    targets: Annotated[
        str,
        typer.Argument(
            metavar="[TARGETS]",
            help="CSV with joints (j1_deg …) or poses (x_mm … qw …), or a controller program; '-' is stdin.",
        ),
    ] = "-",
    output: Output = "-",
    method: CompensationMethod = EXACT,
    outside: Outside = "mark",
    uncertainty: Annotated[
        bool, typer.Option("--uncertainty", help="Add predicted standard deviations of the tool: sd_mm, sd_mrad.")
    ] = False,
    kind: Format = "auto",
    on_error: OnError = "stop",
    joint_values: JointValues = "controller",
    frames: FramesFile = None,
    force: Force = False,
) -> None:
    """Correct commanded poses or joint positions, in a table or in a controller program.

    The output has the corrected joints, the input's other columns and a status: ok, outside (of the training's
    configurations), near-singular, out-of-limits or unreachable (empty joints, exit code 4; the other rows are written all
    the same).

    Of a program (docs/programs) only the numbers of joint and pose targets change; stderr says how many, by how
    much at most, and what was left alone and why. A target without an answer stops it, and nothing is written.

    Example: calibtool compensate calibration.h5 targets.csv -o corrected.csv
    """
    check_output(output, force)
    one_stdin(calibration, targets)
    choice(method, ("exact", "one-step"), "--method")
    from typing import cast

    from calibtool.compensation.program import OUTSIDE_POLICIES, OutsidePolicy, compensate_table
    from calibtool.compensation.solve import Method
    from calibtool.errors import NoSolutionError, UsageError

    choice(outside, OUTSIDE_POLICIES, "--outside")
    options = program_options(method, outside, on_error, joint_values, frames)
    data = read_bytes(targets)
    kind = program_format(kind, targets, data)
    if kind != "csv":
        check_not_input(output, targets, calibration)
        if uncertainty:
            raise UsageError(f"--uncertainty adds columns to a table, but {shown(targets)} is {kind}")
        compensate_file(load_calibration(calibration)[0], data, targets, kind, output, force, options)
        return
    if on_error != "stop" or joint_values != "controller" or frames is not None:
        raise UsageError(f"--on-error, --joint-values and --frames are for programs, but {shown(targets)} is a table")
    loaded, _ = load_calibration(calibration)
    policy = cast(OutsidePolicy, outside)
    text = decoded(data, shown(targets))
    result = compensate_table(
        loaded, text, shown(targets), cast(Method, method), outside=policy, uncertainty=uncertainty
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
