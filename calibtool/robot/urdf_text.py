"""A URDF built link by link for other formats, and the parts that a tree cannot hold."""

from collections.abc import Container, Mapping
from types import MappingProxyType
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from calibtool.robot.se3 import Array, exp6

Cut = tuple[str, str, str, str]  # name, the frames A and B, and the joint that joins them


class Converted(NamedTuple):
    """A description as a URDF, with its closed loops.

    loops: as in [kinematics]. actuated: joints with a motor, None where the file does not say.
    closed_at: rad or m by joint. gravity (3,): its direction in the root link, None where the file
    does not say.
    """

    urdf: str
    loops: tuple[Cut, ...] = ()
    actuated: tuple[str, ...] | None = None
    closed_at: Mapping[str, float] = MappingProxyType({})
    gravity: tuple[float, float, float] | None = None


class _Joint(NamedTuple):
    element: ElementTree.Element
    pose: Array
    twist: Array  # (6,) in the joint's frame


class UrdfText:
    """Links and joints in the order in which they are added; poses (4, 4) in m."""

    def __init__(self, name: str) -> None:
        self.root = ElementTree.Element("robot", {"name": name})
        self._links: dict[str, ElementTree.Element] = {}
        self._joints: dict[str, _Joint] = {}

    def link(self, wanted: str) -> str:
        """A new link; its name, which differs from the wanted one where that is used already."""
        name = free_name(wanted, self._links)
        self._links[name] = ElementTree.SubElement(self.root, "link", {"name": name})
        return name

    def mass(self, link: str, mass: float, pose: Array, inertia: Array) -> None:
        """Mass (kg), centre and axes (4, 4) of a link, and its inertia (3, 3) in them, kg m²."""
        inertial = ElementTree.SubElement(self._links[link], "inertial")
        _origin(inertial, pose)
        ElementTree.SubElement(inertial, "mass", {"value": repr(mass)})
        entries = {
            f"i{'xyz'[j]}{'xyz'[k]}": repr(float(inertia[j, k]))
            for j in range(3)
            for k in range(j, 3)
        }
        ElementTree.SubElement(inertial, "inertia", entries)

    def joint(
        self,
        wanted: str,
        kind: str,
        parent: str,
        child: str,
        pose: Array,
        axis: Array | None = None,
        limits: tuple[float, float] | None = None,
    ) -> str:
        """A joint that places `child` on `parent` at `pose` (4, 4), and its name; axis (3,).

        limits in rad or m; a revolute joint without them is continuous.
        """
        name = free_name(wanted, self._joints)
        turns = kind == "revolute"
        kind = "continuous" if turns and limits is None else kind
        joint = ElementTree.SubElement(self.root, "joint", {"name": name, "type": kind})
        along, zero = np.zeros(3) if axis is None else axis, np.zeros(3)
        twist = np.concatenate([zero, along] if turns else [along, zero])
        self._joints[name] = _Joint(joint, pose, twist)
        ElementTree.SubElement(joint, "parent", {"link": parent})
        ElementTree.SubElement(joint, "child", {"link": child})
        _origin(joint, pose)
        if axis is not None:
            ElementTree.SubElement(joint, "axis", {"xyz": _numbers(axis)})
        if limits is not None:
            low, high = (repr(float(value)) for value in limits)
            ElementTree.SubElement(joint, "limit", {"lower": low, "upper": high})
        return name

    def frame(self, wanted: str, parent: str, pose: Array) -> str:
        """A link that is fixed to another one at a pose (4, 4), and its name."""
        name = self.link(wanted)
        self.joint(f"{name}_fixed", "fixed", parent, name, pose)
        return name

    def mimic(self, joint: str, leader: str, multiplier: float, offset: float) -> None:
        """θ_joint = multiplier · θ_leader + offset, rad or m."""
        values = {"joint": leader, "multiplier": repr(multiplier), "offset": repr(offset)}
        ElementTree.SubElement(self._joints[joint].element, "mimic", values)

    def hold(self, joint: str, value: float) -> None:
        """A revolute or prismatic joint that stands still at a value, rad or m."""
        element, pose, twist = self._joints[joint]
        element.set("type", "fixed")
        for part in element.findall("*"):
            if part.tag in ("axis", "limit", "origin"):
                element.remove(part)
        _origin(element, pose @ exp6(twist * value))

    @property
    def text(self) -> str:
        """The URDF."""
        ElementTree.indent(self.root)
        return ElementTree.tostring(self.root, "unicode") + "\n"


def free_name(wanted: str, taken: Container[str]) -> str:
    """The wanted name, or the first of name_2, name_3 … that is free."""
    name, k = wanted, 2
    while name in taken:
        name, k = f"{wanted}_{k}", k + 1
    return name


def _origin(part: ElementTree.Element, pose: Array) -> None:
    values = {
        "xyz": _numbers(pose[:3, 3]),
        "rpy": _numbers(np.array(roll_pitch_yaw(pose[:3, :3]))),
    }
    ElementTree.SubElement(part, "origin", values)


def _numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def roll_pitch_yaw(R: Array) -> tuple[float, float, float]:
    """Fixed-axes angles (rad) that give R (3, 3) to rounding, where the pitch is ±90° too.

    Roll is the turn that remains after yaw and pitch.
    """
    yaw = np.arctan2(R[1, 0], R[0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return float(roll), float(pitch), float(yaw)
