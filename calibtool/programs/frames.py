"""Poses as programs write them, and the named frames and tools to which they refer."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, RootModel, ValidationError, model_validator

from calibtool.errors import InputError, near_names
from calibtool.robot.orientation import (
    FIXED_ANGLES,
    QUATERNION,
    ROTATION_VECTOR,
    TURNED_ANGLES,
    UNIT_TOLERANCE,
    orientation_numbers,
    rotation_matrices,
)
from calibtool.robot.se3 import Array
from calibtool.robot.toml_text import parse_toml
from calibtool.units import TO_SI


@dataclass(frozen=True)
class NamedFrames:
    """T_base_frame and T_flange_tool by the names that a program uses; `default` is for poses
    without a name.
    """

    frames: dict[str, Array] = field(default_factory=dict)
    tools: dict[str, Array] = field(default_factory=dict)


# Orientation conventions by the names of their numbers.
_TURNS = {
    ("roll_deg", "pitch_deg", "yaw_deg"): FIXED_ANGLES,
    ("w_deg", "p_deg", "r_deg"): FIXED_ANGLES,
    ("a_deg", "b_deg", "c_deg"): TURNED_ANGLES,
    ("rx_rad", "ry_rad", "rz_rad"): ROTATION_VECTOR,
    ("rx_deg", "ry_deg", "rz_deg"): ROTATION_VECTOR,
    ("qw", "qx", "qy", "qz"): QUATERNION,
}
_PLACES = (("x_mm", "y_mm", "z_mm"), ("x_m", "y_m", "z_m"))


class _Pose(RootModel[dict[str, Annotated[float, Field(strict=False, allow_inf_nan=False)]]]):
    """A position and one orientation convention; missing numbers are 0."""

    @model_validator(mode="after")
    def _known(self) -> Self:
        groups = [*_PLACES, *_TURNS]
        known = [name for group in groups for name in group]
        for name in self.root:
            if name not in known:
                raise ValueError(f"unknown '{name}'; {near_names(name, known)}")
        for kind in (_PLACES, tuple(_TURNS)):
            used = [next((n for n in group if n in self.root), "") for group in kind]
            used = [name for name in used if name]
            if len(used) > 1:
                raise ValueError(f"{used[0]} and {used[1]} in one pose; give one of them")
        turn = [self.root.get(name, 0.0) for name in ("qw", "qx", "qy", "qz")]
        if "qw" in self.root or any(turn):
            length = float(np.linalg.norm(turn))
            if abs(length - 1.0) > UNIT_TOLERANCE:
                raise ValueError(f"a quaternion of length {length:.4g}; expected 1")
        return self

    @property
    def matrix(self) -> Array:
        """T (4, 4) in m."""
        names = next(
            (g for g in (*_TURNS,) if set(g) & self.root.keys()), ("w_deg", "p_deg", "r_deg")
        )
        place = next((g for g in _PLACES if set(g) & self.root.keys()), _PLACES[0])
        values = [
            self.root.get(name, 0.0) * TO_SI.get(name.rpartition("_")[2], 1.0)
            for name in (*place, *names)
        ]
        return pose(values, _TURNS[names])


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    frames: dict[str, _Pose] = {}
    tools: dict[str, _Pose] = {}


def read_frames(text: str, name: str) -> NamedFrames:
    """Frames and tools from TOML: `[frames.NAME]` and `[tools.NAME]` with x_mm … and an
    orientation.

    Orientations: roll_deg pitch_deg yaw_deg or w_deg p_deg r_deg about the fixed axes x, y, z;
    a_deg b_deg c_deg about z, the new y and the new x; rx_rad ry_rad rz_rad, a rotation vector; qw
    qx qy qz. Missing numbers are 0. Raises InputError for anything else in the file.
    """
    try:
        file = _File.model_validate(parse_toml(text, name))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        what = first["msg"].removeprefix("Value error, ")
        raise InputError(
            f"{name}: {place}: {what}; expected [frames.NAME] or [tools.NAME] with x_mm …"
        ) from None
    return NamedFrames(
        {key: value.matrix for key, value in file.frames.items()},
        {key: value.matrix for key, value in file.tools.items()},
    )


def poses(values: Array, orientation: str) -> Array:
    """Poses (N, 4, 4) of x, y, z (m) and an orientation (rad), (N, 6) or (N, 7), in a convention
    of `rotation_matrices`.
    """
    values = np.asarray(values, dtype=float)
    T = np.zeros((len(values), 4, 4))
    T[:, :3, 3], T[:, 3, 3] = values[:, :3], 1.0
    if len(values):
        T[:, :3, :3] = rotation_matrices(values[:, 3:], orientation)
    return T


def poses_values(T: Array, orientation: str, near: Array) -> Array:
    """Numbers of poses T (N, 4, 4), the inverse of `poses`. Of several solutions it takes the one
    nearest to the numbers `near`.
    """
    near = np.asarray(near, dtype=float)
    if not len(T):
        return near.copy()
    turn = orientation_numbers(T[:, :3, :3], orientation, near[:, 3:])
    return np.concatenate([T[:, :3, 3], turn], axis=1)


def pose(values: Sequence[float], orientation: str) -> Array:
    """The same for one pose: (4, 4)."""
    T: Array = poses(np.array([values]), orientation)[0]
    return T


def pose_values(T: Array, orientation: str, near: Sequence[float]) -> list[float]:
    """The same for one pose T (4, 4)."""
    return [float(x) for x in poses_values(T[None], orientation, np.array([near]))[0]]
