"""Equalities of MJCF: closed loops and mimic joints."""

import re
from xml.etree.ElementTree import Element

import numpy as np

from calibtool.errors import InputError
from calibtool.robot.mjcf_attributes import Attributes
from calibtool.robot.se3 import Array, inverse, translation
from calibtool.robot.urdf_text import Cut, UrdfText, free_name

_JOINED = {"connect": "spherical", "weld": "weld"}
_NO_NAME = re.compile(r"[^A-Za-z0-9 ._-]+")


class Equalities:
    """The active equalities of a file, with the bodies, sites and joints in them.

    bodies: link and pose in the world (4, 4) from which MuJoCo starts. sites: link. joints: those
    of the URDF, and the reference (rad or m), from which MuJoCo starts.
    """

    def __init__(self, root: Element, attributes: Attributes) -> None:
        self.attributes = attributes
        self.bodies: dict[str, tuple[str, Array]] = {}
        self.sites: dict[str, str] = {}
        self.joints: dict[str, tuple[list[str], float]] = {}
        # A body that is moved from outside (mocap) is no part of a robot.
        moved = {body.get("name") for body in root.iter("body") if body.get("mocap") == "true"}
        active = [
            each
            for part in root.iterfind("equality")
            for each in part
            if each.get("active", "true") == "true" and not moved & {*_ends(each)}
        ]
        for each in active:
            if each.tag not in (*_JOINED, "joint"):
                raise InputError(
                    f"{attributes.place}: an equality <{each.tag}> is not modelled; if the arm "
                    'does not need it, set its attribute active="false"'
                )
        self._cuts = [each for each in active if each.tag in _JOINED]
        self._couplings = [each for each in active if each.tag == "joint"]

    def holds(self, body: Element) -> bool:
        """Whether a loop joins a body, or one of its descendants, to something else."""
        names = {part.get("name") for part in body.iter() if part.tag in ("body", "site")}
        return any(sum(end in names for end in _ends(each)) == 1 for each in self._cuts)

    @property
    def following(self) -> set[str | None]:
        """Joints that follow another one, or are held."""
        return {each.get("joint1") for each in self._couplings}

    def references(self) -> dict[str, float]:
        """Joints that do not start at 0, and where they start: rad or m."""
        return {urdf[0]: ref for urdf, ref in self.joints.values() if ref and len(urdf) == 1}

    def loops(self, urdf: UrdfText) -> tuple[Cut, ...]:
        """`connect` as a spherical joint, `weld`; their frames become links of their own."""
        found: dict[str, Cut] = {}
        for k, each in enumerate(self._cuts, start=1):
            wanted = _NO_NAME.sub("-", each.get("name", "")).lstrip(" ._-") or f"loop{k}"
            name = free_name(wanted, found)
            if len({*_ends(each)}) == 1:
                raise InputError(
                    f"{self.attributes.place}: loop '{name}' joins '{_ends(each)[0]}' to itself; "
                    "name two bodies or sites"
                )
            a, b = self._frames(each, urdf, name)
            found[name] = name, a, b, _JOINED[each.tag]
        return tuple(found.values())

    def _frames(self, each: Element, urdf: UrdfText, name: str) -> tuple[str, str]:
        values, numbers = each.attrib, self.attributes.numbers
        if "site1" in values:
            a, b = (self.sites.get(values.get(key, ""), "") for key in ("site1", "site2"))
            if not a or not b:
                raise self._missing(each)
            return a, b
        ends = [self.bodies.get(end) for end in _ends(each)]
        if ends[0] is None or ends[1] is None:
            raise self._missing(each)
        (link_a, pose_a), (link_b, pose_b) = ends[0], ends[1]
        in_a = np.eye(4)
        in_b = inverse(pose_b) @ pose_a
        if each.tag == "connect":
            if "anchor" not in values:
                raise InputError(f"{self.attributes.place}: loop '{name}': <connect> has no anchor")
            in_a = translation(numbers(values, "anchor", (0.0,) * 3))
            in_b = in_b @ in_a
        elif "relpose" in values:
            relative = numbers(values, "relpose", (0.0,) * 7)
            if relative[3:].any():
                words = [repr(float(value)) for value in relative]
                pose = {"pos": " ".join(words[:3]), "quat": " ".join(words[3:])}
                in_a, in_b = self.attributes.pose(pose), np.eye(4)
        return urdf.frame(f"{name}_a", link_a, in_a), urdf.frame(f"{name}_b", link_b, in_b)

    def followers(self, urdf: UrdfText) -> None:
        """`joint` equalities as mimic joints: q1 − ref1 = a0 + a1 (q2 − ref2).

        A joint alone is held at a0. InputError for a polynomial of a higher degree.
        """
        for each in self._couplings:
            joint, leader = each.get("joint1", ""), each.get("joint2")
            (own, own_ref), place = self.joints.get(joint, ([], 0.0)), self.attributes.place
            a0, a1, *more = self._polynomial(each)
            other, other_ref = self.joints.get(leader or "", ([], 0.0))
            if len(own) != 1 or (leader is not None and len(other) != 1):
                raise self._missing(each)
            if leader is None:
                urdf.hold(own[0], own_ref + a0)
                continue
            if any(more):
                raise InputError(
                    f"{place}: joint '{joint}' follows '{leader}' by a polynomial of a higher "
                    "degree; only factor and offset are modelled"
                )
            urdf.mimic(own[0], other[0], a1, own_ref + a0 - a1 * other_ref)

    def _polynomial(self, each: Element) -> list[float]:
        given = each.get("polycoef", "0 1").split()[:5]
        padded = {"polycoef": " ".join([*given, *["0"] * (5 - len(given))])}
        coefficients: list[float] = self.attributes.numbers(padded, "polycoef", (0.0,) * 5).tolist()
        return coefficients

    def _missing(self, each: Element) -> InputError:
        ends = ", ".join(value for key, value in each.attrib.items() if key[-1] in "12")
        return InputError(
            f"{self.attributes.place}: an equality <{each.tag}> of {ends or 'nothing'}: not all of "
            "them are bodies, sites or joints of one degree of freedom in this file"
        )


def _ends(each: Element) -> tuple[str, str]:
    if "site1" in each.attrib:
        return each.get("site1", ""), each.get("site2", "")
    return each.get("body1", ""), each.get("body2", "world")
