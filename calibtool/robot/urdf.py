"""URDF text → a Pinocchio model, with its frames, end links and locked joints."""

import contextlib
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from calibtool.errors import InputError, UsageError, near_names
from calibtool.robot.se3 import Array

T = TypeVar("T")

_OF_JOINT = " (joint)"  # behind the name of a joint that a link shares


def joint_name(model: pin.Model, joint: int) -> str:
    """The name that the URDF gives to a joint."""
    return str(model.names[joint]).removesuffix(_OF_JOINT)


def parse_urdf(urdf_text: str, name: str) -> pin.Model:
    """The Pinocchio model of a URDF text; name is used in messages.

    InputError for what is no arm.
    """
    if re.search(r"<!(?:DOCTYPE|ENTITY)", urdf_text, re.IGNORECASE):
        raise InputError(
            f"{name}: the URDF holds a document type or entities (<!DOCTYPE …>); expected plain XML"
        )
    model = read_urdf(urdf_text, name, pin.buildModelFromUrdf)
    if model.njoints < 2:
        raise InputError(f"{name}: the URDF has no movable joint")
    _tell_joints_from_links(model)
    return model


def read_urdf(urdf_text: str, name: str, read: Callable[[str], T]) -> T:
    """What `read` makes of a file with this text: urdfdom refuses some encodings in a string."""
    try:
        with tempfile.TemporaryDirectory(prefix="calibtool-") as folder:
            path, output = Path(folder) / "robot.urdf", Path(folder) / "said"
            path.write_text(urdf_text, encoding="utf-8")
            try:
                with _redirected_stderr(output):
                    return read(str(path))
            except (ValueError, RuntimeError):
                reason = _reason(output.read_text(errors="replace"))
                raise InputError(
                    f"{name}: the URDF cannot be read{reason}; check it with a URDF checker"
                ) from None
    except OSError as error:
        raise UsageError(
            f"temporary folder: {error.strerror or error}; make room, or set TMPDIR"
        ) from None


def _tell_joints_from_links(model: pin.Model) -> None:
    """Pinocchio finds no frame by a name that a joint and a link share: the joint's frame
    gets another one.
    """
    links = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    for frame in model.frames:
        if frame.type != pin.FrameType.BODY and frame.name in links:
            if frame.type == pin.FrameType.JOINT:
                model.names[frame.parentJoint] = frame.name + _OF_JOINT
            frame.name += _OF_JOINT


@contextlib.contextmanager
def _redirected_stderr(path: Path) -> Iterator[None]:
    """urdfdom writes to the process's stderr by itself: keep its output in a file."""
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


def _reason(output: str) -> str:
    match = re.search(r"Error:\s+(.+)", output)
    return f": {match[1].strip()}" if match else ""


def locked_joints(model: pin.Model, locked: dict[str, float], name: str) -> tuple[list[int], Array]:
    """Ids of the locked joints, and a configuration (nq,) of the model in which they stand where
    they are locked.

    locked: positions by joint name, rad or m; name is used in messages. InputError for
    an unknown joint.
    """
    q = pin.neutral(model)
    ids, names = [], [joint_name(model, j) for j in range(model.njoints)]
    for joint, value in locked.items():
        if joint not in names[1:]:
            raise InputError(
                f"{name}: locked joint '{joint}' is not in the URDF; {near_names(joint, names[1:])}"
            )
        j = names.index(joint, 1)
        check_single(model.joints[j], joint, name)
        ids.append(j)
        if model.joints[j].nq == 1:
            q[model.joints[j].idx_q] = value
        else:  # continuous: (cos, sin)
            q[model.joints[j].idx_q : model.joints[j].idx_q + 2] = np.cos(value), np.sin(value)
    return ids, q


def frame_id(model: pin.Model, frame: str, name: str) -> int:
    """Pinocchio's id of a frame; InputError with near names where there is none."""
    if not model.existFrame(frame):  # getFrameId answers nframes for a missing name
        raise InputError(
            f"{name}: frame '{frame}' is not in the URDF; "
            f"{near_names(frame, [f.name for f in model.frames])}"
        )
    return int(model.getFrameId(frame))


def base_placement(model: pin.Model, base_frame: str | None, name: str) -> pin.SE3:
    """Pose of K_0 in the root link: of `base_frame`, which must not move (InputError),
    or the identity.
    """
    if base_frame is None:
        return pin.SE3.Identity()
    frame = model.frames[frame_id(model, base_frame, name)]
    if frame.parentJoint != 0:
        raise InputError(
            f"{name}: base frame '{base_frame}' moves with joint "
            f"'{model.names[frame.parentJoint]}'; name one before it"
        )
    return frame.placement


def mimicking(urdf_text: str) -> dict[str, str]:
    """Joints that follow another one, with the one they follow.

    Pinocchio reads them as joints of their own.
    """
    try:
        root = ElementTree.fromstring(urdf_text)
    except ElementTree.ParseError:  # Pinocchio's parser forgives more; it has read this text
        return {}
    followed = {joint.get("name", ""): joint.find("mimic") for joint in root.findall("joint")}
    return {joint: mimic.get("joint", "") for joint, mimic in followed.items() if mimic is not None}


def check_single(joint: pin.JointModel, called: str, name: str) -> None:
    """InputError unless a joint has one degree of freedom."""
    if joint.nv != 1:
        raise InputError(
            f"{name}: joint '{called}' has {joint.nv} degrees of freedom; only single ones are "
            "modelled: make it fixed in the URDF, or several single joints"
        )


def last_frame(urdf_text: str, name: str) -> str:
    """The link farthest from the root, the natural tool of a bare URDF. InputError where joints
    branch: which one?
    """
    model = parse_urdf(urdf_text, name)
    parents = list(model.parents)[1:]
    tips = [joint_name(model, j) for j in range(1, model.njoints) if j not in parents]
    if len(tips) > 1:
        raise InputError(
            f"{name}: the URDF branches, its last joints are {', '.join(tips)}; write a robot.toml "
            "that names tool_frame and locks the joints beside it in locked_joints"
        )
    bodies = [f for f in model.frames if f.type == pin.FrameType.BODY]
    return str(max(enumerate(bodies), key=lambda item: (item[1].parentJoint, item[0]))[1].name)


def end_links(urdf_text: str, joint: str, name: str) -> list[str]:
    """Links that move with a joint and carry no other link: what could be the tool."""
    model = parse_urdf(urdf_text, name)
    last = next(j for j in range(1, model.njoints) if joint_name(model, j) == joint)
    carrying = {frame.parentFrame for frame in model.frames}
    return [
        str(frame.name)
        for index, frame in enumerate(model.frames)
        if frame.type == pin.FrameType.BODY and frame.parentJoint == last and index not in carrying
    ]
