"""A calibration as a URDF: fitted joint origins, and the errors that it cannot hold."""

import xml.etree.ElementTree as ET
from itertools import count

import numpy as np
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import InputError
from calibtool.export.rendering import in_xml_comment, render
from calibtool.export.unrepresented_parts import not_held
from calibtool.export.urdf_geometry import urdf_geometry
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6
from calibtool.robot.tree import urdf_root
from calibtool.robot.urdf_text import roll_pitch_yaw


def calibration_as_urdf(
    calibration: Calibration, *, comments: bool = True
) -> tuple[str, list[str]]:
    """The robot's own URDF with calibrated origins, and one line for each part that it does not
    hold.

    Links, meshes, masses, joint names and limits do not change. The origins are those of
    `urdf_geometry`, which represent as much of the calibration as origins can. The remaining error
    of every part alone, and of all together, is given in mm and mrad at the tool over the
    configurations of the calibration. comments: launch files of ROS 2 may fail at comments; without
    them the same text is in an element <calibtool> that readers of URDFs ignore. Raises InputError
    where the tool frame is no link of the URDF.
    """
    robot = calibration.robot
    _calibrated_tree(robot, RobotErrors.of(robot), comments)  # refuses before the long fit
    geometry = urdf_geometry(calibration)
    root, tool = _calibrated_tree(robot, geometry, comments)
    missing = list(not_held(calibration, geometry))
    kinematics = robot.source.description.kinematics
    values = {
        "robot": robot.name,
        "base_model": calibration.base.model,
        "tool": tool,
        "base": kinematics.base_frame,
        "locked": kinematics.locked_joints,
        "configurations": len(calibration.q),
        "missing": missing,
        "loops": [loop.name for loop in robot.chain.tree.loops] if robot.chain.tree else [],
    }
    comment = render("urdf_comment.xml.j2", values, in_xml_comment)
    if not comments:
        said = {"tool": tool, "base": kinematics.base_frame or "the root link"}
        root.insert(0, ET.Element("calibtool", said | {"not_held": "; ".join(missing)}))
        comment = ""
    text = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0"?>\n{comment}{text}\n', missing


def _calibrated_tree(robot: Robot, geometry: RobotErrors, comments: bool) -> tuple[ET.Element, str]:
    """The URDF with new origins, and the name of the link that is K_{n+1} in it."""
    root = urdf_root(robot.source.urdf_text, robot.source.place, comments=comments)
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    links = {link.get("name", "") for link in root.findall("link")}
    tool = robot.source.description.kinematics.tool_frame
    if tool not in links and tool in joints:  # a joint's frame stands where its child does
        tool = _child(joints[tool])
    if tool not in links:
        place = robot.source.place
        raise InputError(
            f"{place}: tool frame '{tool}' is no link of the URDF; name the link instead"
        )
    moved = [joints[name] for name in robot.chain.bodies.joints]
    for loop in robot.source.description.kinematics.loops:
        moved += [_fixed_to(frame, joints, robot.source.place) for frame in loop.frames]
    if geometry["placements"][-1].any():
        carrier = next((joint for joint in joints.values() if _child(joint) == tool), None)
        if carrier is None or carrier.get("type") != "fixed":
            carrier = _new_tool(root, tool, links | joints.keys())
            tool = _child(carrier)
        moved.append(carrier)
    for joint, error in zip(moved, geometry["placements"], strict=False):
        if error.any():
            _set_origin(joint, _origin(joint) @ exp6(error))
    return root, tool


def _fixed_to(frame: str, joints: dict[str, ET.Element], place: str) -> ET.Element:
    """The fixed joint that places a frame of a loop; InputError where there is none."""
    found = joints.get(frame) or next((j for j in joints.values() if _child(j) == frame), None)
    if found is None or found.get("type") != "fixed":
        raise InputError(
            f"{place}: frame '{frame}' of a loop has no fixed joint of its own in the URDF, whose "
            "origin could be calibrated: give it one, or export json"
        )
    return found


def _new_tool(root: ET.Element, tool: str, taken: set[str]) -> ET.Element:
    """A fixed joint to a link of its own, for a tool that has no fixed joint before it."""
    names = (f"{tool}_calibrated{f'_{k}' if k > 1 else ''}" for k in count(1))
    name = next(name for name in names if not {name, f"{name}_joint"} & taken)
    carrier = ET.SubElement(root, "joint", {"name": f"{name}_joint", "type": "fixed"})
    ET.SubElement(carrier, "parent", {"link": tool})
    ET.SubElement(carrier, "child", {"link": name})
    ET.SubElement(root, "link", {"name": name})
    return carrier


def _child(joint: ET.Element) -> str:
    child = joint.find("child")
    return "" if child is None else child.get("link", "")


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
    origin.set("rpy", " ".join(repr(float(value)) for value in roll_pitch_yaw(pose[:3, :3])))
