"""MJCF, MuJoCo's descriptions, as a URDF with closed loops.

Pinocchio reads MJCF too, but neither frames, nor several bodies of the world, nor its default class
`main`; several joints of a body and quaternions that are not normalised it reads wrong.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from calibtool.errors import InputError
from calibtool.robot.mjcf_attributes import Attributes, mjcf_root, turn
from calibtool.robot.mjcf_equalities import Equalities
from calibtool.robot.se3 import Array, translation
from calibtool.robot.urdf_text import Converted, UrdfText

WORLD = "world"
_UNREAD = ("attach", "replicate")


class Joint(NamedTuple):
    """A joint of a body: attributes, and the pose of its <frame> in the body (4, 4)."""

    values: dict[str, str]
    frame: Array


class Step(NamedTuple):
    """A joint of the URDF, on the one before it."""

    suffix: str
    kind: str
    axis: Array | None = None
    limits: tuple[float, float] | None = None


_SLIDES = [Step(f"_{c}", "prismatic", axis) for c, axis in zip("xyz", np.eye(3), strict=True)]
_TURNS = [Step(f"_r{c}", "revolute", axis) for c, axis in zip("xyz", np.eye(3), strict=True)]


def read_mjcf(text: str, path: Path, allowed: tuple[Path, ...] = ()) -> Converted:
    """The tree of bodies as links and joints, `connect` and `weld` as loops, actuators as motors.

    Every site is a link. A ball joint is three revolute joints; so is, with three slides before
    them, the free joint of a body that a loop holds. A `joint` equality is a mimic joint. Masses
    are those of <inertial>, and none at all where a body has shapes instead. InputError for what is
    no robot, and for what is not read.
    """
    return _Reader(mjcf_root(text, path, allowed), str(path)).read()


class _Reader:
    def __init__(self, root: Element, place: str) -> None:
        self.root, self.place = root, place
        self.attributes = Attributes.of(root, place)
        self.urdf = UrdfText(root.get("model") or "robot")
        self.equalities = Equalities(root, self.attributes)
        self.masses: list[tuple[str, float, Array, Array]] = []
        self.weightless = False

    def read(self) -> Converted:
        world, equalities = self.urdf.link(WORLD), self.equalities
        equalities.bodies[WORLD] = world, np.eye(4)
        for part in self.root.iterfind("worldbody"):
            self._inside(part, world, np.eye(4), np.eye(4), part.get("childclass", "main"), False)
        for link, mass, pose, inertia in () if self.weightless else self.masses:
            self.urdf.mass(link, mass, pose, inertia)
        if not equalities.joints:
            raise InputError(f"{self.place}: an MJCF of MuJoCo without joints; expected a robot")
        loops = equalities.loops(self.urdf)
        equalities.followers(self.urdf)
        gravity = np.array([0.0, 0.0, -9.81])
        for option in self.root.iterfind("option"):
            gravity = self.attributes.numbers(option.attrib, "gravity", gravity.tolist())
        down = gravity[2] < 0 and not gravity[:2].any()
        return Converted(
            self.urdf.text,
            loops,
            self._actuated(),
            {joint: ref for joint, ref in equalities.references().items() if loops},
            None if down or not gravity.any() else tuple(gravity.tolist()),
        )

    def _inside(
        self, element: Element, link: str, at: Array, frame: Array, childclass: str, moves: bool
    ) -> None:
        """Bodies and sites of a body's link, which has the pose `at` in the world, or of a <frame>
        in it.

        at: with the joints at their references, from which MuJoCo starts.
        """
        for part in element:
            if part.tag in _UNREAD:
                raise InputError(
                    f"{self.place}: <{part.tag}> is not read; save the compiled model "
                    "(mj_saveLastXML) and give that"
                )
            if part.tag == "frame":
                pose = frame @ self.attributes.pose(part.attrib)
                self._inside(part, link, at, pose, part.get("childclass", childclass), moves)
            elif part.tag == "body":
                self._body(part, link, at, frame, part.get("childclass", childclass), moves)
            elif part.tag == "site":
                pose = frame @ self.attributes.pose(self.attributes.all_of(part, childclass))
                name = self.urdf.frame(part.get("name", f"{link}_site"), link, pose)
                self.equalities.sites[part.get("name", name)] = name

    def _body(
        self, element: Element, on: str, at: Array, frame: Array, childclass: str, moves: bool
    ) -> None:
        pose = frame @ self.attributes.pose(element.attrib)
        joints = list(self._joints(element, np.eye(4), childclass))
        name = element.get("name") or f"body_{len(self.equalities.bodies)}"
        parent, rest = on, pose
        for k, joint in enumerate(joints):
            default = f"{name}_joint" if len(joints) == 1 else f"{name}_joint_{k + 1}"
            called = joint.values.get("name", default)
            steps, place, back, reference = self._steps(joint, element)
            found = []
            for step in steps:
                body = joint is joints[-1] and step is steps[-1] and not back[:3, 3].any()
                child = self.urdf.link(name if body else f"{called}{step.suffix}_moves")
                where = rest @ place if step is steps[0] else np.eye(4)
                joined = f"{called}{step.suffix}", step.kind, parent, child
                found.append(self.urdf.joint(*joined, where, step.axis, step.limits))
                parent = child
            rest = back
            self.equalities.joints[called] = found, reference
        if parent == on or rest[:3, 3].any():
            parent = self.urdf.frame(name, parent, rest)
        self.equalities.bodies[name] = parent, at @ pose
        moves = moves or bool(joints)
        self._mass(element, parent, moves)
        self._inside(element, parent, at @ pose, np.eye(4), childclass, moves)

    def _joints(self, element: Element, frame: Array, childclass: str) -> Iterator[Joint]:
        """The joints of a body, in the order in which they move it."""
        for part in element:
            if part.tag == "frame":
                inner = frame @ self.attributes.pose(part.attrib)
                yield from self._joints(part, inner, part.get("childclass", childclass))
            elif part.tag == "joint":
                yield Joint(self.attributes.all_of(part, childclass), frame)
            elif part.tag == "freejoint":
                yield Joint({"type": "free"} | part.attrib, frame)

    def _steps(self, joint: Joint, body: Element) -> tuple[list[Step], Array, Array, float]:
        """The URDF's joints; the pose of the first one in the body, of the body in the last one,
        and the reference (rad or m).
        """
        values, numbers = joint.values, self.attributes.numbers
        kind = values.get("type", "hinge")
        if kind == "free":
            held = self.equalities.holds(body)
            steps = [*_SLIDES, *_TURNS] if held else [Step("", "floating")]
            return steps, np.eye(4), np.eye(4), 0.0
        place = joint.frame @ translation(numbers(values, "pos", (0.0,) * 3))
        place[:3, :3] = np.eye(3)
        back = translation(-place[:3, 3])
        if kind == "ball":
            return _TURNS, place, back, 0.0
        if kind not in ("hinge", "slide"):
            raise InputError(f"{self.place}: a joint of type '{kind}'; expected one of MuJoCo's")
        axis = joint.frame[:3, :3] @ numbers(values, "axis", (0.0, 0.0, 1.0))
        size = float(np.linalg.norm(axis))
        if size < 1e-12:
            raise InputError(f"{self.place}: joint '{values.get('name', '')}' has no axis: zero")
        axis = axis / size
        unit = self.attributes.angle if kind == "hinge" else float
        reference = unit(float(numbers(values, "ref", (0.0,))[0]))
        low, high = (unit(float(v)) for v in numbers(values, "range", (0.0, 0.0)))
        auto = "true" if self.attributes.autolimits and "range" in values else "false"
        limited = values.get("limited", "auto").replace("auto", auto) == "true"
        limits = (low, high) if limited else None
        if kind == "slide":
            place, back = translation(-reference * axis), np.eye(4)
            return [Step("", "prismatic", axis, limits)], place, back, reference
        place[:3, :3] = turn(axis, -reference)
        return [Step("", "revolute", axis, limits)], place, back, reference

    def _mass(self, element: Element, link: str, moves: bool) -> None:
        inertial = element.find("inertial")
        if inertial is None:
            shapes = element.find("geom") is not None or element.find("frame/geom") is not None
            self.weightless |= shapes and moves
            return
        values, numbers = inertial.attrib, self.attributes.numbers
        matrix = np.diag(numbers(values, "diaginertia", (0.0,) * 3))
        if "fullinertia" in values:
            xx, yy, zz, xy, xz, yz = numbers(values, "fullinertia", (0.0,) * 6)
            matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        mass = float(numbers(values, "mass", (0.0,))[0])
        self.masses.append((link, mass, self.attributes.pose(values), matrix))

    def _actuated(self) -> tuple[str, ...] | None:
        """The joints that actuators move, in their order; None where the file has none.

        Of several joints that a tendon moves, the one that does not follow any of the others.
        """
        following = self.equalities.following
        fixed = {
            tendon.get("name", ""): [
                joint.get("joint", "")
                for joint in tendon.iterfind("joint")
                if joint.get("joint") not in following
            ]
            for part in self.root.iterfind("tendon")
            for tendon in part.iterfind("fixed")
        }
        found: dict[str, None] = {}
        for part in self.root.iterfind("actuator"):
            for actuator in part:
                joint = actuator.get("joint") or actuator.get("jointinparent")
                pulled = fixed.get(actuator.get("tendon", ""), [])
                for name in [joint] if joint else pulled if len(pulled) == 1 else []:
                    urdf, _ = self.equalities.joints.get(name, ([], 0.0))
                    found |= dict.fromkeys(urdf if len(urdf) == 1 else [])
        return tuple(found) or None
