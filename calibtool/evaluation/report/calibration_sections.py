"""Sections about calibrations: training, motions, parameters, flagged rows, noise."""

from calibtool.calibration import Calibration
from calibtool.calibration.frame_report import frame_report
from calibtool.calibration.noise_groups import NoiseGroup, noise_groups
from calibtool.equivalent.gaussian_process import GaussianProcess
from calibtool.errormodel.family import COMPONENTS
from calibtool.evaluation.plots import Subject
from calibtool.evaluation.report.content import Drawing, PageSection, PageTable, number
from calibtool.evaluation.wording import OPTIMISERS, REGULARISATIONS
from calibtool.identification.report import ParameterRow, parameter_rows, strongest_correlations
from calibtool.measurement.measurements import Measurements
from calibtool.units import minus, three_digits

_OPEN_ROWS = 20  # a longer table is folded
_DETERMINED = 0.5  # parameters that are determined to at least this part are listed
SYMBOLS = (
    "ζ: where a joint stands in the link before it; ξ: error of its axis, which grows with the "
    "joint's position; q: offset of its zero; sin, cos: periodic error of its gear, with the "
    "number of periods per turn; gravity: wind-up under its load; backlash: half of its play. "
    "Numbers count the joints from the base; x, y, z are lengths, rx, ry, rz angles."
)
_NAMED = 12  # number of unobservable parameters named


def training_section(subject: Subject) -> PageSection:
    """How networks or a Gaussian process were trained, and whether they are used."""
    lines = []
    for name, calibration in subject.calibrations:
        report, validation = calibration.training, calibration.validation
        if report is None:
            continue
        used = "not used, because it does not help"
        if calibration.networks:
            used = f"{len(calibration.networks)} used"
        elif validation is None and report.regularisation == "bayes":
            used = "not used, because with some configurations left out nothing is determined"
        text = (
            f"{name}: network with {report.hidden} hidden nodes, {used}. Trained by "
            f"{OPTIMISERS[report.optimiser]}, {REGULARISATIONS[report.regularisation]}; training "
            f"ended because {report.history.reason}."
        )
        if report.regressor == GaussianProcess.id:
            used = used if not calibration.networks else "used"
            text = f"{name}: Gaussian process with {report.hidden} points, {used}."
        if validation is not None:
            text += f" Gain in {validation.folds}-fold cross-validation: {validation}."
        lines.append(text)
    caption = "Loss over the iterations of the best restart."
    alt = "Training and validation loss, the loss without network, and the iteration that was kept."
    drawings = [Drawing("training", caption, alt)]
    return PageSection("training", "Training", lines, drawings, printed=False)


def motions_section(subject: Subject) -> PageSection:
    """δρ of each joint against its position."""
    virtual = subject.calibrations[0][1].equivalent.virtual_joints
    lines = []
    if virtual and any(c.networks for _, c in subject.calibrations):
        names = ", ".join(virtual)
        lines = [
            f"The virtual joints ({names}, in the tool frame) have no position of their own and "
            "are not drawn."
        ]
    return PageSection(
        "motions",
        "Joint motions",
        lines,
        [
            Drawing(
                "motions",
                "δρ is how much more a joint moves than commanded, here at the configurations of "
                "the training. Line: periodic errors (harmonics). Dots: these with the wind-up "
                "under gravity, functions of pairs of joints and the learned model. Constant "
                "offsets are left out.",
                "Joint motion error against joint position, one panel per joint.",
            )
        ],
        printed=False,
    )


def parameters_section(subject: Subject) -> PageSection:
    """Every parameter with its uncertainty; for a model without one its placement errors."""
    tables, lines = [], []
    for name, calibration in subject.calibrations:
        base, frame = calibration.base, frame_report(calibration)
        lines += [] if frame is None else [f"{name}: {line}." for line in frame.lines()]
        if base.posterior is not None:
            rows = parameter_rows(base)
            lines.append(
                f"{name}: {base.posterior.effective:.1f} of {base.observable_rank} "
                f"combinations of {len(rows)} parameters determined; strongest correlations "
                + ", ".join(
                    minus(f"{a} and {b} {value:+.2f}")
                    for a, b, value in strongest_correlations(base.posterior, 3)
                )
                + "."
            )
            known = [row for row in rows if row.family and row.determined >= _DETERMINED]
            lines.append(
                f"{name}: the table lists the {len(known)} of {len(rows)} parameters that the "
                "measurements determine to at least half; calibtool report writes all of them "
                "to a file on request."
            )
            known.sort(key=lambda row: -abs(row.value) / row.std)
            header = ["parameter", "value ±", "determined"]
            cells = _side_by_side([_parameter(row) for row in known])
            heads = [*header, *header][: len(cells[0]) if cells else len(header)]
            title = f"Parameters of {name} that are determined; ± is one standard deviation"
            tables.append(PageTable(title, heads, cells))
        elif base.model != "nominal":
            tables.append(_placements(name, calibration))
    if not tables:
        return PageSection("parameters", "Parameters", ["None: no base model was identified."])
    if any(calibration.base.posterior is not None for _, calibration in subject.calibrations):
        lines.append(SYMBOLS)
    caption = (
        "Values ± 2 standard deviations. A bar as long as the tolerance: the measurements do not "
        "determine this parameter."
    )
    alt = "Identified parameters with error bars, one panel per family."
    return PageSection(
        "parameters", "Parameters", lines, [Drawing("parameters", caption, alt)], tables
    )


def _parameter(row: ParameterRow) -> list[str]:
    value = minus(f"{three_digits(row.value)} ± {three_digits(row.std)} {row.unit}")
    return [row.name, value, f"{100 * row.determined:.0f} %"]


def _side_by_side(rows: list[list[str]]) -> list[list[str]]:
    """Rows in two columns, where there are more than a few."""
    half = (len(rows) + 1) // 2
    if len(rows) < _OPEN_ROWS:
        return rows
    right = [*rows[half:], *([[""] * len(rows[0])] * (2 * half - len(rows)))]
    return [[*a, *b] for a, b in zip(rows[:half], right, strict=True)]


def _placements(name: str, calibration: Calibration) -> PageTable:
    errors = calibration.base.errors["placements"]
    rows = [[f"ζ{j + 1}", *(f"{v * 1e3:.4f}" for v in row)] for j, row in enumerate(errors)]
    header = ["error", *(f"{c} {'mrad' if c.startswith('r') else 'mm'}" for c in COMPONENTS)]
    return PageTable(
        f"Placement errors of {name} (least norm, no uncertainty)", header, rows, folded=True
    )


def flagged_section(subject: Subject) -> PageSection:
    """Rows of the identification that do not fit."""
    tables, lines = [], []
    looked = False
    for name, calibration in subject.calibrations:
        flagged = calibration.base.flagged
        if flagged is None:
            continue
        looked = True
        if not len(flagged.rows):
            continue
        done = "left out of the fit" if flagged.dropped else "kept in the fit"
        count = len(flagged.rows)
        lines.append(f"{name}: {count} {'row does' if count == 1 else 'rows do'} not fit, {done}.")
        if flagged.cluster:
            lines.append(f"{name}: {flagged.cluster}.")
        rows = [
            [
                str(int(flagged.rows[k]) + 1),
                number(float(flagged.position[k]) * 1e3),
                f"{flagged.deviation[k]:.1f}",
            ]
            for k in (-flagged.deviation).argsort(kind="stable")
        ]
        header = ["configuration", "residual mm", "times the noise"]
        tables.append(
            PageTable(f"Flagged rows of {name}", header, rows, folded=len(rows) > _OPEN_ROWS)
        )
    if not lines:
        lines = [
            "None: every row of the identification fits."
            if looked
            else "Not looked for: only the complete model flags rows that do not fit."
        ]
    return PageSection("flagged", "Flagged rows", lines, (), tables)


def observability_section(subject: Subject) -> PageSection:
    """Rank, singular values, and what the configurations do not show."""
    rows, lines = [], []
    for name, calibration in subject.calibrations:
        base = calibration.base
        if not base.parameters:
            continue
        kept = base.singular_values[: max(base.rank, 1)]
        rows.append(
            [
                name,
                str(base.parameters),
                str(base.rank),
                str(base.observable_rank),
                f"{kept[0]:.3g}",
                f"{kept[-1]:.3g}",
            ]
        )
        if base.unobservable:
            missing = ", ".join(base.unobservable[:_NAMED])
            more = (
                f" and {len(base.unobservable) - _NAMED} more"
                if len(base.unobservable) > _NAMED
                else ""
            )
            lines.append(f"{name}: not observable from these configurations: {missing}{more}.")
    header = [
        "calibration",
        "parameters",
        "rank",
        "could be determined",
        "largest",
        "smallest kept",
    ]
    tables = [PageTable("Rank and singular values", header, rows)] if rows else []
    caption = (
        "Singular values, largest first; each belongs to a combination of parameters. Complete "
        "model: in multiples of the tolerances; above 1 the measurements say more than the "
        "tolerances do. Lowest row: values at or below it."
    )
    alt = (
        "Singular values in falling order, with the limit below which a combination is "
        "not determined."
    )
    drawings = [Drawing("observability", caption, alt)]
    return PageSection("observability", "Observability", lines, drawings, tables, printed=False)


def noise_section(subject: Subject) -> PageSection:
    """Stated noise compared with that of the residuals."""
    rows = []
    for name, calibration in subject.calibrations:
        base = calibration.base
        factor = None if base.posterior is None else base.posterior.noise_factor
        position, orientation = base.residual_rms
        stated = calibration.noise_position * 1e3
        cells = [
            number(stated),
            number(None if factor is None else factor * stated),
            number(position * 1e3),
        ]
        if orientation is not None:
            angle = calibration.noise_orientation * 1e3
            cells += [
                number(angle),
                number(None if factor is None else factor * angle),
                number(orientation * 1e3),
            ]
        elif any(c.base.residual_rms[1] is not None for _, c in subject.calibrations):
            cells += ["–"] * 3
        rows.append([name, *cells, _noise_verdict(factor)])
    header = ["calibration", "stated mm", "estimated mm", "base residual rms mm"]
    if len(rows[0]) > len(header) + 1:
        header += ["stated mrad", "estimated mrad", "base residual rms mrad"]
    tables = [PageTable("Per measured coordinate", [*header, "verdict"], rows)]
    lines = []
    if subject.measurements is not None:
        for name, calibration in subject.calibrations:
            groups = noise_groups(calibration, subject.measurements)
            noisier = [group for group in groups if group.noisier]
            lines += [f"{name}: {group}." for group in noisier]
            if noisier:
                tables.append(_by_group(name, groups))
    return PageSection("noise", "Noise", lines, (), tables)


def _by_group(name: str, groups: list[NoiseGroup]) -> PageTable:
    """Residuals of the judged rows by target and by axis."""
    cells = [
        [group.called, f"{number(group.rms * 1e3)} {group.unit}", f"{group.ratio:.2f}"]
        for group in groups
    ]
    header = ["residuals of", "rms", "noise over the others'"]
    return PageTable(f"Residuals of {name} by target and axis", header, cells)


def _noise_verdict(factor: float | None) -> str:
    if factor is None:
        return "not estimated by this model"
    if factor > 2:
        return (
            f"{factor:.1f} times the stated noise: it is wrong, or the robot has errors that the "
            "model does not describe"
        )
    return (
        "as stated" if factor >= 0.5 else f"{factor:.2f} times the stated noise: less than stated"
    )


def provenance_section(subject: Subject, own: dict[str, str], judged: Measurements) -> PageSection:
    """Where the page, the calibrations and the measurements come from."""
    sources = [("this page", own), *((name, c.provenance) for name, c in subject.calibrations)]
    sources.append(("the measurements", judged.provenance))
    tables = [
        PageTable(
            f"Provenance of {name}",
            ["entry", "value"],
            list(map(list, entries.items())),
            folded=name != "this page",
        )
        for name, entries in sources
        if entries
    ]
    missing = [name for name, entries in sources if not entries]
    return PageSection(
        "provenance",
        "Provenance",
        [f"Nothing is recorded for {name}." for name in missing],
        (),
        tables,
    )
