"""Simulated measurements of an actual robot with errors."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from calibtool.errormodel.actual import ActualRobot, ErrorScales, random_actual
from calibtool.errormodel.operating_conditions import Conditions
from calibtool.errors import (
    InputError,
    NoSolutionError,
    check_choice,
    check_number,
    check_whole,
)
from calibtool.measurement.instruments import INSTRUMENTS, Cell, unknown
from calibtool.measurement.measurements import Measurements, Truth
from calibtool.measurement.registration import register
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.setup import Setup, check_targets
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, inverse, readonly, transform_points
from calibtool.robot.workspace import Workspace

SMALLEST_NOISE = 1e-9  # m: less counts as no noise
NO_NOISE = 1e-6  # m: stated where there is no noise, because the weights need a number
# Number of new draws for configurations at which loops of the actual robot do not close
_DRAWN_AGAIN = 20
ORIENTATION_NOISE = 0.1e-3  # rad: stated for 6-D instruments unless another value is given


@dataclass(frozen=True, eq=False)
class Simulation:
    """Options of a simulation.

    seed            of all random numbers
    configurations  number to sample in `workspace`
    workspace       a workspace of the robot or its name, `full` for the whole joint range; None is
                    the robot's default one, as on the command line
    scales          kinds and magnitudes of the errors of the actual robot
    noise           standard deviation per coordinate, m
    unregistered    instrument and targets are at random places that the estimators do not know
    at              (N, n) joint positions to measure at instead of sampled ones, rad or m
    same_robot      robot and set-up of an earlier simulation (`Measurements.truth`), measured again
    payload_kg      masses at the tool are drawn evenly between these two; None: that of the
                    description of the robot
    temperature_c   temperature of the links from the first to the last row, linear in between;
                    None: see `ActualRobot`
    instrument      `points` (the targets, by a tracker) or one of `instruments.INSTRUMENTS`
    places          of that instrument: placements, planes, boards, stations; of wires how many
    gauge           length of its gauge, m, see `Cell`
    """

    seed: int = 0
    configurations: int = 100
    workspace: Workspace | str | None = None
    scales: ErrorScales = field(default_factory=ErrorScales)
    noise: float = 0.05e-3
    unregistered: bool = False
    at: ArrayLike | None = None
    same_robot: Truth | None = None
    payload_kg: tuple[float, float] | None = None
    temperature_c: tuple[float, float] | None = None
    instrument: str = "points"
    places: int = 1
    gauge: float | None = None

    def __post_init__(self) -> None:
        check_whole(self.seed, "seed", 0)
        check_whole(self.configurations, "configurations", 1)
        check_number(self.noise, "noise", 0)
        check_whole(self.places, "places", 1)
        check_number(1.0 if self.gauge is None else self.gauge, "gauge", 1e-3)
        check_choice(self.instrument, ("points", *INSTRUMENTS), "instrument")


def simulate(robot: Robot, simulation: Simulation) -> Measurements:
    """Draw an actual robot, drive it to configurations and observe its targets with noise.

    Robot, configurations, noise and set-up have separate random streams, spawned from the seed. A
    robot that is measured again uses other streams than its first measurement, so that the same
    seed gives new configurations. Points (N, m, 3) are in the instrument's frame, which is K_0
    unless `unregistered`; units as in `Measurements`.

    Raises NoSolutionError when hardly any pose of the workspace can be reached, InputError for
    configurations (`at`) or targets that do not fit the robot.
    """
    again = simulation.same_robot is not None
    entropy = np.random.SeedSequence([simulation.seed, 1] if again else simulation.seed)
    robot_rng, configuration_rng, noise_rng, setup_rng, load_rng = (
        np.random.default_rng(s) for s in entropy.spawn(5)
    )

    truth = simulation.same_robot
    if truth is None or truth.setup.kind.id != "points":  # or it was seen by another instrument
        check_targets(robot.targets, f"{robot.name}: targets")
        setup = Setup(readonly(np.eye(4)), robot.targets)
        if simulation.unregistered:
            setup = _random_setup(setup, setup_rng)
        drawn = random_actual(robot, simulation.scales, robot_rng)
        truth = Truth(drawn if truth is None else truth.actual, setup)

    if simulation.instrument != "points":
        return _by_instrument(robot, simulation, truth.actual, configuration_rng)
    if simulation.at is not None:
        q = np.asarray(simulation.at, dtype=float)
        robot.check_positions(q, "configurations")
    else:
        q = _sampled(robot, simulation, truth.actual, configuration_rng)
    if not len(q):
        raise InputError("configurations: there is none to measure at")
    _check_closed(truth.actual, q)

    payload, temperature = simulation.payload_kg, simulation.temperature_c
    conditions = Conditions(
        payload_kg=None if payload is None else readonly(load_rng.uniform(*payload, len(q))),
        temperature_c=None if temperature is None else readonly(np.linspace(*temperature, len(q))),
    )
    points = observe(truth.actual, truth.setup, q, conditions)
    points = points + noise_rng.normal(size=points.shape) * simulation.noise
    known = truth.setup.known
    measurements = Measurements(
        robot=robot,
        q=readonly(q),
        points=readonly(points),
        rotations=None,
        setup=truth.setup if known else replace(truth.setup, T_instrument_base=readonly(np.eye(4))),
        noise_position=simulation.noise if simulation.noise > SMALLEST_NOISE else NO_NOISE,
        noise_orientation=ORIENTATION_NOISE,
        truth=truth,
        conditions=replace(conditions, direction=readonly(truth.actual.directions(q))),
    )
    return measurements if known else replace(measurements, setup=register(measurements))


def _sampled(
    robot: Robot, simulation: Simulation, actual: ActualRobot, rng: np.random.Generator
) -> Array:
    """Configurations of the workspace; with closed loops those at which the loops of the actual
    robot close.

    Raises NoSolutionError when too few are found.
    """
    wanted, workspace = simulation.configurations, simulation.workspace
    q: Array = sample_configurations(robot, workspace, wanted, rng)
    if robot.chain.tree is None:
        return q
    for _ in range(_DRAWN_AGAIN):
        q = q[actual.mechanism.closes(q)]
        if len(q) == wanted:
            return q
        q = np.concatenate([q, sample_configurations(robot, workspace, wanted - len(q), rng)])
    closes = int(actual.mechanism.closes(q).sum())
    if closes < wanted:
        raise NoSolutionError(
            f"{robot.name}: with these errors the loops close at only {closes} of {wanted} "
            "configurations; draw smaller errors, or another --seed"
        )
    return q


def _check_closed(actual: ActualRobot, q: Array) -> None:
    """InputError where closed loops do not close, of the nominal robot or of the actual one."""
    for whose, mechanism in (("nominal", actual.robot.mechanism), ("actual", actual.mechanism)):
        lost = np.flatnonzero(~mechanism.closes(q))
        if len(lost):
            raise InputError(
                f"configurations: row {lost[0] + 1}: the loops of the {whose} robot do not close "
                "at these joint positions "
                f"({len(lost)} of {len(q)} rows); leave them out, or measure inside the workspace"
            )


def _by_instrument(
    robot: Robot, simulation: Simulation, actual: ActualRobot, rng: np.random.Generator
) -> Measurements:
    """What another instrument than a tracker reads, see `instruments`; its set-up is registered."""
    if simulation.at is not None:
        raise InputError("configurations: the instrument chooses where the arm is measured")
    workspace = robot.workspace(simulation.workspace)
    cell = Cell(robot, actual, workspace, simulation.noise, simulation.gauge)
    read = INSTRUMENTS[simulation.instrument]
    seen = read(cell, simulation.configurations, simulation.places, rng)
    setup = replace(seen.setup, places=seen.places)
    measurements = Measurements(
        robot=robot,
        q=readonly(seen.q),
        points=readonly(seen.readings.points),
        rotations=None if seen.readings.rotations is None else readonly(seen.readings.rotations),
        setup=unknown(setup),
        noise_position=max(simulation.noise, NO_NOISE) if seen.noise is None else seen.noise,
        noise_orientation=ORIENTATION_NOISE
        if seen.deviations is None
        else float(np.median(seen.deviations[:, 3:])),
        truth=Truth(actual, setup),
        conditions=Conditions(direction=readonly(actual.directions(seen.q))),
        deviations=seen.deviations,
        values=None if seen.readings.values is None else readonly(seen.readings.values),
        place=seen.readings.place,
    )
    return replace(measurements, setup=register(measurements))


def observe(
    actual: ActualRobot, setup: Setup, q: Array, conditions: Conditions | None = None
) -> Array:
    """Target points (N, m, 3) in the instrument's frame, m, without noise, for q (N, n)."""
    return transform_points(setup.T_instrument_base @ actual.forward(q, conditions), setup.targets)


def _random_setup(nominal: Setup, rng: np.random.Generator) -> Setup:
    """An instrument up to 5 m away in any orientation, and targets moved together near the tool."""
    frame = exp6(np.concatenate([rng.normal(size=3), rng.normal(size=3)]))
    frame[:3, 3] = rng.uniform(-5, 5, 3)
    shift = exp6(np.concatenate([np.zeros(3), rng.normal(size=3)]))
    shift[:3, 3] = rng.uniform(-0.2, 0.2, 3)
    return Setup(
        readonly(inverse(frame)),
        readonly(transform_points(shift, nominal.targets)),
        frame_known=False,
        targets_known=False,
    )
