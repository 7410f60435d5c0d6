"""Sections about the judged configurations: errors, directions, ISO 9283, coverage."""

from dataclasses import replace
from typing import Any

import numpy as np

from calibtool.calibration.guard import coverage
from calibtool.evaluation.metrics import STATISTICS, MethodErrors, pose_statistics
from calibtool.evaluation.plots import Subject
from calibtool.evaluation.report.content import Drawing, PageSection, PageTable, number
from calibtool.measurement.checks import design_findings
from calibtool.measurement.measurements import Measurements

_WORST = 5  # number of configurations listed per calibration


def errors_section(subject: Subject, judged: Measurements) -> PageSection:
    """Statistics and distribution of the errors, and the worst configurations."""
    evaluation = subject.evaluated
    entries: list[dict[str, Any]] = evaluation.as_json()["methods"]  # type: ignore[assignment]
    tables = [
        PageTable(
            f"{quantity.capitalize()} error, {unit}",
            ["method", *STATISTICS],
            [
                [e["name"], *(number(e[f"{quantity}_{unit}"][s]) for s in STATISTICS)]
                for e in entries
            ],
        )
        for quantity, unit in (("position", "mm"), ("orientation", "mrad"))
        if entries[0][f"{quantity}_{unit}"] is not None
    ]
    if evaluation.proof is not None:
        tables = [_with_expected(table, evaluation.proof.expected) for table in tables]
    lines = (
        []
        if len(tables) == 2
        else ["The target points do not show the orientation: only the position is judged."]
    )
    spread = "; ".join(
        f"{e['name']}: mean {number(e['position_mm']['mean'])}, largest "
        f"{number(e['position_mm']['max'])}"
        for e in entries
    )
    return PageSection(
        "errors",
        "Errors",
        lines,
        [
            Drawing(
                "errors",
                "Error of every configuration, and its spread (quartiles and extremes)."
                + _floor(subject),
                f"Position error in mm. {spread}.",
            ),
        ],
        [*tables, _worst(evaluation.methods[1:], judged)],
    )


def distribution_caption(subject: Subject) -> str:
    """Caption of the distribution of the errors, with the lines in it."""
    limits = " Dotted: limits." if subject.limits else ""
    share = "Share of the configurations whose error is at most the value below."
    return f"{share}{limits}{_floor(subject)}"


def _floor(subject: Subject) -> str:
    if subject.evaluated.kind == "compensated":
        return ""
    return " Dashed: what the noise of the measurement alone gives (rms)."


def _with_expected(table: PageTable, expected: MethodErrors) -> PageTable:
    """The table of one quantity with a row of what the model expects after correction."""
    key = "position_mm" if table.caption.endswith("mm") else "orientation_mrad"
    found = pose_statistics(expected)[key]
    if found is None:
        return table
    row = ["expected, without noise", *(number(found[s]) for s in STATISTICS)]
    return replace(table, rows=[*table.rows, row])


def _worst(methods: list[MethodErrors], judged: Measurements) -> PageTable:
    """The largest position errors, and the joint positions where they are."""
    factors = judged.robot.display_factors
    rows = []
    for method in methods:
        for k in np.argsort(-method.position_size, kind="stable")[:_WORST]:
            cells = [str(int(k) + 1), number(float(method.position_size[k]) * 1e3)]
            rows.append([method.name, *cells, *(f"{v:.1f}" for v in judged.q[k] * factors)])
    header = ["method", "configuration", "error mm", *judged.robot.joint_columns]
    return PageTable("Largest position errors, and the joints there", header, rows, folded=True)


def vectors_section() -> PageSection:
    """Error vectors in three projections."""
    return PageSection(
        "vectors",
        "Error vectors in the workspace",
        [
            "Each arrow starts at a commanded tool position, in the robot's base frame, and shows "
            "its position error, magnified."
        ],
        [
            Drawing(
                "vectors",
                "Position errors seen along the axes of the base frame, each method at its own "
                "magnification.",
                "Position error as arrows at the tool positions, projected along z, y and x; one "
                "row per method.",
            )
        ],
    )


def uncorrectable_section(subject: Subject) -> PageSection:
    """Poses that the actual robot cannot reach with any joint positions."""
    evaluation = subject.evaluated
    name, title = "uncorrectable", "What no joint can correct"
    beyond = evaluation.uncorrectable
    if beyond is None:
        known = (
            evaluation.kind == "compensated"
            and subject.measurements is not None
            and subject.measurements.setup.known
        )
        reason = (
            "Nothing: the actual robot can take every judged pose."
            if known
            else "Not known: only a simulation with a known set-up knows which poses the actual "
            "robot can take."
        )
        return PageSection(name, title, [reason], printed=False)
    line = (
        f"{len(beyond.position)} of {evaluation.configurations} commanded poses cannot be taken by "
        "the actual robot: too few joints, or out of reach. The error that remains at the "
        "nearest poses stays whatever the calibration; reductions in percent are of the rest."
    )
    whole = pose_statistics(beyond)
    rows = [
        [f"{quantity} {unit}", *(number(values[s]) for s in STATISTICS)]
        for quantity, unit in (("position", "mm"), ("orientation", "mrad"))
        if (values := whole[f"{quantity}_{unit}"]) is not None
    ]
    tables = [PageTable("Nearest poses", ["", *STATISTICS], rows)]
    return PageSection(name, title, [line], (), tables)


def pose_test_section(subject: Subject) -> PageSection:
    """AP and RP where configurations were repeated."""
    evaluation = subject.evaluated
    title = "ISO 9283: pose accuracy and repeatability"
    drawing = Drawing(
        "iso9283",
        "AP of every method, RP (bars) of the robot.",
        "Pose accuracy AP and repeatability RP.",
    )
    test = evaluation.pose_test
    if test is None:
        return PageSection("iso9283", title, (), [drawing], printed=False)
    tables = []
    shown = (
        ("mm", test.accuracy, test.repeatability),
        ("mrad", test.accuracy_turn, test.repeatability_turn),
    )
    for unit, accuracy, repeatability in shown:
        if accuracy is None or repeatability is None:
            continue
        rows = [
            [
                pose.name,
                str(len(pose.rows)),
                *(number(float(v) * 1e3) for v in (*accuracy[:, k], repeatability[k])),
            ]
            for k, pose in enumerate(test.poses)
        ]
        header = ["pose", "repeats", *(f"AP {name}" for name in test.methods), "RP"]
        tables.append(PageTable(f"AP and RP, {unit}", header, rows, folded=len(rows) > 10))
    how = "Commanded against measured" if evaluation.proof else "Measured minus predicted"
    lines = [f"{how}, from the repeated rows."]
    if test.before is not None:
        earlier = ", ".join(number(float(v) * 1e3) for v in test.before[0])
        lines.append(f"RP before the correction, mm: {earlier}.")
    return PageSection("iso9283", title, lines, [drawing], tables)


def coverage_section(subject: Subject, judged: Measurements) -> PageSection:
    """Where the judged configurations lie among those of the training."""
    rows, lines = [], [f"judged rows: {finding}" for finding in judged.findings]
    for name, calibration in subject.calibrations:
        found = coverage(calibration, judged.q)
        rows.append(
            [
                name,
                str(len(calibration.q)),
                str(len(judged)),
                str(int(found.outside.sum())),
                number(float(found.distance.max())),
            ]
        )
        lines += [
            f"{name}: {finding.message}"
            for finding in design_findings(calibration.robot, calibration.q)
        ]
    header = [
        "calibration",
        "training rows",
        "judged rows",
        "unlike the training",
        "largest distance",
    ]
    table = PageTable(
        "Distance to the nearest training row over the largest one within the training",
        header,
        rows,
    )
    return PageSection(
        "coverage",
        "Coverage of the joint space",
        lines,
        [
            Drawing(
                "coverage",
                "Joint positions between the limits of each joint: judged (shade) and of the "
                "training (lines).",
                "Histograms of the joint positions, one panel per joint.",
            )
        ],
        [table],
        printed=False,
    )
