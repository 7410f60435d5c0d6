"""calibtool info: what a file holds."""

from typing import Annotated

import typer

from calibtool.cli.files import read_bytes, shown, write_stdout
from calibtool.cli.options import Json
from calibtool.cli.show import lines, print_json


def info(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A measurements or calibration file; '-' is stdin.")],
    json: Json = False,
) -> None:
    """Show what a file holds.

    Example: calibtool info calibration.h5
    """
    import io

    from calibtool.calibration import Calibration
    from calibtool.measurement.checks import check_measurements
    from calibtool.storage import read_any
    from calibtool.summary import calibration_summary, measurements_summary

    contents = read_any(io.BytesIO(read_bytes(file)), shown(file))
    if isinstance(contents, Calibration):
        summary = calibration_summary(contents)
    else:
        summary = measurements_summary(contents)
        found = check_measurements(contents)
        summary["findings"] = [f.as_json() if json else {f.severity: f.message} for f in found]
    summary["provenance"] = contents.provenance
    if json:
        print_json({**summary, "schema": "calibtool/info"})
    else:
        write_stdout(("\n".join(lines(summary)) + "\n").encode())
