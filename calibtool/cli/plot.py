"""calibtool plot: every figure of the report from files."""

from pathlib import Path
from typing import Annotated

import typer

from calibtool.cli.files import check_output, one_stdin, shown, stem, write_output, wrote
from calibtool.cli.input_files import load_calibration, load_measurements
from calibtool.cli.judging import CalibrationFiles, Judging
from calibtool.cli.options import Force, choice
from calibtool.errors import InputError, UsageError

# The figures of `calibtool.evaluation.plots`, which is not imported for a help page; the second
# half needs --on.
OF_CALIBRATIONS = ("training", "motions", "parameters", "observability")
OF_ERRORS = ("errors", "distribution", "vectors", "coverage", "iso9283")
FIGURES = (*OF_CALIBRATIONS, *OF_ERRORS)


def plot(
    *,
    kind: Annotated[
        str,
        typer.Argument(
            metavar="FIGURE",
            help=f"{', '.join(OF_CALIBRATIONS)}; on measurements {', '.join(OF_ERRORS)}.",
        ),
    ],
    calibrations: CalibrationFiles,
    output: Annotated[
        str,
        typer.Option(
            "-o", "--output", metavar="FILE", help="A file that ends in .png, .svg or .pdf."
        ),
    ],
    on: Annotated[
        str | None,
        typer.Option(metavar="MEASUREMENTS", help=f"Measurements for {', '.join(OF_ERRORS)}."),
    ] = None,
    width_mm: Annotated[
        float,
        typer.Option(
            "--width-mm",
            min=60,
            max=400,
            help="Width of the figure: 85 is a column, 180 a page of a journal.",
        ),
    ] = 180.0,
    judging: Judging,
    force: Force = False,
) -> None:
    """Draw one figure, such as the errors.

    The figures are those of the report, in a size for print (--width-mm). Limits given with
    --require are drawn into `distribution`. The same command gives the same bytes.

    Example: calibtool plot errors paper.h5 local-poe.h5 --on measurements.h5 -o errors.svg
    """
    choice(kind, FIGURES, "figure")
    check_output(output, force)
    one_stdin(*calibrations, on, judging.before)
    from calibtool.calibration import check_same_robot
    from calibtool.evaluation.plots import Subject, draw, image_format

    image = image_format(Path(output).name)
    limits = judging.limits()
    if kind in OF_ERRORS and on is None:
        raise UsageError(f"plot {kind}: give the measurements with --on")
    named = [(stem(path), load_calibration(path, judging.frame)[0]) for path in calibrations]
    for name, calibration in named[1:]:
        check_same_robot(
            calibration.robot,
            named[0][1].robot,
            f"calibration '{name}'",
            f"calibration '{named[0][0]}'",
        )
    subject = Subject(named)
    if kind in OF_ERRORS:
        measurements, _ = load_measurements(str(on))
        earlier = None if judging.before is None else load_measurements(judging.before)[0]
        evaluation = judging.evaluation(named, measurements, earlier)
        subject = Subject(named, measurements, evaluation, limits)
    try:
        picture = draw(kind, subject, image, width_mm)
    except InputError as error:
        raise InputError(f"{', '.join(map(shown, calibrations))}: {error}") from None
    write_output(output, picture, force)
    wrote(output, f"figure {kind}")
