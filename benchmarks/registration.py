"""Registration from anywhere: 1,000 instruments at random poses and 1,000 random starts, one
answer each time.

Run: python benchmarks/registration.py [RUNS]. Robots with errors of every kind and 0.05 mm of
noise, 40 configurations; the instrument within 5 m in any orientation, the targets (or the sensor
of a 6-D instrument) anywhere within 1 m of the tool. Columns: starts that end in the answer when
handed to `register`; the largest distance of their answers from the first one; starts that would
end there alone (the search from that rotation only; for a 6-D instrument the refinement from that
set-up), which is why the program does not rely on one start; set-ups found where they really are
(within 0.03, robot errors included); the residual before any calibration. Then circle fits of
joints 1 and 2 (10 rows each) against the true frame.
"""

import sys
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from calibtool.errormodel.actual import ActualRobot, ErrorScales, random_actual
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.measurement.circles import circle_start
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import residuals
from calibtool.measurement.registration import frames_of_least_squares, refine, register
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.setup import Setup
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array, inverse, readonly, transform_points

KINDS = {"three targets": 3, "one target": 1, "6-D": 1}
NOISE, TURN_NOISE = 0.05e-3, 0.1e-3


def random_setup(kind: str, rng: np.random.Generator) -> Setup:
    T = np.eye(4)
    T[:3, :3] = Rotation.random(rng=rng).as_matrix()
    T[:3, 3] = rng.uniform(-5, 5, 3)
    sensor = readonly(Rotation.random(rng=rng).as_matrix()) if kind == "6-D" else None
    targets = rng.normal(size=(KINDS[kind], 3))
    targets *= rng.uniform(0.1, 1, (len(targets), 1)) / np.linalg.norm(
        targets, axis=-1, keepdims=True
    )
    return Setup(readonly(T), readonly(targets), sensor, frame_known=False, targets_known=False)


def measured(actual: ActualRobot, truth: Setup, q: Array, rng: np.random.Generator) -> Measurements:
    T = truth.T_instrument_base @ actual.forward(q)
    points = transform_points(T, truth.targets)
    rotations = None
    if truth.R_tool_sensor is not None:
        turns = Rotation.from_rotvec(rng.normal(size=(len(q), 3)) * TURN_NOISE).as_matrix()
        rotations = readonly(turns @ T[:, :3, :3] @ truth.R_tool_sensor)
    unknown = replace(
        truth, T_instrument_base=readonly(np.eye(4)), targets=readonly(np.zeros_like(truth.targets))
    )
    points = readonly(points + rng.normal(size=points.shape) * NOISE)
    return Measurements(actual.robot, q, points, rotations, unknown, NOISE, TURN_NOISE)


def alone(measurements: Measurements, start: Setup, poses: Array) -> Setup:
    """From the start's rotation only (points), or the start itself refined (6-D)."""
    if measurements.rotations is not None:
        return refine(measurements, start, poses)[0]
    frame = frames_of_least_squares(
        poses, measurements.points, [start.T_instrument_base], only_guesses=True
    )[0]
    seen = transform_points(inverse(frame @ poses)[:, None], measurements.points[:, :, None])[
        :, :, 0
    ]
    return replace(start, T_instrument_base=readonly(frame), targets=readonly(seen.mean(axis=0)))


def apart(a: Setup, b: Setup) -> float:
    """Largest difference of the two set-ups: m, and elements of the rotations."""
    parts = [a.T_instrument_base - b.T_instrument_base, a.targets - b.targets]
    if a.R_tool_sensor is not None and b.R_tool_sensor is not None:
        parts.append(a.R_tool_sensor - b.R_tool_sensor)
    return max(float(np.abs(part).max()) for part in parts)


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    print(
        "| robot | instrument | same answer | largest difference m | start alone | set-ups found | "
        "nominal mm rms |"
    )
    print("|---|---|---|---|---|---|---|")
    for name in ("fanuc-m1000ia", "ur5"):
        robot = load_robot(name)
        actual = random_actual(robot, ErrorScales(ERROR_KINDS), np.random.default_rng(1))
        q = readonly(sample_configurations(robot, robot.workspace(), 40, np.random.default_rng(2)))
        poses = robot.mechanism.forward(q)
        for kind in KINDS:
            rng = np.random.default_rng(3)
            truth = random_setup(kind, rng)
            measurements = measured(actual, truth, q, rng)
            answer = register(measurements)
            differences, lonely, found = [], 0, 0
            for _ in range(runs):
                start = random_setup(kind, rng)
                differences.append(apart(register(measurements, start=start), answer))
                lonely += apart(alone(measurements, start, poses), answer) < 1e-6
                # The same robot, seen by an instrument elsewhere: the frame is the true one but for
                # the robot's errors.
                elsewhere = register(measured(actual, start, q, rng))
                off = inverse(elsewhere.T_instrument_base) @ start.T_instrument_base
                found += bool(np.abs(off - np.eye(4)).max() < 0.03)
            left = residuals(measurements, answer, poses)[:, : 3 * len(answer.targets)]
            rms = float(np.sqrt((left**2).sum() / (len(q) * len(answer.targets))))
            same = sum(difference < 1e-6 for difference in differences)
            print(
                f"| {name} | {kind} | {same} of {runs} | {max(differences):.1e} | "
                f"{lonely} of {runs} | {found} of {runs} | {rms * 1e3:.3f} |",
                flush=True,
            )
    print(
        "\n| robot | circles: direction of joint 1 mrad, median (max) | circles: base mm, median "
        "(max) |\n|---|---|---|"
    )
    for name in ("fanuc-m1000ia", "ur5"):
        robot = load_robot(name)
        home = robot.workspace().home
        turns, shifts = [], []
        for seed in range(100):
            rng = np.random.default_rng(seed)
            q = np.tile(home, (20, 1))
            q[:10, 0] += np.linspace(-1, 1, 10)
            q[10:, 1] += np.linspace(-0.5, 0.5, 10)
            truth = random_setup("three targets", rng)
            actual = random_actual(robot, ErrorScales(), rng)
            frame = circle_start(measured(actual, truth, readonly(q), rng))
            assert frame is not None
            off = inverse(truth.T_instrument_base) @ frame
            turns.append(np.arccos(min(1.0, off[2, 2])) * 1e3)
            shifts.append(np.linalg.norm(off[:3, 3]) * 1e3)
        cells = [f"{np.median(values):.2f} ({np.max(values):.2f})" for values in (turns, shifts)]
        print(f"| {name} | {cells[0]} | {cells[1]} |")


if __name__ == "__main__":
    main()
