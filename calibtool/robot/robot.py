"""The nominal robot: its description, serial chain and derived quantities."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from calibtool.errors import InputError, UsageError, near_names
from calibtool.robot.chain import NO_LIMITS, SerialChain
from calibtool.robot.closed import ClosedMechanism
from calibtool.robot.closed_chain import ClosedChain, chain_of
from calibtool.robot.coupling import (
    JointValues,
    check_joint_values,
    coupling_matrix,
    settled_values,
)
from calibtool.robot.mechanism import Mechanism
from calibtool.robot.se3 import Array, readonly
from calibtool.robot.singularity import (
    MIN_SINGULARITY_DISTANCE,
    at_point,
    singularity_distance,
)
from calibtool.robot.source import Source
from calibtool.robot.tree import UNBOUNDED
from calibtool.robot.workspace import Workspace
from calibtool.units import joint_and_factor, joint_values

# Times the usual gain of closed loops: a tool that moves farther is near a singularity of type 2,
# where a robot with errors may not close.
_LARGEST_GAIN = 2.0
LONGEST = 10.0  # m: characteristic length of a robot with slides


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """The nominal robot. Joint positions q are (N, n), in rad, or m for a prismatic joint.

    source   description and texts that it was built from
    chain    placements and twists of its joints, from K_0 to the tool: serial, or with closed loops
    lower, upper   (n,) joint limits, rad or m
    """

    source: Source
    chain: SerialChain | ClosedChain
    lower: Array  # (n,) joint limits
    upper: Array

    def __repr__(self) -> str:
        kinds = "".join("P" if prismatic else "R" for prismatic in self.prismatic)
        return f"<Robot {self.name}: {kinds}>"

    @classmethod
    def from_source(cls, source: Source) -> "Robot":
        """Build the robot and check the parts of the description that need the joints.

        Raises InputError.
        """
        chain = chain_of(source)
        description = source.description
        prismatic = _prismatic(chain)
        lower, upper = chain.lower.copy(), chain.upper.copy()
        seen: set[int] = set()
        for name, (low, high) in description.limits.items():
            place = f"{source.place}: limits"
            index, factor = joint_and_factor(name, prismatic, place)
            if index in seen:
                raise InputError(f"{place}: joint {index + 1} is given twice, again by '{name}'")
            seen.add(index)
            if not low < high:
                raise InputError(
                    f"{place}.{name}: the lower limit {low:g} is not below the upper limit {high:g}"
                )
            lower[index], upper[index] = low * factor, high * factor
            if prismatic[index] and max(-lower[index], upper[index]) > UNBOUNDED:
                raise InputError(
                    f"{place}.{name}: {low:g} to {high:g} is beyond a kilometre; give the stroke"
                )
        for unlimited in np.flatnonzero(np.isnan(lower)):
            j = int(unlimited) + 1
            raise InputError(
                f"{source.place}: slide '{chain.bodies.joints[j - 1]}' "
                f"{NO_LIMITS[chain.limited_by[j - 1]]} in the URDF; give them in robot.toml: "
                f"[limits] j{j}_mm = [lower, upper]"
            )
        for name, workspace in description.workspaces.items():
            joint_values(workspace.home, prismatic, f"{source.place}: workspaces.{name}.home")
        n = len(prismatic)
        for name in description.tolerances.joints:
            if int(name[1:]) > n + 1:
                raise InputError(
                    f"{source.place}: tolerances.joints.{name}: the robot has {n} joints "
                    f"(j{n + 1} is the tool)"
                )
        if description.equivalent is not None and len(
            set(description.equivalent.virtual_joints)
        ) != max(6 - n, 0):
            raise InputError(
                f"{source.place}: equivalent.virtual_joints: {max(6 - n, 0)} different "
                "ones are needed"
            )
        coupling_matrix(description, n, source.place)
        for name, joint in description.external.items():
            if int(joint[1:]) > n or list(description.external.values()).count(joint) > 1:
                raise InputError(
                    f"{source.place}: external.{name}: '{joint}' is no joint of its "
                    f"own; there are {n}"
                )
        return cls(source, chain, readonly(lower), readonly(upper))

    @property
    def name(self) -> str:
        """The name of the description."""
        return self.source.description.name

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.chain.n

    @cached_property
    def prismatic(self) -> list[bool]:
        """Per joint: prismatic (m) or not (rad)."""
        return _prismatic(self.chain)

    @cached_property
    def external(self) -> dict[int, int]:
        """Joints that programs call external axes, by the number of the axis from 0: a track, a
        turntable below the arm.
        """
        return {
            int(axis[1:]) - 1: int(joint[1:]) - 1
            for axis, joint in self.source.description.external.items()
        }

    @cached_property
    def arm(self) -> list[int]:
        """The other joints, in order: the axes of the arm."""
        return [j for j in range(self.n) if j not in self.external.values()]

    @property
    def mechanism(self) -> Mechanism:
        """The nominal kinematics."""
        return self.chain.mechanism

    @property
    def model(self) -> pin.Model:
        """The nominal robot as a new Pinocchio model; its last frame is the tool."""
        return self.mechanism.as_model(self.lower, self.upper)

    @cached_property
    def coupling(self) -> Array:
        """C (n, n): joint positions of the serial chain are C times those of the controller."""
        return coupling_matrix(self.source.description, self.n, self.source.place)

    @property
    def coupled(self) -> bool:
        """Whether the controller's joint values differ from those of the serial chain."""
        return not np.array_equal(self.coupling, np.eye(self.n))

    def to_serial(self, q_controller: Array) -> Array:
        """Joint positions of the serial chain from those of the controller, (…, n), rad or m.

        Limits are not checked.
        """
        return q_controller @ self.coupling.T if self.coupled else q_controller

    def to_controller(self, q: Array) -> Array:
        """The controller's joint values for those of the serial chain, (…, n), rad or m."""
        return q @ np.linalg.inv(self.coupling).T if self.coupled else q

    def serial_from(self, values: JointValues, q: Array) -> Array:
        """Joint positions of the serial chain from values of either kind, (N, n)."""
        check_joint_values(values)
        return self.to_serial(q) if values == "controller" else q

    def serial_as(self, values: JointValues, q: Array) -> Array:
        """Joint positions of the serial chain as values of either kind, (N, n)."""
        check_joint_values(values)
        return self.to_controller(q) if values == "controller" else q

    def joint_values(self, place: str, *stated: JointValues | None) -> JointValues:
        """The kind of joint values of `place`; see `settled_values`."""
        return settled_values(self.coupling, place, *stated)

    @cached_property
    def targets(self) -> Array:
        """(m, 3) target points in the tool frame, m."""
        return readonly(np.array(self.source.description.targets.points_mm) * 1e-3)

    @cached_property
    def length(self) -> float:
        """Characteristic length in m: half of the sum of link lengths and prismatic strokes.

        Weighs rad against m. With slides at most LONGEST: 1 m of a slide counts 1/length, and every
        pose of a long crane would look singular. That of closed loops stands in the description.
        """
        if self.chain.tree is not None:
            return self.chain.tree.length
        links = np.linalg.norm(self.chain.placements[1:, :3, 3], axis=-1).sum()
        strokes = (self.upper - self.lower)[self.prismatic].sum()
        half = float(max(links + strokes, 1e-3) / 2)
        return min(half, LONGEST) if any(self.prismatic) else half

    @property
    def joint_units(self) -> list[str]:
        """SI unit of each joint position."""
        return ["m" if p else "rad" for p in self.prismatic]

    @property
    def joint_columns(self) -> list[str]:
        """Headers of joint positions of the serial chain in tables for people, see `columns`."""
        return self.columns("serial")

    def columns(self, values: JointValues | None) -> list[str]:
        """Headers of joint positions in tables for people: `j1_deg`, or `j1_mm` if prismatic.

        The joints for which the controller shows other values than the serial chain's say which
        they are: `j3_serial_deg`, `j3_controller_deg`; with None they do not.
        """
        return [
            self.column(j, "mm" if prismatic else "deg", values)
            for j, prismatic in enumerate(self.prismatic)
        ]

    def column(self, joint: int, unit: str, values: JointValues | None) -> str:
        """The header of one joint (from 0) in a unit, see `columns`."""
        differs = not np.array_equal(self.coupling[joint], np.eye(self.n)[joint])
        return f"j{joint + 1}_{values}_{unit}" if differs and values else f"j{joint + 1}_{unit}"

    @property
    def workspace_names(self) -> list[str]:
        """Named workspaces, the default first."""
        return [*self.source.description.workspaces, "full"]

    def workspace(self, name: str | Workspace | None = None) -> Workspace:
        """The workspace called `name`, or the default one (None); `full` is the joint range.

        Its home is, for `full`, the middle of the joint range or, with closed loops, where the
        description closes them. A Workspace is returned as it is. Raises UsageError if unknown.
        """
        if isinstance(name, Workspace):
            return name
        names = self.workspace_names
        chosen = names[0] if name is None else name
        if chosen not in names:
            raise UsageError(
                f"{self.name} has no workspace '{chosen}'; {near_names(chosen, names)}"
            )
        described = self.source.description.workspaces.get(chosen)
        if described is None:
            tree = self.chain.tree
            middle = (self.lower + self.upper) / 2
            return Workspace(chosen, middle if tree is None else tree.closed_at[: self.n])
        roll = described.cone_deg if described.roll_deg is None else described.roll_deg
        return Workspace(
            name=chosen,
            home=np.array(joint_values(described.home, self.prismatic, self.name)),
            box=np.array(described.box_m),
            cone=float(np.deg2rad(described.cone_deg)),
            roll=float(np.deg2rad(roll)),
        )

    def display_unit(self, joint: int) -> tuple[float, str]:
        """Factor and unit, mm or deg, that show the position of a joint (from 0) to people."""
        return (1e3, "mm") if self.prismatic[joint] else (180.0 / np.pi, "deg")

    @property
    def display_factors(self) -> Array:
        """The factors of `display_unit` of all joints, (n,)."""
        return np.array([self.display_unit(joint)[0] for joint in range(self.n)])

    def anywhere(self, count: int, rng: np.random.Generator) -> Array:
        """Joint positions (count, n) drawn evenly over the whole joint range, rad or m."""
        return self.lower + (self.upper - self.lower) * rng.random((count, self.n))

    def joints_within_limits(self, q: Array) -> np.ndarray:
        """Per joint of q (…, n): inside its limits; a rounding error of 1e-9 is allowed. bool"""
        return (q >= self.lower - 1e-9) & (q <= self.upper + 1e-9)

    def within_limits(self, q: Array) -> np.ndarray:
        """Per row of q (N, n): all joints inside their limits, see `joints_within_limits`. (N,)
        bool

        With closed loops also the passive joints; a row that does not close is not inside.
        """
        inside: np.ndarray = np.all(self.joints_within_limits(q), axis=-1)
        if isinstance(self.mechanism, ClosedMechanism):
            inside &= self.mechanism.passive_within(q)
        return inside

    def closing(self, q: Array) -> Array:
        """Rows of q (N, n) at which the nominal robot's loops close; all without loops."""
        return q if self.chain.tree is None else q[self.mechanism.closes(q)]

    def singularity_distance(self, q: Array) -> Array:
        """Smooth lower bound of σ_min of the actuated Jacobian at the tool, see
        `mechanism.singularity_distance`. (N,)

        With closed loops also small where the passive joints are near a singularity of their own,
        and 0 where they do not close (`ClosedMechanism.gain`).
        """
        pose, jacobian = self.mechanism.forward_and_jacobian(q)
        if not isinstance(self.mechanism, ClosedMechanism):
            return singularity_distance(at_point(jacobian, pose[:, :3, 3]), self.length)
        ok = np.isfinite(pose[:, 0, 0])
        distance = np.zeros(len(q))
        seen = at_point(jacobian[ok], pose[ok, :3, 3])
        gain = self.mechanism.gain(pose[ok], jacobian[ok]) / self._usual_gain
        steady = _LARGEST_GAIN * MIN_SINGULARITY_DISTANCE / np.maximum(gain, 1e-300)
        distance[ok] = np.minimum(singularity_distance(seen, self.length), steady)
        return distance

    @cached_property
    def _usual_gain(self) -> float:
        """The median `ClosedMechanism.gain` over the closed configurations of the chain."""
        mechanism = self.mechanism
        assert isinstance(mechanism, ClosedMechanism)
        q = mechanism.starts().theta[:, : self.n]
        pose, jacobian = mechanism.forward_and_jacobian(q[:: max(1, len(q) // 500)])
        return float(np.nanmedian(mechanism.gain(pose, jacobian)))

    def check_positions(self, q: Array, place: str) -> None:
        """InputError unless q is (N, n) and finite."""
        if q.ndim != 2 or q.shape[1] != self.n:
            raise InputError(
                f"{place}: joint positions have shape {q.shape}, but {self.name} has "
                f"{self.n} joints"
            )
        if not np.isfinite(q).all():
            raise InputError(
                f"{place}: row {int(np.argwhere(~np.isfinite(q))[0, 0]) + 1} holds a joint "
                "position that is not finite"
            )


def _prismatic(chain: SerialChain | ClosedChain) -> list[bool]:
    return [bool(np.linalg.norm(twist[3:]) < 0.5) for twist in chain.twists[: chain.n]]


def is_path(name: str) -> bool:
    """Whether a robot's name means a file or a folder instead of one of the catalogue."""
    return (
        "/" in name
        or "\\" in name
        or Path(name).suffix.lower() in (".toml", ".urdf", ".xacro", ".xml", ".csv", ".yaml")
        or Path(name).exists()
    )
