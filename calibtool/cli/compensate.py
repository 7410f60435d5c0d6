"""calibtool compensate: poses or joints in, corrected joints out."""

from collections.abc import Iterator
from itertools import chain
from typing import Annotated

import typer

from calibtool.cli.files import check_output, message, one_stdin, output_stream, shown, text_lines
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
from calibtool.cli.progress import counted


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
    verify: Annotated[
        bool,
        typer.Option("--verify", help="Drive the calibrated model to every corrected row; add left_mm, left_mrad."),
    ] = False,
    row_format: Annotated[
        str,
        typer.Option("--format", metavar="auto|csv|ndjson", help="Rows of CSV, or JSON objects, one per line."),
    ] = "auto",
    line_buffered: Annotated[
        bool,
        typer.Option("--line-buffered", help="Answer every row at once, for a program at the other end of a pipe."),
    ] = False,
    force: Force = False,
) -> None:
    """Correct commanded poses or joint positions, any number of them.

    The output has the corrected joints, the input's other columns and a status: ok, outside (of the training's
    configurations), near-singular, out-of-limits or unreachable (empty joints, exit code 4; the other rows are written all
    the same). Poses without joints are a path: each row starts from the one before, jumps of the joints are reported.

    Example: calibtool compensate calibration.h5 targets.csv -o corrected.csv
    """
    check_output(output, force)
    one_stdin(calibration, targets)
    choice(method, ("exact", "one-step"), "--method")
    choice(row_format, ("auto", "csv", "ndjson"), "--format")
    from typing import cast

    from calibtool.compensation.program import OUTSIDE_POLICIES, OutsidePolicy
    from calibtool.compensation.solve import Method
    from calibtool.compensation.stream import BATCH, StreamOptions, StreamReport, compensate_stream
    from calibtool.errors import NoSolutionError
    from calibtool.robot.coupling import JOINT_VALUES, JointValues

    values = choice(joint_values or "serial", JOINT_VALUES, "--joint-values")
    choice(outside, OUTSIDE_POLICIES, "--outside")
    loaded, _ = load_calibration(calibration)
    options = StreamOptions(
        method=cast(Method, method),
        outside=cast(OutsidePolicy, outside),
        uncertainty=uncertainty,
        verify=verify,
        joint_values=cast(JointValues, values),
        batch=1 if line_buffered else BATCH,
    )
    report = StreamReport()
    lines = text_lines(targets)
    if row_format == "auto":
        lines, row_format = recognised(lines)
    texts = compensate_stream(
        loaded, lines, shown(targets), options, report, "ndjson" if row_format == "ndjson" else "csv"
    )
    with output_stream(output, force) as write:
        for text in counted(texts, "rows", options.batch):
            write(text.encode())
    for line in report.remarks:
        message(line)
    if report.others:
        message(f"… and {report.others} more rows; see the column status")
    if verify:
        message(
            f"{report.rows} rows verified: the calibrated model stays within {report.left * 1e3:.3g} mm and "
            f"{report.turned * 1e3:.3g} mrad of the command where the status is ok or outside"
        )
    if report.without_joints:
        raise NoSolutionError(
            f"{shown(targets)}: {report.without_joints} of {report.rows} rows have no joints, unreachable or refused; "
            "the others are written"
        )


def recognised(lines: Iterator[str]) -> tuple[Iterator[str], str]:
    """The same lines, and whether the first that is not empty is a JSON object."""
    seen = []
    for line in lines:
        seen.append(line)
        if line.strip().removeprefix("\ufeff"):
            break
    found = "ndjson" if seen and seen[-1].removeprefix("\ufeff").lstrip().startswith("{") else "csv"
    return chain(seen, lines), found
