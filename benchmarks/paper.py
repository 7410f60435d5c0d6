"""The paper's experiment over seeds: 100 configurations, half for training, and 1,000 fresh ones
of the same robot.

Run: python benchmarks/paper.py [--seeds 20]. Prints a table in Markdown: median and worst
reduction over the seeds.
"""

import argparse

import numpy as np

from calibtool.calibration import Calibration, identify, train
from calibtool.equivalent.training import TrainingOptions, split_rows
from calibtool.evaluation.compare import evaluate
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot

STATISTICS = (
    "position_max",
    "orientation_max",
    "position_mean",
    "orientation_mean",
    "position_std",
    "orientation_std",
)


def methods(measurements: Measurements, seed: int) -> list[tuple[str, Calibration]]:
    """The calibrations compared; the base model alone sees the 50 training configurations only,
    like the networks.
    """
    training_rows, _ = split_rows(len(measurements), 0.5, np.random.default_rng(seed))
    return [
        (
            "network on nominal, task loss",
            train(measurements, "nominal", TrainingOptions(loss="task", seed=seed)),
        ),
        (
            "network on nominal, joint loss",
            train(measurements, "nominal", TrainingOptions(loss="joint", seed=seed)),
        ),
        ("local POE, 50 configurations", identify(measurements.rows(training_rows), "local-poe")),
        ("local POE, 100 configurations", identify(measurements, "local-poe")),
        (
            "network on local POE",
            train(
                measurements,
                "local-poe",
                TrainingOptions(regularisation="early-stopping", seed=seed),
            ),
        ),
        (
            "complete (default)",
            train(measurements, "complete", TrainingOptions(regularisation="bayes", seed=seed)),
        ),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--workspace", default=None)
    seeds = range(parser.parse_args().seeds)
    robot = load_robot("fanuc-m1000ia")
    workspace = robot.workspace(parser.parse_args().workspace)

    results: dict[tuple[str, str], list[list[float]]] = {}
    for seed in seeds:
        measurements = simulate(robot, Simulation(seed=seed, workspace=workspace))
        again = Simulation(
            seed=seed, workspace=workspace, configurations=1000, same_robot=measurements.truth
        )
        fresh = simulate(robot, again)
        calibrations = methods(measurements, seed)
        for name, judged in (("the 100", measurements), ("1,000 fresh", fresh)):
            report = evaluate(calibrations, judged).as_json()["methods"]
            assert isinstance(report, list)
            for entry in report[1:]:
                reduction = entry["reduction_percent"]
                results.setdefault((entry["name"], name), []).append(
                    [reduction[s] for s in STATISTICS]
                )

    print(f"Reduction in %, median over {len(seeds)} seeds (worst seed in brackets)\n")
    print(
        "| method | configurations | " + " | ".join(s.replace("_", " ") for s in STATISTICS) + " |"
    )
    print("|---|---|" + "---|" * len(STATISTICS))
    for (method, judged), rows in results.items():
        median, worst = np.median(rows, axis=0), np.min(rows, axis=0)
        cells = " | ".join(f"{m:.1f} ({w:.1f})" for m, w in zip(median, worst, strict=True))
        print(f"| {method} | {judged} | {cells} |")


if __name__ == "__main__":
    main()
