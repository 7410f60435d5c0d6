"""The actual robot of a simulation (METHOD §2): geometric errors, and the physical effects that depend on the motion."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from calibtool.errors import check_choice, check_number
from calibtool.robot.geometry import GeometricErrors, mechanism
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.model import Robot
from calibtool.robot.motion import JointMotion, directions, largest_torque, load_carrying
from calibtool.robot.se3 import Array, exp6, inverse, log6, readonly

ERROR_KINDS = ("geometric", "gear", "gravity", "backlash", "thermal")

STEEL_EXPANSION = 12e-6  # per K


@dataclass(frozen=True)
class ErrorScales:
    """Sizes of the simulated errors, in SI; a kind that is not in `kinds` is absent.

    length, angle  standard deviation of every element of δζ, δξ, δq: m and rad (a prismatic offset is a length)
    gear           standard deviation of each coefficient of the first and second harmonic, rad
    gravity        wind-up of each load-carrying joint at its largest static torque, rad
    backlash       half width, rad (m per metre-sized prismatic axis: the same figure)
    temperature    rise in K on steel links
    """

    kinds: tuple[str, ...] = ("geometric",)
    length: float = 0.5e-3
    angle: float = 0.5e-3
    gear: float = 0.2e-3
    gravity: float = 0.5e-3
    backlash: float = 0.1e-3
    temperature: float = 10.0

    def __post_init__(self) -> None:
        for kind in self.kinds:
            check_choice(kind, ERROR_KINDS, "kind of error")
        for name in ("length", "angle", "gear", "gravity", "backlash"):
            check_number(getattr(self, name), name, 0)


@dataclass(frozen=True, eq=False)
class ActualRobot:
    """A robot whose geometry and joint motions differ from the drawing; exact, nothing is linearised.

    geometry    δζ, δξ, δq
    gear        (n, 4) a1, b1, a2, b2 in rad: δq_j += a1 sin q + b1 cos q + a2 sin 2q + b2 cos 2q
    compliance  (n,) c_j in rad per N m (see `gravity_torque`): δq_j −= c_j · τ_g,j(q)
    backlash    (n,) half width in rad or m: δq_j −= half width · direction of the last motion
    expansion   relative growth of every link along itself
    """

    robot: Robot
    geometry: GeometricErrors
    gear: Array
    compliance: Array
    backlash: Array
    expansion: float

    @cached_property
    def mechanism(self) -> Mechanism:
        """The chain of grown links with the geometric errors."""
        chain = self.robot.chain
        grown = chain.placements.copy()
        grown[:, :3, 3] *= 1.0 + self.expansion
        placements = log6(inverse(chain.placements) @ grown @ exp6(self.geometry.placements))
        return mechanism(chain, GeometricErrors(placements, self.geometry.twists, self.geometry.offsets))

    @property
    def model(self) -> pin.Model:
        """The geometry as a Pinocchio model of its own, limits included; `mechanism.configuration` gives its coordinates.

        What depends on the joint positions or on time (gear, gravity, backlash) is not in it: see `joint_motion`.
        """
        return self.mechanism.as_model(self.robot.lower, self.robot.upper)

    def joint_motion(self, q: Array) -> Array:
        """Error δq(q) of the joint motions beyond the constant offsets, q (N, n) in the order of measuring: (N, n).

        Backlash takes the direction of each joint's last motion from the rows before; the first row comes from home.
        """
        return JointMotion(self.gear, self.compliance, self.backlash).errors(self.robot, q, self.directions(q))

    def directions(self, q: Array) -> Array:
        """Direction of each joint's last motion (N, n) when the joints are driven to q (N, n) in order, from home."""
        return directions(q, start=self.robot.home(self.robot.workspace(None)[1]))

    def forward(self, q: Array) -> Array:
        """Actual T_base_tool when the joints are commanded to q (N, n): (N, 4, 4)."""
        return self.mechanism.forward(q + self.joint_motion(q))


def random_actual(robot: Robot, scales: ErrorScales, rng: np.random.Generator) -> ActualRobot:
    """Draw an actual robot. Every kind has its own stream, so that adding one leaves the others as they were."""
    n = robot.n
    streams = dict(zip(ERROR_KINDS, rng.spawn(len(ERROR_KINDS)), strict=True))
    length, angle = scales.length, scales.angle
    geometry = GeometricErrors.none(n)
    if "geometric" in scales.kinds:
        stream = streams["geometric"]
        sizes = np.repeat([length, angle], 3)
        geometry = GeometricErrors(
            placements=readonly(stream.normal(size=(n + 1, 6)) * sizes),
            twists=readonly(stream.normal(size=(n, 6)) * sizes),
            offsets=readonly(stream.normal(size=n) * np.where(robot.prismatic, length, angle)),
        )
    revolute = ~np.array(robot.prismatic)
    gear = np.zeros((n, 4))
    if "gear" in scales.kinds:
        gear = streams["gear"].normal(size=(n, 4)) * scales.gear * revolute[:, None]
    compliance = np.zeros(n)
    if "gravity" in scales.kinds:
        carrying = load_carrying(robot)
        compliance[carrying] = scales.gravity / largest_torque(robot)[carrying]
    return ActualRobot(
        robot=robot,
        geometry=geometry,
        gear=readonly(gear),
        compliance=readonly(compliance),
        backlash=readonly(np.full(n, scales.backlash if "backlash" in scales.kinds else 0.0)),
        expansion=STEEL_EXPANSION * scales.temperature if "thermal" in scales.kinds else 0.0,
    )
