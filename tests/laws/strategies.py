"""Drawn robots: serial chains of 1 to 8 joints as URDF text, the carried robots, and errors, set-ups and rows for them."""

from dataclasses import dataclass, replace

import numpy as np
from hypothesis import assume, settings
from hypothesis import strategies as st
from plain import PlainChain, read_urdf

from calibtool.calibration import Calibration, identify
from calibtool.equivalent.network import Network, initial_network
from calibtool.measurement.measurements import Measurements, Setup, Truth
from calibtool.robot.actual import ERROR_KINDS, ActualRobot, ErrorScales, random_actual
from calibtool.robot.catalogue import load_robot, robot_names
from calibtool.robot.description import parse_source
from calibtool.robot.geometry import GeometricErrors
from calibtool.robot.mechanism import MIN_SINGULARITY_DISTANCE
from calibtool.robot.model import Robot
from calibtool.robot.motion import JointMotion, load_carrying
from calibtool.robot.se3 import Array, exp6, readonly, transform_points

seeds = st.integers(0, 2**32 - 1)


def examples(count: int) -> settings:
    """So many cases of a law; fifty times as many under the profile `thorough`."""
    return settings(max_examples=count * settings.default.max_examples // 100)


LIMITS = {"revolute": (-2.5, 2.8), "prismatic": (-0.1, 0.1)}  # robot.toml has those of slides, which are scaled
SIMPLE_AXES = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1), (-1, 0, 0)]


@dataclass(frozen=True)
class DrawnJoint:
    """A joint of a drawn chain: origin in the joint before (m, rad), axis of any length."""

    kind: str
    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]
    axis: tuple[float, float, float]
    mass: float


@dataclass(frozen=True)
class DrawnChain:
    """Text of a chain can be written with other names, another base before it, or other lengths."""

    joints: tuple[DrawnJoint, ...]
    tool: DrawnJoint
    targets_mm: tuple[tuple[float, float, float], ...]

    def robot(
        self, *, tool_name: str = "tool0", base: Array | None = None, base_frame: str | None = None, scale: float = 1.0
    ) -> Robot:
        """base: xyz and rpy (6,) of the chain on a further link `world`; scale: of every length (densities stay)."""
        key = f'base_frame = "{base_frame}"\n' if base_frame else ""
        limits = "".join(
            f"j{i + 1}_mm = [{-400 * scale!r}, {600 * scale!r}]\n"
            for i, joint in enumerate(self.joints)
            if joint.kind == "prismatic"
        )
        points = [[float(c) * scale for c in point] for point in self.targets_mm]
        toml = (
            f'name = "drawn"\ntitle = "drawn"\n[kinematics]\nurdf = "robot.urdf"\ntool_frame = "{tool_name}"\n{key}'
            f"[targets]\npoints_mm = {points}\n[limits]\n{limits}"
            f"[tolerances]\nlength_mm = {scale!r}\n"
        )
        return Robot.from_source(parse_source(toml, self.urdf(tool_name, base, scale), "drawn"))

    def urdf(self, tool_name: str, base: Array | None, scale: float) -> str:
        """The text of a URDF: links base, l1 … ln, a link of a fixed joint, the tool."""
        links, joints = ['<link name="base"/>'], []
        if base is not None:
            links.append('<link name="world"/>')
            joints.append(_joint("stand", "fixed", "world", "base", tuple(base[:3]), tuple(base[3:]), None))
        parent = "base"
        for i, joint in enumerate(self.joints, start=1):
            inertial = (
                f'<inertial><origin xyz="0 0 {0.1 * scale!r}"/><mass value="{joint.mass!r}"/>'
                '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
            )
            links.append(f'<link name="l{i}">{inertial if joint.mass else ""}</link>')
            xyz = tuple(scale * c for c in joint.xyz)
            joints.append(_joint(f"joint_{i}", joint.kind, parent, f"l{i}", xyz, joint.rpy, joint.axis))
            parent = f"l{i}"
        links += ['<link name="flange"/>', f'<link name="{tool_name}"/>']
        xyz = tuple(scale * c for c in self.tool.xyz)
        joints.append(_joint("to_flange", "fixed", parent, "flange", xyz, (0.0, 0.0, 0.0), None))
        joints.append(_joint("to_tool", "fixed", "flange", tool_name, (0.0, 0.0, 0.0), self.tool.rpy, None))
        return '<robot name="drawn">' + "".join(links + joints) + "</robot>"


def _joint(name: str, kind: str, parent: str, child: str, xyz: tuple, rpy: tuple, axis: tuple | None) -> str:
    def words(values: tuple) -> str:
        return " ".join(repr(float(value)) for value in values)

    parts = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{words(xyz)}" rpy="{words(rpy)}"/>'
    if axis is not None:
        parts += f'<axis xyz="{words(axis)}"/>'
    if kind in LIMITS:
        parts += '<limit lower="{}" upper="{}" effort="0" velocity="0"/>'.format(*LIMITS[kind])
    return f'<joint name="{name}" type="{kind}">{parts}</joint>'


def _lengths(bound: float) -> st.SearchStrategy[float]:
    return st.floats(-bound, bound).map(lambda x: round(x, 4))


def _triples(values: st.SearchStrategy) -> st.SearchStrategy[tuple]:
    return st.tuples(values, values, values)


angles = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi]) | _lengths(3.0)
axes = st.sampled_from(SIMPLE_AXES) | _triples(_lengths(1.0)).filter(lambda a: np.linalg.norm(a) > 0.1)


@st.composite
def drawn_joints(draw: st.DrawFn, kinds: tuple[str, ...] = ("revolute", "continuous", "prismatic")) -> DrawnJoint:
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
    draw: st.DrawFn, smallest: int = 1, largest: int = 8, kinds: tuple = ("revolute", "continuous", "prismatic")
) -> DrawnChain:
    """Chains whose links are together at least 0.1 m long."""
    joints = draw(st.lists(drawn_joints(kinds), min_size=smallest, max_size=largest))
    tool = replace(draw(drawn_joints()), xyz=draw(_triples(_lengths(0.4)).filter(lambda x: np.linalg.norm(x) > 0.1)))
    height = draw(_lengths(100.0))
    return DrawnChain(tuple(joints), tool, ((100.0, 0.0, height), (-50.0, 86.6, height), (-50.0, -86.6, height)))


carried = st.sampled_from(robot_names()).map(load_robot)


def robots(largest: int = 8) -> st.SearchStrategy[Robot]:
    """Carried robots and drawn chains."""
    return carried | drawn_chains(largest=largest).map(DrawnChain.robot)


def plain_chain(robot: Robot) -> PlainChain:
    """The same robot, read by the second reader."""
    kinematics = robot.source.description.kinematics
    return read_urdf(robot.source.urdf_text, kinematics.base_frame, kinematics.tool_frame, kinematics.locked_joints)


def configurations(robot: Robot, count: int, rng: np.random.Generator) -> Array:
    """Uniform over the joint range: (count, n)."""
    return robot.lower + (robot.upper - robot.lower) * rng.random((count, robot.n))


def geometric(robot: Robot, rng: np.random.Generator, size: float = 1e-3) -> GeometricErrors:
    """Errors in every element: δξ makes revolute joints helical, and slides slightly turning."""
    n = robot.n
    return GeometricErrors(*(readonly(size * rng.normal(size=shape)) for shape in ((n + 1, 6), (n, 6), (n,))))


def motion(robot: Robot, rng: np.random.Generator, orders: int = 2) -> JointMotion:
    """Harmonics of the turning joints and wind-up of those that carry load."""
    turning = ~np.array(robot.prismatic)
    compliance = np.where(load_carrying(robot), 1e-6 * rng.normal(size=robot.n), 0.0)
    harmonics = 3e-4 * rng.normal(size=(robot.n, 2 * orders)) * turning[:, None]
    return JointMotion(readonly(harmonics), readonly(compliance))


def network(robot: Robot, outputs: int, q: Array, rng: np.random.Generator) -> Network:
    """Random weights, corrections of a tenth of a milliradian or millimetre."""
    return initial_network(q, np.full(outputs, 1e-4), int(rng.integers(1, 6)), rng)


def assume_regular(robot: Robot) -> None:
    """Leave out robots that are singular nearly everywhere, as with two slides side by side."""
    q = configurations(robot, 100, np.random.default_rng(0))
    assume((robot.singularity_distance(q) > MIN_SINGULARITY_DISTANCE).mean() > 0.1)


def perfect(robot: Robot) -> ActualRobot:
    """An actual robot without any error."""
    n = robot.n
    return ActualRobot(robot, GeometricErrors.none(n), np.zeros((n, 4)), np.zeros(n), np.zeros(n), 0.0)


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
    """What an instrument at T_instrument_base = `frame`, known, sees of an actual robot; `pose`: one 6-D sensor."""
    frame = np.eye(4) if frame is None else frame
    poses = frame @ actual.forward(q)
    stated = max(noise, 1e-6)
    setup = Setup(readonly(frame), robot.targets)
    rotations = None
    if pose:
        sensor = exp6(np.concatenate([np.zeros(3), rng.normal(size=3)]))[:3, :3]
        setup = Setup(readonly(frame), robot.targets[:1], readonly(sensor))
        turns = np.concatenate([np.zeros((len(q), 3)), noise * rng.normal(size=(len(q), 3))], axis=-1)
        rotations = readonly(exp6(turns)[:, :3, :3] @ poses[:, :3, :3] @ sensor)
    points = transform_points(poses, setup.targets)
    points = readonly(points + noise * rng.normal(size=points.shape))
    return Measurements(robot, readonly(q), points, rotations, setup, stated, stated, Truth(actual, setup))


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
    return measured(robot, configurations(robot, count, rng), actual, rng, noise=noise, pose=pose, frame=frame)


def calibrated(
    robot: Robot, rng: np.random.Generator, *, with_network: bool = True, with_motion: bool = True, size: float = 1e-3
) -> Calibration:
    """A calibration with made-up errors of every kind: what it predicts is known without any fit."""
    assume_regular(robot)
    q = configurations(robot, 20, rng)
    plain = identify(measured(robot, q, perfect(robot), rng), "nominal")
    base = replace(
        plain.base,
        model="complete",
        geometry=geometric(robot, rng, size),
        motion=motion(robot, rng) if with_motion else JointMotion.none(robot.n),
    )
    networks = (network(robot, plain.equivalent.p, q, rng),) if with_network else ()
    return replace(plain, base=base, networks=networks)
