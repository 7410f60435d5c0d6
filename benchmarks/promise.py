"""The promise of corrections: never worse than none, inside the limits, no jumps along paths.

Run: python benchmarks/promise.py [--json] [--quick] [--only TABLE,…] [--rows N] [--robots A,B]

Every calibration is made from 100 configurations over the whole joint range of a robot with every
kind of error (`--errors all`): the complete model, a network and a Gaussian process on the nominal
robot. Judged is what the calibrated model says at fresh rows of the whole range. docs/numerics.md
shows the tables.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
from collections.abc import Callable
from functools import cache

import numpy as np

from calibtool.calibration import Calibration, identify, train
from calibtool.compensation.jumps import CorrectionPath
from calibtool.compensation.one_step import default_bounds
from calibtool.compensation.solve import Compensation, Method, compensate_joints
from calibtool.compensation.status import OK, OUT_OF_LIMITS, UNCORRECTED
from calibtool.compensation.weighted_error import Task
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot, robot_names
from calibtool.robot.inverse import solve_poses
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, pose_difference

Table = list[list[str]]  # a header and rows
METHODS: tuple[Method, ...] = ("exact", "one-step")
MANY = ("ur5", "panda", "fanuc-m1000ia")
REDUNDANT = ("panda", "xarm7", "tiago-arm")
# Joints that are moved through a singularity, on five robots.
PATHS = {
    "ur5": {"wrist": 4, "elbow": 2, "shoulder": 1},
    "ur3": {"wrist": 4, "elbow": 2, "shoulder": 1},
    "fanuc-m1000ia": {"wrist": 4, "elbow": 2, "shoulder": 1},
    "kinova": {"elbow": 2, "shoulder": 1},
    "panda": {"elbow": 3, "wrist": 5},
}
STEP = np.deg2rad(0.003)
NONE = 1e-9  # weighted pose error: below it, nothing is left


@cache
def calibrated(name: str, base: str) -> Calibration:
    robot = load_robot(name)
    simulation = Simulation(
        seed=1, configurations=100, scales=ErrorScales(kinds=ERROR_KINDS), workspace="full"
    )
    data = simulate(robot, simulation)
    if base == "complete":
        return identify(data, base)
    if base == "gaussian-process":
        return train(data, "nominal", TrainingOptions(regressor=base))
    return train(data, base, TrainingOptions(regularisation="early-stopping", restarts=1))


def fresh(robot: Robot, count: int, seed: int = 7) -> Array:
    return robot.lower + (robot.upper - robot.lower) * np.random.default_rng(seed).random(
        (count, robot.n)
    )


def errors(calibration: Calibration, q: Array, commanded: Array) -> tuple[Array, Array]:
    """Weighted pose errors at q: of the components that joints can correct, of all six. (N,)"""
    error = pose_difference(calibration.forward(q), commanded, calibration.robot.length)
    task = Task.of(calibration.equivalent).of_error(error, commanded)
    return np.linalg.norm(task, axis=-1), np.linalg.norm(error, axis=-1)


def judged(calibration: Calibration, q: Array, result: Compensation) -> list[str]:
    """Rows worse than uncorrected, `ok` rows that leave too much, and how many rows are what."""
    robot = calibration.robot
    commanded = robot.mechanism.forward(q)
    before, after = errors(calibration, q, commanded), errors(calibration, result.q, commanded)
    worse = np.any([a > b for a, b in zip(after, before, strict=True)], axis=0)
    ok = result.status == OK
    much = np.any([a > np.maximum(5 * np.median(a), NONE) for a in after], axis=0) & ok
    return [
        *(str(int(rows.sum())) for rows in (worse, much)),
        *(f"{100 * rows.mean():.1f} %" for rows in (ok, result.status == UNCORRECTED)),
        *(f"{1e3 * np.median(size):.2g}" for size in (before[1], after[0])),
        f"{np.rad2deg(default_bounds(calibration).largest_change):.1f}",
    ]


JUDGED = [
    "worse",
    "`ok`, leaves > 5 × median",
    "`ok`",
    "as commanded",
    "before",
    "left",
    "largest change deg",
]


def serial() -> str:
    """Names of the arms without closed loops: a correction of these is judged by all components."""
    return ",".join(name for name in robot_names() if load_robot(name).chain.tree is None)


def promise(count: int, robots: list[str]) -> Table:
    rows = [["robot", "base", "method", *JUDGED]]
    for name in robots:
        for base in ("complete", "nominal", "gaussian-process"):
            calibration = calibrated(name, base)
            q = fresh(calibration.robot, count)
            for method in METHODS:
                result = compensate_joints(calibration, q, method)
                rows.append([name, base, method, *judged(calibration, q, result)])
    return rows


def many(count: int) -> Table:
    rows = [["robot", "method", "rows", *JUDGED]]
    for name in MANY:
        calibration = calibrated(name, "complete")
        q = fresh(calibration.robot, count, seed=8)
        for method in METHODS:
            result = compensate_joints(calibration, q, method)
            rows.append([name, method, f"{count:,}", *judged(calibration, q, result)])
    return rows


def through_singularity(robot: Robot, joint: int, seed: int, count: int) -> Array:
    """Rows STEP apart of one joint, nearest to a singularity in the middle: (count, n)."""
    start = robot.lower + (robot.upper - robot.lower) * (
        0.3 + 0.4 * np.random.default_rng(seed).random(robot.n)
    )
    low, high = np.clip([robot.lower[joint], robot.upper[joint]], -np.pi, np.pi)
    angles = np.linspace(low, high, 4001)
    q = np.tile(start, (len(angles), 1))
    q[:, joint] = angles
    nearest = angles[robot.singularity_distance(q).argmin()]
    middle = np.clip(nearest, low + STEP * count / 2, high - STEP * count / 2)
    path = np.tile(start, (count, 1))
    path[:, joint] = middle + STEP * (np.arange(count) - count / 2)
    return path


def paths(count: int) -> Table:
    """Largest change of the correction from row to row, over its median: unreported rows, all."""
    header = [
        "robot",
        "through",
        "method",
        "nearest d",
        "median deg",
        "unreported",
        "all rows",
        "reported",
    ]
    rows = [header]
    for name, singularities in PATHS.items():
        calibration = calibrated(name, "complete")
        for place, joint in singularities.items():
            for seed in (1, 2):
                q = through_singularity(calibration.robot, joint, seed, count)
                nearest = calibration.robot.singularity_distance(q).min()
                for method in METHODS:
                    result = compensate_joints(calibration, q, method)
                    said = result.status != OK
                    said[
                        [jump.row for jump in CorrectionPath(calibration.robot).jumps(q, result.q)]
                    ] = True
                    change = np.linalg.norm(np.diff(result.q - q, axis=0), axis=-1)
                    median = float(np.median(change))
                    quiet = change[~said[1:]].max(initial=0.0) / median
                    told = [
                        f"{nearest:.4f}",
                        f"{np.rad2deg(median):.1e}",
                        f"{quiet:.1f}",
                        f"{change.max() / median:.0f}",
                    ]
                    rows.append([name, place, method, *told, f"{100 * said.mean():.0f} %"])
    return rows


def limits(count: int) -> Table:
    """Rows of redundant arms for which a search inside the limits arrives."""
    rows = [
        ["robot", "method", "rows", "answer exists", "answered inside", "else", "joints outside"]
    ]
    total = {method: np.zeros(2, dtype=int) for method in METHODS}
    for name in REDUNDANT:
        calibration = calibrated(name, "complete")
        robot = calibration.robot
        q = fresh(robot, count, seed=9)

        def actuated(x: Array, calibration: Calibration = calibration) -> tuple[Array, Array]:
            pose, jacobian = calibration.forward_and_jacobian(x)
            return pose, jacobian[:, :, : calibration.robot.n]

        commanded = robot.mechanism.forward(q)
        bounds = robot.lower, robot.upper
        exists = solve_poses(
            actuated,
            commanded,
            q,
            length=robot.length,
            lower=bounds[0],
            upper=bounds[1],
            max_iterations=300,
        ).reached
        for method in METHODS:
            result = compensate_joints(calibration, q, method)
            inside = robot.within_limits(result.q)
            answered = exists & inside & (result.status != OUT_OF_LIMITS)
            total[method] += [exists.sum(), answered.sum()]
            share = f"{100 * answered.sum() / exists.sum():.2f} %"
            rest = int((exists & ~answered).sum())
            rows.append(
                [
                    name,
                    method,
                    str(count),
                    str(int(exists.sum())),
                    share,
                    str(rest),
                    str(int((~inside).sum())),
                ]
            )
    for method, (there, found) in total.items():
        share, rest = f"{100 * found / there:.2f} %", str(there - found)
        rows.append(["all", method, str(3 * count), str(there), share, rest, "0"])
    return rows


def mastering() -> Table:
    """All joints at zero, where many wrists are singular: the largest change of a joint."""
    rows = [["robot", "d", *(f"{method} deg" for method in METHODS), "left of the error"]]
    for name in robot_names():
        calibration = calibrated(name, "complete")
        robot = calibration.robot
        q = np.clip(np.zeros((1, robot.n)), robot.lower, robot.upper)
        if any(robot.prismatic):
            continue
        results = [compensate_joints(calibration, q, method) for method in METHODS]
        before = errors(calibration, q, robot.mechanism.forward(q))[0][0]
        after = errors(calibration, results[0].q, robot.mechanism.forward(q))[0][0]
        told = [f"{np.rad2deg(np.abs(result.q - q).max()):.2f}" for result in results]
        rows.append(
            [
                name,
                f"{robot.singularity_distance(q)[0]:.4f}",
                *told,
                f"{100 * after / before:.1f} %",
            ]
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description="The promise of corrections.")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quick", action="store_true", help="A tenth of the rows.")
    parser.add_argument("--only", default="", help="Tables by name, comma-separated.")
    parser.add_argument("--rows", type=int, default=2000, help="Of the table `promise`.")
    parser.add_argument("--robots", help="The same; all serial arms by default.")
    options = parser.parse_args()
    part = 10 if options.quick else 1
    makers: dict[str, Callable[[], Table]] = {
        "promise": lambda: promise(options.rows // part, (options.robots or serial()).split(",")),
        "many": lambda: many(200_000 // part),
        "paths": lambda: paths(20_000 // part),
        "limits": lambda: limits(2000 // part),
        "mastering": mastering,
    }
    wanted = options.only.split(",") if options.only else list(makers)
    tables = {name: makers[name]() for name in wanted}
    if options.json:
        print(json.dumps(tables))
        return
    for name, (header, *rows) in tables.items():
        print(f"\n{name}\n")
        for row in (header, ["---"] * len(header), *rows):
            print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()
