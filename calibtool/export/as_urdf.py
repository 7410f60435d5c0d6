"""A calibration as a URDF: the identified geometry as joint origins, and what a URDF cannot hold, with its size."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration
from calibtool.errors import InputError
from calibtool.export.rendering import left_out, render
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array, exp6, inverse, log3, translation

_NOTHING = 1e-9  # m or rad: a smaller effect is rounding


def calibration_as_urdf(calibration: Calibration) -> tuple[str, list[str]]:
    """The robot's own URDF with calibrated origins, and one line for everything that it does not hold.

    Links, meshes, masses, joint names and limits stay. The placement errors δζ and the offsets δq become part of the
    origins, exactly. Of a twist error δξ the direction and the place of the axis are held exactly; pitch, gain and
    (prismatic joints) rotation only at the home of the default workspace. Joint-motion functions and the network are
    left out. Sizes are the largest effects at the tool over the configurations used for the calibration.
    """
    robot = calibration.robot
    root, tool = _calibrated_tree(calibration)
    text = ET.tostring(root, encoding="unicode")
    description = robot.source.description
    kinematics = description.kinematics.model_copy(update={"tool_frame": tool})
    source = replace(
        robot.source, urdf_text=text, description=description.model_copy(update={"kinematics": kinematics})
    )
    missing = _missing(calibration, Robot.from_source(source))
    values = {
        "robot": robot.name,
        "base_model": calibration.base.model,
        "tool": tool,
        "base": description.kinematics.base_frame,
        "locked": description.kinematics.locked_joints,
        "configurations": len(calibration.q),
        "missing": missing,
    }
    comment = render("urdf_comment.xml.j2", values, comment=lambda text: text.replace("--", "- -"))
    return f'<?xml version="1.0"?>\n{comment}{text}\n', missing


def _calibrated_tree(calibration: Calibration) -> tuple[ET.Element, str]:
    """The URDF with new origins, and the name of the link that is K_{n+1} in it."""
    robot, errors = calibration.robot, calibration.errors
    root = ET.fromstring(
        robot.source.urdf_text.encode(),
        parser=ET.XMLParser(target=ET.TreeBuilder(insert_comments=True), encoding="utf-8"),
    )
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    links = {link.get("name", ""): link for link in root.findall("link")}
    tool, carrier = _tool(calibration, root, joints, links)
    home = robot.home(robot.workspace(None)[1])
    for j in range(robot.n):
        joint = joints[robot.chain.model.names[j + 1]]
        axis, held = _axis_and_offset(robot.chain.twists[j], errors["twists"][j], errors["offsets"][j], home[j])
        _set_origin(joint, _origin(joint) @ exp6(errors["placements"][j]) @ axis @ held)
        if not np.array_equal(axis, np.eye(4)):
            _shift_link(_child(joint), inverse(axis), joints, links)
    if carrier is not None:
        _set_origin(carrier, _origin(carrier) @ exp6(errors["placements"][-1]))
    return root, tool


def _tool(
    calibration: Calibration, root: ET.Element, joints: dict[str, ET.Element], links: dict[str, ET.Element]
) -> tuple[str, ET.Element | None]:
    """The link that is K_{n+1}, and the fixed joint that carries it; None where the tool needs no correction.

    A tool frame that moves with a joint, without a fixed joint between, becomes a link of its own.
    """
    source, errors = calibration.robot.source, calibration.errors
    tool = source.description.kinematics.tool_frame
    if tool in joints:  # a frame named after a joint stands where its link does
        tool = _child(joints[tool])
    if tool not in links:
        raise InputError(f"{source.place}: tool frame '{tool}' is no link of the URDF; name the link instead")
    if not (errors["placements"][-1].any() or errors["twists"][-1].any()):
        return tool, None
    carrier = next((joint for joint in joints.values() if _child(joint) == tool), None)
    if carrier is not None and carrier.get("type") == "fixed":
        return tool, carrier
    parent, tool = tool, f"{tool}_calibrated"
    carrier = ET.SubElement(root, "joint", {"name": f"{tool}_joint", "type": "fixed"})
    ET.SubElement(carrier, "parent", {"link": parent})
    ET.SubElement(carrier, "child", {"link": tool})
    links[tool] = ET.SubElement(root, "link", {"name": tool})
    joints[f"{tool}_joint"] = carrier
    return tool, carrier


def _axis_and_offset(twist: Array, error: Array, offset: float, home: float) -> tuple[Array, Array]:
    """Poses S and L with exp6((ξ + δξ)(q + δq)) = S L exp6(ξ q) S⁻¹, at q = home, and everywhere if δξ is a mere
    displacement of the axis: S carries the nominal axis to the identified one."""
    axis = np.eye(4)
    if error.any():
        identified = twist + error
        linear, angular = identified[:3], identified[3:]
        revolute = bool(twist[3:].any())
        old, new = (twist[3:], angular) if revolute else (twist[:3], linear)
        axis[:3, :3] = _shortest_rotation(old, new)
        if revolute:
            axis = translation(np.cross(angular, linear) / (angular @ angular)) @ axis
    moved = exp6((twist + error) * (home + offset))
    return axis, inverse(axis) @ moved @ axis @ exp6(-twist * home)


def _shortest_rotation(a: Array, b: Array) -> Array:
    """The rotation (3, 3) about a × b that carries the direction of a to that of b."""
    normal = np.cross(a, b)
    sine = float(np.linalg.norm(normal))
    if sine == 0.0:
        return np.eye(3)
    rotation: Array = Rotation.from_rotvec(normal / sine * np.arctan2(sine, a @ b)).as_matrix()
    return rotation


def _shift_link(link: str, pose: Array, joints: dict[str, ET.Element], links: dict[str, ET.Element]) -> None:
    """Everything fixed to a link, its joints and its body, moves by `pose` in the link's frame: it stays in the world."""
    attached = [joint for joint in joints.values() if _parent(joint) == link]
    for part in [
        *attached,
        *(part for kind in ("inertial", "visual", "collision") for part in links[link].findall(kind)),
    ]:
        _set_origin(part, pose @ _origin(part))


def _child(joint: ET.Element) -> str:
    child = joint.find("child")
    return "" if child is None else child.get("link", "")


def _parent(joint: ET.Element) -> str:
    parent = joint.find("parent")
    return "" if parent is None else parent.get("link", "")


def _origin(part: ET.Element) -> Array:
    """<origin> as a pose (4, 4); the identity where there is none."""
    pose, origin = np.eye(4), part.find("origin")
    if origin is not None:
        roll, pitch, yaw = (float(angle) for angle in origin.get("rpy", "0 0 0").split())
        pose[:3, :3] = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
        pose[:3, 3] = [float(value) for value in origin.get("xyz", "0 0 0").split()]
    return pose


def _set_origin(part: ET.Element, pose: Array) -> None:
    origin = part.find("origin")
    if origin is None:
        origin = ET.Element("origin")
        part.insert(0, origin)
    origin.set("xyz", " ".join(repr(float(value)) for value in pose[:3, 3]))
    origin.set("rpy", " ".join(repr(float(value)) for value in _roll_pitch_yaw(pose[:3, :3])))


def _roll_pitch_yaw(R: Array) -> tuple[float, float, float]:
    """Fixed-axes angles that give R to rounding also where the pitch is ±90°: roll is what is left after yaw and pitch."""
    yaw = np.arctan2(R[1, 0], R[0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return float(roll), float(pitch), float(yaw)


def _missing(calibration: Calibration, urdf: Robot) -> list[str]:
    """One line per part of the calibration that the URDF leaves out, and one for all of it."""
    q, base = calibration.q, calibration.base
    held = urdf.mechanism.forward(q)
    beyond = [family for family in base.errors.beyond_geometry if family.id != "backlash"]
    stages = ["twist errors (pitch, gain; right at the home of the workspace)", *(family.words for family in beyond)]
    lines, before = [], held
    for k, name in enumerate(stages):
        errors = base.errors.without(*(family.id for family in beyond[k:]))
        stage = replace(calibration, base=replace(base, errors=errors), networks=()).forward(q)
        lines += _size(name, before, stage)
        before = stage
    whole = calibration.forward(q)
    lines += _size("network", before, whole)
    lines += _size("all together", held, whole) if len(lines) > 1 else []
    return lines + ([left_out(calibration)] if left_out(calibration) else [])


def _size(name: str, before: Array, after: Array) -> list[str]:
    """The line of a part: its largest effect on the tool's position and orientation, none where there is none."""
    position = float(np.linalg.norm(after[:, :3, 3] - before[:, :3, 3], axis=-1).max())
    turn = log3(after[:, :3, :3] @ np.swapaxes(before[:, :3, :3], -1, -2))
    orientation = float(np.linalg.norm(turn, axis=-1).max())
    if max(position, orientation) < _NOTHING:
        return []
    return [f"{name}: up to {position * 1e3:.4f} mm, {orientation * 1e3:.4f} mrad"]
