"""calibtool monitor: has the arm drifted since its calibration?"""

from typing import Annotated

import typer

from calibtool.cli.files import check_output, message, one_stdin, shown, write_output, wrote
from calibtool.cli.input_files import load_calibration, load_measurements
from calibtool.cli.options import CalibrationFile, Force, Json
from calibtool.cli.printing import print_json, print_tables
from calibtool.errors import AcceptanceError, UsageError
from calibtool.units import count_of, three_digits

_SHOWN = 4  # number of causes in the table


def monitor(
    calibration: CalibrationFile,
    on: Annotated[
        str, typer.Option(metavar="MEASUREMENTS", help="A few rows, measured now; five are enough.")
    ],
    history: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.ndjson", help="Append the outcome as a line; made where it is missing."
        ),
    ] = None,
    date: Annotated[
        str | None, typer.Option(metavar="TEXT", help="When it was measured, for the history.")
    ] = None,
    chart: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Draw the history: .svg, .png or .pdf."),
    ] = None,
    false_alarm: Annotated[
        float,
        typer.Option(metavar="RATE", help="Share of checks of an unchanged arm that give alarm."),
    ] = 0.01,
    refit_setup: Annotated[
        bool,
        typer.Option(
            "--refit-setup",
            help="The instrument was moved: register it again on these rows, judge no base.",
        ),
    ] = False,
    json: Json = False,
    force: Force = False,
) -> None:
    """Notice from a few poses that an arm has drifted.

    The rows are compared with what the calibration predicts. An alarm is given where the difference
    is larger than noise and the uncertainty of the calibration explain, at a stated rate of false
    alarms; the exit code is then 5.

    To name the likely cause, changes of the base, of the tool and of each joint are fitted one at a
    time. All that explain the rows equally well are named; more poses, farther apart, distinguish
    them.

    Example: calibtool monitor complete.h5 --on fresh.h5 --history drift.ndjson
    """
    from calibtool.calibration import moved_instrument
    from calibtool.cli.history import append, entries
    from calibtool.evaluation.drift import check_drift

    if not 0.0 < false_alarm <= 0.5:
        raise UsageError(f"--false-alarm is {false_alarm:g}; expected more than 0, at most 0.5")
    one_stdin(calibration, on)
    if chart is not None:
        from calibtool.evaluation.plots import image_format

        if history is None:
            raise UsageError("--chart draws a history; give --history FILE")
        image_format(chart)
        check_output(chart, force)
    earlier, cut = ([], 0) if history is None else entries(history, "calibtool/monitor")
    if cut:
        message(f"warning: {history}: {count_of(cut, 'line')} cut off; not counted")
    loaded, _ = load_calibration(calibration)
    measurements, _ = load_measurements(on)
    if not refit_setup and (line := moved_instrument(loaded, measurements)):
        message(f"warning: {line}")
    found = check_drift(loaded, measurements, false_alarm=false_alarm, refit_setup=refit_setup)
    entry = {**found.as_json(), "measurements": shown(on), "date": date}
    if json:
        print_json(entry)
    else:
        message(
            f"{found.robot}, {count_of(found.configurations, 'configuration')}: residual "
            f"{three_digits(found.residual * 1e3)} mm rms per coordinate, expected "
            f"{three_digits(found.expected * 1e3)} mm; false alarms: {100 * false_alarm:g} % of "
            "such checks"
        )
        if found.alarm:
            rows = [[cause.name, cause.change_text] for cause in found.causes[:_SHOWN]]
            title = "what may have changed, the most probable first"
            print_tables(title, [(["cause, fitted alone", "change"], rows)])
        else:
            message("no drift is seen")
    if history is not None:
        append(history, entry)
        wrote(history, f"{count_of(len(earlier) + 1, 'check')}")
    if chart is not None:
        from calibtool.evaluation.plots.history_figure import draw_history

        picture = draw_history([*earlier, entry], image_format(chart))
        write_output(chart, picture, force)
        wrote(chart, "chart of the history")
    if found.alarm:
        raise AcceptanceError(f"drift: {found.named}; measure again, then calibrate")
