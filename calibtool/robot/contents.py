"""The kind of a robot's file, by its contents; conversion of all but robot.toml to a URDF."""

import re
from pathlib import Path
from typing import Literal

from calibtool.errors import InputError
from calibtool.robot.constant_placements import chain_urdf, near_frames
from calibtool.robot.denavit_hartenberg import dh_text, is_dh, read_dh, steps_of
from calibtool.robot.kuka_machine import (
    AXES,
    SIGNS,
    is_machine_data,
    machine_steps,
    read_machine_data,
)
from calibtool.robot.markup import decoded_xml, is_xml, parse_xml
from calibtool.robot.mjcf import read_mjcf
from calibtool.robot.parallel_yaml import is_parallel, read_parallel
from calibtool.robot.sdf import read_sdf
from calibtool.robot.universal_robots import is_changes
from calibtool.robot.ur_frames import FRAMES, is_frames, ur_frames
from calibtool.robot.urdf_text import Converted
from calibtool.robot.xacro_expansion import expanded_xacro

Kind = Literal[
    "toml", "urdf", "xacro", "mjcf", "sdf", "parallel", "dh", "ur-yaml", "ur-conf", "kuka-machine"
]
# Descriptions without a robot.toml, as the message about assumptions names them.
WHAT: dict[Kind, str] = {
    "urdf": "a bare URDF",
    "xacro": "a bare xacro file",
    "mjcf": "a bare MJCF of MuJoCo",
    "sdf": "a bare SDF of Gazebo",
    "parallel": "a bare robot.yaml with closed loops",
    "dh": "a bare table of DH parameters",
    "ur-yaml": "a bare calibration of a UR arm, without limits",
    "ur-conf": "changes of a UR arm",
    "kuka-machine": "bare machine data of a KUKA arm",
}
ACCEPTED = (
    "a robot is a robot.toml, a URDF, a xacro file, an MJCF, an SDF, a table of DH parameters, the "
    "calibration.yaml of a UR arm, the $machine.dat of a KUKA arm or a robot.yaml with closed loops"
)
_BYTES = (
    (b"\x89HDF\r\n", "an HDF5 file, such as measurements or a calibration"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"%PDF", "a PDF"),
    (b"solid ", "an STL mesh"),
    (b"ISO-10303-21", "a STEP file"),
    (b"glTF", "a glTF mesh"),
    (b"PXR-USDC", "a USD file"),
    (b"#usda", "a USD file"),
    (b"#VRML", "a VRML file, as Webots' PROTO files are"),
    (b"ply\n", "a PLY mesh"),
)
_XML = {
    "mujocoinclude": "a part of an MJCF; give the file that includes it",
    "COLLADA": "a COLLADA mesh",
    "html": "an HTML page",
    "svg": "an SVG image",
    "package": "the manifest of a ROS package",
    "launch": "a launch file of ROS",
    "Robot": "a robot of OpenRAVE; convert it to a URDF",
    "model": "the manifest of a Gazebo model",
}
_TOML = re.compile(
    r"^[ \t]*(?:\[[ \t]*(?:kinematics|targets|limits)[ \t.\]]|(?:name|title)[ \t]*=)", re.MULTILINE
)
_PROPERTY = "xacro:property"
_MACRO = re.compile(r"\$\{|\$\(")


def recognise(data: bytes, path: Path) -> tuple[Kind, str]:
    """The kind of a file with these bytes, and its text; InputError where it is no robot."""
    place = str(path)
    if is_xml(data):
        return _recognise_xml(decoded_xml(data, place), place)
    for mark, what in _BYTES:
        if data.startswith(mark):
            raise InputError(f"{place}: {what}; {ACCEPTED}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        if b"$TIRORO" in data:  # KUKA's controllers write their comments in their own code page
            return "kuka-machine", data.decode("latin-1")
        raise InputError(f"{place}: not a UTF-8 text file; {ACCEPTED}") from None
    if path.suffix == ".toml":
        return "toml", text
    if "\0" in text:
        raise InputError(f"{place}: a binary file; {ACCEPTED}")
    if not text.strip():
        raise InputError(f"{place}: cannot be read, the file is empty; {ACCEPTED}")
    if is_dh(text):
        return "dh", text
    if is_changes(text):
        return "ur-conf", text
    if is_machine_data(text):
        return "kuka-machine", text
    if is_parallel(text):
        return "parallel", text
    if is_frames(text):
        return "ur-yaml", text
    if _TOML.search(text):
        return "toml", text
    what = "a JSON file" if text.lstrip()[0] in "{[" else "a text file of another kind"
    raise InputError(f"{place}: {what}; {ACCEPTED}")


def _recognise_xml(text: str, place: str) -> tuple[Kind, str]:
    root = parse_xml(text, place, "URDF")
    if root.tag == "mujoco":
        return "mjcf", text
    if root.tag == "sdf":
        return "sdf", text
    if root.tag.rpartition(":")[2] != "robot":
        what = _XML.get(root.tag, f"an XML file with the root <{root.tag}>")
        raise InputError(f"{place}: {what}; {ACCEPTED}")
    moving = [part for joint in root.iterfind("joint") for part in joint.iter()]
    tags = {str(part.tag) for part in root if str(part.tag).startswith("xacro:")}
    # properties that nothing refers to change nothing
    parts = root.iter() if tags == {_PROPERTY} else [root, *root.iterfind("link"), *moving]
    macros = bool(tags - {_PROPERTY}) or any(
        _MACRO.search(value) for part in parts for value in part.attrib.values()
    )
    return ("xacro" if macros else "urdf"), text


def converted(kind: Kind, text: str, path: Path, allowed: tuple[Path, ...] = ()) -> Converted:
    """A description that is no robot.toml as a URDF with loops, called by its path in messages.

    allowed: see `named_files.inside`.
    """
    if kind == "mjcf":
        return read_mjcf(text, path, allowed)
    if kind == "sdf":
        return read_sdf(text, str(path))
    if kind == "parallel":
        return read_parallel(text, path, allowed)
    return Converted(_as_urdf(kind, text, path, allowed))


def _as_urdf(kind: Kind, text: str, path: Path, allowed: tuple[Path, ...]) -> str:
    place = path.stem if kind == "urdf" else str(path)
    if kind == "ur-conf":
        raise InputError(
            f"{place}: a UR controller's calibration.conf, changes of an arm that it does not "
            'name; write a robot.toml with [kinematics] nominal = "ur5e", calibration = '
            f'"{path.name}", or give it with compensate --controller'
        )
    if kind == "xacro":
        return expanded_xacro(path, allowed)
    if kind == "dh":
        table = read_dh(dh_text(text, place))
        if table.convention is None:
            raise InputError(
                f"{place}: DH parameters do not say their convention; add a column 'convention' "
                "with standard (a and alpha behind the joint) or modified (Craig: before it)"
            )
        slides = table.prismatic or [False] * len(table.joints)
        return chain_urdf(
            near_frames(steps_of(table, table.convention)), slides, "dh", table.limits
        )
    if kind == "kuka-machine":
        data = read_machine_data(text, place)
        axes = [[sign * part for part in axis] for sign, axis in zip(SIGNS, AXES, strict=True)]
        return chain_urdf(machine_steps(data), [False] * 6, "kuka", data.limits, axes)
    if kind == "ur-yaml":
        return chain_urdf(ur_frames(text, place), [False] * len(FRAMES), "ur")
    return text
