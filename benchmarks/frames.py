"""How far targets move in the fitted and in the taught frames, and whether ± is their deviation.

    python benchmarks/frames.py            # 1 min

The sample of the pages, then simulated robots in an unknown set-up with every kind of error but
backlash: 60 configurations of the default workspace, the complete model, 500 fresh targets. Median
of the seeds (worst).
"""

import argparse
import io
from dataclasses import replace

import numpy as np

from calibtool.calibration import Calibration, identify
from calibtool.calibration.frame import FRAMES, FrameName, taught_frame
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.compensation.solve import compensate_joints
from calibtool.compensation.targets import read_configurations
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.evaluation.compare import evaluate
from calibtool.evaluation.view.scene import scene_of
from calibtool.measurement.importing import import_table
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.programs.compensate import compensate_program
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array
from calibtool.robot.shipped import shipped
from calibtool.storage import read_calibration, to_bytes

ROBOTS = ("fanuc-m1000ia", "ur5", "panda", "scara", "gantry")


def moved(calibration: Calibration, q: Array) -> Array:
    """How far each target at q (N, n) moves: (N,) m."""
    nominal = calibration.robot.mechanism
    after = compensate_joints(calibration, q).q
    change = nominal.forward(after) - nominal.forward(q)
    result: Array = np.linalg.norm(change[:, :3, 3], axis=-1)
    return result


def sample() -> None:
    """The figures of the sample in both frames."""
    folder, robot = shipped("data") / "sample", load_robot("fanuc-m1000ia")

    def imported(name: str):
        table = folder / name
        return import_table(table.read_bytes(), name, robot, joint_values="controller").measurements

    tracker, verification = imported("tracker.csv"), imported("verification.csv")
    calibration = read_calibration(io.BytesIO(to_bytes(identify(tracker))), "sample")
    targets = read_configurations((folder / "targets.csv").read_text("utf-8"), "targets.csv", robot)
    program = (folder / "seam.ls").read_bytes()
    print(
        "sample: nominal error, view, largest change of targets.csv, of seam.ls, largest ± of "
        "targets.csv, mm"
    )
    for name in FRAMES:
        chosen = calibration.in_frame(name)
        nominal = evaluate([("c", chosen)], verification).methods[0].position_size.mean()
        figures = [
            nominal * 1e3,
            np.sqrt((scene_of(chosen).error_rms ** 2).mean()) * 1e3,
            moved(chosen, targets).max() * 1e3,
            compensate_program(chosen, program, "seam.ls", "fanuc-ls").largest_mm,
            predicted_uncertainty(chosen, targets).position.max() * 1e3,
        ]
        print(f"  {name:7}", "  ".join(f"{value:.3f}" for value in figures))


def of_seed(name: str, seed: int) -> list[float]:
    """Largest change fitted and taught (mm), mean ± (mm), mean square of the deviation over ±²."""
    robot = load_robot(name)
    simulation = Simulation(
        seed=seed,
        configurations=60,
        scales=ErrorScales(kinds=tuple(kind for kind in ERROR_KINDS if kind != "backlash")),
        unregistered=True,
    )
    data = simulate(robot, simulation)
    assert data.truth is not None
    fresh = simulate(robot, replace(simulation, configurations=500, same_robot=data.truth)).q
    calibration = identify(data)
    names: tuple[FrameName, ...] = ("fitted", "taught")
    largest = [moved(calibration.in_frame(frame), fresh).max() * 1e3 for frame in names]
    actual, noise = data.truth.actual.forward, (data.noise_position, data.noise_orientation)
    true = taught_frame(actual(data.q), robot.mechanism.forward(data.q), data.setup, *noise)
    wanted = true.T_taught_fitted @ actual(fresh) @ true.T_tool_taught
    error = (calibration.in_frame("taught").forward(fresh) - wanted)[:, :3, 3]
    sd = predicted_uncertainty(calibration, fresh).position
    return [*largest, float(sd.mean()) * 1e3, float(((error**2).sum(axis=-1) / sd**2).mean())]


def main() -> None:
    """Both tables."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--seeds", type=int, default=10)
    seeds = options.parse_args().seeds
    sample()
    print("robot: largest change fitted, taught (mm), mean ± (mm), deviation² / ±²")
    for name in ROBOTS:
        found = np.array([of_seed(name, seed) for seed in range(seeds)])
        texts = [f"{np.median(column):.3f} ({column.max():.3f})" for column in found.T]
        print(f"  {name:14}", "  ".join(texts))


if __name__ == "__main__":
    main()
