"""A robot description → a serial chain of joint placements and twists (Eq. 7)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import pinocchio as pin

from calibtool.errors import InputError
from calibtool.robot.description import Source
from calibtool.robot.mechanism import Bodies, Mechanism
from calibtool.robot.se3 import Array, readonly
from calibtool.robot.urdf import (
    base_placement,
    check_single,
    frame_id,
    joint_name,
    locked_joints,
    mimicking,
    parse_urdf,
)

LimitSource = Literal["urdf", "continuous", "missing"]


@dataclass(frozen=True, eq=False)
class SerialChain:
    """n joints with one coordinate each, in series from K_0 to the tool.

    bodies       names, inertias and gravity, which geometric errors do not change
    placements   (n+1, 4, 4) M_j, pose of joint frame j in frame j−1 at q_j = 0; the last one is
                 that of the tool, K_{n+1}
    twists       (n, 6) ξ_j, unit twist of joint j in its own frame
    lower, upper (n,) joint limits in rad or m; ±π for a continuous or unlimited angle, NaN for an
                 unlimited slide
    limited_by   (n,) source of the limits: the URDF, a continuous joint, or none
    """

    bodies: Bodies
    placements: Array
    twists: Array
    lower: Array
    upper: Array
    limited_by: tuple[LimitSource, ...]

    @cached_property
    def mechanism(self) -> Mechanism:
        """The nominal kinematics."""
        return Mechanism.of(self.bodies, self.placements, self.twists)

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
    full = parse_urdf(source.urdf_text, name)
    locked = kinematics.locked_joints
    reduced = pin.buildReducedModel(full, *locked_joints(full, locked, name)) if locked else full
    tool = reduced.frames[frame_id(reduced, kinematics.tool_frame, name)]

    joints = joints_to(reduced, tool.parentJoint, name)
    base = base_placement(reduced, kinematics.base_frame, name)
    followed = mimicking(source.urdf_text)
    placements, twists, limits = [], [], []
    for position, j in enumerate(joints):
        old, called = reduced.joints[j], joint_name(reduced, j)
        if called in followed:
            raise InputError(
                f"{name}: joint '{called}' between base and tool mimics '{followed[called]}'; "
                "only independent joints are modelled: lock it in [kinematics], or make it "
                "fixed in the URDF"
            )
        twist = _unit_twist(old, called, name)
        placement = reduced.jointPlacements[j]
        placements.append((base.actInv(placement) if position == 0 else placement).homogeneous)
        twists.append(twist)
        limits.append(_limits(reduced, old, prismatic=bool(np.linalg.norm(twist[3:]) < 0.5)))
    placements.append(tool.placement.homogeneous)
    lower, upper, limited_by = zip(*limits, strict=True)
    bodies = Bodies(
        robot=source.description.name,
        joints=tuple(joint_name(reduced, j) for j in joints),
        tool=kinematics.tool_frame,
        inertias=tuple(reduced.inertias[j].copy() for j in joints),
        gravity=readonly(
            _gravity(source.description.mounting.gravity, base.rotation.T @ reduced.gravity.linear)
        ),
    )
    return SerialChain(
        bodies, readonly(placements), readonly(twists), readonly(lower), readonly(upper), limited_by
    )


def _gravity(direction: tuple[float, float, float] | None, urdf: Array) -> Array:
    """Gravity (3,) in K_0, m/s²: in the direction that the description names, or as in the URDF."""
    if direction is None:
        return urdf
    turned: Array = np.array(direction) / np.linalg.norm(direction) * np.linalg.norm(urdf)
    return turned


def joints_to(model: pin.Model, last: int, name: str) -> list[int]:
    """Joint ids from the base to joint `last`; a joint beside or beyond this way must be locked by
    the description.
    """
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


def _unit_twist(joint: pin.JointModel, called: str, name: str) -> Array:
    check_single(joint, called, name)
    data = joint.createData()
    joint.calc(data, np.array([0.0]) if joint.nq == 1 else np.array([1.0, 0.0]))
    twist = np.array(data.S, dtype=float).reshape(6)
    if not abs(np.linalg.norm(twist) - 1.0) < 1e-9:
        raise InputError(
            f"{name}: joint '{called}' has no axis; its <axis xyz=…/> must not be zero"
        )
    return twist


def _limits(
    model: pin.Model, joint: pin.JointModel, prismatic: bool
) -> tuple[float, float, LimitSource]:
    if joint.nq == 2:
        return -np.pi, np.pi, "continuous"
    low, high = (
        float(model.lowerPositionLimit[joint.idx_q]),
        float(model.upperPositionLimit[joint.idx_q]),
    )
    if np.isfinite([low, high]).all() and high > low:
        return low, high, "urdf"
    return (np.nan, np.nan, "missing") if prismatic else (-np.pi, np.pi, "missing")
