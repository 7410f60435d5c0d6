"""The complete model over seeds: accuracy on fresh configurations, distance to the
Cramér–Rao bound, times.

Run: python benchmarks/complete.py [--seeds 20] [--first-seed 0] [--only accuracy|times].
fanuc-m1000ia, whole joint range, 0.05 mm noise, 1,000 fresh configurations. Reductions are of the
part that the joints can correct; the last column keeps the poses that the actual arm, shorter than
drawn, cannot reach.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import resource
import statistics
import time

import numpy as np

from calibtool.calibration import Calibration, identify, train
from calibtool.calibration.fit import BaseOptions
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.evaluation.compare import evaluate
from calibtool.identification.complete import CompleteOptions
from calibtool.identification.parameters import Parameters, State
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import observation_matrix, weights
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.singularity import at_point

PHYSICAL = ("geometric", "gear", "gravity", "thermal")
BAYES = TrainingOptions(regularisation="bayes")
GEOMETRY = BaseOptions("complete", CompleteOptions(orders={"harmonics": 0, "gravity": 0}))


def bound(measurements: Measurements, fresh: Measurements) -> float:
    """Mean position error that no unbiased estimator can beat, m: Cramér–Rao at the true
    errors (δζ, δξ, δq).
    """
    assert measurements.truth is not None
    robot, setup = measurements.robot, measurements.truth.setup
    parameters = Parameters.of(robot, setup, twists=1)
    state = State(
        measurements.truth.actual.errors.without("harmonics", "gravity", "backlash"), setup
    )
    context = state.errors.context(measurements.q)
    columns = observation_matrix(setup, context.frames.tool) @ parameters.pose_columns(context)
    A = (columns * weights(measurements)[..., None]).reshape(-1, parameters.count)
    covariance = np.linalg.pinv(A, rcond=1e-10) @ np.linalg.pinv(A, rcond=1e-10).T
    context = state.errors.context(fresh.q)
    C = at_point(parameters.pose_columns(context), context.frames.tool[:, :3, 3])[:, :3]
    factors = np.linalg.cholesky(C @ covariance @ np.swapaxes(C, 1, 2) + 1e-18 * np.eye(3))
    draws = np.random.default_rng(0).normal(size=(200, 3))
    return float(np.linalg.norm(np.einsum("kij,dj->kdi", factors, draws), axis=-1).mean())


def accuracy(seeds: range) -> None:
    robot = load_robot("fanuc-m1000ia")
    print(
        "Reduction in % of the nominal robot's error on 1,000 fresh configurations, median of "
        f"{len(seeds)} seeds (worst)\n"
    )
    print(
        "| errors | configurations | method | position max | orientation max | position mean | "
        "mean / bound | whole max |"
    )
    print("|---|---|---|---|---|---|---|---|")
    worst_ratio = 0.0
    for kinds, count in ((("geometric",), 50), (("geometric",), 20), (PHYSICAL, 50)):
        results: dict[str, list[list[float]]] = {}
        ratios = []
        for seed in seeds:
            measurements = simulate(
                robot,
                Simulation(
                    seed=seed, configurations=count, scales=ErrorScales(kinds), workspace="full"
                ),
            )
            fresh = simulate(
                robot,
                Simulation(
                    seed=seed, configurations=1000, same_robot=measurements.truth, workspace="full"
                ),
            )
            methods: list[tuple[str, Calibration]] = [
                ("geometry alone", identify(measurements, GEOMETRY)),
                ("complete", identify(measurements, "complete")),
                ("train (default)", train(measurements, "complete", BAYES)),
            ]
            evaluation = evaluate(methods, fresh)
            entries = evaluation.as_json()["methods"]
            assert isinstance(entries, list)
            parts = [result.correctable for result in evaluation.results]
            lowest = bound(measurements, fresh) if kinds == ("geometric",) else np.nan
            before = evaluation.methods[0].position_size.max()
            for entry, part, whole in zip(
                entries[1:], parts[1:], evaluation.methods[1:], strict=True
            ):
                reduction = entry["reduction_percent"]
                results.setdefault(entry["name"], []).append(
                    [
                        *(
                            reduction[s]
                            for s in ("position_max", "orientation_max", "position_mean")
                        ),
                        -part.position_size.mean() / lowest,
                        100.0 * (1.0 - whole.position_size.max() / before),
                    ]
                )
            ratios.append(parts[3].position_size.mean() / parts[2].position_size.mean())
        worst_ratio = max(worst_ratio, *ratios)
        for name, rows in results.items():
            median, worst = np.median(rows, axis=0), np.min(rows, axis=0)
            cells = " | ".join(
                f"{m:.1f} ({w:.1f})" for m, w in zip(median[:3], worst[:3], strict=True)
            )
            last = "" if np.isnan(median[3]) else f"{-median[3]:.2f} ({-worst[3]:.2f})"
            print(
                f"| {'+'.join(kinds)} | {count} | {name} | {cells} | {last} | {median[4]:.1f} "
                f"({worst[4]:.1f}) |"
            )
    print(
        "\nDefault against its base, mean position error, worst seed of all: "
        f"{100 * (worst_ratio - 1):+.2f} %"
    )


def times() -> None:
    robot = load_robot("fanuc-m1000ia")
    print(
        "\n| configurations | complete identification | default train | peak memory |\n"
        "|---|---|---|---|"
    )
    for count in (50, 1000, 3000, 10_000):
        measurements = simulate(
            robot, Simulation(configurations=count, scales=ErrorScales(PHYSICAL), workspace="full")
        )
        repeats = 5 if count == 50 else 1
        taken = []
        for function in (
            lambda m=measurements: identify(m, "complete"),
            lambda m=measurements: train(m, "complete", BAYES),
        ):
            runs = []
            for _ in range(repeats):
                start = time.perf_counter()
                function()
                runs.append(time.perf_counter() - start)
            taken.append(statistics.median(runs))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(
            f"| {count} | {taken[0] * 1e3:.0f} ms | {taken[1]:.1f} s | {peak:.0f} MiB |", flush=True
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--only", choices=["accuracy", "times"])
    arguments = parser.parse_args()
    if arguments.only != "times":
        accuracy(range(arguments.first_seed, arguments.first_seed + arguments.seeds))
    if arguments.only != "accuracy":
        times()


if __name__ == "__main__":
    main()
