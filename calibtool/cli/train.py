"""calibtool train: a learned model on a base model."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, cast

import typer

from calibtool.cli.base_model_options import BaseModelOptions
from calibtool.cli.files import HDF5, check_output, message, one_stdin, shown, write_output, wrote
from calibtool.cli.identify import fit_words, report_calibration
from calibtool.cli.input_files import (
    frame_name,
    load_calibration,
    load_measurements,
    say_if_frame_is_not_free,
)
from calibtool.cli.options import (
    Force,
    FrameOption,
    Json,
    MeasurementsFile,
    ReportingOutput,
    Seed,
    choice,
    report_target,
)
from calibtool.cli.progress import counted, working
from calibtool.cli.provenance import provenance
from calibtool.errors import UsageError


def train(
    *,
    measurements: MeasurementsFile,
    output: ReportingOutput = None,
    base: Annotated[
        str,
        typer.Option(
            metavar="nominal|local-poe|complete|FILE.h5",
            help="What the network builds on; 'nominal' is the method of Song, Tian and Ma.",
        ),
    ] = "complete",
    loss: Annotated[
        str,
        typer.Option(
            metavar="task|joint", help="What training lowers: errors of the tool, or of the joints."
        ),
    ] = "task",
    optimizer: Annotated[
        str,
        typer.Option(metavar="lm|gd", help="Levenberg-Marquardt, or gradient descent."),
    ] = "lm",
    regularisation: Annotated[
        str | None,
        typer.Option(
            metavar="bayes|early-stopping",
            help="Default: bayes; early-stopping on 'nominal'.",
        ),
    ] = None,
    regressor: Annotated[
        str | None,
        typer.Option(
            metavar="tanh|gaussian-process",
            help="Learned model: a small neural network, or a Gaussian process. Default: the one "
            "that predicts held-out rows better (bayes), or the network.",
        ),
    ] = None,
    hidden: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Hidden nodes (default: the square root of 6n), or points of a Gaussian process.",
        ),
    ] = None,
    validation: Annotated[
        float, typer.Option(min=0, max=0.9, help="Part of the rows for early stopping.")
    ] = 0.5,
    restarts: Annotated[
        int, typer.Option(min=1, help="Networks trained: averaged (bayes), or the best kept.")
    ] = 5,
    folds: Annotated[int, typer.Option(min=2, help="Parts of the cross-validation (bayes).")] = 5,
    learning_curve: Annotated[
        bool,
        typer.Option(
            "--learning-curve", help="Also report the error against the number of configurations."
        ),
    ] = False,
    base_model: BaseModelOptions,
    frame: FrameOption = None,
    seed: Seed = 0,
    json: Json = False,
    force: Force = False,
) -> None:
    """Find the errors, and learn what they do not explain.

    First the base model is identified (see `identify`). Then the errors of the joint motions that
    it does not describe are learned. By default the learned model is kept only if cross-validation
    shows that it helps; the base is identified again in every fold.

    Example: calibtool train measurements.h5 --base nominal --loss task -o paper.h5
    """
    target = report_target(output, json)
    if target is not None:
        check_output(target, force, binary=True, suffixes=HDF5)
    one_stdin(measurements, base)
    choice(loss, ("task", "joint"), "--loss")
    choice(optimizer, ("lm", "gd"), "--optimizer")
    import numpy as np

    from calibtool.calibration import BASE_MODELS, Calibration
    from calibtool.calibration import train as run
    from calibtool.calibration.fit import BaseOptions, on_base
    from calibtool.calibration.learning_curve import learning_curve as curve_of
    from calibtool.equivalent.optimisers import Optimiser
    from calibtool.equivalent.training import LossName, Regularisation, TrainingOptions
    from calibtool.storage import to_bytes
    from calibtool.summary import learning_curve_lines, learning_curve_summary

    chosen = None if frame is None else frame_name(frame)
    inputs: dict[str, bytes] = {}
    start: Calibration | BaseOptions
    if base not in BASE_MODELS:
        if base != "-" and not Path(base).exists() and "." not in base and "/" not in base:
            choice(base, BASE_MODELS, "--base")
        start, inputs["base"] = load_calibration(base)
        data, inputs["measurements"] = load_measurements(measurements)
    else:
        data, inputs["measurements"] = load_measurements(measurements)
        start = base_model.of(base, data.robot)
    if regularisation is not None:
        choice(regularisation, ("bayes", "early-stopping"), "--regularisation")
    if regularisation == "bayes" and optimizer == "gd":
        raise UsageError(
            "--optimizer gd takes --regularisation early-stopping; bayes needs second derivatives"
        )
    options = TrainingOptions(
        loss=cast(LossName, loss),
        optimiser=cast(Optimiser, optimizer),
        regularisation=cast("Regularisation | None", regularisation),
        regressor=regressor,
        hidden=hidden,
        validation=validation,
        restarts=restarts,
        folds=folds,
        seed=seed,
    )
    with working(f"training on {len(data)} configurations"):
        calibration = run(data, start, options, counted, chosen)
    if frame is not None:
        say_if_frame_is_not_free(calibration, shown(measurements))
    calibration = replace(calibration, provenance=provenance(seed, **inputs))
    extra: dict[str, object] = {}
    if learning_curve:
        assert calibration.training is not None
        learned = replace(options, regressor=calibration.training.regressor)
        curve = curve_of(
            data,
            lambda rows, stream: on_base(rows, start, learned, stream),
            folds,
            np.random.default_rng(seed),
            counted,
        )
        extra["learning_curve"] = learning_curve_summary(curve)
    if target is not None:  # first: the reader of stdout may have gone
        write_output(target, to_bytes(calibration), force)
    report_calibration(calibration, data, "calibtool/training", json, extra)
    if learning_curve and not json:
        for line in learning_curve_lines(curve, len(data)):
            message(line)
    if target is not None:
        wrote(target, fit_words(calibration))
