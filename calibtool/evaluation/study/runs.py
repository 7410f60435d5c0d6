"""One run of a study: draw a robot, measure, calibrate by every method, evaluate."""

import threading
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from calibtool import __version__
from calibtool.calibration import Calibration, identify, train
from calibtool.equivalent.training import TrainingOptions
from calibtool.errors import CalibtoolError
from calibtool.evaluation.compare import Evaluation, evaluate
from calibtool.evaluation.metrics import STATISTICS
from calibtool.evaluation.study.definition import NOMINAL, RobotText, Study
from calibtool.evaluation.study.study_table import OK, REDUCTIONS, Cell, Row, failed, rounded
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.robot import Robot
from calibtool.robot.source import parse_source

# A worker of a cluster may have several threads, and a robot's kinematics keep their work
# space in the robot.
_ONE_AT_A_TIME = threading.Lock()

_CALIBRATE: dict[str, Callable[[Measurements, int], Calibration]] = {
    "local-poe": lambda m, seed: identify(m, "local-poe"),
    "complete": lambda m, seed: identify(m, "complete"),
    "network": lambda m, seed: train(m, "nominal", TrainingOptions(seed=seed)),
    "network-local-poe": lambda m, seed: train(
        m, "local-poe", TrainingOptions(regularisation="early-stopping", seed=seed)
    ),
    "default": lambda m, seed: train(m, options=TrainingOptions(seed=seed)),
}


def perform(study: Study, index: int) -> list[Row]:
    """The rows of run `index`, one per method; a method that fails leaves a row with the
    reason as its status.

    The rows depend on the study and the index alone. CalibtoolError when the study comes from
    another calibtool.
    """
    study.check_version(__version__)
    with _ONE_AT_A_TIME:
        return _perform(study, index)


def lost(study: Study, index: int, reason: str) -> list[Row]:
    """The rows of a run that could not be finished."""
    return [failed(_head(study, index, method), reason) for method in study.definition.methods]


def _perform(study: Study, index: int) -> list[Row]:
    run = study.run(index)
    problems: dict[str, str] = {}
    calibrations: list[tuple[str, Calibration]] = []
    try:
        measurements, judged = _measure(study, index)
    except Exception as error:
        return lost(study, index, _reason(error))
    for method in study.definition.methods:
        if method == NOMINAL:
            continue
        try:
            calibrations.append((method, _CALIBRATE[method](measurements, run.seed)))
        except Exception as error:  # a method that fails must not stop the others
            problems[method] = _reason(error)
    try:
        evaluation = evaluate(calibrations, judged)
    except Exception as error:
        return lost(study, index, _reason(error))
    networks = {name: len(calibration.networks) for name, calibration in calibrations}
    results = _results(evaluation, networks)
    return [
        failed(_head(study, index, method), problems[method])
        if method in problems
        else (*_head(study, index, method), OK, *results[method])
        for method in study.definition.methods
    ]


def _measure(study: Study, index: int) -> tuple[Measurements, Measurements]:
    """The measurements to calibrate with, and those to judge on."""
    run, definition = study.run(index), study.definition
    text = study.robots[run.robot]
    robot = _robot(text)
    common: dict[str, Any] = {"seed": run.seed, "workspace": text.workspace}
    measurements = simulate(
        robot,
        Simulation(
            configurations=run.configurations,
            scales=definition.scales(run.errors, run.error_scale),
            noise=run.noise_mm * 1e-3,
            **common,
        ),
    )
    if not definition.fresh:
        return measurements, measurements
    again = Simulation(
        configurations=definition.fresh, same_robot=measurements.truth, noise=0.0, **common
    )
    return measurements, simulate(robot, again)


def _head(study: Study, index: int, method: str) -> tuple[Cell, ...]:
    """Cells of a row up to the method."""
    run = study.run(index)
    text = study.robots[run.robot]
    return (
        study.key,
        _robot(text).name,
        text.workspace,
        run.errors.replace(",", "+"),
        run.error_scale,
        run.noise_mm,
        run.configurations,
        study.definition.fresh,
        run.number,
        run.seed,
        method,
    )


def _results(evaluation: Evaluation, networks: dict[str, int]) -> dict[str, tuple[Cell, ...]]:
    """Per method: networks used, doubtful corrections, statistics, reductions."""
    entries = evaluation.as_json()["methods"]
    assert isinstance(entries, list)
    return {
        entry["name"]: (
            networks.get(entry["name"], 0),
            result.marked,
            *(_cell(entry["position_mm"], s) for s in STATISTICS),
            *(_cell(entry["orientation_mrad"], s) for s in STATISTICS),
            *(
                _cell(entry["reduction_percent"], f"{p}_{s}")
                for p in ("position", "orientation")
                for s in REDUCTIONS
            ),
        )
        for entry, result in zip(entries, evaluation.results, strict=True)
    }


def _cell(values: dict[str, float | None] | None, name: str) -> float | None:
    value = None if values is None else values[name]
    return None if value is None else rounded(value)


def _reason(error: Exception) -> str:
    """Why there is no result, on one line."""
    text = " ".join(str(error).split())
    return (
        text if isinstance(error, CalibtoolError) else f"unexpected {type(error).__name__}: {text}"
    )


@lru_cache(maxsize=64)
def _robot(text: RobotText) -> Robot:
    return Robot.from_source(parse_source(text.toml, text.urdf, text.place))
