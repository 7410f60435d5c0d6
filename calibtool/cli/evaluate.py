"""calibtool evaluate: methods side by side."""

from typing import Annotated, Any

import typer

from calibtool.cli.files import check_output, message, one_stdin, stem, write_output, wrote
from calibtool.cli.input_files import load_calibration, load_measurements
from calibtool.cli.judging import CalibrationFiles, JudgedOn, Judging, require_met
from calibtool.cli.options import Force, Json, check_one_stdout
from calibtool.cli.printing import Table, print_json, print_tables
from calibtool.cli.progress import working
from calibtool.units import count_of, three_digits

_POSES = 8  # number of poses of ISO 9283 in the printed table
_STATISTICS = ("mean", "rms", "95 % below", "max", "change of max")


def evaluate(
    *,
    calibrations: CalibrationFiles,
    on: JudgedOn,
    output: Annotated[
        str | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE.csv",
            help="Signed errors of every configuration; '-' is stdout.",
        ),
    ] = None,
    judging: Judging,
    json: Json = False,
    force: Force = False,
) -> None:
    """Judge calibrations on measurements.

    Simulated measurements: the actual robot is driven to the corrected joints and measured without
    noise. Real ones: measured minus predicted target points, which is what to expect after
    correction. Where configurations were measured repeatedly, pose accuracy AP and repeatability RP
    of ISO 9283 are reported, too. The tables go to stderr.

    Proof on the arm: measurements imported with --commanded were taken at corrected joints. Then
    measured points are compared with commanded ones, after the correction and, with --before,
    before it. Exit code 3 where the arm was driven to other joints than the calibration asks for.

    Example: calibtool evaluate paper.h5 local-poe.h5 --on fresh.h5 --json
    """
    check_one_stdout(output, json)
    if output is not None:
        check_output(output, force, suffixes=(".csv",))
    one_stdin(*calibrations, on, judging.before)
    from calibtool.calibration.guard import also_in_training
    from calibtool.evaluation.compare import judged_rows
    from calibtool.evaluation.metrics import error_rows
    from calibtool.tables import format_table

    limits = judging.limits()
    named = [(stem(path), load_calibration(path, judging.frame)[0]) for path in calibrations]
    measurements, _ = load_measurements(on)
    earlier = None if judging.before is None else load_measurements(judging.before)[0]
    with working(f"evaluating on {len(measurements)} configurations"):
        evaluation = judging.evaluation(named, measurements, earlier)
    if output is not None:
        header, rows = error_rows(evaluation.methods)
        write_output(output, format_table(header, rows), force)
    report = evaluation.as_json()
    if json:
        print_json(report)
    else:
        show_evaluation(report)
    judged = judged_rows(measurements)
    for name, calibration in named:
        if seen := also_in_training(calibration, judged.q):
            message(
                f"warning: {name}: {seen} of {len(judged)} configurations were used to make it; "
                "its errors elsewhere are larger: judge on other rows"
            )
    for result in evaluation.results:
        if result.marked:
            message(
                f"warning: {result.name}: {result.marked} of {evaluation.configurations} "
                f"configurations {'is' if result.marked == 1 else 'are'} corrected in part, or not "
                "at all (status of compensate)"
            )
    for result in evaluation.results:
        if result.outside:
            message(
                f"warning: {result.name}: {result.outside} of {evaluation.configurations} "
                f"configurations {'is' if result.outside == 1 else 'are'} unlike the training's"
            )
    if output is not None:
        wrote(output, f"signed errors of {count_of(len(rows), 'row')}")
    require_met(evaluation, limits)


def show_evaluation(report: dict[str, object]) -> None:
    """The tables for people: position, then orientation where it is seen."""
    from calibtool.evaluation.wording import words

    terms = words(report["kind"], report.get("before"))  # type: ignore[arg-type]
    methods = report["methods"]
    assert isinstance(methods, list)
    entries = [(entry["name"], entry, entry["reduction_percent"]) for entry in methods]
    expected, by = report.get("expected"), ""
    if isinstance(expected, dict):
        entries = [
            (name, *entry[1:])
            for name, entry in zip((terms.before, terms.after), entries, strict=True)
        ]
        entries.append(("expected, without noise", expected, {}))
        by = f" corrected by {expected['name']}"
    count = report["configurations"]
    assert isinstance(count, int)
    tables: list[Table] = []
    for quantity, unit in (("position", "mm"), ("orientation", "mrad")):
        key = f"{quantity}_{unit}"
        rows = [
            _cells(name, errors[key], reduction.get(f"{quantity}_max") if k else None)
            for k, (name, errors, reduction) in enumerate(entries)
            if errors[key] is not None
        ]
        if rows:
            tables.append(([f"{quantity} error, {unit}", *_STATISTICS], rows))
    print_tables(f"{report['robot']}, {count_of(count, 'configuration')}{by}, {terms.how}", tables)
    beyond = report.get("uncorrectable")
    if isinstance(beyond, dict):
        position, orientation = beyond["position_mm"], beyond["orientation_mrad"]
        message(
            f"{count_of(beyond['configurations'], 'pose is', 'poses are')} out of the joints' "
            f"reach: at best {three_digits(position['mean'])} mm and "
            f"{three_digits(orientation['mean'])} mrad stay (at most "
            f"{three_digits(position['max'])}, {three_digits(orientation['max'])}); percentages "
            "count only the error that moving the joints can remove"
        )
    test = report.get("iso9283")
    if isinstance(test, dict):
        names = [entry["name"] for entry in methods]
        if report["kind"] == "measured":
            names = [terms.before, terms.after]
        how = terms.how if report["kind"] == "measured" else "measured minus predicted"
        _show_pose_test(test, how, names)


def _cells(name: str, errors: dict[str, float], reduction: float | None) -> list[str]:
    """A row of the table: statistics of an error, and how much lower its maximum is."""
    found = [three_digits(errors[s]) for s in ("mean", "rms", "p95", "max")]
    return [name, *found, "" if reduction is None else change(reduction)]


def change(reduction: float) -> str:
    """A reduction in percent as a change of the error: `−93.0 %`."""
    return f"{'−' if reduction > 0 else '+'}{abs(reduction):.1f} %"


def _show_pose_test(test: dict[str, Any], how: str, names: list[str]) -> None:
    """AP of every method under its name, and RP, for each pose."""
    repeats = sorted({*test["repeats"]})
    counted = str(repeats[0]) if len(repeats) == 1 else f"{repeats[0]} to {repeats[-1]}"
    poses = test["poses"][:_POSES]
    more = "" if len(poses) == len(test["poses"]) else f" of {len(test['poses'])} (all: --json)"
    title = (
        f"ISO 9283, {count_of(len(poses), 'pose')}{more} measured {counted} times, {how}; "
        "AP: accuracy, RP: repeatability"
    )
    tables: list[Table] = []
    for unit in ("mm", "mrad"):
        called = [
            (f"AP {name}", entry[f"ap_{unit}"])
            for name, entry in zip(names, test["methods"], strict=True)
        ]
        if f"rp_before_{unit}" in test:
            called.append((f"RP {names[0]}", test[f"rp_before_{unit}"]))
        after = f"RP {names[1]}" if "rp_before_mm" in test else "RP"
        called.append((after, test[f"rp_{unit}"]))
        rows = [[name, *map(three_digits, values[:_POSES])] for name, values in called if values]
        if rows:
            tables.append(([unit, *poses], rows))
    print_tables(title, tables)
