"""calibtool identify: a base model from measurements."""

from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.files import check_output, message, write_output
from calibtool.cli.load import load_measurements
from calibtool.cli.options import Force, Json, MeasurementsFile, choice
from calibtool.cli.provenance import provenance
from calibtool.cli.show import print_json

if TYPE_CHECKING:
    from calibtool.calibration import Calibration


def identify(
    measurements: MeasurementsFile,
    output: Annotated[
        str | None,
        typer.Option("-o", "--output", metavar="FILE", help="Output file; '-' is stdout (default without --json)."),
    ] = None,
    model: Annotated[str, typer.Option(metavar="local-poe", help="The base model.")] = "local-poe",
    json: Json = False,
    force: Force = False,
) -> None:
    """Identify the geometry by the local POE formula.

    Rank, singular values and what cannot be observed are reported.

    Example: calibtool identify measurements.h5 --model local-poe -o local-poe.h5
    """
    target = report_target(output, json)
    if target is not None:
        check_output(target, force, binary=True)
    from dataclasses import replace

    from calibtool.calibration import IDENTIFIED_MODELS
    from calibtool.calibration import identify as run
    from calibtool.storage import to_bytes

    choice(model, IDENTIFIED_MODELS, "--model")
    data, raw = load_measurements(measurements)
    calibration = replace(run(data, model), provenance=provenance(None, measurements=raw))
    report_calibration(calibration, "calibtool/identification", json)
    if target is not None:
        write_output(target, to_bytes(calibration), force)


def report_target(output: str | None, json: bool) -> str | None:
    """Where the file goes: with --json stdout is taken, and no file is written unless one is named."""
    if json and output == "-":
        from calibtool.errors import UsageError

        raise UsageError("--json and -o - both want stdout; give -o FILE")
    return output if output is not None or json else "-"


def report_calibration(calibration: "Calibration", schema: str, json: bool) -> None:
    """What came out: JSON on stdout, or a few lines on stderr."""
    from calibtool.summary import calibration_lines, calibration_summary

    if json:
        print_json({**calibration_summary(calibration), "schema": schema})
        return
    for line in calibration_lines(calibration):
        message(line)
