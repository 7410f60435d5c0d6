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


def pose(values: Sequence[float], orientation: str) -> Array:
    """Pose (4, 4) of x, y, z (m) and an orientation (rad), see `Target.orientation`."""
    T = np.eye(4)
    T[:3, 3] = values[:3]
    turn = np.asarray(values[3:], dtype=float)
    if orientation == "quaternion":
        rotation = Rotation.from_quat(turn, scalar_first=True)
    elif orientation == "rotation vector":
        rotation = Rotation.from_rotvec(turn)
    else:
        rotation = Rotation.from_euler("xyz", turn[::-1] if orientation == "abc" else turn)  # lower case: fixed axes
    T[:3, :3] = rotation.as_matrix()
    return T


def pose_values(T: Array, orientation: str, near: Sequence[float]) -> list[float]:
    """The numbers of a pose T (4, 4), inverse of `pose`; of several answers the one nearest to the numbers `near`."""
    R, old = T[:3, :3], np.asarray(near[3:], dtype=float)
    if orientation == "quaternion":
        turn = Rotation.from_matrix(R).as_quat(scalar_first=True)
        turn = -turn if turn @ old < 0 else turn
    elif orientation == "rotation vector":
        vector = Rotation.from_matrix(R).as_rotvec()
        angle = np.linalg.norm(vector)
        axis = vector / angle if angle > 1e-12 else old / max(float(np.linalg.norm(old)), 1e-12)
        turn = min((axis * (angle + 2 * np.pi * k) for k in (-2, -1, 0, 1, 2)), key=lambda v: np.linalg.norm(v - old))
    elif orientation == "abc":
        turn = _fixed_angles(R, old[::-1])[::-1]
    else:
        turn = _fixed_angles(R, old)
    return [*T[:3, 3].tolist(), *turn.tolist()]


def _fixed_angles(R: Array, old: Array) -> Array:
    """Angles about the fixed axes x, y, z nearest to `old`; where the middle one is ±90 deg the first one is kept."""
    horizontal = float(np.hypot(R[0, 0], R[1, 0]))
    pitch = np.arctan2(-R[2, 0], horizontal)
    if horizontal < 1e-9:
        left = R @ Rotation.from_euler("xyz", [old[0], pitch, 0.0]).as_matrix().T
        found = [np.array([old[0], pitch, np.arctan2(left[1, 0], left[0, 0])])]
    else:
        roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
        found = [np.array([roll, pitch, yaw]), np.array([roll + np.pi, np.pi - pitch, yaw + np.pi])]
    near = [angles - 2 * np.pi * np.round((angles - old) / (2 * np.pi)) for angles in found]
    return min(near, key=lambda angles: float(np.linalg.norm(angles - old)))
