"""SDF, Gazebo's descriptions, as a URDF; a joint to a link that has a parent closes a loop."""

import math
from collections import deque
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from calibtool.errors import InputError, near_names
from calibtool.robot.markup import parse_xml
from calibtool.robot.mjcf_attributes import from_z
from calibtool.robot.orientation import FIXED_ANGLES, rotation_matrices
from calibtool.robot.se3 import Array, inverse, translation
from calibtool.robot.ur_frames import number
from calibtool.robot.urdf_text import Converted, Cut, UrdfText

_MODEL = ("__model__", "world", "")
_KINDS = {
    "revolute": 1,
    "continuous": 1,
    "prismatic": 1,
    "fixed": 0,
    "universal": 2,
    "revolute2": 2,
}
_CUT = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"} | {
    "ball": "spherical",
    "fixed": "weld",
}
_MOST = 200  # number of frames that may stand on one another


class _Joint(NamedTuple):
    name: str
    kind: str
    parent: str
    child: str
    element: Element
    pose: Array  # in the model


def read_sdf(text: str, place: str) -> Converted:
    """The links, joints and frames of the one model of an SDF that has joints.

    A ball joint is three revolute joints, a universal one two. InputError for other joints, for
    several such models or none, and for a model that only includes others.
    """
    root = parse_xml(text, place, "SDF")
    models = [model for model in root.iter("model") if model.find("joint") is not None]
    if len(models) != 1:
        names = ", ".join(model.get("name", "") for model in models)
        raise InputError(
            f"{place}: an SDF of Gazebo with several models that have joints: {names}; keep one"
            if models
            else f"{place}: an SDF of Gazebo without joints; give the file of the model included"
        )
    axes_in_model = root.get("version", "") in ("1.0", "1.2", "1.3", "1.4")
    return _Reader(models[0], place, axes_in_model).read()


class _Reader:
    def __init__(self, model: Element, place: str, axes_in_model: bool) -> None:
        self.model, self.place, self.axes_in_model = model, place, axes_in_model
        self.frames = {
            part.get("name", ""): part for part in model if part.tag in ("link", "joint", "frame")
        }
        self.poses: dict[str, Array] = {}
        self.urdf = UrdfText(model.get("name") or "robot")

    def read(self) -> Converted:
        joints = [self._joint(part) for part in self.model.iterfind("joint")]
        links = {part.get("name", ""): part for part in self.model.iterfind("link")}
        children = {joint.child for joint in joints}
        fixed = any(joint.parent == "world" for joint in joints)
        start = "world" if fixed else next((name for name in links if name not in children), "")
        if not start:
            raise InputError(f"{self.place}: every link of the model has a parent; expected a base")
        self.urdf.link(start)
        done, waiting, cuts = {start}, deque([start]), []
        while waiting:
            on = waiting.popleft()
            for joint in (each for each in joints if each.parent == on):
                if joint.child in done:
                    cuts.append(joint)
                    continue
                self._add(joint)
                done.add(joint.child)
                waiting.append(joint.child)
        if unreached := [name for name in links if name not in done]:
            raise InputError(
                f"{self.place}: no joint joins {', '.join(unreached)} to '{start}'; a joint is "
                "read from its parent to its child"
            )
        for name, link in links.items():
            self._mass(name, link)
        for part in self.model.iterfind("frame"):
            on = self._link_of(part.get("attached_to", ""), start)
            pose = inverse(self._pose(on)) @ self._pose(part.get("name", ""))
            self.urdf.frame(part.get("name", ""), on, pose)
        for joint in joints:
            self._mimic(joint)
        loops = tuple(self._cut(joint) for joint in cuts)
        return Converted(self.urdf.text, loops)

    def _joint(self, part: Element) -> _Joint:
        name, kind = part.get("name", ""), part.get("type", "")
        if kind not in _KINDS and kind != "ball":
            raise InputError(
                f"{self.place}: joint '{name}' is of type '{kind}'; read are "
                f"{', '.join([*_KINDS, 'ball'])}"
            )
        parent, child = ((part.findtext(tag) or "").strip() for tag in ("parent", "child"))
        for link in (parent, child):
            if link != "world" and self.frames.get(link, part).tag == "joint":
                known = [each for each, found in self.frames.items() if found.tag != "joint"]
                raise InputError(
                    f"{self.place}: joint '{name}' joins '{link}', which is no link; "
                    f"{near_names(link, known)}"
                )
        start = "world" if parent == "world" else self._link_of(parent, parent)
        return _Joint(name, kind, start, self._link_of(child, child), part, self._pose(name))

    def _link_of(self, name: str, otherwise: str) -> str:
        """The link to which a frame is attached, directly or through other frames."""
        for _ in range(_MOST):
            element = self.frames.get(name)
            if element is None:
                return otherwise
            if element.tag == "link":
                return name
            tag = "attached_to" if element.tag == "frame" else "child"
            name = element.get(tag) or (element.findtext(tag) or "").strip()
        raise InputError(f"{self.place}: frame '{name}' is attached to itself")

    def _pose(self, name: str, depth: int = 0) -> Array:
        """The pose of a link, joint or frame in the model (4, 4)."""
        if name in _MODEL:
            return np.eye(4)
        if name not in self.frames or depth > _MOST:
            raise InputError(
                f"{self.place}: there is no frame '{name}'; {near_names(name, list(self.frames))}"
                if depth <= _MOST
                else f"{self.place}: frames stand on one another in a circle, '{name}' among them"
            )
        if name not in self.poses:
            part = self.frames[name]
            pose, on = self._given(part.find("pose"), name)
            if not on and part.tag == "joint":
                on = (part.findtext("child") or "").strip()
            elif not on and part.tag == "frame":
                on = part.get("attached_to", "")
            self.poses[name] = self._pose(on, depth + 1) @ pose
        return self.poses[name]

    def _given(self, pose: Element | None, name: str) -> tuple[Array, str]:
        """A <pose> (4, 4), and the frame that it is in, "" where it does not say."""
        if pose is None or not (pose.text or "").strip():
            return np.eye(4), "" if pose is None else pose.get("relative_to", "")
        values = self._numbers(pose.text or "", f"pose of '{name}'")
        quaternion = pose.get("rotation_format") == "quat_xyzw"
        if len(values) != (7 if quaternion else 6):
            raise InputError(f"{self.place}: pose of '{name}': {len(values)} numbers; expected 6")
        result, turned = translation(np.array(values[:3])), np.array([values[3:]])
        if quaternion and not turned.any():
            raise InputError(f"{self.place}: pose of '{name}': its quaternion is zero")
        if not quaternion and pose.get("degrees") in ("true", "1"):
            turned = np.deg2rad(turned)
        convention = "quaternion-xyzw" if quaternion else FIXED_ANGLES
        result[:3, :3] = rotation_matrices(turned, convention)[0]
        return result, pose.get("relative_to", "")

    def _numbers(self, text: str, what: str) -> list[float]:
        return [number(word, f"{self.place}: {what}") for word in text.split()]

    def _axis(self, joint: _Joint, tag: str = "axis") -> tuple[Array, tuple[float, float] | None]:
        """A joint's unit axis in its own frame, and its limits."""
        element = joint.element.find(tag)
        xyz = None if element is None else element.find("xyz")
        words = "0 0 1" if xyz is None else xyz.text or ""
        axis = np.array(self._numbers(words, f"axis of '{joint.name}'"))
        if axis.shape != (3,) or not axis.any():
            raise InputError(f"{self.place}: axis of '{joint.name}' is '{words}'; expected x y z")
        axis = axis / np.linalg.norm(axis)
        frame = "" if xyz is None else xyz.get("expressed_in", "")
        value = "" if element is None else element.findtext("use_parent_model_frame") or ""
        in_model = self.axes_in_model or value.strip() in ("1", "true")
        if frame or in_model:
            axis = joint.pose[:3, :3].T @ self._pose(frame or "__model__")[:3, :3] @ axis
        ends = [
            element.findtext(f"limit/{end}") if element is not None else None
            for end in ("lower", "upper")
        ]
        if None in ends:
            return axis, None
        low, high = (self._limit(text or "", joint.name) for text in ends)
        return axis, (low, high) if math.isfinite(low) and math.isfinite(high) else None

    def _limit(self, text: str, name: str) -> float:
        word = text.strip().lower()
        if word.lstrip("+-") in ("inf", "infinity") or word.lstrip("+-") in ("1e16", "1e+16"):
            return -math.inf if word.startswith("-") else math.inf
        return number(word, f"{self.place}: limit of '{name}'")

    def _add(self, joint: _Joint) -> None:
        """A joint and its child, in the frame of the parent."""
        parent = np.eye(4) if joint.parent == "world" else self._pose(joint.parent)
        rest = inverse(joint.pose) @ self._pose(joint.child)
        where, on = inverse(parent) @ joint.pose, joint.parent
        if joint.kind == "fixed":
            self.urdf.link(joint.child)
            self.urdf.joint(joint.name, "fixed", on, joint.child, where @ rest)
            return
        steps: list[tuple[str, Array, tuple[float, float] | None, str]] = [
            ("revolute", axis, None, f"_{letter}")
            for axis, letter in zip(np.eye(3), "xyz", strict=True)
        ]
        if joint.kind != "ball":
            kind = "prismatic" if joint.kind == "prismatic" else "revolute"
            tags = ("axis", "axis2")[: _KINDS[joint.kind]]
            steps = [
                (kind, *self._axis(joint, tag), f"_{tag}" if len(tags) > 1 else "") for tag in tags
            ]
        still = bool(np.abs(rest - np.eye(4)).max() < 1e-12)
        for k, (kind, axis, limits, suffix) in enumerate(steps):
            last = still and k == len(steps) - 1
            child = self.urdf.link(joint.child if last else f"{joint.name}{suffix}_moves")
            pose = np.eye(4) if k else where
            self.urdf.joint(f"{joint.name}{suffix}", kind, on, child, pose, axis, limits)
            on = child
        if not still:
            self.urdf.link(joint.child)
            self.urdf.joint(f"{joint.child}_fixed", "fixed", on, joint.child, rest)

    def _cut(self, joint: _Joint) -> Cut:
        """A joint that closes a loop, as two frames whose z is its axis."""
        if joint.kind not in _CUT:
            raise InputError(
                f"{self.place}: joint '{joint.name}', {joint.kind}, closes a loop; such a joint "
                "must stand before one that can be cut: ball, revolute, prismatic or fixed"
            )
        pose = joint.pose
        if joint.kind not in ("ball", "fixed"):
            axis, _ = self._axis(joint)
            pose = pose.copy()
            pose[:3, :3] = pose[:3, :3] @ from_z(axis)
        parent = np.eye(4) if joint.parent == "world" else self._pose(joint.parent)
        a = self.urdf.frame(f"{joint.name}_a", joint.parent, inverse(parent) @ pose)
        child = inverse(self._pose(joint.child)) @ pose
        return (
            joint.name,
            a,
            self.urdf.frame(f"{joint.name}_b", joint.child, child),
            _CUT[joint.kind],
        )

    def _mimic(self, joint: _Joint) -> None:
        """A mimic joint: multiplier · (leader − reference) + offset."""
        mimic = joint.element.find("axis/mimic")
        if mimic is None:
            return

        def value(tag: str, default: str) -> float:
            return number(mimic.findtext(tag) or default, f"{self.place}: mimic of '{joint.name}'")

        multiplier = value("multiplier", "1")
        offset = value("offset", "0") - multiplier * value("reference", "0")
        self.urdf.mimic(joint.name, mimic.get("joint", ""), multiplier, offset)

    def _mass(self, name: str, link: Element) -> None:
        inertial = link.find("inertial")
        if inertial is None:
            return
        pose, _ = self._given(inertial.find("pose"), name)

        def value(path: str, default: str = "0") -> float:
            return number(inertial.findtext(path) or default, f"{self.place}: {path} of '{name}'")

        xx, xy, xz, yy, yz, zz = (
            value(f"inertia/i{both}") for both in ("xx", "xy", "xz", "yy", "yz", "zz")
        )
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        self.urdf.mass(name, value("mass", "1"), pose, matrix)
