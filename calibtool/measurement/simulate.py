"""Simulated measurements of an actual robot with errors."""

from dataclasses import dataclass, field, replace

import numpy as np

from calibtool.errormodel.actual import ActualRobot, ErrorScales, random_actual
from calibtool.errormodel.operating_conditions import Conditions
from calibtool.errors import InputError, check_number
from calibtool.measurement.measurements import Measurements, Setup, Truth, check_targets
from calibtool.measurement.registration import register
from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.description import Workspace
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, inverse, readonly, transform_points

SMALLEST_NOISE, NO_NOISE = (
    1e-9,
    1e-6,
)  # m: less is none at all, for which the weights still need a figure
ORIENTATION_NOISE = 0.1e-3  # rad, stated for 6-D instruments unless told otherwise


@dataclass(frozen=True, eq=False)
class Simulation:
    """Options of a simulation.

    seed            of all random numbers
    configurations  number to sample in `workspace` (None: the whole joint range)
    scales          kinds and magnitudes of the errors of the actual robot
    noise           standard deviation per coordinate, m
    unregistered    instrument and targets are at random places that the estimators do not know
    at              (N, n) joint positions to measure at instead of sampled ones, rad or m
    same_robot      robot and set-up of an earlier simulation (`Measurements.truth`), measured again
    payload_kg      masses at the tool are drawn evenly between these two; None: that of the
                    description of the robot
    temperature_c   temperature of the links from the first to the last row, linear in between;
                    None: see `ActualRobot`
    """

    seed: int = 0
    configurations: int = 100
    workspace: Workspace | None = None
    scales: ErrorScales = field(default_factory=ErrorScales)
    noise: float = 0.05e-3
    unregistered: bool = False
    at: Array | None = None
    same_robot: Truth | None = None
    payload_kg: tuple[float, float] | None = None
    temperature_c: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_number(self.seed, "seed", 0)
        check_number(self.configurations, "configurations", 1)
        check_number(self.noise, "noise", 0)


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

    if simulation.same_robot is not None:
        truth = simulation.same_robot
    else:
        check_targets(robot.targets, f"{robot.name}: targets")
        setup = Setup(readonly(np.eye(4)), robot.targets)
        if simulation.unregistered:
            setup = _random_setup(setup, setup_rng)
        truth = Truth(random_actual(robot, simulation.scales, robot_rng), setup)

    if simulation.at is not None:
        q = simulation.at
        robot.check_positions(q, "configurations")
    else:
        q = sample_configurations(
            robot, simulation.workspace, simulation.configurations, configuration_rng
        )
    if not len(q):
        raise InputError("configurations: there is none to measure at")

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


def observe(
    actual: ActualRobot, setup: Setup, q: Array, conditions: Conditions | None = None
) -> Array:
    """Target points (N, m, 3) in the instrument's frame, m, without noise, for q (N, n) in rad or
    m.
    """
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
