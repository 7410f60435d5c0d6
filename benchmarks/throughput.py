"""Rows per second and memory of `calibtool compensate` through the command line, CSV in and out.

Run: python benchmarks/throughput.py [--rows 1000000]. fanuc-m1000ia, joint rows of the default
workspace; one BLAS thread, by this process alone and with one worker per core. Start-up (about half
a second, a second more for the workers) counts; CPU seconds are user and system time, which other
programs on the machine disturb less. Bytecode is kept, as an
installation does.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path

import numpy as np

from calibtool.measurement.sampling import sample_configurations
from calibtool.processes import processors
from calibtool.robot.catalogue import load_robot

CALIBTOOL = [sys.executable, "-m", "calibtool"]
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
ENVIRONMENT.pop("PYTHONDONTWRITEBYTECODE", None)


def run(*arguments: str) -> tuple[float, float, float]:
    """Wall seconds, CPU seconds and peak memory in MiB of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    subprocess.run([*CALIBTOOL, *arguments], check=True, env=ENVIRONMENT, stderr=subprocess.DEVNULL)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (
        wall,
        after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        after.ru_maxrss / 1024,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=1_000_000)
    count = parser.parse_args().rows
    robot = load_robot("fanuc-m1000ia")
    q = sample_configurations(
        robot, robot.workspace(), min(count, 20_000), np.random.default_rng(0)
    )
    with tempfile.TemporaryDirectory() as folder:
        table, measurements = str(Path(folder, "rows.csv")), str(Path(folder, "m.h5"))
        lines = [",".join(f"{v:.6f}" for v in row) for row in np.rad2deg(q)]
        with open(table, "w", encoding="ascii") as file:
            file.write(",".join(robot.joint_columns) + "\n")
            for k in range(count):
                file.write(lines[k % len(lines)] + "\n")
        run(
            "simulate",
            "fanuc-m1000ia",
            "--errors",
            "geometric,gear,gravity,thermal",
            "-n",
            "60",
            "-o",
            measurements,
        )
        print(
            "| calibration | method | workers | rows/s, wall | rows/s, CPU | peak memory |\n"
            "|---|---|---|---|---|---|"
        )
        for base in ("nominal", "complete"):
            calibration = str(Path(folder, f"{base}.h5"))
            run("train", measurements, "--base", base, "-o", calibration)
            for method, workers in product(("one-step", "exact"), sorted({1, processors()})):
                how = ("--method", method, "--workers", str(workers))
                wall, cpu, peak = run("compensate", calibration, table, *how, "-o", os.devnull)
                name = "network on nominal" if base == "nominal" else "complete"
                print(
                    f"| {name} | {method} | {workers} | {count / wall:,.0f} | {count / cpu:,.0f} | "
                    f"{peak:.0f} MiB |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
