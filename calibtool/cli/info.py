"""calibtool info: what a file holds."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from calibtool.cli.files import read_bytes, shown
from calibtool.cli.options import Json
from calibtool.cli.printing import print_json, print_summary

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
        print_summary(summary)


def _clearest(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Parameters for people: the largest first, in multiples of their standard deviations; those
    that are not determined last."""

    def order(row: dict[str, Any]) -> tuple[bool, float]:
        return row["at_prior"], -abs(row["value"]) / row["std"] if row["std"] else 0.0

    ordered = sorted(rows, key=order)
    return [{k: v for k, v in row.items() if k not in ("id", "at_prior")} for row in ordered]


def _summary(contents: "Measurements | Calibration", json: bool) -> dict[str, object]:
    from calibtool.calibration import Calibration
    from calibtool.measurement.checks import check_measurements
    from calibtool.summary import calibration_summary, measurements_summary

    if isinstance(contents, Calibration):
        summary = calibration_summary(contents)
        base = summary["base"]
        if not json and isinstance(base, dict) and "parameter_table" in base:
            base["parameter_table"] = _clearest(base["parameter_table"])
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
