"""Robots with closed loops: what a calibration takes away, how fast it is, whether an assembly mode
is ever wrong.

Run: python benchmarks/closed.py [--seeds 7] [--first-seed 0] [--fresh 1000] [--robots
delta,hexapod] [--poses 10000] [--only reductions|plans]. 0.5 mm and 0.5 mrad at every joint and
cut, 0.05 mm noise, default workspace. Errors are those of the task components (all but the virtual
joints), at exactly corrected joints, on fresh configurations at which the task can be corrected
inside the joint limits: position in mm, rotation in mrad, in percent of the nominal robot's. Median
(worst) of the seeds. Below, paired by seed: what 15 planned configurations leave of the position
error, over what 30 random ones leave, geometric mean. `plans` are these sets alone; planned without
a margin at the joint limits, like the random ones, too. The network is the paper's, on the nominal
hexapod, trained on 50 configurations with Bayesian regularisation. Assembly modes are compared with
small steps along the straight way from the closed configuration of the description, without a
table, on poses drawn from the whole joint range. Times are processor times.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calibtool.calibration import Calibration, identify, train
from calibtool.compensation.solve import compensate_joints
from calibtool.compensation.weighted_error import Task
from calibtool.equivalent.joints import equivalent_robot
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ActualRobot
from calibtool.identification.identification import Identification
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.constraints import Constraints
from calibtool.planning.information import Knowledge
from calibtool.planning.plan import make_plan
from calibtool.robot.catalogue import load_robot
from calibtool.robot.closed import ClosedMechanism
from calibtool.robot.continuation import newton
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, log3

ROBOTS = ("fivebar", "hexapod", "delta", "prs3", "palletizer", "palletizer-level", "hybrid")
BAYES = TrainingOptions(regularisation="bayes")
PLANNED = "complete, 15 planned"
RANDOM = "complete, 30 random"
STEPS = 100  # of the way to a pose whose assembly mode is checked


def task_errors(robot: Robot, actual: ActualRobot, driven: Array, commanded: Array) -> Array:
    """Sizes of the position (mm) and the rotation (mrad) of the task components at driven joints:
    (N, 2).
    """
    pose = actual.forward(driven)
    turn = log3(pose[:, :3, :3] @ np.swapaxes(commanded[:, :3, :3], 1, 2))
    error = np.concatenate([pose[:, :3, 3] - commanded[:, :3, 3], turn], axis=-1)
    task = Task.of(equivalent_robot(robot))
    components = range(6) if task.components is None else task.components
    own = task.of_error(error, commanded)
    shift = [k for k, component in enumerate(components) if component < 3]
    turned = [k for k, component in enumerate(components) if component >= 3]
    sizes = [np.linalg.norm(own[:, part], axis=-1) * 1e3 for part in (shift, turned)]
    return np.stack(sizes, axis=-1)


def left(calibration: Calibration | None, fresh: Measurements) -> Array:
    """Task errors on fresh configurations, corrected by a calibration or not at all: (N, 2)."""
    assert fresh.truth is not None
    robot, q = fresh.robot, fresh.q
    driven = q if calibration is None else compensate_joints(calibration, q).q
    return task_errors(robot, fresh.truth.actual, driven, robot.mechanism.forward(q))


def correctable(fresh: Measurements) -> np.ndarray:
    """Rows in which the task can be corrected in full inside the joint limits, by whoever knows the
    truth: (N,) bool.
    """
    result = compensate_joints(knowing(fresh), fresh.q)
    return np.asarray(result.status == "ok")


def knowing(measured: Measurements) -> Calibration:
    """A calibration that is the truth."""
    assert measured.truth is not None
    calibration = identify(measured, "nominal")
    knowing: Identification = replace(
        calibration.base, model="complete", errors=measured.truth.actual.errors
    )
    return replace(calibration, base=knowing)


def planned(robot: Robot, truth: Measurements, count: int, seed: int) -> Array:
    """Configurations (count, n) that the command `plan` chooses, its other options not given."""
    workspace = robot.workspace()
    plan = make_plan(
        Knowledge.of_tolerances(robot, truth.noise_position),
        workspace,
        count,
        constraints=Constraints(),
        criterion="i",
        candidates=2000,
        rng=np.random.default_rng(seed),
    )
    return plan.q


def reductions(robot: Robot, seed: int, fresh_rows: int, plans: bool) -> dict[str, Array]:
    """Per method the reductions of (maximum, mean) of position and rotation, percent: (4,), NaN
    where there is none. plans: of planned and of 30 random configurations alone.
    """
    basis = Simulation(seed=seed, configurations=50)
    measured = simulate(robot, basis)
    assert measured.truth is not None
    fresh = simulate(robot, replace(basis, configurations=fresh_rows, same_robot=measured.truth))
    fresh = fresh.rows(np.flatnonzero(correctable(fresh)))
    methods = {} if plans else {"complete, 50": identify(measured)}
    at = planned(robot, measured, 15, seed)
    methods[PLANNED] = identify(
        simulate(robot, Simulation(seed=seed, same_robot=measured.truth, at=at))
    )
    methods[RANDOM] = identify(measured.rows(np.arange(30)))
    if robot.name == "hexapod" and not plans:
        methods["network on nominal"] = train(measured, "nominal", BAYES)
    before = left(None, fresh)
    result = {}
    for name, calibration in methods.items():
        after = left(calibration, fresh)
        values = [1.0 - size(after) / np.maximum(size(before), 1e-9) for size in (_max, _mean)]
        result[name] = 100.0 * np.concatenate(values)
        result[name][np.tile(before.max(axis=0) < 1e-9, 2)] = np.nan
    return result


def _max(errors: Array) -> Array:
    return np.asarray(errors.max(axis=0))


def _mean(errors: Array) -> Array:
    return np.asarray(errors.mean(axis=0))


def perfect_model(robot: Robot, seed: int) -> float:
    """Largest position error (mm) of the task components after exact correction by the truth
    itself.
    """
    basis = Simulation(seed=seed, configurations=200)
    measured = simulate(robot, basis)
    assert measured.truth is not None
    result = compensate_joints(knowing(measured), measured.q)
    sizes = task_errors(robot, measured.truth.actual, result.q, robot.mechanism.forward(measured.q))
    return float(sizes[result.status == "ok", 0].max())


def modes(robot: Robot, poses: int, seed: int) -> tuple[int, int, int, int]:
    """Rows that close by the table and by small steps: both; of those wrong; by small steps alone;
    by the table alone.
    """
    mechanism = robot.mechanism
    assert isinstance(mechanism, ClosedMechanism)
    tree, rng = mechanism.tree, np.random.default_rng(seed)
    q = robot.lower + (robot.upper - robot.lower) * rng.random((poses, robot.n))
    found, stepped = mechanism.joints(q), by_small_steps(mechanism, q)
    a, b = (np.isfinite(each).all(axis=-1) for each in (found, stepped))
    apart = np.abs((found - stepped) / tree.joint_scale).max(axis=-1)
    return (
        int((a & b).sum()),
        int((apart[a & b] > 1e-6).sum()),
        int((b & ~a).sum()),
        int((a & ~b).sum()),
    )


def by_small_steps(mechanism: ClosedMechanism, q: Array) -> Array:
    """All joints (N, J) by Newton in small steps from the closed configuration; NaN where det C_p
    changes its sign.
    """
    tree, rows = mechanism.tree, np.arange(len(q))
    home = tree.closed_at
    theta, reach = np.tile(home, (len(q), 1)), np.full(len(q), 0.3)
    sign = None
    for k in range(STEPS + 1):
        theta[:, : tree.n] = home[: tree.n] + (q - home[: tree.n]) * (k / STEPS)
        closed = newton(mechanism.equations, tree, theta, rows, reach)
        _, _, now = mechanism.equations(closed.theta, rows)(rows, closed.theta[:, tree.passive])
        with np.errstate(invalid="ignore"):
            now_sign = np.sign(np.linalg.det(now.columns[:, :, tree.passive]))
        sign = now_sign if sign is None else sign
        theta = closed.theta
        theta[~closed.ok | (now_sign != sign)] = np.nan
    return theta


def processor_time(work: Callable[[], object]) -> float:
    """Shortest of five runs, s."""
    times = []
    for _ in range(5):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def speed(robot: Robot) -> tuple[float, float, float]:
    """Forward kinematics with Jacobian in µs a pose, exact corrections in rows/s, making of the
    starts in s.
    """
    workspace = robot.workspace()
    start = time.process_time()
    robot.mechanism.closes(workspace.home[None])
    starts = time.process_time() - start
    q = sample_configurations(robot, workspace, 2000, np.random.default_rng(0))
    forward = processor_time(lambda: robot.mechanism.forward_and_jacobian(q)) / len(q)
    calibration = identify(simulate(robot, Simulation(seed=1, workspace=workspace)))
    compensate_joints(calibration, q[:2])
    correction = processor_time(lambda: compensate_joints(calibration, q)) / len(q)
    return 1e6 * forward, 1.0 / correction, starts


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=7)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--fresh", type=int, default=1000)
    parser.add_argument("--robots", default=",".join(ROBOTS))
    parser.add_argument("--poses", type=int, default=10000)
    parser.add_argument("--only", choices=["speed", "modes", "reductions", "plans"], default=None)
    options = parser.parse_args()
    names = options.robots.split(",")
    if options.only in (None, "speed"):
        print_speed(names)
    if options.only in (None, "modes"):
        print_modes(names, options.poses)
    if options.only in (None, "reductions", "plans"):
        seeds = range(options.first_seed, options.first_seed + options.seeds)
        print_reductions(names, seeds, options.fresh, options.only == "plans")


def print_speed(names: list[str]) -> None:
    print("| robot | FK + Jacobian µs | exact rows/s | starts s | perfect model, left mm |")
    print("|---|---|---|---|---|")
    for name in names:
        robot = load_robot(name)
        forward, rows, starts = speed(robot)
        print(
            f"| {name} | {forward:.1f} | {rows:,.0f} | {starts:.1f} | "
            f"{perfect_model(robot, 0):.1e} |",
            flush=True,
        )


def print_modes(names: list[str], poses: int) -> None:
    print("\n| robot | both close | wrong mode | only by small steps | only by the table |")
    print("|---|---|---|---|---|")
    for name in names:
        print(
            f"| {name} | " + " | ".join(map(str, modes(load_robot(name), poses, 0))) + " |",
            flush=True,
        )


def print_reductions(names: list[str], which: range, fresh: int, plans: bool) -> None:
    print("\n| robot | method | position max −% | mean −% | rotation max −% | mean −% |")
    print("|---|---|---|---|---|---|")
    paired = []
    for name in names:
        robot = load_robot(name)
        seeds = [reductions(robot, seed, fresh, plans) for seed in which]
        for method in seeds[0]:
            values = np.array([outcome[method] for outcome in seeds])
            cells = [
                "-" if np.isnan(column).all() else f"{np.median(column):.1f} ({column.min():.1f})"
                for column in (values[:, 0], values[:, 2], values[:, 1], values[:, 3])
            ]
            print(f"| {name} | {method} | " + " | ".join(cells) + " |", flush=True)
        remains = {m: 100.0 - np.array([s[m] for s in seeds])[:, [0, 2]] for m in seeds[0]}
        logs = np.log(remains[PLANNED] / remains[RANDOM])
        ratio = np.exp(logs.mean(axis=0))
        error = 100 * logs.std(axis=0, ddof=1) / len(logs) ** 0.5
        paired.append(
            f"| {name} | × {ratio[0]:.2f} (± {error[0]:.0f} %) | "
            f"× {ratio[1]:.2f} (± {error[1]:.0f} %) |"
        )
    print("\n| robot | maximum, planned / random | mean |\n|---|---|---|")
    print("\n".join(paired))


if __name__ == "__main__":
    main()
