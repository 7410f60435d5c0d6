"""Attributes of MJCF elements: included files, default classes, angles, poses."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from calibtool.errors import InputError
from calibtool.robot.markup import decoded_xml, parse_xml
from calibtool.robot.named_files import contents, inside
from calibtool.robot.orientation import QUATERNION, ROTATION_VECTOR, rotation_matrices
from calibtool.robot.se3 import Array, translation
from calibtool.units import number_in

_MOST_FILES = 100
_TURNS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")  # one of them orients an element


def mjcf_root(text: str, path: Path, allowed: tuple[Path, ...] = ()) -> Element:
    """The <mujoco> of a text, its <include> replaced by the contents of the files.

    Files are looked for beside the first one, as MuJoCo does; see `inside`. InputError for one that
    is missing or included twice.
    """
    root, seen = parse_xml(text, str(path), "MJCF"), {path.resolve()}

    def expand(parent: Element) -> None:
        for k, part in reversed(list(enumerate(parent))):
            if part.tag != "include":
                expand(part)
                continue
            place, name = f"{path}: <include>", part.get("file", "")
            found = inside(path.parent, name, place, allowed)
            if found in seen or len(seen) > _MOST_FILES:
                raise InputError(f"{place}: '{name}' is included twice, or there are too many")
            seen.add(found)
            included = parse_xml(decoded_xml(contents(found), str(found)), str(found), "MJCF")
            expand(included)
            parent[k : k + 1] = list(included)

    expand(root)
    return root


@dataclass
class Attributes:
    """The settings of <compiler> and <default> for the attributes of all other elements."""

    place: str
    degrees: bool = True
    eulerseq: str = "xyz"
    autolimits: bool = True
    defaults: dict[str, dict[str, dict[str, str]]] = field(default_factory=dict)

    @classmethod
    def of(cls, root: Element, place: str) -> "Attributes":
        """Those of a file; InputError for global coordinates, which MuJoCo has given up."""
        found = cls(place)
        for compiler in root.iterfind("compiler"):
            found.degrees = compiler.get("angle", "degree" if found.degrees else "") == "degree"
            found.eulerseq = compiler.get("eulerseq", found.eulerseq)
            found.autolimits = compiler.get("autolimits", "true") == "true"
            if compiler.get("coordinate", "local") != "local":
                raise InputError(
                    f"{place}: coordinates are global; convert the file with a MuJoCo before 2.3.4"
                )
        if len(found.eulerseq) != 3 or set(found.eulerseq.lower()) - set("xyz"):
            raise InputError(f"{place}: eulerseq is '{found.eulerseq}'; expected three of x, y, z")
        found.defaults["main"] = {}
        for default in root.iterfind("default"):
            found._read_defaults(default, "main", found.defaults["main"])
        return found

    def _read_defaults(self, default: Element, name: str, above: dict[str, dict[str, str]]) -> None:
        here = {tag: dict(values) for tag, values in above.items()}
        for part in default:
            if part.tag != "default":
                here[part.tag] = here.get(part.tag, {}) | part.attrib
        self.defaults[name] = here
        self.defaults.setdefault(default.get("class", name), here)
        for part in default.iterfind("default"):
            self._read_defaults(part, part.get("class", ""), here)

    def all_of(self, element: Element, childclass: str) -> dict[str, str]:
        """The attributes of an element with those of its class."""
        name = element.get("class", childclass)
        if name not in self.defaults:
            raise InputError(f"{self.place}: there is no default class '{name}'")
        inherited = self.defaults[name].get(str(element.tag), {})
        if any(turn in element.attrib for turn in _TURNS):
            inherited = {key: value for key, value in inherited.items() if key not in _TURNS}
        return inherited | element.attrib

    def numbers(self, values: dict[str, str], key: str, default: Sequence[float]) -> Array:
        """As many numbers as the default has, (k,); InputError for anything else."""
        if key not in values:
            return np.array(default, dtype=float)
        return np.array(list(self._read(values[key], key, len(default))))

    def _read(self, text: str, key: str, count: int) -> Iterator[float]:
        words = text.split()
        if len(words) != count:
            raise InputError(f"{self.place}: {key}='{text[:60]}'; expected {count} numbers")
        for word in words:
            value = number_in(word)
            if math.isnan(value):
                raise InputError(f"{self.place}: {key}='{text[:60]}'; '{word}' is no number")
            yield value

    def angle(self, value: float) -> float:
        """An angle of the file in rad."""
        return math.radians(value) if self.degrees else value

    def pose(self, values: dict[str, str]) -> Array:
        """Position and orientation of an element in the one around it: (4, 4)."""
        pose = translation(self.numbers(values, "pos", (0.0, 0.0, 0.0)))
        pose[:3, :3] = self._rotation(values)
        return pose

    def _rotation(self, values: dict[str, str]) -> Array:
        if "axisangle" in values:
            given = self.numbers(values, "axisangle", (0.0,) * 4)
            return turn(self._unit(given[:3], "axisangle"), self.angle(float(given[3])))
        if "xyaxes" in values:
            both = self.numbers(values, "xyaxes", (0.0,) * 6)
            x = self._unit(both[:3], "xyaxes")
            y = self._unit(both[3:] - (both[3:] @ x) * x, "xyaxes")
            return np.stack([x, y, np.cross(x, y)], axis=1)
        if "zaxis" in values:
            z = self._unit(self.numbers(values, "zaxis", (0.0,) * 3), "zaxis")
            return from_z(z)
        if "euler" in values:
            rotation = np.eye(3)
            angles = self.numbers(values, "euler", (0.0,) * 3)
            for letter, value in zip(self.eulerseq, angles.tolist(), strict=True):
                step = turn(np.eye(3)["xyz".index(letter.lower())], self.angle(value))
                rotation = rotation @ step if letter.islower() else step @ rotation
            return rotation
        quaternion = self._unit(self.numbers(values, "quat", (1.0, 0.0, 0.0, 0.0)), "quat")
        turned: Array = rotation_matrices(quaternion[None], QUATERNION)[0]
        return turned

    def _unit(self, vector: Array, key: str) -> Array:
        size = float(np.linalg.norm(vector))
        if size < 1e-12:
            raise InputError(f"{self.place}: {key} has no direction: it is zero")
        return vector / size


def turn(axis: Array, angle: float) -> Array:
    """The rotation (3, 3) by an angle (rad) about a unit axis (3,)."""
    rotation: Array = rotation_matrices((axis * angle)[None], ROTATION_VECTOR)[0]
    return rotation


def from_z(z: Array) -> Array:
    """The shortest rotation (3, 3) from the axis z to a unit vector (3,)."""
    across = np.array([-z[1], z[0], 0.0])
    size = float(np.linalg.norm(across))
    axis = across / size if size > 1e-10 else np.array([1.0, 0.0, 0.0])
    return turn(axis, math.atan2(size, z[2]))
