"""A calibration as a URDF: fitted joint origins, and the errors that it cannot hold."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace
from itertools import count

import numpy as np
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import InputError
from calibtool.export.rendering import left_out, render
from calibtool.export.urdf_geometry import fitted_geometry, urdf_geometry
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, log3

_NOTHING = 5e-8  # m or rad: less is 0.0000 mm in a line


def calibration_as_urdf(calibration: Calibration) -> tuple[str, list[str]]:
    """The robot's own URDF with calibrated origins, and one line for everything that
    it does not hold.

    Links, meshes, masses, joint names and limits stay. The origins are those of `urdf_geometry`: of
    all errors of the calibration they take up what origins can. The remaining error of every part
    alone, and of all together, is given in mm and mrad at the tool over the configurations of the
    calibration. Raises InputError where the tool frame is no link of the URDF.
    """
    robot = calibration.robot
    geometry = urdf_geometry(calibration)
    root, tool = _calibrated_tree(robot, geometry)
    missing = list(_missing(calibration, geometry))
    kinematics = robot.source.description.kinematics
    values = {
        "robot": robot.name,
        "base_model": calibration.base.model,
        "tool": tool,
        "base": kinematics.base_frame,
        "locked": kinematics.locked_joints,
        "configurations": len(calibration.q),
        "missing": missing,
    }
    comment = render("urdf_comment.xml.j2", values, comment=lambda text: text.replace("--", "- -"))
    text = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0"?>\n{comment}{text}\n', missing


def _calibrated_tree(robot: Robot, geometry: RobotErrors) -> tuple[ET.Element, str]:
    """The URDF with new origins, and the name of the link that is K_{n+1} in it."""
    root = ET.fromstring(
        robot.source.urdf_text.encode(),
        parser=ET.XMLParser(target=ET.TreeBuilder(insert_comments=True), encoding="utf-8"),
    )
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
    moved = [joints[name] for name in robot.chain.model.names[1:]]
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
    origin.set("rpy", " ".join(repr(float(value)) for value in _roll_pitch_yaw(pose[:3, :3])))


def _roll_pitch_yaw(R: Array) -> tuple[float, float, float]:
    """Fixed-axes angles that give R to rounding also where the pitch is ±90°: roll is what is left
    after yaw and pitch.
    """
    yaw = np.arctan2(R[1, 0], R[0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return float(roll), float(pitch), float(yaw)


def _missing(calibration: Calibration, held: RobotErrors) -> Iterator[str]:
    """One line per part of the calibration that the URDF leaves out, and one for all of it."""
    robot, q = calibration.robot, calibration.q
    whole, tool = calibration.forward(q), held.forward(q)
    if max(_sizes(whole, tool).max(axis=0)) > _NOTHING:
        for name, part in _parts(calibration):
            alone = fitted_geometry(robot, part.forward, q).forward(q)
            position, orientation = _sizes(part.forward(q), alone).max(axis=0)
            if max(position, orientation) > _NOTHING:
                yield f"{name}: up to {position * 1e3:.4f} mm, {orientation * 1e3:.4f} mrad alone"
        mean, most = _sizes(whole, tool).mean(axis=0) * 1e3, _sizes(whole, tool).max(axis=0) * 1e3
        yield (
            f"all together: {mean[0]:.4f} mm, {mean[1]:.4f} mrad in the mean, "
            f"up to {most[0]:.4f} mm, {most[1]:.4f} mrad"
        )
    if left_out(calibration):
        yield left_out(calibration)


def _parts(calibration: Calibration) -> Iterator[tuple[str, Calibration]]:
    """The calibration with one only of the parts that joint origins cannot hold altogether."""
    base, none = calibration.base, RobotErrors.of(calibration.robot)
    for family in base.errors.present:
        if family.id not in ("placements", "offsets", "backlash"):
            alone = none.having(**{family.id: base.errors[family.id]})
            yield family.words, replace(calibration, base=replace(base, errors=alone), networks=())
    if calibration.networks:
        yield "network", replace(calibration, base=replace(base, errors=none))


def _sizes(a: Array, b: Array) -> Array:
    """Distance of the tool points (m) and angle between the orientations (rad) of poses: (N, 2)."""
    turn = log3(a[:, :3, :3] @ np.swapaxes(b[:, :3, :3], -1, -2))
    position = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=-1)
    return np.stack([position, np.linalg.norm(turn, axis=-1)], axis=-1)
