"""calibtool evaluate: methods side by side."""

from typing import Annotated, Any

import typer

from calibtool.cli.files import check_output, message, one_stdin, stem, write_output
from calibtool.cli.input_files import load_calibration, load_measurements
from calibtool.cli.options import (
    EXACT,
    Before,
    CompensationMethod,
    Force,
    FrameOption,
    Json,
    Outside,
    RefitSetup,
    Require,
    choice,
)
from calibtool.cli.printing import print_json, print_table
from calibtool.cli.progress import working

_POSES = 8  # columns of a table for people


def evaluate(
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
        str | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE.csv",
            help="Signed errors of every configuration; '-' is stdout.",
        ),
    ] = None,
    method: CompensationMethod = EXACT,
    outside: Outside = "mark",
    refit_setup: RefitSetup = False,
    require: Require = None,
    frame: FrameOption = None,
    before: Before = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Compare calibrations with the nominal robot.

    Simulated measurements: the actual robot is driven to the corrected joints and measured without
    noise. Real ones: measured minus predicted target points, which is what to expect after
    correction. Where configurations were measured repeatedly, ISO 9283's pose accuracy AP and
    repeatability RP follow from the measured points. Tables for people go to stderr.

    Proof on the arm: measurements imported with --commanded were taken at corrected joints. Then
    measured points are compared with commanded ones: after the correction and, with --before,
    before it. Exit code 3 where the arm was driven to other joints than the calibration asks for.

    Example: calibtool evaluate paper.h5 local-poe.h5 --on fresh.h5 --json
    """
    if json and output == "-":
        from calibtool.errors import UsageError

        raise UsageError("--json and -o - both want stdout; give -o FILE")
    if output is not None:
        check_output(output, force)
    one_stdin(*calibrations, on, before)
    choice(method, ("exact", "one-step"), "--method")
    from typing import cast

    from calibtool.compensation.solve import Method
    from calibtool.compensation.targets import OUTSIDE_POLICIES, OutsidePolicy
    from calibtool.errors import AcceptanceError
    from calibtool.evaluation.acceptance import broken_limits, parse_limit
    from calibtool.evaluation.compare import evaluate as run
    from calibtool.evaluation.metrics import error_rows
    from calibtool.tables import format_table

    choice(outside, OUTSIDE_POLICIES, "--outside")
    limits = [parse_limit(text) for text in require or []]
    named = [(stem(path), load_calibration(path, frame)[0]) for path in calibrations]
    measurements, _ = load_measurements(on)
    earlier = None if before is None else load_measurements(before)[0]
    policy = cast(OutsidePolicy, outside)
    with working(f"evaluating on {len(measurements)} configurations"):
        evaluation = run(
            named,
            measurements,
            method=cast(Method, method),
            refit_setup=refit_setup,
            outside=policy,
            before=earlier,
        )
    if output is not None:
        write_output(output, format_table(*error_rows(evaluation.methods)), force)
    report = evaluation.as_json()
    if json:
        print_json(report)
    else:
        show_evaluation(report)
    for result in evaluation.results:
        if result.marked:
            message(
                f"warning: {result.name}: {result.marked} of {evaluation.configurations} "
                "configurations are corrected in part, or not at all (status of compensate)"
            )
    for result in evaluation.results:
        if result.outside:
            message(
                f"warning: {result.name}: {result.outside} of {evaluation.configurations} "
                "configurations are unlike the training's"
            )
    broken = broken_limits(evaluation.methods[1:], limits, evaluation.pose_tests[1:])
    if broken:
        raise AcceptanceError(broken[0])


def show_evaluation(report: dict[str, object]) -> None:
    """The table for people."""
    from calibtool.evaluation.wording import words

    terms = words(report["kind"], report.get("before"))  # type: ignore[arg-type]
    methods = report["methods"]
    assert isinstance(methods, list)
    rows = [_cells(entry["name"], entry, entry["reduction_percent"]) for entry in methods]
    expected = report.get("expected")
    if isinstance(expected, dict):
        rows[0][0], rows[1][0] = terms.before, f"{terms.after} ({expected['name']})"
        rows.append(_cells("expected, without noise", expected, {}))
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
    print_table(
        f"{report['robot']}, {report['configurations']} configurations, {terms.how}", header, rows
    )
    beyond = report.get("uncorrectable")
    if isinstance(beyond, dict):
        position, orientation = beyond["position_mm"], beyond["orientation_mrad"]
        message(
            f"{beyond['configurations']} poses are out of the joints' reach: at best "
            f"{position['mean']:.3f} mm and {orientation['mean']:.3f} mrad stay (at most "
            f"{position['max']:.3f}, {orientation['max']:.3f}); −% is of the part that the "
            "joints can correct"
        )
    test = report.get("iso9283")
    if isinstance(test, dict):
        names = [entry["name"] for entry in methods]
        if report["kind"] == "measured":
            names = [terms.before, terms.after]
        how = terms.how if report["kind"] == "measured" else "measured minus predicted"
        _show_pose_test(test, how, names)


def _cells(name: str, errors: dict[str, Any], reduction: dict[str, float | None]) -> list[str]:
    """A row of the table: the statistics of position and orientation, each with its reduction."""
    row = [name]
    for quantity, key in (("position", "position_mm"), ("orientation", "orientation_mrad")):
        found = errors[key]
        if found is None:
            row += ["-"] * 5
            continue
        lowered = reduction.get(f"{quantity}_max")
        row += [f"{found[s]:.3f}" for s in ("mean", "rms", "p95", "max")]
        row.append("" if lowered is None else f"{lowered:.1f}")
    return row


def _show_pose_test(test: dict[str, Any], how: str, names: list[str]) -> None:
    """AP of every method, as it is called, and RP, per pose."""

    def cells(position: list[float], turn: list[float] | None) -> list[str]:
        if turn is None:
            return [f"{value:.3f}" for value in position]
        return [f"{value:.3f} / {angle:.3f}" for value, angle in zip(position, turn, strict=True)]

    rows = [
        [f"AP {name}", *cells(entry["ap_mm"], entry["ap_mrad"])]
        for name, entry in zip(names, test["methods"], strict=True)
    ]
    if "rp_before_mm" in test:
        rows.append([f"RP {names[0]}", *cells(test["rp_before_mm"], test["rp_before_mrad"])])
    called = f"RP {names[1]}" if "rp_before_mm" in test else "RP"
    rows.append([called, *cells(test["rp_mm"], test["rp_mrad"])])
    rows = [row[: _POSES + 1] for row in rows]
    repeats = sorted({*test["repeats"]})
    counted = str(repeats[0]) if len(repeats) == 1 else f"{repeats[0]} to {repeats[-1]}"
    unit = "mm" if test["rp_mrad"] is None else "mm / mrad"
    more = (
        ""
        if len(test["poses"]) <= _POSES
        else f", the first {_POSES} of {len(test['poses'])} poses (all: --json)"
    )
    print_table(
        f"ISO 9283, {counted} repeats, {how}, {unit}{more}", ["", *test["poses"][:_POSES]], rows
    )
