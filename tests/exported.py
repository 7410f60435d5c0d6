"""Calibrations for the tests of exports: small, quick to make, and with every part that an
export may have.
"""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify, train
from calibtool.compensation.one_step import Linearised, default_bounds
from calibtool.equivalent.gaussian_process import GaussianProcess
from calibtool.equivalent.network import Network
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.families import BY_ID
from calibtool.errormodel.operating_conditions import Conditions
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errormodel.tolerances import Tolerances
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array
from calibtool.robot.singularity import MIN_SINGULARITY_DISTANCE

REGULAR = (
    2 * MIN_SINGULARITY_DISTANCE
)  # here answers are compared to the last digits; nearer, rounding is magnified
STATUS = (
    "ok",
    "near-singular",
    "not-finite",
    "partial",
    "limited",
    "out-of-limits",
    "uncorrected",
)  # by their codes

# robot, base model, with a network
CASES = [
    ("fanuc-m1000ia", "nominal", True),
    ("fanuc-m1000ia", "nominal", False),
    ("fanuc-m1000ia", "local-poe", True),
    ("fanuc-m1000ia", "local-poe", False),
    ("fanuc-m1000ia", "everything", True),
    ("scara", "local-poe", True),
    ("gantry", "local-poe", True),
    ("scara", "everything", True),
    ("gantry", "everything", True),
    ("panda", "everything", True),
    ("panda", "nominal", True),
    ("scara", "nominal", True),
    ("fanuc-m1000ia", "process", True),
    ("scara", "process", True),
]


@cache
def calibrated(name: str, base: str, network: bool) -> Calibration:
    """A calibration from 60 simulated configurations; the network is a small random one where none
    was worth keeping.

    `process`: a Gaussian process in place of the network. `everything`: random geometric errors of
    all kinds, 32 harmonics per revolute joint, functions of pairs of joints, and wind-up under
    gravity.
    """
    robot = load_robot(name)
    measurements = simulate(robot, Simulation(configurations=60))
    model = "nominal" if base == "nominal" else "local-poe"
    if not network:
        return identify(measurements, model)
    calibration = train(
        measurements, model, TrainingOptions(regularisation="early-stopping", restarts=2)
    )
    rng = np.random.default_rng(1)
    if calibration.network is None:
        scale = np.full(calibration.equivalent.p, 1e-3)
        calibration = replace(
            calibration, networks=(Network.initial(measurements.q, scale, 5, rng),)
        )
    if base == "process":
        p, points = calibration.equivalent.p, measurements.q[:20]
        centre, scale = measurements.q.mean(axis=0), np.ptp(measurements.q, axis=0) / 3
        process = GaussianProcess(
            input_centre=centre,
            input_scale=scale,
            points=(points - centre) / scale,
            output_weights=rng.normal(size=(p, len(points))),
            output_scale=np.full(p, 1e-3),
        )
        calibration = replace(calibration, networks=(process,))
    if base == "everything":
        errors = [
            rng.normal(size=shape) * 1e-3 for shape in ((robot.n + 1, 6), (robot.n, 6), (robot.n,))
        ]
        shape = BY_ID["pairs"].shape(robot.n)
        revolute = ~np.array(robot.prismatic)
        drawn = RobotErrors.of(
            robot,
            **dict(zip(("placements", "twists", "offsets"), errors, strict=True)),
            harmonics=rng.normal(size=(robot.n, 64)) * 1e-4 * revolute[:, None],
            gravity=rng.random(robot.n) * 1e-6 * revolute,
            pairs=rng.normal(size=shape) * 2e-5 * BY_ID["pairs"].free(robot, shape),
        )
        identified = replace(calibration.base, model="complete", errors=drawn)
        calibration = replace(calibration, base=identified)
    return calibration


# Those with a base model to which `turning` adds
TURNING_CASES = [case for case in CASES if case[1] == "everything"]


@cache
def turning(name: str, base: str, network: bool) -> Calibration:
    """The same with random payload, bending, wobble and growth, at 8 kg and 45 °C."""
    calibration = calibrated(name, base, network)
    n, rng = calibration.robot.n, np.random.default_rng(3)
    errors = calibration.base.errors.having(
        payload=rng.uniform(1, 5, (n, 2)) * 1e-6,
        temperature=rng.uniform(5, 25, n + 1) * 1e-6,
        bending=rng.normal(size=(n, 2)) * 1e-8,
        wobble=rng.normal(size=(n, 4)) * 3e-4,
    )
    return _loaded(calibration, errors)


@cache
def turning_by(family: str) -> Calibration:
    """One family of errors of the size of its tolerances alone beside the geometry, at 8 kg and
    45 °C.
    """
    calibration = calibrated("fanuc-m1000ia", "local-poe", False)
    robot = calibration.robot
    shape = BY_ID[family].shape(robot.n)
    drawn = np.random.default_rng(5).normal(size=shape)
    value = drawn * BY_ID[family].tolerance(robot, Tolerances(), shape)
    held = np.where(np.abs(value) < 1.0, value, 0.0)  # a joint without a moment has no tolerance
    return _loaded(calibration, calibration.base.errors.having(**{family: held}))


def _loaded(calibration: Calibration, errors: RobotErrors) -> Calibration:
    conditions = Conditions(payload_kg=np.array(8.0), temperature_c=np.array(45.0))
    return replace(calibration, base=replace(calibration.base, errors=errors)).at(conditions)


def anywhere(calibration: Calibration, count: int) -> Array:
    """Random configurations of the whole joint range."""
    robot = calibration.robot
    return robot.lower + (robot.upper - robot.lower) * np.random.default_rng(2).random(
        (count, robot.n)
    )


def undisturbed(calibration: Calibration, q: Array) -> np.ndarray:
    """Rows far from singularities in which no joint is held: rounding is not magnified there.

    (N,) bool
    """
    proposal, _ = Linearised.at(calibration, q, None, default_bounds(calibration)).proposed()
    lower, upper = proposal.box
    inside = ((proposal.change > lower) & (proposal.change < upper)).all(axis=1) | (
        proposal.change == 0
    ).all(axis=1)
    return np.asarray(inside & (proposal.distance >= REGULAR))


def weighted_sizes(calibration: Calibration, q: Array, commanded: Array) -> Array:
    """Size of the weighted pose error of the calibrated robot at q against the nominal one at
    `commanded`, rad: (N,).
    """
    robot = calibration.robot
    pose, aim = calibration.forward(q), robot.mechanism.forward(commanded)
    turn = Rotation.from_matrix(pose[:, :3, :3] @ np.swapaxes(aim[:, :3, :3], 1, 2)).magnitude()
    return np.hypot(np.linalg.norm(pose[:, :3, 3] - aim[:, :3, 3], axis=1) / robot.length, turn)
