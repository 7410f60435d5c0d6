"""The promise of exported code: under the calibrated model no row is worse than uncorrected.

Run: python benchmarks/exported.py [--rows 2000] [--configurations 60] [--seed 0] [--robots
ur5,panda]. Every built-in robot with every kind of error: the complete model and its network from
configurations of the whole joint range (`complete`) and of the default workspace (`complete,
workspace`), and a network alone on the nominal robot from the latter (`nominal, workspace`). Fresh
rows of the whole joint range through the compiled C code, double and float, and through the
Structured Text, which Python runs.
`worse`: rows whose weighted pose error under the calibrated model grew. `ok, above`: rows with
status ok that leave more than 5 times the median of all rows, of all components or of those that
the joints can correct.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import ctypes
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from exported import STATUS
from structured_text import FunctionBlock

from calibtool.calibration import Calibration, train
from calibtool.compensation.weighted_error import Task
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.export.c_code import calibration_as_c
from calibtool.export.rendering import Precision
from calibtool.export.structured_text import calibration_as_structured_text
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot, robot_names
from calibtool.robot.se3 import Array, pose_difference

LOOP = """
#include "arm.h"
void many(int count, const REAL *q, REAL *q_m, int *codes)
{
    for (int k = 0; k < count; k++)
        codes[k] = arm_correct(q + k * ARM_N, q_m + k * ARM_N);
}
"""


def by_c(calibration: Calibration, q: Array, precision: Precision) -> tuple[Array, Array]:
    """Corrected joints (N, n) and return codes (N,) of the compiled C code."""
    header, source = calibration_as_c(calibration, "arm", precision)
    real, kind = ("double", np.float64) if precision == "double" else ("float", np.float32)
    with tempfile.TemporaryDirectory() as folder:
        for name, text in (("arm.h", header), ("arm.c", source), ("loop.c", LOOP)):
            Path(folder, name).write_text(text)
        command = [
            "cc",
            "-std=c99",
            "-O2",
            f"-DREAL={real}",
            "-shared",
            "-fPIC",
            "-o",
            "arm.so",
            "arm.c",
            "loop.c",
            "-lm",
        ]
        subprocess.run(command, check=True, cwd=folder)
        library = ctypes.CDLL(f"{folder}/arm.so")
        rows = np.ascontiguousarray(q, dtype=kind)
        corrected, codes = np.empty_like(rows), np.empty(len(rows), dtype=np.intc)
        library.many(
            len(rows), *(ctypes.c_void_p(array.ctypes.data) for array in (rows, corrected, codes))
        )
    return corrected.astype(float), codes


def by_structured_text(calibration: Calibration, q: Array) -> tuple[Array, Array]:
    """The same of the function block."""
    block = FunctionBlock(calibration_as_structured_text(calibration))
    answers = [block(row) for row in q]
    return np.array([row for row, _ in answers]), np.array([code for _, code in answers])


def sizes(calibration: Calibration, q: Array, commanded: Array) -> Array:
    """Weighted pose error of the calibrated robot at q against the nominal one: of all, of the
    task. (2, N), rad.
    """
    robot = calibration.robot
    aim = robot.mechanism.forward(commanded)
    error = pose_difference(calibration.forward(q), aim, robot.length)
    task = Task.of(calibration.equivalent).of_error(error, aim)
    return np.array([np.linalg.norm(part, axis=1) for part in (error, task)])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rows", type=int, default=2000)
    parser.add_argument("--configurations", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robots", default=",".join(robot_names()))
    options = parser.parse_args()
    print(
        "| robot | base | code | worse | ok, above | largest changes deg | left / before, "
        "median | status |"
    )
    print("|---|---|---|---|---|---|---|---|")
    worse = above = rows = 0
    for name in options.robots.split(","):
        robot = load_robot(name)
        span = robot.upper - robot.lower
        q = robot.lower + span * np.random.default_rng([options.seed, 7]).random(
            (options.rows, robot.n)
        )
        for base, workspace in (
            ("complete", robot.workspace("full")),
            ("complete", robot.workspace()),
            ("nominal", robot.workspace()),
        ):
            basis = Simulation(
                seed=options.seed,
                configurations=options.configurations,
                workspace=workspace,
                scales=ErrorScales(ERROR_KINDS),
            )
            calibration = train(simulate(robot, basis), base)
            label = f"{base}, workspace" if workspace.bounded else base
            single = q.astype(np.float32).astype(float)
            found = {
                "C": (q, *by_c(calibration, q, "double")),
                "ST": (q, *by_structured_text(calibration, q)),
                "C float": (single, *by_c(calibration, single, "single")),
            }
            for code, (commanded, corrected, codes) in found.items():
                before, after = (sizes(calibration, x, commanded) for x in (commanded, corrected))
                grown = int((after > before).any(axis=0).sum())
                fine = codes == STATUS.index("ok")
                high = int(
                    (fine & (after > 5 * np.median(after, axis=1, keepdims=True)).any(axis=0)).sum()
                )
                change = np.abs(corrected - commanded).max(axis=0)
                units = zip(change, robot.prismatic, strict=True)
                shown = "/".join(
                    f"{1e3 * c:.0f} mm" if slide else f"{np.rad2deg(c):.1f}" for c, slide in units
                )
                counts = Counter(STATUS[k] for k in codes)
                status = ", ".join(f"{count} {word}" for word, count in counts.most_common())
                share = np.median(after[1]) / max(float(np.median(before[1])), 1e-300)
                print(
                    f"| {name} | {label} | {code} | {grown} | {high} | {shown} | "
                    f"{share:.3f} | {status} |",
                    flush=True,
                )
                if code != "C float":
                    worse, above, rows = worse + grown, above + high, rows + len(commanded)
    print(
        f"\nDouble precision: {rows} rows, worse than uncorrected {worse}, ok but above 5 "
        f"medians {above}"
    )


if __name__ == "__main__":
    main()
