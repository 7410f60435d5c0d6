"""calibtool evaluate: methods side by side."""

from typing import Annotated, Any

import typer

from calibtool.cli.files import check_output, message, one_stdin, stem, write_output
from calibtool.cli.load import load_calibration, load_measurements
from calibtool.cli.options import EXACT, CompensationMethod, Force, Json, Outside, RefitSetup, Require, choice
from calibtool.cli.progress import working
from calibtool.cli.show import print_json, print_table

_POSES = 8  # columns of a table for people


def evaluate(
    calibrations: Annotated[
        list[str], typer.Argument(metavar="CALIBRATION...", help="Calibration files; one may be '-'.")
    ],
    on: Annotated[
        str, typer.Option(metavar="MEASUREMENTS", help="Measurements to judge on, best ones no fit has seen.")
    ],
    output: Annotated[
        str | None,
        typer.Option("-o", "--output", metavar="FILE.csv", help="Signed errors of every configuration; '-' is stdout."),
    ] = None,
    method: CompensationMethod = EXACT,
    outside: Outside = "mark",
    refit_setup: RefitSetup = False,
    require: Require = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Compare calibrations with the nominal robot.

    Simulated measurements: the actual robot is driven to the corrected joints and measured without noise. Real ones:
    measured minus predicted target points. Where configurations were measured repeatedly, ISO 9283's pose accuracy AP and
    repeatability RP follow from the measured points. Tables for people go to stderr.

    Example: calibtool evaluate paper.h5 local-poe.h5 --on fresh.h5 --json
    """
    if json and output == "-":
        from calibtool.errors import UsageError

        raise UsageError("--json and -o - both want stdout; give -o FILE")
    if output is not None:
        check_output(output, force)
    one_stdin(*calibrations, on)
    choice(method, ("exact", "one-step"), "--method")
    from typing import cast

    from calibtool.compensation.program import OUTSIDE_POLICIES, OutsidePolicy
    from calibtool.compensation.solve import Method
    from calibtool.errors import AcceptanceError
    from calibtool.evaluation.acceptance import broken_limits, parse_limit
    from calibtool.evaluation.compare import evaluate as run
    from calibtool.evaluation.metrics import error_rows
    from calibtool.tables import format_table

    choice(outside, OUTSIDE_POLICIES, "--outside")
    limits = [parse_limit(text) for text in require or []]
    named = [(stem(path), load_calibration(path)[0]) for path in calibrations]
    measurements, _ = load_measurements(on)
    policy = cast(OutsidePolicy, outside)
    with working(f"evaluating on {len(measurements)} configurations"):
        evaluation = run(named, measurements, method=cast(Method, method), refit_setup=refit_setup, outside=policy)
    if output is not None:
        write_output(output, format_table(*error_rows(evaluation.methods)), force)
    report = evaluation.as_json()
    if json:
        print_json(report)
    else:
        show_evaluation(report)
    for errors, marked in zip(evaluation.methods, evaluation.marked, strict=True):
        if marked:
            message(
                f"warning: {errors.name}: {marked} of {evaluation.configurations} configurations are corrected in part, "
                "or not at all (status of compensate)"
            )
    for errors, far in zip(evaluation.methods, evaluation.outside, strict=True):
        if far:
            message(
                f"warning: {errors.name}: {far} of {evaluation.configurations} configurations are unlike the training's"
            )
    broken = broken_limits(evaluation.methods[1:], limits)
    if broken:
        raise AcceptanceError(broken[0])


def show_evaluation(report: dict[str, object]) -> None:
    """The table for people."""
    rows = []
    methods = report["methods"]
    assert isinstance(methods, list)
    for entry in methods:
        position, reduction = entry["position_mm"], entry["reduction_percent"]
        row = [
            entry["name"],
            *(f"{position[s]:.3f}" for s in ("mean", "rms", "p95", "max")),
            f"{reduction['position_max']:.1f}",
        ]
        orientation = entry["orientation_mrad"]
        if orientation is None:
            row += ["-"] * 5
        else:
            row += [
                *(f"{orientation[s]:.3f}" for s in ("mean", "rms", "p95", "max")),
                f"{reduction['orientation_max']:.1f}",
            ]
        rows.append(row)
    header = [
        "method",
        "mean mm",
        "rms mm",
        "p95 mm",
        "max mm",
        "max −%",
        "mean mrad",
        "rms mrad",
        "p95 mrad",
        "max mrad",
        "max −%",
    ]
    kind = (
        "driven to corrected joints, without noise" if report["kind"] == "compensated" else "measured minus predicted"
    )
    print_table(f"{report['robot']}, {report['configurations']} configurations, {kind}", header, rows)
    beyond = report.get("uncorrectable")
    if isinstance(beyond, dict):
        position, orientation = beyond["position_mm"], beyond["orientation_mrad"]
        message(
            f"{beyond['configurations']} poses are out of the joints' reach: at best {position['mean']:.3f} mm and "
            f"{orientation['mean']:.3f} mrad stay (at most {position['max']:.3f}, {orientation['max']:.3f}); "
            "−% is of the part that the joints can correct"
        )
    test = report.get("iso9283")
    if isinstance(test, dict):
        _show_pose_test(test)


def _show_pose_test(test: dict[str, Any]) -> None:
    """AP of every method and RP, per pose."""

    def cells(position: list[float], turn: list[float] | None) -> list[str]:
        if turn is None:
            return [f"{value:.3f}" for value in position]
        return [f"{value:.3f} / {angle:.3f}" for value, angle in zip(position, turn, strict=True)]

    rows = [[f"AP {entry['name']}", *cells(entry["ap_mm"], entry["ap_mrad"])] for entry in test["methods"]]
    rows.append(["RP", *cells(test["rp_mm"], test["rp_mrad"])])
    rows = [row[: _POSES + 1] for row in rows]
    repeats = sorted({*test["repeats"]})
    counted = str(repeats[0]) if len(repeats) == 1 else f"{repeats[0]} to {repeats[-1]}"
    unit = "mm" if test["rp_mrad"] is None else "mm / mrad"
    more = "" if len(test["poses"]) <= _POSES else f", the first {_POSES} of {len(test['poses'])} poses (all: --json)"
    print_table(
        f"ISO 9283, {counted} repeats, measured minus predicted, {unit}{more}", ["", *test["poses"][:_POSES]], rows
    )
