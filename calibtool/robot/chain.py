"""URDF text → a Pinocchio model that is one serial chain with one coordinate per joint."""

import contextlib
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from calibtool.errors import InputError, UsageError, near_names
from calibtool.robot.description import Source
from calibtool.robot.se3 import Array, readonly

T = TypeVar("T")
LimitSource = Literal["urdf", "continuous", "missing"]

_OF_JOINT = " (joint)"  # behind the name of a joint that a link shares


@dataclass(frozen=True, eq=False)
class SerialChain:
    """n one-coordinate joints in a row, from K_0 to the tool.

    model        Pinocchio model, nq = nv = n, joints 1…n in order
    placements   (n+1, 4, 4) M_j, pose of joint frame j in frame j−1 at q_j = 0; the last one is the tool's, K_{n+1}
    twists       (n, 6) ξ_j, unit twist of joint j in its own frame
    lower, upper (n,) joint limits in rad or m; ±π for a continuous or unlimited angle, NaN for an unlimited slide
    limited_by   (n,) where they come from: the URDF, a continuous joint, or nowhere
    """

    model: pin.Model
    placements: Array
    twists: Array
    lower: Array
    upper: Array
    limited_by: tuple[LimitSource, ...]


def build_chain(source: Source) -> SerialChain:
    """Lock, cut and rebuild the URDF's model: joints that Pinocchio stores as (cos, sin) become plain angles.

    Raises InputError for an unknown joint or frame, a chain that branches before the tool, or a joint of several
    degrees of freedom.
    """
    name = source.place
    kinematics = source.description.kinematics
    full = _parse_urdf(source.urdf_text, name)
    reduced = _lock(full, kinematics.locked_joints, name)
    tool = reduced.frames[_frame_id(reduced, kinematics.tool_frame, name)]

    joints = _joints_to(reduced, tool.parentJoint, name)
    base = _base_placement(reduced, kinematics.base_frame, name)
    model = pin.Model()
    model.name = source.description.name
    model.gravity = pin.Motion(base.rotation.T @ reduced.gravity.linear, np.zeros(3))
    mimicking = _mimicking(source.urdf_text)
    placements, twists, lower, upper, limited_by = [], [], [], [], []
    for position, j in enumerate(joints):
        old = reduced.joints[j]
        joint_name = reduced.names[j].removesuffix(_OF_JOINT)
        if joint_name in mimicking:
            raise InputError(
                f"{name}: joint '{joint_name}' between base and tool mimics '{mimicking[joint_name]}'; only independent "
                "joints are modelled: lock it in [kinematics], or make it fixed in the URDF"
            )
        twist = _unit_twist(old, joint_name, name)
        placement = base.actInv(reduced.jointPlacements[j]) if position == 0 else reduced.jointPlacements[j]
        new = model.addJoint(position, _joint_model(twist), placement, joint_name)
        model.appendBodyToJoint(new, reduced.inertias[j], pin.SE3.Identity())
        placements.append(placement.homogeneous)
        twists.append(twist)
        low, high, limit = _limits(reduced, old, prismatic=bool(np.linalg.norm(twist[3:]) < 0.5))
        lower.append(low)
        upper.append(high)
        limited_by.append(limit)
    placements.append(tool.placement.homogeneous)
    return SerialChain(
        model, readonly(placements), readonly(twists), readonly(lower), readonly(upper), tuple(limited_by)
    )


def last_frame(urdf_text: str, name: str) -> str:
    """The link farthest from the root, the natural tool of a bare URDF. InputError where joints branch: which one?"""
    model = _parse_urdf(urdf_text, name)
    tips = [
        str(model.names[j]).removesuffix(_OF_JOINT) for j in range(1, model.njoints) if j not in list(model.parents)[1:]
    ]
    if len(tips) > 1:
        raise InputError(
            f"{name}: the URDF branches, its last joints are {', '.join(tips)}; write a robot.toml that names tool_frame "
            "and locks the joints beside it in locked_joints"
        )
    bodies = [f for f in model.frames if f.type == pin.FrameType.BODY]
    return str(max(enumerate(bodies), key=lambda item: (item[1].parentJoint, item[0]))[1].name)


def end_links(urdf_text: str, joint: str, name: str) -> list[str]:
    """Links that move with a joint and carry no other link: what could be the tool."""
    model = _parse_urdf(urdf_text, name)
    last = next(j for j in range(1, model.njoints) if model.names[j].removesuffix(_OF_JOINT) == joint)
    carrying = {frame.parentFrame for frame in model.frames}
    return [
        str(frame.name)
        for index, frame in enumerate(model.frames)
        if frame.type == pin.FrameType.BODY and frame.parentJoint == last and index not in carrying
    ]


def visual_geometry(source: Source, urdf_text: str) -> pin.GeometryModel:
    """What the links look like, on the joints of `build_chain(source)`: placements in their frames, and in K_0 before them.

    urdf_text: the source's URDF with meshes named by absolute paths. InputError for a mesh that cannot be read.
    """
    name, kinematics = source.place, source.description.kinematics
    full = _parse_urdf(urdf_text, name)
    every = _read_urdf(urdf_text, name, lambda path: pin.buildGeomFromUrdf(full, path, pin.GeometryType.VISUAL))
    reduced, geometry = pin.buildReducedModel(full, every, *_locked(full, kinematics.locked_joints, name))
    tool = reduced.frames[_frame_id(reduced, kinematics.tool_frame, name)]
    way = [0, *_joints_to(reduced, tool.parentJoint, name)]
    base = _base_placement(reduced, kinematics.base_frame, name)
    result = pin.GeometryModel()
    for piece in geometry.geometryObjects:
        piece.parentJoint, piece.parentFrame = way.index(piece.parentJoint), 0
        if piece.parentJoint == 0:
            piece.placement = base.actInv(piece.placement)
        result.addGeometryObject(piece)
    return result


def _parse_urdf(urdf_text: str, name: str) -> pin.Model:
    if re.search(r"<!(?:DOCTYPE|ENTITY)", urdf_text, re.IGNORECASE):
        raise InputError(f"{name}: the URDF holds a document type or entities (<!DOCTYPE …>); expected plain XML")
    model = _read_urdf(urdf_text, name, pin.buildModelFromUrdf)
    if model.njoints < 2:
        raise InputError(f"{name}: the URDF has no movable joint")
    _tell_joints_from_links(model)
    return model


def _read_urdf(urdf_text: str, name: str, read: Callable[[str], T]) -> T:
    """What `read` makes of a file with this text: urdfdom refuses some encodings in a string."""
    try:
        with tempfile.TemporaryDirectory(prefix="calibtool-") as folder:
            path, said = Path(folder) / "robot.urdf", Path(folder) / "said"
            path.write_text(urdf_text, encoding="utf-8")
            try:
                with _redirected_stderr(said):
                    return read(str(path))
            except (ValueError, RuntimeError):
                reason = _reason(said.read_text(errors="replace"))
                raise InputError(f"{name}: the URDF cannot be read{reason}; check it with a URDF checker") from None
    except OSError as error:
        raise UsageError(f"temporary folder: {error.strerror or error}; make room, or set TMPDIR") from None


def _tell_joints_from_links(model: pin.Model) -> None:
    """Pinocchio finds no frame by a name that a joint and a link share: the joint's frame gets another one."""
    links = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    for frame in model.frames:
        if frame.type != pin.FrameType.BODY and frame.name in links:
            if frame.type == pin.FrameType.JOINT:
                model.names[frame.parentJoint] = frame.name + _OF_JOINT
            frame.name += _OF_JOINT


@contextlib.contextmanager
def _redirected_stderr(path: Path) -> Iterator[None]:
    """urdfdom writes to the process's stderr by itself: keep what it says in a file."""
    with path.open("wb") as stream:
        try:
            kept = os.dup(2)
        except OSError:  # no stderr at all
            yield
            return
        os.dup2(stream.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _reason(said: str) -> str:
    match = re.search(r"Error:\s+(.+)", said)
    return f": {match[1].strip()}" if match else ""


def _lock(model: pin.Model, locked: dict[str, float], name: str) -> pin.Model:
    return pin.buildReducedModel(model, *_locked(model, locked, name)) if locked else model


def _locked(model: pin.Model, locked: dict[str, float], name: str) -> tuple[list[int], Array]:
    """Ids of the locked joints, and a configuration of the model in which they stand where they are locked."""
    q = pin.neutral(model)
    ids = []
    names = [joint.removesuffix(_OF_JOINT) for joint in model.names]
    for joint, value in locked.items():
        if joint not in names[1:]:
            raise InputError(f"{name}: locked joint '{joint}' is not in the URDF; {near_names(joint, names[1:])}")
        j = names.index(joint, 1)
        _check_single(model.joints[j], joint, name)
        ids.append(j)
        if model.joints[j].nq == 1:
            q[model.joints[j].idx_q] = value
        else:  # continuous: (cos, sin)
            q[model.joints[j].idx_q : model.joints[j].idx_q + 2] = np.cos(value), np.sin(value)
    return ids, q


def _frame_id(model: pin.Model, frame: str, name: str) -> int:
    if not model.existFrame(frame):  # getFrameId answers nframes for a missing name
        raise InputError(
            f"{name}: frame '{frame}' is not in the URDF; {near_names(frame, [f.name for f in model.frames])}"
        )
    return int(model.getFrameId(frame))


def _base_placement(model: pin.Model, base_frame: str | None, name: str) -> pin.SE3:
    if base_frame is None:
        return pin.SE3.Identity()
    frame = model.frames[_frame_id(model, base_frame, name)]
    if frame.parentJoint != 0:
        raise InputError(
            f"{name}: base frame '{base_frame}' moves with joint '{model.names[frame.parentJoint]}'; name one before it"
        )
    return frame.placement


def _joints_to(model: pin.Model, last: int, name: str) -> list[int]:
    """Joint ids from the base to joint `last`; a joint beside or beyond this way must be locked by the description."""
    way: list[int] = []
    while last > 0:
        way.insert(0, last)
        last = model.parents[last]
    beside = [str(model.names[j]).removesuffix(_OF_JOINT) for j in range(1, model.njoints) if j not in way]
    if beside:
        raise InputError(f"{name}: joints {', '.join(beside)} are not between base and tool; lock them in [kinematics]")
    if not way:
        raise InputError(f"{name}: no joint moves the tool frame")
    return way


def _mimicking(urdf_text: str) -> dict[str, str]:
    """Joints that follow another one, with the one they follow. Pinocchio reads them as joints of their own."""
    try:
        root = ElementTree.fromstring(urdf_text)
    except ElementTree.ParseError:  # Pinocchio's parser forgives more; it has read this text
        return {}
    pairs = ((joint.get("name"), joint.find("mimic")) for joint in root.findall("joint"))
    return {str(joint): str(mimic.get("joint")) for joint, mimic in pairs if mimic is not None}


def _check_single(joint: pin.JointModel, joint_name: str, name: str) -> None:
    if joint.nv != 1:
        raise InputError(
            f"{name}: joint '{joint_name}' has {joint.nv} degrees of freedom; only single ones are modelled: make it fixed "
            "in the URDF, or several single joints"
        )


def _unit_twist(joint: pin.JointModel, joint_name: str, name: str) -> Array:
    _check_single(joint, joint_name, name)
    data = joint.createData()
    joint.calc(data, np.array([0.0]) if joint.nq == 1 else np.array([1.0, 0.0]))
    twist = np.array(data.S, dtype=float).reshape(6)
    if not abs(np.linalg.norm(twist) - 1.0) < 1e-9:
        raise InputError(f"{name}: joint '{joint_name}' has no axis; its <axis xyz=…/> must not be zero")
    return twist


def _joint_model(twist: Array) -> pin.JointModel:
    """The Pinocchio joint of a pure rotation or translation."""
    linear, angular = twist[:3], twist[3:]
    if np.linalg.norm(angular) < 0.5:
        return pin.JointModelPrismaticUnaligned(linear)
    aligned = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
    for axis, model in enumerate(aligned):
        if angular[axis] == 1.0:
            return model()
    return pin.JointModelRevoluteUnaligned(angular)


def _limits(model: pin.Model, joint: pin.JointModel, prismatic: bool) -> tuple[float, float, LimitSource]:
    if joint.nq == 2:
        return -np.pi, np.pi, "continuous"
    low, high = float(model.lowerPositionLimit[joint.idx_q]), float(model.upperPositionLimit[joint.idx_q])
    if np.isfinite([low, high]).all() and high > low:
        return low, high, "urdf"
    return (np.nan, np.nan, "missing") if prismatic else (-np.pi, np.pi, "missing")
