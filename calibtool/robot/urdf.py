"""URDF text → a Pinocchio model, with its frames, end links and locked joints."""

import contextlib
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from typing import IO, TypeVar
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from calibtool.errors import InputError, UsageError, near_names
from calibtool.robot.se3 import Array
from calibtool.robot.tree import urdf_root, urdf_tree

T = TypeVar("T")

_OF_JOINT = " (joint)"  # added to the name of a joint where a link has the same name


def joint_name(model: pin.Model, joint: int) -> str:
    """The name that the URDF gives to a joint."""
    return str(model.names[joint]).removesuffix(_OF_JOINT)


def parse_urdf(urdf_text: str, name: str) -> pin.Model:
    """The Pinocchio model of a URDF text; name is used in messages.

    InputError for what is no arm.
    """
    moving = ElementTree.tostring(_moving_parts(urdf_root(urdf_text, name)), "unicode")
    model = read_urdf(moving, name, pin.buildModelFromXML)
    if model.njoints < 2:
        raise InputError(f"{name}: no movable joint; expected a robot")
    _tell_joints_from_links(model)
    return model


def _moving_parts(root: ElementTree.Element) -> ElementTree.Element:
    """A URDF without shapes and extensions, with the parts of limits that Pinocchio requires."""
    for part in list(root):
        if part.tag not in ("link", "joint"):
            root.remove(part)
    for link in root.iterfind("link"):
        for part in link.findall("*"):
            if part.tag != "inertial":
                link.remove(part)
    root.set("name", root.get("name") or "robot")
    for joint in root.iterfind("joint"):
        limit = joint.find("limit")
        if limit is None and joint.get("type") in ("revolute", "prismatic"):
            limit = ElementTree.SubElement(joint, "limit")
        if limit is not None:
            limit.set("effort", "0")
            limit.set("velocity", "0")
            for key in ("lower", "upper"):
                if limit.get(key, "").strip().lower().lstrip("+-") in ("inf", "infinity"):
                    limit.set(key, "0")
    return root


def read_urdf(urdf_text: str, name: str, read: Callable[[str], T]) -> T:
    """The result of `read` for a text that declares no encoding; InputError where it refuses it.

    Messages of urdfdom are kept in a file without a name, so that no file can remain.
    """
    try:
        with tempfile.TemporaryFile() as output:
            try:
                with _redirected_stderr(output):
                    return read(urdf_text)
            except (ValueError, RuntimeError):
                output.seek(0)
                reason = _reason(output.read().decode(errors="replace"))
                raise InputError(
                    f"{name}: the URDF cannot be read{reason}; check it with a URDF checker"
                ) from None
    except OSError as error:
        raise UsageError(
            f"temporary folder: {error.strerror or error}; make room, or set TMPDIR"
        ) from None


def _tell_joints_from_links(model: pin.Model) -> None:
    """Rename the frame of a joint with the name of a link: Pinocchio finds no such frame."""
    links = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    for frame in model.frames:
        if frame.type != pin.FrameType.BODY and frame.name in links:
            if frame.type == pin.FrameType.JOINT:
                model.names[frame.parentJoint] = frame.name + _OF_JOINT
            frame.name += _OF_JOINT


@contextlib.contextmanager
def _redirected_stderr(stream: IO[bytes]) -> Iterator[None]:
    """urdfdom writes to the process's stderr by itself: keep its output in a file."""
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
        ids.append(j)
        if model.joints[j].nv != 1:
            if value:
                raise InputError(
                    f"{name}: locked joint '{joint}' has {model.joints[j].nv} degrees of freedom; "
                    "it can be locked at 0 only, or made fixed in the URDF"
                )
            continue
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
    """Pose of K_0 in the root link: of a fixed `base_frame` (InputError), or the identity."""
    if base_frame is None:
        return pin.SE3.Identity()
    frame = model.frames[frame_id(model, base_frame, name)]
    if frame.parentJoint != 0:
        raise InputError(
            f"{name}: base frame '{base_frame}' moves with joint "
            f"'{model.names[frame.parentJoint]}'; name one before it"
        )
    return frame.placement


def mimic_joints(urdf_text: str, name: str) -> dict[str, tuple[str, float, float]]:
    """Joints that follow another one, with its name, factor and offset (rad or m).

    θ = factor · θ_other + offset. Pinocchio reads them as joints of their own.
    """
    joints = urdf_tree(urdf_text, name).joints
    found = {joint.name: joint.follows for joint in joints if joint.follows is not None}
    for joint, (_, factor, offset) in found.items():
        if not np.isfinite([factor, offset]).all():
            raise InputError(
                f"{name}: joint '{joint}': multiplier and offset of <mimic> must be numbers"
            )
    return found


def check_single(joint: pin.JointModel, called: str, name: str) -> None:
    """InputError unless a joint has one degree of freedom."""
    if joint.nv != 1:
        raise InputError(
            f"{name}: joint '{called}' has {joint.nv} degrees of freedom; only single ones are "
            "modelled: make it fixed in the URDF, or several single joints"
        )
