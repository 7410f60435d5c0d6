"""Robots with every family of errors beside the Cramér–Rao bound, what absent families cost, and
how many truths the 95 % intervals of the parameters hold.

    python benchmarks/bound.py [--seeds 20] [--first-seed 0] [--only present|absent]

Whole joint range, 0.05 mm noise, three targets, mean position errors of the tool on 1,000 fresh
configurations without noise. Every kind of error of `simulate` is there, with harmonics 4 to 16 of
joints 1 to 3 (0.02 mrad each coefficient), 0 to 10 kg at the tool and 20 to 35 °C.

`bound` is the expected error of a fit that is told exactly which parameters the robot has, the
noise, and how large the errors of each kind are: θ̂ − θ ~ N(0, Σ), Σ = (AᵀA/σ² + S⁻²)⁻¹, with A the
derivative of the measured coordinates at the true errors and S the root mean square of the true
parameters of a group; of a fresh pose it leaves E‖C (θ̂ − θ)‖, C the derivative of its position.
`unbiased` is the same with S⁻² = 0: what no estimate without a prior can beat.

`absent`: robots with geometric errors only, in the same conditions; the default, which is offered
every family, against a fit that is offered the geometric ones.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections import Counter
from dataclasses import replace

import numpy as np
from calibtool.robot.damped_least_squares import at_point

from calibtool.calibration import Calibration, identify
from calibtool.calibration.fit import BaseOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS, FAMILIES
from calibtool.errormodel.harmonics import Harmonics
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.identification.complete import CompleteOptions
from calibtool.identification.equations import normal_equations
from calibtool.identification.parameters import Parameters, State
from calibtool.measurement.measurements import Measurements, Truth
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

FINE, FINE_JOINTS, FINE_SIZE = (4, 16), 3, 0.02e-3  # rad
CONDITIONS = {"payload_kg": (0.0, 10.0), "temperature_c": (20.0, 35.0)}
FRESH = 1000
NORMAL_95 = 1.959964
_RANK = 1e-12  # of the largest eigenvalue of the information: less is an exact redundancy
GEOMETRY = BaseOptions(
    "complete",
    CompleteOptions(orders={family.id: int(family.kind == "geometric") for family in FAMILIES}),
)


def actual_robot(robot: Robot, seed: int, kinds: tuple[str, ...]) -> Truth:
    """A robot with errors of these kinds; gears have fine structure, too."""
    drawn = simulate(
        robot, Simulation(seed=seed, configurations=4, scales=ErrorScales(kinds), workspace="full")
    ).truth
    assert drawn is not None
    if "gear" not in kinds:
        return drawn
    errors = drawn.actual.errors
    harmonics = Harmonics().resized(errors["harmonics"], (robot.n, 2 * FINE[1])).copy()
    fine = harmonics[:FINE_JOINTS, 2 * FINE[0] - 2 :]
    fine[:] = np.random.default_rng([seed, 16]).normal(size=fine.shape) * FINE_SIZE
    return replace(drawn, actual=replace(drawn.actual, errors=errors.having(harmonics=harmonics)))


def measured(truth: Truth, seed: int, count: int, noise: float = 0.05e-3) -> Measurements:
    simulation = Simulation(
        seed=seed,
        configurations=count,
        same_robot=truth,
        workspace="full",
        noise=noise,
        **CONDITIONS,
    )
    return simulate(truth.actual.robot, simulation)


def true_parameters(errors: RobotErrors, setup) -> Parameters:
    """The elements that differ from zero."""
    orders = {family.id: family.order(errors[family.id].shape) for family in errors.present}
    every = Parameters.of(errors.robot, setup, **orders)
    return every.only(State(errors, setup).vector(every) != 0.0)


def expected_error(
    seen: Measurements, fresh: Measurements, parameters: Parameters, std: Array | None
) -> float:
    """Mean position error at fresh rows at the Cramér–Rao bound of known parameters, m.

    std (p,): their true sizes; None: no prior, directions that no row tells are left out.
    """
    assert seen.truth is not None
    errors, setup = seen.truth.actual.errors, seen.truth.setup
    rows = np.ones(len(seen))
    information = normal_equations(seen, parameters, State(errors, setup), rows).information
    scale = parameters.prior_std() if std is None else std
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    if std is None:
        root = np.where(values > _RANK * values[-1], np.maximum(values, 1e-300) ** -0.5, 0.0)
    else:
        root = (np.maximum(values, 0.0) + 1.0) ** -0.5
    context = errors.context(fresh.q, fresh.conditions)
    tool = context.frames.tool[:, :3, 3]
    C = at_point(parameters.pose_columns(context), tool)[:, :3]
    drawn = np.random.default_rng(0).normal(size=(len(root), 200))
    apart = C @ ((scale[:, None] * vectors * root) @ drawn)
    return float(np.linalg.norm(apart, axis=1).mean())


def true_sizes(parameters: Parameters, theta: Array) -> Array:
    """Root mean square of the true parameters of every group, in proportion to tolerances (p,)."""
    std = parameters.prior_std()
    for group in parameters.groups:
        std[group] *= np.sqrt(np.mean((theta[group] / std[group]) ** 2))
    return std


def mean_error(calibration: Calibration, fresh: Measurements) -> float:
    """Of predicted positions of the tool, m."""
    assert fresh.truth is not None
    truth = fresh.truth.actual.forward(fresh.q, fresh.conditions)
    found = calibration.forward(fresh.q, fresh.conditions)
    return float(np.linalg.norm((found - truth)[:, :3, 3], axis=-1).mean())


class Intervals:
    """Truths within ± 1.96 standard deviations of the estimate, by family."""

    def __init__(self) -> None:
        self.held: Counter[str] = Counter()
        self.asked: Counter[str] = Counter()

    def add(self, calibration: Calibration, errors: RobotErrors) -> None:
        base = calibration.base
        if base.posterior is None:
            return
        parameters = base.posterior.parameters
        truth = State(errors, base.setup).vector(parameters)
        z = np.abs(base.state.vector(parameters) - truth) / base.posterior.std
        for part in parameters.parts:
            block = parameters.blocks[part.family.id]
            names = np.where(parameters.fine_structure[block], "fine structure", part.family.id)
            self.asked.update(names.tolist())
            self.held.update(names[z[block] < NORMAL_95].tolist())

    def table(self) -> None:
        print("\n| family | parameters | truths in their 95 % interval |\n|---|---|---|")
        for name, count in self.asked.items():
            print(f"| {name} | {count} | {100 * self.held[name] / count:.1f} % |")
        total, held = sum(self.asked.values()), sum(self.held.values())
        print(f"| all | {total} | {100 * held / total:.1f} % |", flush=True)


def missed_and_false(calibration: Calibration, errors: RobotErrors) -> tuple[str, str]:
    """Families of the robot that the model does not have, and families of the model that the
    robot does not have.
    """
    has = {family.id for family in calibration.errors.present}
    true = {family.id for family in errors.present}
    return " ".join(sorted(true - has)), " ".join(sorted(has - true))


def counted(names: list[str]) -> str:
    words = Counter(name for text in names for name in text.split())
    return ", ".join(f"{name} {count}" for name, count in words.most_common()) or "none"


def present(robots: list[str], counts: list[int], seeds: range) -> None:
    print(
        "| robot | configurations | nominal mm | found mm | bound mm | found / bound (worst) | "
        "unbiased mm | families missed |\n|---|---|---|---|---|---|---|---|"
    )
    intervals = {count: Intervals() for count in counts}
    for name in robots:
        robot = load_robot(name)
        for count in counts:
            found, missed = [], []
            for seed in seeds:
                truth = actual_robot(robot, seed, ERROR_KINDS)
                seen, fresh = measured(truth, seed, count), measured(truth, 1000 + seed, FRESH, 0.0)
                calibration = identify(seen)
                errors, setup = truth.actual.errors, truth.setup
                parameters = true_parameters(errors, setup)
                std = true_sizes(parameters, State(errors, setup).vector(parameters))
                poses = truth.actual.forward(fresh.q, fresh.conditions)
                nominal = (robot.mechanism.forward(fresh.q) - poses)[:, :3, 3]
                found.append(
                    (
                        float(np.linalg.norm(nominal, axis=-1).mean()),
                        mean_error(calibration, fresh),
                        expected_error(seen, fresh, parameters, std),
                        expected_error(seen, fresh, parameters, None),
                    )
                )
                missed.append(missed_and_false(calibration, errors)[0])
                intervals[count].add(calibration, errors)
            values = 1e3 * np.array(found)
            nominal_mm, found_mm, bound_mm, unbiased_mm = values.mean(axis=0)
            worst = (values[:, 1] / values[:, 2]).max()
            print(
                f"| {name} | {count} | {nominal_mm:.3f} | {found_mm:.4f} | {bound_mm:.4f} | "
                f"{found_mm / bound_mm:.2f} ({worst:.2f}) | {unbiased_mm:.4f} | "
                f"{counted(missed)} |",
                flush=True,
            )
    for count in counts:
        print(f"\n{count} configurations, {len(seeds)} robots of each kind")
        intervals[count].table()


def absent(robots: list[str], counts: list[int], seeds: range) -> None:
    print(
        "\n| robot | configurations | every family offered mm | geometry alone mm | cost (worst) | "
        "families falsely taken |\n|---|---|---|---|---|---|"
    )
    for name in robots:
        robot = load_robot(name)
        for count in counts:
            found, false = [], []
            for seed in seeds:
                truth = actual_robot(robot, seed, ("geometric",))
                seen, fresh = measured(truth, seed, count), measured(truth, 1000 + seed, FRESH, 0.0)
                calibration = identify(seen)
                found.append(
                    (mean_error(calibration, fresh), mean_error(identify(seen, GEOMETRY), fresh))
                )
                false.append(missed_and_false(calibration, truth.actual.errors)[1])
            values = 1e3 * np.array(found)
            every, alone = values.mean(axis=0)
            worst = (values[:, 0] / values[:, 1]).max()
            print(
                f"| {name} | {count} | {every:.4f} | {alone:.4f} | {100 * (every / alone - 1):+.1f}"
                f" % ({100 * (worst - 1):+.1f} %) | {counted(false)} |",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--robots", default="fanuc-m1000ia,ur10,panda")
    parser.add_argument("--configurations", help="comma-separated; 50,100,300, absent 20,50,100")
    parser.add_argument("--only", choices=["present", "absent"])
    options = parser.parse_args()
    robots = options.robots.split(",")
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    given = options.configurations
    for table, counts in ((present, [50, 100, 300]), (absent, [20, 50, 100])):
        if options.only in (None, table.__name__):
            table(robots, [int(n) for n in given.split(",")] if given else counts, seeds)


if __name__ == "__main__":
    main()
