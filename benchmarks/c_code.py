"""Time of one correction by the generated C code, on this machine.

Run: python benchmarks/c_code.py [compiler flags]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import shlex
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibtool.calibration import Calibration, identify, train
from calibtool.equivalent.network import Network
from calibtool.equivalent.training import TrainingOptions
from calibtool.export.c_code import calibration_as_c
from calibtool.export.rendering import Precision
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot

# The smallest of many short runs: what the machine does besides is not the code's.
MAIN = """
#include <stdio.h>
#include <time.h>
#include "arm.h"
int main(void)
{
    const int count = 200, runs = 3000;
    double best = 1e9, sum = 0;
    for (int run = 0; run < runs; run++) {
        struct timespec start, end;
        clock_gettime(CLOCK_MONOTONIC, &start);
        for (int k = 0; k < count; k++) {
            REAL q[ARM_N], q_m[ARM_N];
            for (int j = 0; j < ARM_N; j++)
                q[j] = (REAL)(0.3 + 0.1 * j + 1e-3 * k);
            arm_correct(q, q_m);
            sum += (double)q_m[0];
        }
        clock_gettime(CLOCK_MONOTONIC, &end);
        const double nanoseconds = (double)(end.tv_sec - start.tv_sec) * 1e9
            + (double)(end.tv_nsec - start.tv_nsec);
        const double taken = nanoseconds / count;
        best = taken < best ? taken : best;
    }
    printf("%.0f\\n", best);
    return sum == 0;
}
"""


def nanoseconds(calibration: Calibration, precision: Precision, flags: list[str]) -> float:
    """One call of `arm_correct`, compiled by the system's cc."""
    header, source = calibration_as_c(calibration, "arm", precision)
    with tempfile.TemporaryDirectory() as folder:
        for name, text in (("arm.h", header), ("arm.c", source), ("main.c", MAIN)):
            Path(folder, name).write_text(text)
        define = [
            "-D_POSIX_C_SOURCE=199309L",
            f"-DREAL={'double' if precision == 'double' else 'float'}",
        ]
        command = ["cc", "-std=c99", *flags, *define, "-o", "main", "main.c", "arm.c", "-lm"]
        subprocess.run(command, check=True, cwd=folder)
        return float(
            subprocess.run([f"{folder}/main"], check=True, capture_output=True, text=True).stdout
        )


def with_harmonics(calibration: Calibration, orders: int) -> Calibration:
    """The calibration with every joint-motion function: `orders` random harmonics per joint,
    wind-up, and a network.
    """
    rng = np.random.default_rng(0)
    n = calibration.robot.n
    harmonics, gravity = rng.normal(size=(n, 2 * orders)) * 1e-4, rng.random(n) * 1e-6
    errors = calibration.base.errors.having(harmonics=harmonics, gravity=gravity)
    network = Network.initial(calibration.q, np.full(calibration.equivalent.p, 1e-4), 6, rng)
    return replace(
        calibration,
        base=replace(calibration.base, model="complete", errors=errors),
        networks=(network,),
    )


def main() -> None:
    flags = shlex.split(" ".join(sys.argv[1:])) or ["-O2"]
    robot = load_robot("fanuc-m1000ia")
    measurements = simulate(robot, Simulation(configurations=60))
    paper = train(measurements, "nominal", TrainingOptions(restarts=1))
    complete = identify(measurements, "complete")
    cases = {
        "network on the nominal base": paper,
        "complete and network, 2 harmonics": with_harmonics(complete, 2),
        "complete and network, 32 harmonics": with_harmonics(complete, 32),
    }
    version = subprocess.run(
        ["cc", "--version"], check=True, capture_output=True, text=True
    ).stdout.splitlines()[0]
    print(f"{robot.name}, {version}, -std=c99 {shlex.join(flags)}\n")
    print("| one correction | double | float | target |\n|---|---|---|---|")
    for name, calibration in cases.items():
        taken = [
            nanoseconds(calibration, precision, flags) / 1e3 for precision in ("double", "single")
        ]
        print(f"| {name} | {taken[0]:.2f} µs | {taken[1]:.2f} µs | 5 µs |")


if __name__ == "__main__":
    main()
