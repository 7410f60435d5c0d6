"""Drawn robots: serial chains of 1 to 8 joints as URDF text, the built-in robots, and errors,
set-ups and rows for them.
"""

from dataclasses import replace

import numpy as np
from drawn import DrawnChain, DrawnJoint
from hypothesis import assume
from hypothesis import strategies as st
from plain import PlainChain, read_urdf

from calibtool.calibration import Calibration, identify
from calibtool.equivalent.network import Network
from calibtool.errormodel.actual import ActualRobot, ErrorScales, random_actual
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.measurement.measurements import Measurements, Truth
from calibtool.measurement.setup import Setup
from calibtool.robot.catalogue import load_robot, robot_names
from calibtool.robot.gravity_torque import load_carrying
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, readonly, transform_points
from calibtool.robot.singularity import MIN_SINGULARITY_DISTANCE

seeds = st.integers(0, 2**32 - 1)


SIMPLE_AXES = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1), (-1, 0, 0)]


def _lengths(bound: float) -> st.SearchStrategy[float]:
    return st.floats(-bound, bound).map(lambda x: round(x, 4))


def _triples(values: st.SearchStrategy) -> st.SearchStrategy[tuple]:
    return st.tuples(values, values, values)


angles = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi]) | _lengths(3.0)
axes = st.sampled_from(SIMPLE_AXES) | _triples(_lengths(1.0)).filter(
    lambda a: np.linalg.norm(a) > 0.1
)


@st.composite
def drawn_joints(
    draw: st.DrawFn, kinds: tuple[str, ...] = ("revolute", "continuous", "prismatic")
) -> DrawnJoint:
    """Right angles and parallel or crossing axes are as likely as skew ones."""
    return DrawnJoint(
        draw(st.sampled_from(kinds)),
        draw(_triples(st.just(0.0) | _lengths(0.8))),
        draw(_triples(angles)),
        draw(axes),
        draw(st.sampled_from([0.0, 1.0, 20.0])),
    )


@st.composite
def drawn_chains(
    draw: st.DrawFn,
    smallest: int = 1,
    largest: int = 8,
    kinds: tuple = ("revolute", "continuous", "prismatic"),
) -> DrawnChain:
    """Chains whose links are together at least 0.1 m long."""
    joints = draw(st.lists(drawn_joints(kinds), min_size=smallest, max_size=largest))
    tool = replace(
        draw(drawn_joints()),
        xyz=draw(_triples(_lengths(0.4)).filter(lambda x: np.linalg.norm(x) > 0.1)),
    )
    height = draw(_lengths(100.0))
    return DrawnChain(
        tuple(joints), tool, ((100.0, 0.0, height), (-50.0, 86.6, height), (-50.0, -86.6, height))
    )


built_in = st.sampled_from(
    [name for name in robot_names() if load_robot(name).chain.tree is None]
).map(load_robot)


def robots(largest: int = 8) -> st.SearchStrategy[Robot]:
    """Built-in robots and drawn chains."""
    return built_in | drawn_chains(largest=largest).map(DrawnChain.robot)


def plain_chain(robot: Robot) -> PlainChain:
    """The same robot, read by the second reader."""
    kinematics = robot.source.description.kinematics
    return read_urdf(
        robot.source.urdf_text,
        kinematics.base_frame,
        kinematics.tool_frame,
        kinematics.locked_joints,
    )


def configurations(robot: Robot, count: int, rng: np.random.Generator) -> Array:
    """Uniform over the joint range: (count, n)."""
    return robot.lower + (robot.upper - robot.lower) * rng.random((count, robot.n))


def geometric(robot: Robot, rng: np.random.Generator, size: float = 1e-3) -> RobotErrors:
    """Errors in every element: δξ makes revolute joints helical, and slides slightly turning."""
    shapes = {"placements": (robot.n + 1, 6), "twists": (robot.n, 6), "offsets": (robot.n,)}
    return RobotErrors.of(
        robot, **{name: size * rng.normal(size=shape) for name, shape in shapes.items()}
    )


def with_motion_errors(
    errors: RobotErrors, rng: np.random.Generator, orders: int = 2
) -> RobotErrors:
    """Harmonics of the turning joints and wind-up of those that carry load, added."""
    robot = errors.robot
    turning = ~np.array(robot.prismatic)
    compliance = np.where(load_carrying(robot), 1e-6 * rng.normal(size=robot.n), 0.0)
    harmonics = 3e-4 * rng.normal(size=(robot.n, 2 * orders)) * turning[:, None]
    return errors.having(harmonics=harmonics, gravity=compliance)


def network(robot: Robot, outputs: int, q: Array, rng: np.random.Generator) -> Network:
    """Random weights, corrections of a tenth of a milliradian or millimetre."""
    return Network.initial(q, np.full(outputs, 1e-4), int(rng.integers(1, 6)), rng)


def assume_regular(robot: Robot) -> None:
    """Leave out robots that are singular nearly everywhere, as with two slides side by side."""
    q = configurations(robot, 100, np.random.default_rng(0))
    assume((robot.singularity_distance(q) > MIN_SINGULARITY_DISTANCE).mean() > 0.1)


def perfect(robot: Robot) -> ActualRobot:
    """An actual robot without any error."""
    return ActualRobot(RobotErrors.of(robot))


def measured(
    robot: Robot,
    q: Array,
    actual: ActualRobot,
    rng: np.random.Generator,
    *,
    noise: float = 0.0,
    pose: bool = False,
    frame: Array | None = None,
) -> Measurements:
    """What an instrument at T_instrument_base = `frame`, known, sees of an actual robot;
    `pose`: one 6-D sensor.
    """
    frame = np.eye(4) if frame is None else frame
    poses = frame @ actual.forward(q)
    stated = max(noise, 1e-6)
    setup = Setup(readonly(frame), robot.targets)
    rotations = None
    if pose:
        sensor = exp6(np.concatenate([np.zeros(3), rng.normal(size=3)]))[:3, :3]
        setup = Setup(readonly(frame), robot.targets[:1], readonly(sensor))
        turns = np.concatenate(
            [np.zeros((len(q), 3)), noise * rng.normal(size=(len(q), 3))], axis=-1
        )
        rotations = readonly(exp6(turns)[:, :3, :3] @ poses[:, :3, :3] @ sensor)
    points = transform_points(poses, setup.targets)
    points = readonly(points + noise * rng.normal(size=points.shape))
    return Measurements(
        robot, readonly(q), points, rotations, setup, stated, stated, Truth(actual, setup)
    )


def simulated(
    robot: Robot,
    rng: np.random.Generator,
    count: int = 20,
    *,
    noise: float = 0.05e-3,
    scales: ErrorScales | None = None,
    pose: bool = False,
    frame: Array | None = None,
) -> Measurements:
    """A random actual robot, measured all over its joint range."""
    actual = random_actual(robot, ErrorScales(kinds=ERROR_KINDS) if scales is None else scales, rng)
    return measured(
        robot, configurations(robot, count, rng), actual, rng, noise=noise, pose=pose, frame=frame
    )


def calibrated(
    robot: Robot,
    rng: np.random.Generator,
    *,
    with_network: bool = True,
    with_motion: bool = True,
    size: float = 1e-3,
) -> Calibration:
    """A calibration with made-up errors of every kind: what it predicts
    is known without any fit.
    """
    assume_regular(robot)
    q = configurations(robot, 20, rng)
    plain = identify(measured(robot, q, perfect(robot), rng), "nominal")
    errors = geometric(robot, rng, size)
    base = replace(
        plain.base,
        model="complete",
        errors=with_motion_errors(errors, rng) if with_motion else errors,
    )
    networks = (network(robot, plain.equivalent.p, q, rng),) if with_network else ()
    return replace(plain, base=base, networks=networks)
