"""calibtool info: what a file holds."""

from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.files import read_bytes, shown, write_stdout
from calibtool.cli.options import Json
from calibtool.cli.printing import lines, print_json

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.measurement.measurements import Measurements


def info(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="Measurements, a calibration or the table of a study; '-' is stdin.",
        ),
    ],
    json: Json = False,
) -> None:
    """Show what a file holds.

    Example: calibtool info calibration.h5
    """
    import io

    from calibtool.evaluation.study.statistics import study_contents
    from calibtool.evaluation.study.study_table import is_table, parse_csv
    from calibtool.storage import read_every
    from calibtool.storage.studies import StudyFile

    data = read_bytes(file)
    if is_table(data):
        summary = study_contents(parse_csv(data.decode("utf-8", "replace"), shown(file)), None)
    else:
        contents = read_every(io.BytesIO(data), shown(file))
        if isinstance(contents, StudyFile):
            summary = study_contents(contents.table, contents.definition)
        else:
            summary = _summary(contents, json)
    if json:
        print_json({**summary, "schema": "calibtool/info"})
    else:
        write_stdout(("\n".join(lines(summary)) + "\n").encode())


def _summary(contents: "Measurements | Calibration", json: bool) -> dict[str, object]:
    from calibtool.calibration import Calibration
    from calibtool.measurement.checks import check_measurements
    from calibtool.summary import calibration_summary, measurements_summary

    if isinstance(contents, Calibration):
        summary = calibration_summary(contents)
    else:
        summary = measurements_summary(contents)
        found = check_measurements(contents)
        summary["findings"] = [f.as_json() if json else {f.severity: f.message} for f in found]
        if contents.findings:
            summary["found_on_import"] = list(contents.findings)
    assumed = contents.robot.source.description.assumed
    if assumed is not None:
        summary["assumed"] = assumed
    return {**summary, "provenance": contents.provenance}
