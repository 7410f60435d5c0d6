"""What the largest orientation error that a network on the nominal robot leaves depends on.

Run: python benchmarks/orientation.py [--seeds 7]. fanuc-m1000ia, the paper's experiment: 100
configurations of the default workspace, errors of 0.5 mm, 0.05 mm of noise. One thing is changed at
a time: the size of the angle errors, the spread of the three targets (their distance from the
middle), the noise, the workspace. Reductions of the largest orientation error in %, of the 100
configurations (as in the paper) and of 1,000 fresh ones; median and worst seed.

`paper`: 6 nodes, early stopping on one half. `ensemble`: 24 nodes, Bayesian regularisation, all 100
rows, the mean of five networks. Each with the task loss (Eq. 20) and the joint loss (Eq. 21).
"""

import argparse
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibtool.calibration import train
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.evaluation.compare import evaluate
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

ROBOT = "fanuc-m1000ia"
OPTIONS = {
    "paper, task": TrainingOptions(regularisation="early-stopping", loss="task"),
    "paper, joint": TrainingOptions(regularisation="early-stopping", loss="joint"),
    "ensemble, task": TrainingOptions(regularisation="bayes", hidden=24, loss="task"),
    "ensemble, joint": TrainingOptions(regularisation="bayes", hidden=24, loss="joint"),
}


@dataclass(frozen=True)
class Case:
    """One variant of the experiment: angle errors in mrad, target spread in m, noise in mm."""

    angle_mrad: float = 0.5
    spread_m: float = 0.29
    noise_mm: float = 0.05
    workspace: str | None = None


CASES = (
    *(Case(angle_mrad=angle) for angle in (0.5, 1.0, 2.0, 5.0)),
    *(Case(spread_m=spread) for spread in (0.1, 1.0)),
    *(Case(noise_mm=noise) for noise in (0.0, 0.01)),
    Case(workspace="full"),
)


def robot_with(spread: float) -> Robot:
    """The robot with its three targets on a circle of that radius in m."""
    turns = np.deg2rad([0.0, 120.0, 240.0])
    points = [[1e3 * spread * np.cos(t), 1e3 * spread * np.sin(t), 100.0] for t in turns]
    source, line = load_robot(ROBOT).source, f"points_mm = {np.round(points, 3).tolist()}"
    text = re.sub(r"points_mm = .*", line, source.toml_text)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "robot.toml")
        path.write_text(text, encoding="utf-8")
        Path(folder, "robot.urdf").write_text(source.urdf_text, encoding="utf-8")
        return load_robot(str(path))


def reductions(case: Case, seed: int) -> list[float]:
    """Reduction of the largest orientation error in %, per option: of the 100, of 1,000 fresh."""
    robot = robot_with(case.spread_m)
    scales = ErrorScales(angle=case.angle_mrad * 1e-3)
    how = {"seed": seed, "noise": case.noise_mm * 1e-3, "workspace": case.workspace}
    measurements = simulate(robot, Simulation(scales=scales, **how))
    again = Simulation(configurations=1000, same_robot=measurements.truth, **how)
    fresh = simulate(robot, again)
    found = []
    for options in OPTIONS.values():
        calibration = train(measurements, "nominal", options)
        for judged in (measurements, fresh):
            nominal, trained = evaluate([("network", calibration)], judged).results
            found.append(100 * (1 - trained.orientation.max / nominal.orientation.max))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=7)
    seeds = range(parser.parse_args().seeds)
    columns = [f"{name}, {rows}" for name in OPTIONS for rows in ("100", "fresh")]
    print("| angle mrad | spread m | noise mm | workspace | " + " | ".join(columns) + " |")
    print("|---|---|---|---|" + "---|" * len(columns))
    for case in CASES:
        rows = np.array([reductions(case, seed) for seed in seeds])
        cells = [
            f"{m:.1f} ({w:.1f})"
            for m, w in zip(np.median(rows, axis=0), rows.min(axis=0), strict=True)
        ]
        print(
            f"| {case.angle_mrad:g} | {case.spread_m:g} | {case.noise_mm:g} | "
            f"{case.workspace or 'default'} | " + " | ".join(cells) + " |",
            flush=True,
        )


if __name__ == "__main__":
    main()
