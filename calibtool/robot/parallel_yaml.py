"""The robot.yaml of example-parallel-robots: the closed loops and motors of the URDF beside it."""

import re
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from calibtool.errors import InputError, near_names
from calibtool.robot.markup import decoded_xml
from calibtool.robot.named_files import contents, inside
from calibtool.robot.tree import urdf_root
from calibtool.robot.urdf_text import Converted

_IS = re.compile(r"^closed_loop[ \t]*:", re.MULTILINE)
_URDF = "robot.urdf"
_LARGEST = 1_000_000  # number of characters that a file may have
_JOINED = {"3d": "spherical", "6d": "weld"}
_AXES = {"X": "1 0 0", "Y": "0 1 0", "Z": "0 0 1"}


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    closed_loop: list[tuple[str, str]]
    type: list[str] = []
    name_mot: list[str]
    joint_name: list[str] = []
    joint_type: list[str] = []


def is_parallel(text: str) -> bool:
    """Whether a text is such a file."""
    return _IS.search(text) is not None


def read_parallel(text: str, path: Path, allowed: tuple[Path, ...] = ()) -> Converted:
    """The URDF robot.urdf beside the file, with its loops. SPHERICAL and UJOINT joints become three
    or two revolute ones.

    InputError for any other content, and for frames or joints that do not exist.
    """
    place = str(path)
    file = _parsed(text, place)
    urdf = inside(path.parent, _URDF, place, allowed)
    root = urdf_root(decoded_xml(contents(urdf), str(urdf)), str(urdf))
    joints = {joint.get("name", ""): joint for joint in root.iterfind("joint")}
    links = {link.get("name", "") for link in root.iterfind("link")}
    for name, kind in zip(file.joint_name, file.joint_type, strict=True):
        if name not in joints:
            raise InputError(f"{place}: joint_name: '{name}' is no joint of {_URDF}")
        _replace(root, joints[name], kind, place)
    for name in file.name_mot:
        if name not in joints:
            raise InputError(
                f"{place}: name_mot: '{name}' is no joint of {_URDF}; {near_names(name, joints)}"
            )
    loops = []
    for k, frames in enumerate(file.closed_loop):
        kind = file.type[k].lower() if file.type else "6d"
        if kind not in _JOINED:
            raise InputError(f"{place}: type '{file.type[k]}'; expected 3d or 6d")
        ends = []
        for frame in frames:
            child = joints[frame].find("child") if frame in joints else None
            link = frame if child is None else child.get("link", "")
            if link not in links:
                raise InputError(f"{place}: closed_loop: '{frame}' is no frame of {_URDF}")
            ends.append(link)
        loops.append((f"loop{k + 1}", ends[0], ends[1], _JOINED[kind]))
    return Converted(ElementTree.tostring(root, "unicode"), tuple(loops), tuple(file.name_mot))


def _parsed(text: str, place: str) -> _File:
    if len(text) > _LARGEST:
        raise InputError(f"{place}: a YAML of {len(text)} characters; expected some lines")
    try:
        file = _File.model_validate(yaml.safe_load(text))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{place}: {where}: {first['msg']}") from None
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise InputError(f"{place}: not valid YAML: {str(error).splitlines()[0]}") from None
    for given, what, wanted in (
        (file.type, "type", file.closed_loop),
        (file.joint_type, "joint_type", file.joint_name),
    ):
        if len(given) != len(wanted) and (given or what == "joint_type"):
            raise InputError(f"{place}: {what} has {len(given)} entries; expected {len(wanted)}")
    return file


def _replace(root: Element, joint: Element, kind: str, place: str) -> None:
    """A joint by revolute ones in series, or by a fixed one."""
    found = re.fullmatch(r"SPHERICAL|FIXED|UJOINT_([XYZ])([XYZ])", kind)
    if found is None:
        raise InputError(
            f"{place}: joint_type '{kind}'; expected SPHERICAL, FIXED or UJOINT with two axes, "
            "such as UJOINT_XY"
        )
    for part in [*joint.findall("axis"), *joint.findall("limit")]:
        joint.remove(part)
    if kind == "FIXED":
        joint.set("type", "fixed")
        return
    name, child = joint.get("name", ""), joint.find("child")
    letters = "XYZ" if kind == "SPHERICAL" else "".join(found.groups())
    last = "" if child is None else child.get("link", "")
    before = joint
    for k, letter in enumerate(letters):
        if k:
            before = ElementTree.SubElement(root, "joint")
            ElementTree.SubElement(before, "parent", {"link": f"{name}_{letters[k - 1]}_moves"})
            ElementTree.SubElement(before, "child", {"link": last})
        if k < len(letters) - 1:
            link = f"{name}_{letter}_moves"
            ElementTree.SubElement(root, "link", {"name": link})
            child = before.find("child")
            assert child is not None
            child.set("link", link)
        before.attrib |= {"name": f"{name}_{letter}", "type": "continuous"}
        ElementTree.SubElement(before, "axis", {"xyz": _AXES[letter]})
