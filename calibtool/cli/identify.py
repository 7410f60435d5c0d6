"""calibtool identify: a base model from measurements."""

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.base_model_options import BaseModelOptions
from calibtool.cli.files import HDF5, check_output, message, one_stdin, shown, write_output, wrote
from calibtool.cli.input_files import (
    frame_name,
    load_calibration,
    load_measurements,
    say_if_frame_is_not_free,
)
from calibtool.cli.options import Force, FrameOption, Json, ReportingOutput, choice, report_target
from calibtool.cli.printing import print_json, print_tables
from calibtool.cli.progress import working
from calibtool.cli.provenance import provenance
from calibtool.errors import UsageError
from calibtool.units import count_of, three_digits

if TYPE_CHECKING:
    from calibtool.calibration import Calibration
    from calibtool.calibration.noise_groups import NoiseGroup
    from calibtool.measurement.measurements import Measurements

_CLEAREST = 15


def identify(
    *,
    measurements: Annotated[
        list[str],
        typer.Argument(
            metavar="MEASUREMENTS...",
            help="Measurements, '-' is stdin; of several files each is a set-up of its own.",
        ),
    ],
    output: ReportingOutput = None,
    model: Annotated[
        str, typer.Option(metavar="local-poe|complete", help="The base model.")
    ] = "complete",
    base_model: BaseModelOptions,
    only: Annotated[
        str | None,
        typer.Option(
            metavar="FAMILIES",
            help="Identify these alone, such as q (joint offsets, lost mastering): a comma list.",
        ),
    ] = None,
    fix: Annotated[
        str | None,
        typer.Option(
            metavar="FAMILIES",
            help="Leave these out: placements, twists, q, harmonics, gravity, backlash, payload …",
        ),
    ] = None,
    refit: Annotated[
        str | None,
        typer.Option(
            metavar="base,tool", help="Fit only base and/or tool of --from to these measurements."
        ),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="CALIBRATION", help="The calibration that --refit takes over."
        ),
    ] = None,
    parameters: Annotated[
        bool, typer.Option("--parameters", help="Show every parameter with its uncertainty.")
    ] = False,
    offsets: Annotated[
        bool,
        typer.Option(
            "--offsets",
            help="Say the joint offsets in degrees ±, turns of the placements about the joints' "
            "axes included: for a mastering screen.",
        ),
    ] = False,
    frame: FrameOption = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Find the errors of a robot from measurements.

    The complete model (default) has every error with a tolerance, gear harmonics and gravity where
    the measurements show them, and ± for each parameter. local-poe is the method of Song, Tian and
    Ma: one constant error of each link, with the rank and what cannot be determined.

    Where instrument and targets are unknown, base and tool frame are free: --frame chooses them.
    stderr reports which part of the errors base and tool have in common, and what remains.

    Example: calibtool identify measurements.h5 --model complete -o complete.h5
    """
    target = report_target(output, json)
    if target is not None:
        check_output(target, force, binary=True, suffixes=HDF5)
    one_stdin(*measurements, source)
    from calibtool.calibration import IDENTIFIED_MODELS
    from calibtool.calibration import identify as run
    from calibtool.calibration.noise_groups import noise_groups
    from calibtool.calibration.transfer import refit as transfer
    from calibtool.identification.mastering import mastering
    from calibtool.identification.partial import of_families
    from calibtool.storage import to_bytes

    choice(model, IDENTIFIED_MODELS, "--model")
    chosen = frame_name(frame or "taught")
    if (refit is None) != (source is None):
        raise UsageError("--refit and --from belong together: --refit base,tool --from CALIBRATION")
    inputs: dict[str, bytes] = {}
    extra: dict[str, object] = {}
    if refit is not None and source is not None:
        old, inputs["from"] = load_calibration(source, frame)
        data = loaded(measurements, inputs)
        calibration, verdict = transfer(old, data, tuple(part.strip() for part in refit.split(",")))
        extra["transfer"] = {
            "nominal_rms_mm": verdict.nominal * 1e3,
            "calibrated_rms_mm": verdict.calibrated * 1e3,
            "still_helps": verdict.still_helps,
        }
        verdict_text = "still helps" if verdict.still_helps else "no longer helps: identify again"
        message(
            f"refitted {refit}: {verdict.calibrated * 1e3:.3g} mm rms on left-out rows, "
            f"nominal {verdict.nominal * 1e3:.3g} mm: the calibration {verdict_text}"
        )
    else:
        data = loaded(measurements, inputs)
        options = base_model.of(model, data.robot)
        if only is not None or fix is not None:
            if model != "complete":
                raise UsageError("--only and --fix are of the complete model")
            part = of_families(options.complete, only, fix)
            options = replace(options, complete=part)
        with working(f"identifying from {len(data)} configurations"):
            calibration = run(data, options, chosen)
    if frame is not None and refit is None:
        say_if_frame_is_not_free(calibration, shown(measurements[0]))
    calibration = replace(calibration, provenance=provenance(None, **inputs))
    found = mastering(calibration.base)
    extra["joint_offsets"] = [offset.as_json() for offset in found]
    if target is not None:  # first: the reader of stdout may have gone
        write_output(target, to_bytes(calibration), force)
    groups = noise_groups(calibration, data)
    extra["noise_groups"] = [group.as_json() for group in groups]
    report_calibration(calibration, data, "calibtool/identification", json, extra)
    if not json:
        show_noise(groups)
    posterior = calibration.base.posterior
    alone = posterior is not None and "placements" not in posterior.parameters.orders
    for offset in found if offsets or alone else []:
        message(offset.text)
    if not json and calibration.base.posterior is not None:
        show_parameters(calibration, parameters)
    if target is not None:
        wrote(target, fit_words(calibration))


def loaded(paths: list[str], inputs: dict[str, bytes]) -> "Measurements":
    """The measurements of one or several files; their bytes are noted in `inputs`."""
    from calibtool.measurement.merging import merged

    parts = []
    for k, path in enumerate(paths, start=1):
        name = "measurements" if k == 1 else f"measurements_{k}"
        data, inputs[name] = load_measurements(path)
        parts.append((shown(path), data))
    return merged(parts)


def show_noise(groups: "list[NoiseGroup]") -> None:
    """A warning for targets and axes that are clearly noisier than the others, and the table."""
    noisier = [group for group in groups if group.noisier]
    for group in noisier:
        message(f"warning: {group}")
    if noisier:
        cells = [
            [group.called, three_digits(group.rms * 1e3), group.unit, f"{group.ratio:.2f}"]
            for group in groups
        ]
        header = ["residuals of", "rms", "unit", "noise over the others'"]
        print_tables("Residuals by target and axis", [(header, cells)])


def show_parameters(calibration: "Calibration", every: bool) -> None:
    """Table of the clearest errors, or of every parameter, and the largest correlations."""
    from calibtool.identification.report import parameter_rows, strongest_correlations

    rows = parameter_rows(calibration.base)
    ordered = sorted(rows, key=lambda row: (row.at_prior, -abs(row.value) / row.std))
    shown = rows if every else ordered[:_CLEAREST]
    header = ["parameter", "value", "±", "tolerance", "unit", "determined", ""]
    table = [
        [
            row.name,
            *map(three_digits, (row.value, row.std, row.tolerance)),
            row.unit,
            f"{100 * row.determined:.1f} %",
            "at tolerance" if row.at_prior else "",
        ]
        for row in shown
    ]
    clearest = "" if every else "the clearest "
    more = "" if every else " (all: --parameters or --json; symbols: docs/glossary.md)"
    print_tables(f"{clearest}{len(shown)} of {len(rows)} parameters{more}", [(header, table)])
    posterior = calibration.base.posterior
    assert posterior is not None
    pairs = ", ".join(
        f"{a} and {b} {value:+.2f}" for a, b, value in strongest_correlations(posterior, 3)
    )
    message(f"strongest correlations: {pairs}")


def report_calibration(
    calibration: "Calibration",
    data: "Measurements",
    schema: str,
    json: bool,
    extra: dict[str, object] | None = None,
) -> None:
    """Report the result: JSON on stdout, or a few lines on stderr without the findings of the
    import, which were reported when the measurements were read.
    """
    from calibtool.calibration.fit_summary import fit_lines
    from calibtool.identification.sufficiency import few_rows
    from calibtool.summary import calibration_summary

    few = few_rows(calibration.base, calibration.configurations)
    if few is not None:
        message(f"warning: {few}")
    if json:
        print_json({**calibration_summary(calibration), **(extra or {}), "schema": schema})
        return
    for line in fit_lines(calibration):
        if line.removeprefix("warning: ") not in data.findings:
            message(line)


def fit_words(calibration: "Calibration") -> str:
    """Description of a calibration, for the line after it was written."""
    from calibtool.equivalent.gaussian_process import GaussianProcess

    learned = ""
    if calibration.networks:
        learned = f" with {count_of(len(calibration.networks), 'network')}"
        if isinstance(calibration.network, GaussianProcess):
            learned = " with a Gaussian process"
    return (
        f"calibration of {calibration.robot.name}, {calibration.base.model} model{learned}, from "
        f"{count_of(calibration.configurations, 'configuration')}"
    )
