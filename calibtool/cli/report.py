"""calibtool report: one page about calibrations."""

from dataclasses import dataclass
from typing import Annotated

import typer

from calibtool.cli.files import (
    check_output,
    one_stdin,
    read_text,
    shown,
    stem,
    write_outputs,
    wrote,
)
from calibtool.cli.input_files import load_calibration, load_measurements
from calibtool.cli.judging import CalibrationFiles, JudgedOn, Judging, require_met
from calibtool.cli.options import Force, choice
from calibtool.cli.progress import working
from calibtool.errors import UsageError
from calibtool.units import count_of


@dataclass(frozen=True)
class DocumentOptions:
    """What the document says of the occasion; None where it is not given."""

    title: Annotated[str | None, typer.Option(help="Heading of the document.", metavar="TEXT")] = (
        None
    )
    serial: Annotated[
        str | None, typer.Option(help="Serial number of the robot.", metavar="TEXT")
    ] = None
    customer: Annotated[str | None, typer.Option(help="For whom.", metavar="TEXT")] = None
    operator: Annotated[str | None, typer.Option(help="Who measured.", metavar="TEXT")] = None
    instrument: Annotated[str | None, typer.Option(help="What measured.", metavar="TEXT")] = None
    date: Annotated[str | None, typer.Option(help="When it was measured.", metavar="TEXT")] = None
    temperature: Annotated[
        str | None, typer.Option(help="Temperature in the cell.", metavar="TEXT")
    ] = None


def report(
    *,
    calibrations: CalibrationFiles,
    on: JudgedOn,
    output: Annotated[
        str,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE.html",
            help="The page, or with the suffix .pdf the page printed; '-' is stdout.",
        ),
    ] = "report.html",
    judging: Judging,
    document: DocumentOptions,
    about: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.toml",
            help="Title, serial and so on from a file; [calibrations] gives each a title.",
        ),
    ] = None,
    pdf: Annotated[
        str | None,
        typer.Option(metavar="FILE.pdf", help="Also print the page; needs Chromium or WeasyPrint."),
    ] = None,
    paper: Annotated[str, typer.Option(metavar="a4|letter", help="Paper of --pdf.")] = "a4",
    parameters: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.csv",
            help="Also write every parameter; the page lists the determined ones.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Write an acceptance document to be signed (HTML, PDF).

    The first page stands alone: robot and occasion, verdict against the limits, errors before and
    after with the noise of the measurement, and lines to sign. Before and after are measured where
    rows were measured at corrected joints (see `evaluate`), otherwise expected.

    The annex holds errors, error vectors, parameters, flagged rows, noise and provenance. Training,
    joint motions, observability and coverage are shown on the screen only. The page loads nothing
    from anywhere, and prints on A4 and Letter. With a limit that is not met it is written, too, and
    the exit code is 5.

    Example: calibtool report paper.h5 --on fresh.h5 --require position_max_mm=2 -o report.html
    """
    page_file: str | None = output
    if output.lower().endswith(".pdf"):
        if pdf is not None:
            raise UsageError("--pdf: -o names a PDF already; give one of them")
        page_file, pdf = None, output
    outputs = ((page_file, (".html", ".htm")), (pdf, (".pdf",)), (parameters, (".csv",)))
    for path, suffixes in outputs:
        if path is not None:
            check_output(path, force, suffixes=suffixes)
    one_stdin(*calibrations, on, judging.before, about)
    choice(paper, ("a4", "letter"), "--paper")
    from calibtool.cli.provenance import provenance
    from calibtool.evaluation.plots import Subject
    from calibtool.evaluation.report import Occasion, html_report, parse_occasion
    from calibtool.identification.report import parameter_table

    limits = judging.limits()
    loaded = [(stem(path), *load_calibration(path, judging.frame)) for path in calibrations]
    named = [(name, calibration) for name, calibration, _ in loaded]
    measurements, data = load_measurements(on)
    earlier = None if judging.before is None else load_measurements(judging.before)
    evaluation = judging.evaluation(named, measurements, None if earlier is None else earlier[0])
    inputs = {f"calibration_{k}": part for k, (_, _, part) in enumerate(loaded, 1)}
    if earlier is not None:
        inputs["before"] = earlier[1]
    occasion = Occasion() if about is None else parse_occasion(read_text(about), shown(about))
    page = html_report(
        Subject(named, measurements, evaluation, limits),
        provenance(None, measurements=data, **inputs),
        occasion.changed(vars(document)),
    )
    contents: dict[str, bytes | str] = {} if page_file is None else {page_file: page}
    if pdf is not None:
        from calibtool.evaluation.report.pdf import to_pdf

        with working("printing the page"):
            contents[pdf] = to_pdf(page, paper)
    if parameters is not None:
        contents[parameters] = parameter_table([(name, each.base) for name, each in named])
    write_outputs(contents, force)
    what = f"report of {count_of(len(measurements), 'configuration')}"
    again = what if page_file is None else "the same, printed"
    for path, words in ((page_file, what), (pdf, again), (parameters, "every parameter")):
        if path is not None:
            wrote(path, words)
    require_met(evaluation, limits)
