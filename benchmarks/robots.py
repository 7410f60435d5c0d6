"""Every built-in robot with every kind of error: how much of it a calibration from 60
configurations takes away.

Run: python benchmarks/robots.py [--seeds 5] [--configurations 60] [--robots ur5,panda].
Geometric, gear, gravity, backlash and thermal errors of the default sizes, 0.05 mm noise, the
complete model with a Bayesian network (the default of `train`), 300 fresh configurations. Mean
position error of the part that the joints can correct. Backlash takes the direction of each joint's
last motion, which rows in the order of motion tell: the column `backlash` is the mean position
error that it makes alone in percent of the nominal robot's, `without backlash` the reduction on the
same robot when it has none. Median (worst) of the seeds.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from dataclasses import dataclass, replace

import numpy as np

from calibtool.calibration import train
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.evaluation.compare import evaluate
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot, robot_names
from calibtool.robot.robot import Robot
from calibtool.robot.workspace import Workspace

BAYES = TrainingOptions(regularisation="bayes")
WITHOUT_BACKLASH = tuple(kind for kind in ERROR_KINDS if kind != "backlash")


@dataclass(frozen=True)
class Outcome:
    """One seed: mean position errors in mm, reductions in percent."""

    before: float
    after: float
    backlash: float
    uncorrectable: float
    reduction: float
    without_backlash: float


def run(robot: Robot, workspace: Workspace, configurations: int, seed: int) -> Outcome:
    """Simulate, train and evaluate on fresh configurations; once more without backlash."""
    before, after, backlash, uncorrectable = trial(
        robot, workspace, configurations, seed, ERROR_KINDS
    )
    plain_before, plain_after, _, _ = trial(
        robot, workspace, configurations, seed, WITHOUT_BACKLASH
    )
    return Outcome(
        before,
        after,
        backlash,
        uncorrectable,
        100 * (1 - after / before),
        100 * (1 - plain_after / plain_before),
    )


def trial(
    robot: Robot,
    workspace: Workspace,
    configurations: int,
    seed: int,
    kinds: tuple[str, ...],
) -> tuple[float, float, float, float]:
    """Mean position error before and after, that of backlash alone, and what no joint
    can correct, mm.
    """
    basis = Simulation(
        seed=seed, configurations=configurations, workspace=workspace, scales=ErrorScales(kinds)
    )
    measurements = simulate(robot, basis)
    assert measurements.truth is not None
    fresh = simulate(robot, replace(basis, configurations=300, same_robot=measurements.truth))
    evaluation = evaluate([("complete", train(measurements, "complete", BAYES))], fresh)
    nominal, complete = (
        1e3 * result.correctable.position_size.mean() for result in evaluation.results
    )
    actual = measurements.truth.actual
    still = replace(actual, errors=actual.errors.without("backlash"))
    moved = actual.forward(fresh.q)[:, :3, 3] - still.forward(fresh.q)[:, :3, 3]
    beyond = evaluation.uncorrectable
    left = 0.0 if beyond is None else 1e3 * beyond.position_size.sum() / len(fresh)
    return nominal, complete, 1e3 * float(np.linalg.norm(moved, axis=-1).mean()), left


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--configurations", type=int, default=60)
    parser.add_argument("--robots", default=",".join(robot_names()))
    options = parser.parse_args()
    print(
        "| robot | workspace | nominal mm | left mm | uncorrectable mm | backlash % | reduction % "
        "| without backlash % |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name in options.robots.split(","):
        robot = load_robot(name)
        for workspace_name in dict.fromkeys((robot.workspace_names[0], "full")):
            workspace = robot.workspace(workspace_name)
            seeds = [
                run(robot, workspace, options.configurations, seed) for seed in range(options.seeds)
            ]

            def median(field: str, seeds: list[Outcome] = seeds) -> float:
                return float(np.median([getattr(outcome, field) for outcome in seeds]))

            def both(field: str, seeds: list[Outcome] = seeds) -> str:
                return (
                    f"{median(field):.1f} ({min(getattr(outcome, field) for outcome in seeds):.1f})"
                )

            sizes = " | ".join(
                f"{median(field):.3f}" for field in ("before", "after", "uncorrectable")
            )
            share = [100 * outcome.backlash / outcome.before for outcome in seeds]
            cells = [name, workspace_name, sizes, f"{np.median(share):.1f} ({max(share):.1f})"]
            cells += [both("reduction"), both("without_backlash")]
            print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
