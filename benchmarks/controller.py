"""Poses for a controller with a model of its own: a UR5 whose controller has a factory calibration.

Run: python benchmarks/controller.py [--seeds 20]. The factory model is the nominal arm with errors
in the six frames of a UR calibration, so large that the tool differs as it does between real arms
and their drawing (2 to 3 mm); the actual arm is the factory model with further, small errors. It is
measured with a tracker (three targets, 60 configurations of the whole joint range, 0.05 mm noise,
base frame known) and identified. A URScript program of 40 movel poses of the default workspace then
goes through `compensate`, the controller solves what is written by its own model, and the actual
arm drives there: how far is the tool from the commanded poses?

untouched: the program as it was. naive: corrected with --controller nominal, which is not this
controller's. corrected: with --controller and the factory calibration as the driver's YAML.
"""

import argparse
import re
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify
from calibtool.controller import read_controller_model
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.setup import Setup
from calibtool.programs.compensate import compensate_program
from calibtool.programs.correction import ProgramOptions
from calibtool.programs.frames import pose
from calibtool.robot.catalogue import load_robot
from calibtool.robot.inverse import solve_poses
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.se3 import Array, log3, readonly, transform_points

FRAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
# The UR5 (CB series): placement of every joint in the one before it, m and rad.
UR5 = np.array(
    [
        [0, 0, 0.089159, 0, 0, 0],
        [0, 0, 0, np.pi / 2, 0, 0],
        [-0.425, 0, 0, 0, 0, 0],
        [-0.39225, 0, 0.10915, 0, 0, 0],
        [0, -0.09465, 0, np.pi / 2, 0, 0],
        [0, 0.0823, 0, -np.pi / 2, 0, 0],
    ]
)
FACTORY = (0.44e-3, 1.05e-3)  # m and rad: errors of the nominal arm that the factory finds
LEFT = (0.095e-3, 0.19e-3)  # and those that it leaves
METHODS = ("untouched", "naive", "corrected")


@dataclass(frozen=True, eq=False)
class Scene:
    """One arm: the files of its controller, what it does, and its calibration by calibtool."""

    factory_yaml: str
    factory: Mechanism
    actual: Mechanism
    calibration: Calibration


def yaml_of(frames: Array) -> str:
    """The file that the UR driver's ur_calibration writes for six frames (6, 6)."""
    lines = ["kinematics:"]
    for name, values in zip(FRAMES, frames.tolist(), strict=True):
        lines += [f"  {name}:", *(f"    {k}: {v!r}" for k, v in zip(KEYS, values, strict=True))]
    return "\n".join([*lines, "  hash: calib_0", ""])


def scene(seed: int, configurations: int = 60) -> Scene:
    """An arm with a factory calibration, measured and identified."""
    robot, rng = load_robot("ur5"), np.random.default_rng(seed)
    factory = UR5 + rng.normal(size=(6, 6)) * np.repeat(FACTORY, 3)
    actual = factory + rng.normal(size=(6, 6)) * np.repeat(LEFT, 3)
    mechanisms = [
        read_controller_model(yaml_of(frames), "arm.yaml", robot).mechanism
        for frames in (factory, actual)
    ]
    q = sample_configurations(robot, "full", configurations, rng)
    points = transform_points(mechanisms[1].forward(q), robot.targets)
    measurements = Measurements(
        robot=robot,
        q=readonly(q),
        points=readonly(points + rng.normal(size=points.shape) * 0.05e-3),
        rotations=None,
        setup=Setup(readonly(np.eye(4)), robot.targets),
        noise_position=0.05e-3,
        noise_orientation=0.1e-3,
    )
    return Scene(yaml_of(factory), *mechanisms, identify(measurements, "complete"))


def program(commanded: Array) -> str:
    """A URScript program of movel poses (N, 4, 4), with as many digits as the pendant keeps."""
    lines = ["def work():", "  set_tcp(p[0, 0, 0, 0, 0, 0])"]
    for T in commanded:
        values = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_rotvec()]
        lines.append(f"  movel(p[{', '.join(f'{v:.8f}' for v in values)}], a=1.2, v=0.25)")
    return "\n".join([*lines, "end", ""])


def poses_in(text: str) -> Array:
    """The poses of movel instructions (N, 4, 4)."""
    found = re.findall(r"movel\(p\[([^]]*)\]", text)
    return np.array(
        [pose([float(v) for v in each.split(",")], "rotation-vector") for each in found]
    )


def driven(made: Scene, text: str, q_near: Array) -> Array:
    """Where the actual arm's tool is when the controller solves the poses of a program."""
    solved = solve_poses(made.factory.forward_and_jacobian, poses_in(text), q_near, length=0.6)
    assert solved.reached.all()
    return made.actual.forward(solved.q)


def errors(made: Scene, seed: int, count: int = 40) -> dict[str, tuple[Array, Array]]:
    """Distances (N,) in m and turns (N,) in rad from the commanded poses, by method."""
    robot = made.calibration.robot
    workspace = robot.workspace()
    q = sample_configurations(robot, workspace, count, np.random.default_rng([seed, 1]))
    text = program(robot.mechanism.forward(q))
    commanded = poses_in(text)
    models = {
        "naive": robot.mechanism,
        "corrected": read_controller_model(made.factory_yaml, "factory.yaml", robot).mechanism,
    }
    texts = {"untouched": text}
    for name, model in models.items():
        options = ProgramOptions(controller_model=model)
        result = compensate_program(
            made.calibration, text.encode(), "work.script", "ur-script", options
        )
        assert not result.left_alone
        texts[name] = result.data.decode()
    found = {}
    for name, written in texts.items():
        T = driven(made, written, q)
        turn = log3(T[:, :3, :3] @ np.swapaxes(commanded[:, :3, :3], -1, -2))
        distance = np.linalg.norm(T[:, :3, 3] - commanded[:, :3, 3], axis=-1)
        found[name] = (distance, np.linalg.norm(turn, axis=-1))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    seeds = parser.parse_args().seeds
    runs = [errors(scene(seed), seed) for seed in range(seeds)]
    print(f"| program, {seeds} arms | mean mm | max mm | mean mrad |")
    print("|---|---|---|---|")
    for name in METHODS:
        cells = []
        for part, statistic in ((0, np.mean), (0, np.max), (1, np.mean)):
            values = np.array([statistic(run[name][part]) for run in runs]) * 1e3
            low, high = values.min(), values.max()
            cells.append(f"{np.median(values):.3f} ({low:.3f} to {high:.3f})")
        print(f"| {name} | {' | '.join(cells)} |")
    worse = [int((run["corrected"][0] > run["untouched"][0]).sum()) for run in runs]
    print(f"\npoints that are farther off than untouched: {sum(worse)} of {seeds * 40}")


if __name__ == "__main__":
    main()
