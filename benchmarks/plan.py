"""Selected configurations against random ones over seeds, and the time of a selection.

Run: python benchmarks/plan.py [--seeds 10] [--first-seed 0] [--only accuracy|limits|times]
[--workspace full|machining]. fanuc-m1000ia, complete model, 0.05 mm noise, 1,000 fresh
configurations of the same workspace. Reductions are of the part that the joints can correct. Random
sets of one seed measure the same actual robot as the selected ones.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from dataclasses import replace

import numpy as np

from calibtool.calibration import identify
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.tolerances import Tolerances
from calibtool.evaluation.compare import evaluate
from calibtool.identification.parameters import Parameters
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.constraints import Constraints
from calibtool.planning.information import Knowledge
from calibtool.planning.plan import make_plan
from calibtool.planning.selection import select
from calibtool.robot.catalogue import load_robot

NOISE = 0.05e-3
RANDOM = (15, 20, 25, 30)


def accuracy(seeds: range, workspace: str) -> None:
    robot = load_robot("fanuc-m1000ia")
    space = robot.workspace(workspace)
    knowledge = Knowledge.of_tolerances(robot, NOISE)
    print(f"\n{workspace}: reduction in %, median of {len(seeds)} seeds (worst)\n")
    print(
        "| errors | set | position max | position mean | orientation max | mean error mm |\n"
        "|---|---|---|---|---|---|"
    )
    for kinds in (("geometric",), ("geometric", "gear", "gravity", "thermal")):
        results: dict[str, list[list[float]]] = {}
        for seed in seeds:
            scales = ErrorScales(kinds)
            first = simulate(
                robot,
                Simulation(seed=seed, configurations=max(RANDOM), workspace=space, scales=scales),
            )
            fresh = simulate(
                robot,
                Simulation(
                    seed=seed + 1000, configurations=1000, workspace=space, same_robot=first.truth
                ),
            )
            sets = {f"{count} random": first.rows(np.arange(count)) for count in RANDOM}
            for criterion in ("d", "i"):
                made = make_plan(
                    knowledge,
                    space,
                    15,
                    constraints=Constraints(),
                    criterion=criterion,
                    candidates=2000,
                    rng=np.random.default_rng(seed),
                )
                sets[f"15 selected ({criterion})"] = simulate(
                    robot, Simulation(seed=seed, at=made.q, same_robot=first.truth)
                )
            evaluation = evaluate(
                [(name, identify(data, "complete")) for name, data in sets.items()], fresh
            )
            entries = evaluation.as_json()["methods"]
            assert isinstance(entries, list)
            for entry, result in zip(entries[1:], evaluation.results[1:], strict=True):
                found = entry["reduction_percent"]
                cells = [found[s] for s in ("position_max", "position_mean", "orientation_max")]
                results.setdefault(entry["name"], []).append(
                    [*cells, -result.correctable.position_size.mean() * 1e3]
                )
        for name, rows in results.items():
            median, worst = np.median(rows, axis=0), np.min(rows, axis=0)
            cells = " | ".join(
                f"{m:.2f} ({w:.2f})" for m, w in zip(median[:3], worst[:3], strict=True)
            )
            print(
                f"| {'+'.join(kinds)} | {name} | {cells} | {-median[3]:.3f} ({-worst[3]:.3f}) |",
                flush=True,
            )


def limits(seeds: range) -> None:
    """What 15 configurations can tell of the geometric errors: predicted deviations; some designs
    know of no others.
    """
    robot = load_robot("fanuc-m1000ia")
    space = robot.workspace("full")
    whole = Knowledge.of_tolerances(robot, NOISE)
    parameters = Parameters.of(robot, whole.state.setup, twists=1)
    prior_std = parameters.prior_std(Tolerances.of_robot(robot))
    geometry = replace(
        whole, parameters=parameters, prior_std=prior_std, covariance=np.eye(parameters.count)
    )
    judged = sample_configurations(robot, space, 500, np.random.default_rng(99))
    results: dict[str, list[float]] = {}
    for seed in seeds:
        q = sample_configurations(robot, space, max(RANDOM), np.random.default_rng(seed))
        sets = {f"{count} random": q[:count] for count in RANDOM}
        for knowledge, name in ((whole, "everything"), (geometry, "geometric errors alone")):
            for criterion in ("d", "i"):
                rng = np.random.default_rng(seed)
                made = make_plan(
                    knowledge,
                    space,
                    15,
                    constraints=Constraints(),
                    criterion=criterion,
                    candidates=2000,
                    rng=rng,
                )
                sets[f"15 selected for {name} ({criterion})"] = made.q
        for name, chosen in sets.items():
            deviation = geometry.after(geometry.rows(chosen)).target_deviation(judged)
            results.setdefault(name, []).append(deviation.mean() * 1e3)
    print(
        "\nPredicted deviation of the targets from the geometric errors, whole range, "
        f"{len(seeds)} seeds\n"
    )
    print("| set | mean mm |\n|---|---|")
    for name, values in results.items():
        print(f"| {name} | {np.median(values):.4f} ({np.max(values):.4f}) |", flush=True)


def times() -> None:
    robot = load_robot("fanuc-m1000ia")
    print("\n| 30 of 2,000 | rows | select d | select i |\n|---|---|---|---|")
    knowledge = Knowledge.of_tolerances(robot, NOISE)
    for workspace in ("full", "machining"):
        q = sample_configurations(robot, robot.workspace(workspace), 2000, np.random.default_rng(0))
        start = time.perf_counter()
        rows = knowledge.rows(q)
        taken = [time.perf_counter() - start]
        for criterion in ("d", "i"):
            start = time.perf_counter()
            select(rows, knowledge.covariance, 30, criterion)
            taken.append(time.perf_counter() - start)
        print(f"| {workspace} | " + " | ".join(f"{t:.2f} s" for t in taken) + " |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--only", choices=["accuracy", "limits", "times"])
    parser.add_argument("--workspace", choices=["full", "machining"])
    arguments = parser.parse_args()
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    if arguments.only in (None, "accuracy"):
        for workspace in [arguments.workspace] if arguments.workspace else ["full", "machining"]:
            accuracy(seeds, workspace)
    if arguments.only in (None, "limits"):
        limits(seeds)
    if arguments.only in (None, "times"):
        times()


if __name__ == "__main__":
    main()
