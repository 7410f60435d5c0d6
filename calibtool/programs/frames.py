"""Poses as programs write them, and the frames and tools that they refer to."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError
from calibtool.robot.description import parse_toml
from calibtool.robot.se3 import Array

UNIT_TOLERANCE = 1e-3  # how far a quaternion's length may be from 1; four decimals make 1e-4


@dataclass(frozen=True)
class Frames:
    """T_base_frame and T_flange_tool by the names that the program uses; `default` is for poses that name none."""

    frames: dict[str, Array] = field(default_factory=dict)
    tools: dict[str, Array] = field(default_factory=dict)


class _Pose(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    x_mm: float = 0.0
    y_mm: float = 0.0
    z_mm: float = 0.0
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0

    @property
    def matrix(self) -> Array:
        position = [1e-3 * self.x_mm, 1e-3 * self.y_mm, 1e-3 * self.z_mm]
        return pose([*position, *np.deg2rad([self.roll_deg, self.pitch_deg, self.yaw_deg])], "wpr")


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    frames: dict[str, _Pose] = {}
    tools: dict[str, _Pose] = {}


def read_frames(text: str, name: str) -> Frames:
    """Frames and tools from TOML: `[frames.NAME]` and `[tools.NAME]` with x_mm … and roll_deg pitch_deg yaw_deg.

    Angles are about the fixed axes x, y, z; what is left out is 0. Raises InputError for anything else in the file.
    """
    try:
        file = _File.model_validate(parse_toml(text, name))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(
            f"{name}: {place}: {first['msg']}; expected [frames.NAME] or [tools.NAME] with x_mm …"
        ) from None
    return Frames(
        {key: value.matrix for key, value in file.frames.items()},
        {key: value.matrix for key, value in file.tools.items()},
    )


def poses(values: Array, orientation: str) -> Array:
    """Poses (N, 4, 4) of x, y, z (m) and an orientation (rad), (N, 6) or (N, 7), see `Literal.orientation`."""
    values = np.asarray(values, dtype=float)
    T = np.zeros((len(values), 4, 4))
    T[:, :3, 3], T[:, 3, 3] = values[:, :3], 1.0
    if len(values):
        T[:, :3, :3] = _rotation(values[:, 3:], orientation).as_matrix()
    return T


def _rotation(turn: Array, orientation: str) -> Rotation:
    if orientation == "quaternion":
        return Rotation.from_quat(turn, scalar_first=True)
    if orientation == "rotation vector":
        return Rotation.from_rotvec(turn)
    reverse = orientation == "abc"
    return Rotation.from_euler("xyz", turn[:, ::-1] if reverse else turn)  # lower case: fixed axes


def poses_values(T: Array, orientation: str, near: Array) -> Array:
    """Numbers of poses T (N, 4, 4), inverse of `poses`; of several answers that nearest to the numbers `near`."""
    near = np.asarray(near, dtype=float)
    if not len(T):
        return near.copy()
    old, R = near[:, 3:], T[:, :3, :3]
    if orientation == "quaternion":
        turn = Rotation.from_matrix(R).as_quat(scalar_first=True)
        turn = np.where((turn * old).sum(axis=1, keepdims=True) < 0, -turn, turn)
    elif orientation == "rotation vector":
        turn = _rotation_vectors(Rotation.from_matrix(R).as_rotvec(), old)
    elif orientation == "abc":
        turn = _fixed_angles(R, old[:, ::-1])[:, ::-1]
    else:
        turn = _fixed_angles(R, old)
    return np.concatenate([T[:, :3, 3], turn], axis=1)


def pose(values: Sequence[float], orientation: str) -> Array:
    """The same for one pose: (4, 4)."""
    T: Array = poses(np.array([values]), orientation)[0]
    return T


def pose_values(T: Array, orientation: str, near: Sequence[float]) -> list[float]:
    """The same for one pose T (4, 4)."""
    return [float(x) for x in poses_values(T[None], orientation, np.array([near]))[0]]


def _rotation_vectors(vectors: Array, old: Array) -> Array:
    """Rotation vectors (N, 3) of the same rotations nearest to `old`, up to two turns away."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    size = np.linalg.norm(old, axis=1, keepdims=True)
    axis = np.where(angle > 1e-12, vectors / np.maximum(angle, 1e-300), old / np.maximum(size, 1e-12))
    choices = axis * (angle + 2 * np.pi * np.arange(-2, 3)[:, None, None])
    nearest = np.linalg.norm(choices - old, axis=-1).argmin(axis=0)
    result: Array = choices[nearest, np.arange(len(old))]
    return result


def _fixed_angles(R: Array, old: Array) -> Array:
    """Angles about the fixed axes x, y, z (N, 3) nearest to `old`; with the middle one at ±90 deg the first is kept."""
    horizontal = np.hypot(R[:, 0, 0], R[:, 1, 0])
    pitch = np.arctan2(-R[:, 2, 0], horizontal)
    roll, yaw = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arctan2(R[:, 1, 0], R[:, 0, 0])
    choices = np.array([[roll, pitch, yaw], [roll + np.pi, np.pi - pitch, yaw + np.pi]])
    choices = choices.transpose(0, 2, 1)
    locked = np.flatnonzero(horizontal < 1e-9)
    if len(locked):
        kept = np.stack([old[locked, 0], pitch[locked], np.zeros(len(locked))], axis=1)
        turn = Rotation.from_euler("xyz", kept).as_matrix()
        left = R[locked] @ np.swapaxes(turn, -1, -2)
        kept[:, 2] = np.arctan2(left[:, 1, 0], left[:, 0, 0])
        choices[:, locked] = kept
    near = choices - 2 * np.pi * np.round((choices - old) / (2 * np.pi))
    nearest = np.linalg.norm(near - old, axis=-1).argmin(axis=0)
    result: Array = near[nearest, np.arange(len(old))]
    return result
