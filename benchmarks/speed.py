"""Medians of the times that matter, on this machine. Run: python benchmarks/speed.py"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from calibtool.calibration import train
from calibtool.compensation.solve import compensate_joints
from calibtool.equivalent.training import TrainingOptions
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot


def seconds(function: Callable[[], object], repeats: int = 11) -> float:
    """Median of `repeats` runs, after one to warm up."""
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def main() -> None:
    robot = load_robot("fanuc-m1000ia")
    workspace = robot.workspace()
    q = sample_configurations(robot, workspace, 10_000, np.random.default_rng(0))
    measurements = simulate(robot, Simulation(workspace=workspace))

    # One restart: the difference between eleven restarts and one, over ten.
    def training(restarts: int) -> float:
        return seconds(lambda: train(measurements, "nominal", TrainingOptions(restarts=restarts)))

    restart = (training(11) - training(1)) / 10
    calibration = train(measurements, "local-poe", TrainingOptions(regularisation="early-stopping"))
    help_command = [sys.executable, "-m", "calibtool", "--help"]

    print("| what | median | target |\n|---|---|---|")
    kinematics = seconds(lambda: robot.mechanism.forward_and_jacobian(q)) / len(q)
    print(
        f"| forward kinematics and Jacobian, per configuration | {kinematics * 1e6:.2f} µs | 4 µs |"
    )
    print(
        "| training of a 6-6-6 network on 50 configurations, per restart | "
        f"{restart * 1e3:.1f} ms | 20 ms |"
    )
    for method, target in (("exact", "1 s"), ("one-step", "-")):
        taken = seconds(lambda method=method: compensate_joints(calibration, q, method), 5)
        print(f"| {method} compensation of 10,000 joint rows | {taken:.2f} s | {target} |")
    started = seconds(lambda: subprocess.run(help_command, check=True, stdout=subprocess.DEVNULL))
    print(f"| calibtool --help | {started:.2f} s | 0.3 s |")


if __name__ == "__main__":
    main()
