"""A second way to every number of the kinematics: URDF text by ElementTree, motions by scipy's
matrix exponential.

Nothing here is taken from calibtool.
"""

from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.spatial.transform import RigidTransform

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlainChain:
    """placements (n+1, 4, 4), twists (n, 6) (v, ω) in the joints' frames."""

    placements: Array
    twists: Array

    def forward(self, q: Array) -> Array:
        """T_base_tool of one configuration (n,): (4, 4)."""
        pose = np.eye(4)
        for placement, twist, value in zip(self.placements, self.twists, q, strict=False):
            pose = pose @ placement @ exponential(twist * value)
        return pose @ self.placements[-1]

    def with_errors(self, placements: Array, twists: Array) -> "PlainChain":
        """M_j exp(δζ_j) and ξ_j + δξ_j."""
        moved = [
            M @ exponential(error) for M, error in zip(self.placements, placements, strict=True)
        ]
        return PlainChain(np.array(moved), self.twists + twists)


def hat(twist: Array) -> Array:
    """[[ω]×, v; 0, 0] of (v, ω)."""
    x, y, z = twist[3:]
    return np.array(
        [[0, -z, y, twist[0]], [z, 0, -x, twist[1]], [-y, x, 0, twist[2]], [0, 0, 0, 0]]
    )


def exponential(twist: Array) -> Array:
    """The motion of a twist (6,) for unit time: (4, 4)."""
    return np.asarray(expm(hat(twist)))


def read_urdf(text: str, base: str | None, tool: str, locked: dict[str, float]) -> PlainChain:
    """The chain from `base` (the root link unless named; it does not move) to `tool`, with
    some joints locked.
    """
    root = ElementTree.fromstring(text)
    joint_to = {child_of(joint): joint for joint in root.findall("joint")}

    def way_to(link: str) -> list[ElementTree.Element]:
        return [*way_to(parent_of(joint_to[link])), joint_to[link]] if link in joint_to else []

    T_root_base = np.eye(4)
    for joint in way_to(base) if base else []:
        T_root_base = T_root_base @ origin_of(joint)
    placements, twists = [np.linalg.inv(T_root_base)], []
    for joint in way_to(tool):
        placements[-1] = placements[-1] @ origin_of(joint)
        kind, name = joint.get("type"), str(joint.get("name"))
        if kind == "fixed":
            continue
        axis = numbers(joint.find("axis"), "xyz", [1.0, 0.0, 0.0])
        axis /= np.linalg.norm(axis)
        twist = np.array([*axis, 0, 0, 0] if kind == "prismatic" else [0, 0, 0, *axis])
        if name in locked:
            placements[-1] = placements[-1] @ exponential(twist * locked[name])
            continue
        twists.append(twist)
        placements.append(np.eye(4))
    return PlainChain(np.array(placements), np.array(twists))


def parent_of(joint: ElementTree.Element) -> str:
    return str(joint.find("parent").get("link"))


def child_of(joint: ElementTree.Element) -> str:
    return str(joint.find("child").get("link"))


def numbers(element: ElementTree.Element | None, key: str, default: list[float]) -> Array:
    text = None if element is None else element.get(key)
    return np.array(default if text is None else [float(word) for word in text.split()])


def origin_of(joint: ElementTree.Element) -> Array:
    """Fixed axes x, y, z: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    origin = joint.find("origin")
    roll, pitch, yaw = numbers(origin, "rpy", [0.0, 0.0, 0.0])
    turns = [
        exponential(np.array([0, 0, 0, *axis]))
        for axis in ([0, 0, yaw], [0, pitch, 0], [roll, 0, 0])
    ]
    pose = turns[0] @ turns[1] @ turns[2]
    pose[:3, 3] = numbers(origin, "xyz", [0.0, 0.0, 0.0])
    return pose


def logarithm(pose: Array) -> Array:
    """Twist (v, ω) whose exponential is `pose`, |ω| < π."""
    w_v = RigidTransform.from_matrix(
        np.vstack([pose[:3], [0, 0, 0, 1]])
    ).as_exp_coords()  # expm rounds there, too
    return np.array([*w_v[3:], *w_v[:3]])


def adjoint(pose: Array) -> Array:
    """Twists of frame b to frame a for T_a_b."""
    R, S = pose[:3, :3], hat(np.array([0, 0, 0, *pose[:3, 3]]))[:3, :3]
    return np.block([[R, S @ R], [np.zeros((3, 3)), R]])


def poses_along(placements: Array, twists: Array, q: Array) -> list[Array]:
    """F_1 … F_n after each joint has moved, and the tool."""
    pose, result = np.eye(4), []
    for placement, twist, value in zip(placements, twists, q, strict=False):
        pose = pose @ placement @ exponential(twist * value)
        result.append(pose)
    return [*result, pose @ placements[-1]]
