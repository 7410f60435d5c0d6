"""calibtool export: the compensator for other programs."""

from pathlib import Path
from typing import Annotated

import typer

from calibtool.cli.files import check_output, write_output, write_outputs
from calibtool.cli.load import load_calibration
from calibtool.cli.options import CalibrationFile, Force, Output, choice


def export(
    calibration: CalibrationFile,
    format: Annotated[
        str, typer.Option("--format", metavar="json|c", help="json (complete), or c (one C99 file and header).")
    ],
    output: Output = "-",
    force: Force = False,
) -> None:
    """Write the compensator as JSON or C code.

    For C, -o NAME.c also writes NAME.h, and NAME starts every symbol.

    Example: calibtool export calibration.h5 --format c -o compensator.c
    """
    choice(format, ("json", "c"), "--format")
    check_output(output, force)
    from calibtool.errors import UsageError
    from calibtool.export.as_json import calibration_as_json
    from calibtool.export.c_code import calibration_as_c

    header_path = str(Path(output).with_suffix(".h"))
    if format == "c":
        if Path(output).suffix != ".c":
            raise UsageError("--format c: -o takes a file that ends in .c; the header goes beside it")
        check_output(header_path, force)
    loaded, _ = load_calibration(calibration)
    if format == "json":
        write_output(output, calibration_as_json(loaded), force)
        return
    header, source = calibration_as_c(loaded, Path(output).stem)
    write_outputs({header_path: header, output: source}, force)
