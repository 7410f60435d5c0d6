"""The calibrated URDF against the best that any URDF can do, for every built-in robot.

Run: python benchmarks/urdf.py [--seeds 3] [--configurations 60] [--robots ur5,panda].
Every kind of error, 0.05 mm noise, the complete model from 60 configurations of the workspace.
Mean position and orientation errors against the actual robot at 2,000 fresh configurations: of the
drawing (`nominal`), of the complete model itself, of the exported URDF, read again, and of the
best URDF, fitted to the actual robot at these very configurations. `of the best`: URDF over best
URDF. Worst seed.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from dataclasses import replace

import numpy as np

from calibtool.calibration import identify
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.export.as_urdf import calibration_as_urdf
from calibtool.export.urdf_geometry import fitted_geometry
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot, robot_names
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, log3
from calibtool.robot.workspace import Workspace

FRESH = 2000


def mean_errors(poses: Array, truth: Array) -> Array:
    """Position in mm and orientation in mrad: (2,)."""
    turn = log3(poses[:, :3, :3] @ np.swapaxes(truth[:, :3, :3], 1, 2))
    sizes = np.linalg.norm([poses[:, :3, 3] - truth[:, :3, 3], turn], axis=-1)
    return np.asarray(1e3 * sizes.mean(axis=1))


def trial(robot: Robot, workspace: Workspace, configurations: int, seed: int) -> Array:
    """Errors of drawing, complete model, URDF and best URDF: (4, 2)."""
    basis = Simulation(
        seed=seed,
        configurations=configurations,
        workspace=workspace,
        scales=ErrorScales(ERROR_KINDS),
    )
    measurements = simulate(robot, basis)
    assert measurements.truth is not None
    actual = measurements.truth.actual
    calibration = identify(measurements, "complete")
    text, _ = calibration_as_urdf(calibration)
    source = robot.source
    tool = text.split("(tool)   link ")[1].split()[0]
    kinematics = source.description.kinematics.model_copy(update={"tool_frame": tool})
    description = source.description.model_copy(update={"kinematics": kinematics})
    urdf = Robot.from_source(replace(source, urdf_text=text, description=description))
    q = sample_configurations(robot, workspace, FRESH, np.random.default_rng([seed, 1]))
    truth = actual.forward(q)
    best = fitted_geometry(robot, lambda _: truth, q).mechanism
    found = [
        robot.mechanism.forward(q),
        calibration.forward(q),
        urdf.mechanism.forward(q),
        best.forward(q),
    ]
    return np.array([mean_errors(poses, truth) for poses in found])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--configurations", type=int, default=60)
    parser.add_argument("--robots", default=",".join(robot_names()))
    options = parser.parse_args()
    print(
        "| robot | workspace | nominal | complete | URDF | best URDF | of the best, mm | of "
        "the best, mrad |"
    )
    print("|---|---|---|---|---|---|---|---|")
    worst = np.zeros(2)
    for name in options.robots.split(","):
        robot = load_robot(name)
        for workspace_name in dict.fromkeys((robot.workspace_names[0], "full")):
            workspace = robot.workspace(workspace_name)
            trials = [
                trial(robot, workspace, options.configurations, seed)
                for seed in range(options.seeds)
            ]
            shares = np.array([found[2] / found[3] for found in trials])
            seed = int(shares[:, 0].argmax())
            cells = " | ".join(
                f"{position:.3f} mm, {turn:.2f} mrad" for position, turn in trials[seed]
            )
            print(
                f"| {name} | {workspace_name} | {cells} | "
                f"{' | '.join(f'{s:.2f}' for s in shares.max(axis=0))} |"
            )
            worse = [found for found in trials if (found[2] > found[0]).any()]
            for found in worse:
                print("worse than nominal:", found.round(3).tolist())
            worst = np.maximum(worst, shares.max(axis=0))
    print(
        f"\nLargest share of the best: {worst[0]:.2f} of mm, {worst[1]:.2f} of mrad (target 1.20)"
    )


if __name__ == "__main__":
    main()
