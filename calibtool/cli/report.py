"""calibtool report: one page about calibrations."""

from typing import Annotated

import typer

from calibtool.cli.files import check_output, one_stdin, stem, write_output, wrote
from calibtool.cli.input_files import load_calibration, load_measurements
from calibtool.cli.options import (
    EXACT,
    Before,
    CompensationMethod,
    Force,
    FrameOption,
    Outside,
    RefitSetup,
    Require,
    choice,
)
from calibtool.units import count_of


def report(
    calibrations: Annotated[
        list[str],
        typer.Argument(metavar="CALIBRATION...", help="Calibration files; one may be '-'."),
    ],
    on: Annotated[
        str,
        typer.Option(
            metavar="MEASUREMENTS", help="Measurements to judge on, best ones no fit has seen."
        ),
    ],
    output: Annotated[
        str, typer.Option("-o", "--output", metavar="FILE.html", help="The page; '-' is stdout.")
    ] = "report.html",
    method: CompensationMethod = EXACT,
    outside: Outside = "mark",
    refit_setup: RefitSetup = False,
    require: Require = None,
    frame: FrameOption = None,
    before: Before = None,
    force: Force = False,
) -> None:
    """Write one self-contained HTML page about calibrations.

    The verdict first, against limits if there are any: expected after correction, or, from rows
    measured at corrected joints (see `evaluate`), before and after; then errors, error vectors,
    training, joint motions, parameters, flagged rows, observability, coverage, noise and
    provenance. The numbers are those of `evaluate`. The page loads nothing from anywhere, adapts to
    light and dark, and prints. With a limit that is not met the page is written nevertheless, and
    the exit code is 5.

    Example: calibtool report paper.h5 --on fresh.h5 --require position_max_mm=2 -o report.html
    """
    check_output(output, force)
    one_stdin(*calibrations, on, before)
    choice(method, ("exact", "one-step"), "--method")
    from typing import cast

    from calibtool.cli.provenance import provenance
    from calibtool.compensation.solve import Method
    from calibtool.compensation.targets import OUTSIDE_POLICIES, OutsidePolicy
    from calibtool.errors import AcceptanceError
    from calibtool.evaluation.acceptance import broken_limits, parse_limit
    from calibtool.evaluation.compare import evaluate
    from calibtool.evaluation.plots import Subject
    from calibtool.evaluation.report import html_report

    choice(outside, OUTSIDE_POLICIES, "--outside")
    limits = tuple(parse_limit(text) for text in require or [])
    loaded = [(stem(path), *load_calibration(path, frame)) for path in calibrations]
    named = [(name, calibration) for name, calibration, _ in loaded]
    measurements, data = load_measurements(on)
    earlier = None if before is None else load_measurements(before)
    evaluation = evaluate(
        named,
        measurements,
        method=cast(Method, method),
        refit_setup=refit_setup,
        outside=cast(OutsidePolicy, outside),
        before=None if earlier is None else earlier[0],
    )
    inputs = {f"calibration_{k}": part for k, (_, _, part) in enumerate(loaded, 1)}
    if earlier is not None:
        inputs["before"] = earlier[1]
    page = html_report(
        Subject(named, measurements, evaluation, limits),
        provenance(None, measurements=data, **inputs),
    )
    write_output(output, page, force)
    wrote(output, f"report of {count_of(len(measurements), 'configuration')}")
    broken = broken_limits(evaluation.methods[1:], list(limits), evaluation.pose_tests[1:])
    if broken:
        raise AcceptanceError(broken[0])
