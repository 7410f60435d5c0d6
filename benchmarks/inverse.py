"""Inverse kinematics over the whole joint range, beside other solvers in one run.

Run: python benchmarks/inverse.py [--poses 10000] [--peer PYTHON]. Poses of uniform joint positions
inside the limits, singular ones included, all in one call or 500 in each. "no seed": any branch;
"near seed": from 0.05 rad beside the answer. Beside it roboticstoolbox-python's `ik_LM` (PYTHON is
an interpreter that has it) and, on the first 500 and from home, Pinocchio's example loop (CLIK).
Time is that of one CPU.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import pinocchio as pin

from calibtool.robot.catalogue import load_robot
from calibtool.robot.inverse import inverse_kinematics
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, inverse

FEW = 500


def clik(robot: Robot, targets: Array, seed: Array) -> tuple[np.ndarray, float]:
    """The closed loop of Pinocchio's documentation (gain 0.1, damping 1e-12, 1,000 steps), as
    it stands there.
    """
    model, data = robot.chain.model, robot.chain.model.createData()
    tool = robot.chain.placements[-1]
    reached = np.zeros(len(targets), dtype=bool)
    start = time.process_time()
    for k, target in enumerate(targets):
        goal = pin.SE3(target @ inverse(tool))
        q = seed.copy()
        for _ in range(1000):
            pin.forwardKinematics(model, data, q)
            error = data.oMi[model.njoints - 1].actInv(goal)
            e = pin.log(error).vector
            if np.linalg.norm(e) < 1e-6:
                reached[k] = bool(robot.within_limits(q[None])[0])
                break
            J = -pin.Jlog6(error.inverse()) @ pin.computeJointJacobian(
                model, data, q, model.njoints - 1
            )
            q = q + 0.1 * (-J.T @ np.linalg.solve(J @ J.T + 1e-12 * np.eye(6), e))
    return reached, time.process_time() - start


# Runs in an interpreter of its own: the toolbox's libraries and Pinocchio's do not share a process.
TOOLBOX = """
import sys, time
import numpy as np
import roboticstoolbox as rtb
given = np.load(sys.argv[1])
parts = []
joints = zip(*(given[name] for name in ("placements", "twists", "lower", "upper")))
for placement, twist, low, high in joints:
    axis = int(np.argmax(np.abs(twist[3:])))
    turn = (rtb.ET.Rx, rtb.ET.Ry, rtb.ET.Rz)[axis]
    parts += [rtb.ET.SE3(placement), turn(flip=bool(twist[3 + axis] < 0), qlim=[low, high])]
ets = rtb.ETS([*parts, rtb.ET.SE3(given["placements"][-1])])
start = time.process_time()
found = [ets.ik_LM(target, joint_limits=True)[0] for target in given["targets"]]
np.savez(sys.argv[2], q=np.array(found), seconds=time.process_time() - start)
"""


def toolbox(robot: Robot, targets: Array, python: str) -> tuple[np.ndarray, float]:
    """roboticstoolbox-python's compiled `ik_LM` with its defaults: random starts, up to 100
    searches, tolerance 1e-6.
    """
    chain = robot.chain
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder, "given.npz"), Path(folder, "found.npz")
        np.savez(
            given,
            placements=chain.placements,
            twists=chain.twists,
            lower=robot.lower,
            upper=robot.upper,
            targets=targets,
        )
        subprocess.run([python, "-c", TOOLBOX, str(given), str(found)], check=True)
        answer = np.load(found)
        q, seconds = answer["q"], float(answer["seconds"])
    left = np.abs(robot.mechanism.forward(q) - targets).max(axis=(1, 2))
    return (left < 1e-2) & robot.within_limits(
        q
    ), seconds  # its tolerance is on the squared error: 1e-3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--peer", metavar="PYTHON")
    arguments = parser.parse_args()
    count = arguments.poses
    print("| robot | solver | poses | solved | per pose |\n|---|---|---|---|---|")
    for name in ("fanuc-m1000ia", "ur5", "panda"):
        robot = load_robot(name)
        rng = np.random.default_rng(0)
        q = robot.lower + (robot.upper - robot.lower) * rng.random((count, robot.n))
        targets = robot.mechanism.forward(q)
        for size, note in ((count, ""), (FEW, f", {FEW} at a time")):
            start = time.process_time()
            reached = [
                inverse_kinematics(robot, targets[k : k + size]).reached
                for k in range(0, count, size)
            ]
            row(
                name,
                f"calibtool, no seed{note}",
                np.concatenate(reached),
                time.process_time() - start,
            )
        near = np.clip(q + rng.normal(0, 0.05, q.shape), robot.lower, robot.upper)
        start = time.process_time()
        solved = inverse_kinematics(robot, targets, near)
        row(name, "calibtool, near seed", solved.reached, time.process_time() - start)
        seed = robot.workspace().home
        row(name, "Pinocchio's CLIK example, no seed", *clik(robot, targets[:FEW], seed))
        if arguments.peer:
            row(name, "roboticstoolbox ik_LM, no seed", *toolbox(robot, targets, arguments.peer))


def row(robot: str, solver: str, reached: np.ndarray, seconds: float) -> None:
    share = f"{int(reached.sum())} ({100 * reached.mean():.1f} %)"
    print(
        f"| {robot} | {solver} | {len(reached)} | {share} | "
        f"{seconds / len(reached) * 1e6:.0f} µs |",
        flush=True,
    )


if __name__ == "__main__":
    main()
