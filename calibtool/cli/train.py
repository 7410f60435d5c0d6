"""calibtool train: a network on a base model."""

from pathlib import Path
from typing import Annotated

import typer

from calibtool.cli.files import check_output, one_stdin, write_output
from calibtool.cli.identify import report_calibration, report_target
from calibtool.cli.load import load_calibration, load_measurements
from calibtool.cli.options import Force, Json, MeasurementsFile, Seed, choice
from calibtool.cli.provenance import provenance


def train(
    measurements: MeasurementsFile,
    output: Annotated[
        str | None,
        typer.Option("-o", "--output", metavar="FILE", help="Output file; '-' is stdout (default without --json)."),
    ] = None,
    base: Annotated[
        str,
        typer.Option(metavar="nominal|local-poe|FILE.h5", help="What the network builds on; 'nominal' is the paper."),
    ] = "local-poe",
    loss: Annotated[str, typer.Option(metavar="task|joint", help="Loss of Eq. 20 or of Eq. 21.")] = "task",
    optimizer: Annotated[
        str, typer.Option(metavar="lm|gd", help="Levenberg-Marquardt, or gradient descent (Eq. 22).")
    ] = "lm",
    hidden: Annotated[int | None, typer.Option(min=1, help="Hidden nodes (default: the square root of 6n).")] = None,
    validation: Annotated[
        float, typer.Option(min=0, max=0.9, help="Part of the configurations that stops the training.")
    ] = 0.5,
    restarts: Annotated[int, typer.Option(min=1, help="Networks tried; the best on the validation part is kept.")] = 5,
    seed: Seed = 0,
    json: Json = False,
    force: Force = False,
) -> None:
    """Train a network on top of a base model.

    The network learns the joint motion errors of the equivalent robot that the base model leaves over.

    Example: calibtool train measurements.h5 --base nominal --loss task -o paper.h5
    """
    target = report_target(output, json)
    if target is not None:
        check_output(target, force, binary=True)
    one_stdin(measurements, base)
    choice(loss, ("task", "joint"), "--loss")
    choice(optimizer, ("lm", "gd"), "--optimizer")
    from dataclasses import replace
    from typing import cast

    from calibtool.calibration import BASE_MODELS, Calibration
    from calibtool.calibration import train as run
    from calibtool.equivalent.optimisers import Optimiser
    from calibtool.equivalent.training import LossName, TrainingOptions
    from calibtool.storage import to_bytes

    inputs: dict[str, bytes] = {}
    start: Calibration | str = base
    if base not in BASE_MODELS:
        if base != "-" and not Path(base).exists() and "." not in base and "/" not in base:
            choice(base, BASE_MODELS, "--base")
        start, inputs["base"] = load_calibration(base)
    data, inputs["measurements"] = load_measurements(measurements)
    options = TrainingOptions(
        loss=cast(LossName, loss),
        optimiser=cast(Optimiser, optimizer),
        hidden=hidden,
        validation=validation,
        restarts=restarts,
        seed=seed,
    )
    calibration = replace(run(data, start, options), provenance=provenance(seed, **inputs))
    report_calibration(calibration, "calibtool/training", json)
    if target is not None:
        write_output(target, to_bytes(calibration), force)
