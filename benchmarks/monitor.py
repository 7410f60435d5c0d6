"""How often `monitor` finds a drift from a few rows, and how often it gives a false alarm.

    python benchmarks/monitor.py [--seeds 20] [--checks 50]

Per seed a simulated robot with geometric errors is calibrated from 50 configurations of a tracker
at an unknown place (0.05 mm noise). Then five random configurations of the workspace are measured:
`checks` times without any change, and `checks` times each with the base shifted by 0.1 mm in a
random direction, and with one random joint off by 0.05 deg. `named` is how often the cause is among
those that are named.
"""

import argparse
from dataclasses import replace

import numpy as np

from calibtool.calibration import Calibration, identify
from calibtool.evaluation.drift import DriftCheck, check_drift
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, readonly

ROWS, SHIFT, TURN = 5, 1e-4, np.deg2rad(0.05)


def measured(robot: Robot, first: Measurements, q: Array, off: Array, seed: int) -> Measurements:
    """Five rows of the same robot and tracker, joints moved by `off` without anyone knowing."""
    again = Simulation(seed=seed, same_robot=first.truth, at=q + off, unregistered=True)
    assert first.truth is not None
    seen = simulate(robot, again)
    return replace(seen, q=readonly(q), setup=first.setup, truth=None)


def shifted(measurements: Measurements, first: Measurements, shift: Array) -> Measurements:
    """The same with the base shifted (3,), m in K_0."""
    assert first.truth is not None
    moved = first.truth.setup.T_instrument_base[:3, :3] @ shift
    return replace(measurements, points=readonly(measurements.points + moved))


def one_seed(robot: Robot, seed: int, checks: int) -> dict[str, list[DriftCheck]]:
    """Checks of one calibrated robot by what was changed."""
    rng = np.random.default_rng(1000 + seed)
    workspace = robot.workspace(None)
    setup = Simulation(seed=seed, configurations=50, workspace=workspace, unregistered=True)
    first = simulate(robot, setup)
    calibration: Calibration = identify(first)
    found: dict[str, list[DriftCheck]] = {"nothing": [], "base": [], "joint": []}
    names: list[int] = []
    for k in range(checks):
        q = sample_configurations(robot, workspace, ROWS, rng)
        direction = rng.normal(size=3)
        direction *= SHIFT / np.linalg.norm(direction)
        joint = int(rng.integers(robot.n))
        off = TURN * np.eye(robot.n)[joint]
        steady = measured(robot, first, q, 0.0 * off, 10_000 * seed + k)
        found["nothing"].append(check_drift(calibration, steady))
        found["base"].append(check_drift(calibration, shifted(steady, first, direction)))
        turned = measured(robot, first, q, off, 10_000 * seed + k)
        found["joint"].append(check_drift(calibration, turned))
        names.append(joint + 1)
    found["joint names"] = names  # type: ignore[assignment]
    return found


def named(check: DriftCheck, cause: str) -> bool:
    """Whether a cause is among the named ones."""
    return cause in [each.name for each in check.causes[: check.likely]]


def main() -> None:
    """Print one row per robot and change."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--checks", type=int, default=50)
    parser.add_argument("--robots", nargs="+", default=["fanuc-m1000ia", "ur10"])
    given = parser.parse_args()
    print("| robot | change | found, % | worst seed, % | cause named, % |\n|---|---|---|---|---|")
    for name in given.robots:
        robot = load_robot(name)
        every = [one_seed(robot, seed, given.checks) for seed in range(given.seeds)]
        for change in ("nothing", "base", "joint"):
            rates = [np.mean([c.alarm for c in found[change]]) for found in every]
            right = [
                named(check, "base" if change == "base" else f"joint {joint}")
                for found in every
                for check, joint in zip(found[change], found["joint names"], strict=True)
            ]
            worst = max(rates) if change == "nothing" else min(rates)
            text = "–" if change == "nothing" else f"{100 * np.mean(right):.1f}"
            print(
                f"| {name} | {change} | {100 * np.mean(rates):.1f} | {100 * worst:.0f} | {text} |"
            )


if __name__ == "__main__":
    main()
