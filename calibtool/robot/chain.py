"""A robot description → a serial chain of joint placements and twists (Eq. 7)."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
import pinocchio as pin

from calibtool.errors import InputError
from calibtool.robot.mechanism import Bodies, Mechanism
from calibtool.robot.se3 import Array, readonly
from calibtool.robot.source import Source
from calibtool.robot.tree import Joint, urdf_tree
from calibtool.robot.urdf import (
    base_placement,
    check_single,
    frame_id,
    joint_name,
    locked_joints,
    mimic_joints,
    parse_urdf,
)

LimitSource = Literal["urdf", "continuous", "missing", "swapped", "zero", "unbounded"]
# Descriptions of missing limits for messages: "slide 'lift' has no limits".
NO_LIMITS = {
    "missing": "has no limits",
    "swapped": "has a lower limit above the upper one",
    "zero": "has a lower limit equal to the upper one",
    "unbounded": "has limits beyond every joint's range",
}


@dataclass(frozen=True, eq=False)
class SerialChain:
    """n joints with one coordinate each, in series from K_0 to the tool.

    bodies       names, inertias and gravity, which geometric errors do not change
    placements   (n+1, 4, 4) M_j, pose of joint frame j in frame j−1 at q_j = 0; the last one is
                 that of the tool, K_{n+1}
    twists       (n, 6) ξ_j, unit twist of joint j in its own frame
    lower, upper (n,) joint limits in rad or m; ±π for a continuous or unlimited angle, NaN for an
                 unlimited slide
    limited_by   (n,) source of the limits: the URDF, a continuous joint, or what is wrong with them
    """

    bodies: Bodies
    placements: Array
    twists: Array
    lower: Array
    upper: Array
    limited_by: tuple[LimitSource, ...]

    tree: ClassVar[None] = None  # no loops

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.twists)

    @cached_property
    def mechanism(self) -> Mechanism:
        """The nominal kinematics."""
        return Mechanism.of(self.bodies, self.placements, self.twists)

    def mechanism_of(
        self, placements: Array, twists: Array, offsets: Array | None = None
    ) -> Mechanism:
        """The kinematics with other placements (n+1, 4, 4), twists (n, 6) and offsets (n,)."""
        return Mechanism.of(self.bodies, placements, twists, offsets)

    @property
    def n_all(self) -> int:
        """Number of joints, passive ones included."""
        return len(self.twists)

    @property
    def labels(self) -> tuple[str, ...]:
        """A name for each placement: those of the joints and of the tool."""
        return (*self.bodies.joints, self.bodies.tool)

    @property
    def model_joints(self) -> dict[int, int]:
        """The number of each joint, and of the base (−1), in `model`."""
        return {j: j + 1 for j in range(-1, self.n)}

    @property
    def placed_on(self) -> tuple[int, ...]:
        """The joint that carries each placement, −1 for the base."""
        return tuple(range(-1, self.n))

    @property
    def model(self) -> pin.Model:
        """The nominal chain as a Pinocchio model, nq = nv = n, joints 1…n in order."""
        return self.mechanism.model


def build_chain(source: Source) -> SerialChain:
    """The serial chain of a description, with locked joints fixed.

    Joints that Pinocchio stores as (cos, sin) become angles. Raises InputError for an unknown joint
    or frame, a chain that branches before the tool, or a joint of several degrees of freedom.
    """
    name = source.place
    kinematics = source.description.kinematics
    reduced = opened(source)
    tool = reduced.frames[frame_id(reduced, kinematics.tool_frame, name)]

    joints = joints_to(reduced, tool.parentJoint, name)
    base = base_placement(reduced, kinematics.base_frame, name)
    followed = mimic_joints(source.urdf_text, name)
    limited = urdf_tree(source.urdf_text, name).named
    placements, twists, limits = [], [], []
    for position, j in enumerate(joints):
        old, called = reduced.joints[j], joint_name(reduced, j)
        if called in followed:
            raise InputError(
                f"{name}: joint '{called}' between base and tool mimics '{followed[called][0]}'; "
                "write a robot.toml, with which it follows, or lock it there"
            )
        twist = unit_twist(old, called, name)
        placement = reduced.jointPlacements[j]
        placements.append((base.actInv(placement) if position == 0 else placement).homogeneous)
        twists.append(twist)
        limits.append(limits_of(limited[called], prismatic=bool(np.linalg.norm(twist[3:]) < 0.5)))
    placements.append(tool.placement.homogeneous)
    lower, upper, limited_by = zip(*limits, strict=True)
    bodies = Bodies(
        robot=source.description.name,
        joints=tuple(joint_name(reduced, j) for j in joints),
        tool=kinematics.tool_frame,
        inertias=tuple(reduced.inertias[j].copy() for j in joints),
        gravity=gravity_in_base(source, base, reduced),
    )
    return SerialChain(
        bodies, readonly(placements), readonly(twists), readonly(lower), readonly(upper), limited_by
    )


def opened(source: Source) -> pin.Model:
    """The URDF's tree as a Pinocchio model, its locked joints fixed."""
    full = parse_urdf(source.urdf_text, source.place)
    locked = source.description.kinematics.locked_joints
    if not locked:
        return full
    return pin.buildReducedModel(full, *locked_joints(full, locked, source.place))


def gravity_in_base(source: Source, base: pin.SE3, model: pin.Model) -> Array:
    """Gravity (3,) in K_0, m/s²: in the direction that the description names, or as in the URDF."""
    urdf: Array = base.rotation.T @ model.gravity.linear
    direction = source.description.mounting.gravity
    if direction is None:
        return readonly(urdf)
    return readonly(np.array(direction) / np.linalg.norm(direction) * np.linalg.norm(urdf))


def joints_to(model: pin.Model, last: int, name: str) -> list[int]:
    """Joint ids from the base to joint `last`; all other joints must be locked."""
    way: list[int] = []
    while last > 0:
        way.insert(0, last)
        last = model.parents[last]
    beside = [joint_name(model, j) for j in range(1, model.njoints) if j not in way]
    if beside:
        raise InputError(
            f"{name}: joints {', '.join(beside)} are not between base and tool; lock them "
            "in [kinematics]"
        )
    if not way:
        raise InputError(f"{name}: no joint moves the tool frame")
    return way


def unit_twist(joint: pin.JointModel, called: str, name: str) -> Array:
    """ξ (6,) of a joint in its own frame; InputError unless it has one axis."""
    check_single(joint, called, name)
    data = joint.createData()
    joint.calc(data, np.array([0.0]) if joint.nq == 1 else np.array([1.0, 0.0]))
    twist = np.array(data.S, dtype=float).reshape(6)
    if not abs(np.linalg.norm(twist) - 1.0) < 1e-9:
        raise InputError(
            f"{name}: joint '{called}' has no axis; its <axis xyz=…/> must not be zero"
        )
    return twist


def limits_of(joint: Joint, prismatic: bool) -> tuple[float, float, LimitSource]:
    """Lower and upper limit, rad or m, and where they come from; see `SerialChain`."""
    if joint.kind == "continuous":
        return -np.pi, np.pi, "continuous"
    low, high = joint.lower, joint.upper
    if joint.bounded:
        return low, high, "urdf"
    ends = np.array([low, high])
    source: LimitSource = "missing"
    if np.isfinite(ends).all() and np.abs(ends).max() > 0:
        source = "swapped" if low > high else "zero" if low == high else "unbounded"
    return (np.nan, np.nan, source) if prismatic else (-np.pi, np.pi, source)
