"""The page: sections and drawings in one HTML file that needs nothing else."""

import re
from dataclasses import dataclass, replace

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from calibtool.errors import InputError
from calibtool.evaluation.compare import judged_rows
from calibtool.evaluation.metrics import MethodErrors
from calibtool.evaluation.plots import Subject, draw
from calibtool.evaluation.plots.style import COLOURS, GRID, INK, SHADE, WIDTH_MM
from calibtool.evaluation.report import calibration_sections, error_sections
from calibtool.evaluation.report.content import Drawing, PageSection, PageTable
from calibtool.evaluation.report.error_scene import error_scene
from calibtool.evaluation.report.occasion import Occasion
from calibtool.evaluation.report.verdict import cautions, headline, remarks, verdicts
from calibtool.evaluation.wording import words

_VARIABLES = {
    INK: "--ink",
    GRID: "--grid",
    SHADE: "--shade",
    **{c: f"--m{i}" for i, c in enumerate(COLOURS)},
}

_COORDINATES = re.compile(r' (d|x|y|transform)="[^"]*"')
# Digits after the second decimal are removed: a hundredth of a point is enough
_DIGITS = re.compile(r"(\.\d\d)\d+")


@dataclass(frozen=True)
class Shown:
    """A section ready to be shown: its lines, drawings with their SVG, and tables."""

    section: PageSection
    lines: list[str]
    drawings: list[tuple[Drawing, Markup]]
    tables: list[PageTable]


def html_report(
    subject: Subject, provenance: dict[str, str], occasion: Occasion | None = None
) -> str:
    """A self-contained HTML page about calibrations and their errors on measurements, which
    `subject` must hold.

    provenance: of the page itself. occasion: who measured what and for whom; the calibrations are
    called by its titles. The first page stands alone, the rest is its annex. Nothing is loaded from
    anywhere; the same subject gives the same text. Names from files are escaped. The whole
    `evaluate --json` is in the element `#evaluation`.
    """
    measurements, evaluation = subject.measurements, subject.evaluated
    assert measurements is not None
    rows = judged_rows(measurements)
    occasion = occasion or Occasion()
    figures = evaluation.as_json()
    subject = _titled(subject, occasion.calibrations)
    sections = [
        error_sections.errors_section(subject, rows),
        error_sections.vectors_section(),
        calibration_sections.training_section(subject),
        calibration_sections.motions_section(subject),
        calibration_sections.parameters_section(subject),
        calibration_sections.flagged_section(subject),
        calibration_sections.observability_section(subject),
        error_sections.coverage_section(subject, rows),
        calibration_sections.noise_section(subject),
        error_sections.uncorrectable_section(subject),
        error_sections.pose_test_section(subject),
        calibration_sections.provenance_section(subject, provenance, rows),
    ]
    found = verdicts(subject)
    described = rows.robot.source.description.title or evaluation.robot
    environment = Environment(
        loader=ChoiceLoader(
            [PackageLoader(f"calibtool.evaluation.{part}") for part in ("report", "view")]
        ),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("page.html.j2").render(
        evaluation=figures,
        title=occasion.title or f"Calibration of {described}",
        described=described,
        occasion=occasion,
        scene=error_scene(subject),
        compact=_compact(subject),
        caption=error_sections.distribution_caption(subject),
        headline=headline(subject, found),
        verdicts=found,
        cautions=cautions(subject, rows.q),
        remarks=remarks(subject),
        words=words(evaluation.kind, evaluation.before),
        part=evaluation.uncorrectable is not None,
        sections=[_shown(section, subject) for section in sections],
        colours=[f"var(--m{1 + k % (len(COLOURS) - 1)})" for k in range(len(found))],
    )


def _titled(subject: Subject, titles: dict[str, str]) -> Subject:
    """The subject with its calibrations called by their titles."""
    if not titles:
        return subject
    evaluation = subject.evaluated

    def called(errors: MethodErrors) -> MethodErrors:
        return replace(errors, name=titles.get(errors.name, errors.name))

    results = tuple(
        replace(result, errors=called(result.errors), correctable=called(result.correctable))
        for result in evaluation.results
    )
    test = evaluation.pose_test
    if test is not None:
        test = replace(test, methods=[titles.get(name, name) for name in test.methods])
    return replace(
        subject,
        calibrations=[(titles.get(name, name), each) for name, each in subject.calibrations],
        evaluation=replace(evaluation, results=results, pose_test=test),
    )


def _compact(subject: Subject) -> Markup:
    """The figure of the first page."""
    svg = draw("distribution", subject, "svg", WIDTH_MM, letters=True)
    return _inline(svg.decode("utf-8"), "first")


def _shown(section: PageSection, subject: Subject) -> Shown:
    """Draw the figures of a section; one that cannot be drawn becomes a line with the reason."""
    lines, drawings = list(section.lines), []
    for drawing in section.drawings:
        try:
            svg = draw(drawing.kind, subject, "svg", WIDTH_MM, letters=True)
        except InputError as error:
            lines.append(f"{str(error)[0].upper()}{str(error)[1:]}.")
        else:
            drawings.append((drawing, _inline(svg.decode("utf-8"), f"{section.id}-{drawing.kind}")))
    return Shown(section, lines, drawings, list(section.tables))


def _inline(svg: str, prefix: str) -> Markup:
    """The `<svg>` element with unique names and the colours of the page."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<!--.*?-->\n?", "", svg, flags=re.DOTALL)
    svg = re.sub(r' xmlns(:xlink)?="[^"]*"', "", svg).replace("xlink:href", "href")
    svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
    svg = re.sub(r'(href="|url\()#', rf"\g<1>#{prefix}-", svg)
    svg = _COORDINATES.sub(lambda found: _DIGITS.sub(r"\1", found[0]), svg)
    for value, variable in _VARIABLES.items():
        svg = svg.replace(value, f"var({variable})")
    svg = re.sub(
        r'<svg [^>]*?(viewBox="[^"]*")[^>]*>', r'<svg \1 aria-hidden="true">', svg, count=1
    )
    return Markup(svg)
