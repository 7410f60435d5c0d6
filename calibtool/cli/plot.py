"""calibtool plot: the paper's figures from files."""

from pathlib import Path
from typing import Annotated

import typer

from calibtool.cli.files import check_output, one_stdin, stem, write_output
from calibtool.cli.load import load_calibration, load_measurements
from calibtool.cli.options import EXACT, CompensationMethod, Force, choice

_KINDS = ("training", "errors")


def plot(
    kind: Annotated[
        str, typer.Argument(metavar="training|errors", help="The training curve, or errors per configuration.")
    ],
    calibrations: Annotated[
        list[str], typer.Argument(metavar="CALIBRATION...", help="Calibration files; one may be '-'.")
    ],
    output: Annotated[str, typer.Option("-o", "--output", metavar="FILE", help="A file that ends in .png or .svg.")],
    on: Annotated[str | None, typer.Option(metavar="MEASUREMENTS", help="Measurements for 'errors'.")] = None,
    method: CompensationMethod = EXACT,
    force: Force = False,
) -> None:
    """Draw the training curve, or errors per configuration.

    These are figures 4 and 5 of the paper; the errors show the methods side by side, before and after.

    Example: calibtool plot errors paper.h5 local-poe.h5 --on measurements.h5 -o errors.svg
    """
    choice(kind, _KINDS, "kind of plot")
    check_output(output, force)
    one_stdin(*calibrations, on)
    choice(method, ("exact", "one-step"), "--method")
    from typing import cast

    from calibtool.compensation.solve import Method
    from calibtool.errors import UsageError
    from calibtool.evaluation.compare import evaluate
    from calibtool.evaluation.plots import draw_errors, draw_training, image_format

    image = image_format(Path(output).name)
    if kind == "errors" and on is None:
        raise UsageError("plot errors: give the measurements with --on")
    named = [(stem(path), load_calibration(path)[0]) for path in calibrations]
    if kind == "training":
        data = draw_training(named, image)
    else:
        measurements, _ = load_measurements(str(on))
        data = draw_errors(evaluate(named, measurements, method=cast(Method, method)), image)
    write_output(output, data, force)
