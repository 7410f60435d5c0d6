"""The main job from end to end, with the settings of Song, Tian and Ma, on the FANUC M-1000iA."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify, train
from calibtool.compensation.stream import StreamOptions, compensate_text
from calibtool.equivalent.training import TrainingOptions
from calibtool.evaluation.compare import evaluate
from calibtool.evaluation.metrics import error_rows
from calibtool.evaluation.plots import Subject, draw
from calibtool.evaluation.report import html_report
from calibtool.export.as_json import calibration_as_json
from calibtool.export.c_code import calibration_as_c
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.storage import to_bytes
from calibtool.tables import format_table

ROBOT = "fanuc-m1000ia"
FRESH_CONFIGURATIONS = 1000
REPORT = "report.html"

Write = Callable[[str, bytes | str], None]


def run_demo(
    seed: int, provenance: dict[str, str], write: Write, report: Callable[[str], None]
) -> dict[str, object]:
    """Simulate, identify, train, evaluate and report on fresh configurations, compensate a line,
    export; the evaluation.

    `write` receives every file by name, `report` a line before every step.
    """
    robot = load_robot(ROBOT)

    report(f"simulate   {ROBOT}: 100 configurations, 0.5 mm / 0.5 mrad errors, 0.05 mm noise")
    measurements = simulate(robot, Simulation(seed=seed))
    measurements = replace(measurements, provenance=provenance)
    fresh = simulate(
        robot,
        Simulation(
            seed=seed,
            configurations=FRESH_CONFIGURATIONS,
            same_robot=measurements.truth,
        ),
    )
    fresh = replace(fresh, provenance=provenance)
    write("measurements.h5", to_bytes(measurements))
    write("fresh.h5", to_bytes(fresh))

    report("identify   local-poe: one constant error of each link")
    report("train      paper: a network alone (Song, Tian and Ma)")
    report("           complete: every error, and a network only where it helps")
    options = TrainingOptions(seed=seed)
    calibrations: list[tuple[str, Calibration]] = [
        ("paper", train(measurements, "nominal", options)),
        ("local-poe", identify(measurements, "local-poe")),
        ("complete", train(measurements, options=options)),
    ]
    calibrations = [
        (name, replace(calibration, provenance=provenance)) for name, calibration in calibrations
    ]
    for name, calibration in calibrations:
        write(f"{name}.h5", to_bytes(calibration))
    best = calibrations[-1][1]

    report(f"evaluate   on {FRESH_CONFIGURATIONS} configurations that no fit has seen")
    evaluation = evaluate(calibrations, fresh)
    write("evaluation.csv", format_table(*error_rows(evaluation.methods)))
    paper, every = (
        Subject(calibrations[:1]),
        Subject(calibrations, measurements, evaluate(calibrations, measurements)),
    )
    for image in ("png", "svg"):
        write(f"training.{image}", draw("training", paper, image))
        write(f"errors.{image}", draw("errors", every, image))
    write(REPORT, html_report(Subject(calibrations, fresh, evaluation), provenance))

    report("compensate a straight line of 100 poses")
    line = _straight_line(robot)
    write("line.csv", line)
    corrected, _ = compensate_text(best, line, "line.csv", StreamOptions(joint_values="controller"))
    write("corrected.csv", corrected)

    report("export     JSON and C")
    header, source = calibration_as_c(best, "compensator", joint_values="controller")
    write("compensator.json", calibration_as_json(best, "controller"))
    write("compensator.h", header)
    write("compensator.c", source)
    return evaluation.as_json()


def _straight_line(robot: Robot) -> str:
    """A CSV of 100 poses along y through the middle of the workspace, of one orientation."""
    workspace = robot.workspace()
    T = robot.mechanism.forward(workspace.home[None])[0]
    quaternion = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
    rows = []
    for k, shift in enumerate(np.linspace(-0.4, 0.4, 100)):
        position = (T[:3, 3] + [0.0, shift, 0.0]) * 1e3
        rows.append(
            [str(k + 1), *(f"{v:.6f}" for v in position), *(f"{v:.12g}" for v in quaternion)]
        )
    return format_table(["point", "x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"], rows)
