"""Inverse kinematics over the whole joint range, beside other solvers in one run.

Run: python benchmarks/inverse.py [--poses 10000]. Poses of uniform joint positions inside the limits, singular ones included.
"no seed": from the default home; "near seed": from 0.05 rad beside the answer. roboticstoolbox-python (`ik_LM`) and Pinocchio's
example loop (CLIK) join where they are installed, on the first 500 poses, with their own defaults, limits and tolerance 1e-6.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time

import numpy as np
import pinocchio as pin

from calibtool.robot.catalogue import load_robot
from calibtool.robot.inverse import inverse_kinematics
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array, inverse

OTHERS = 500


def clik(robot: Robot, targets: Array, seed: Array) -> tuple[np.ndarray, float]:
    """The closed loop of Pinocchio's documentation (gain 0.1, damping 1e-12, 1,000 steps), as it stands there."""
    model, data = robot.mechanism.model, robot.mechanism.model.createData()
    tool = robot.mechanism.tool
    reached = np.zeros(len(targets), dtype=bool)
    start = time.perf_counter()
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
            J = -pin.Jlog6(error.inverse()) @ pin.computeJointJacobian(model, data, q, model.njoints - 1)
            q = q + 0.1 * (-J.T @ np.linalg.solve(J @ J.T + 1e-12 * np.eye(6), e))
    return reached, time.perf_counter() - start


def toolbox(robot: Robot, targets: Array) -> tuple[np.ndarray, float] | None:
    """roboticstoolbox-python's compiled `ik_LM` with its default number of searches."""
    try:
        import roboticstoolbox as rtb
    except ImportError:
        return None
    links = []
    for j, twist in enumerate(robot.chain.twists):
        ets = rtb.ET.SE3(robot.chain.placements[j])
        axis = int(np.argmax(np.abs(twist[3:])))
        rotation = (rtb.ET.Rx, rtb.ET.Ry, rtb.ET.Rz)[axis](flip=bool(twist[3 + axis] < 0), qlim=[robot.lower[j], robot.upper[j]])
        links += [ets, rotation]
    ets = rtb.ETS([*links, rtb.ET.SE3(robot.chain.placements[-1])])
    start = time.perf_counter()
    found = [ets.ik_LM(target, tol=1e-12, joint_limits=True) for target in targets]
    seconds = time.perf_counter() - start
    q = np.array([answer[0] for answer in found])
    left = np.abs(robot.mechanism.forward(q) - targets).max(axis=(1, 2))
    return (left < 1e-5) & robot.within_limits(q), seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=10_000)
    count = parser.parse_args().poses
    print("| robot | solver | poses | solved | per pose |\n|---|---|---|---|---|")
    for name in ("fanuc-m1000ia", "ur5", "panda"):
        robot = load_robot(name)
        rng = np.random.default_rng(0)
        q = robot.lower + (robot.upper - robot.lower) * rng.random((count, robot.n))
        targets = robot.mechanism.forward(q)
        start = time.perf_counter()
        solved = inverse_kinematics(robot, targets)
        seconds = time.perf_counter() - start
        row(name, "calibtool, no seed", solved.reached, seconds)
        near = np.clip(q + rng.normal(0, 0.05, q.shape), robot.lower, robot.upper)
        start = time.perf_counter()
        solved = inverse_kinematics(robot, targets, near)
        row(name, "calibtool, near seed", solved.reached, time.perf_counter() - start)
        seed = robot.home(robot.workspace(None)[1])
        row(name, "Pinocchio's CLIK example, no seed", *clik(robot, targets[:OTHERS], seed))
        other = toolbox(robot, targets[:OTHERS])
        if other is not None:
            row(name, "roboticstoolbox ik_LM, no seed", *other)


def row(robot: str, solver: str, reached: np.ndarray, seconds: float) -> None:
    share = f"{int(reached.sum())} ({100 * reached.mean():.1f} %)"
    print(f"| {robot} | {solver} | {len(reached)} | {share} | {seconds / len(reached) * 1e6:.0f} µs |", flush=True)


if __name__ == "__main__":
    main()
