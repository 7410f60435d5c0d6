"""Poses as programs write them, and the frames and tools that they refer to."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, RootModel, ValidationError, model_validator

from calibtool.errors import InputError, near_names
from calibtool.robot.description import parse_toml
from calibtool.robot.se3 import Array, exp6, log3
from calibtool.units import TO_SI

UNIT_TOLERANCE = 1e-3  # how far a quaternion's length may be from 1; four decimals make 1e-4


@dataclass(frozen=True)
class NamedFrames:
    """T_base_frame and T_flange_tool by the names that the program uses; `default` is for
    poses that name none.
    """

    frames: dict[str, Array] = field(default_factory=dict)
    tools: dict[str, Array] = field(default_factory=dict)


# Orientation conventions: the names of their numbers, and how `poses` calls them.
_TURNS = {
    ("roll_deg", "pitch_deg", "yaw_deg"): "wpr",
    ("w_deg", "p_deg", "r_deg"): "wpr",
    ("a_deg", "b_deg", "c_deg"): "abc",
    ("rx_rad", "ry_rad", "rz_rad"): "rotation vector",
    ("rx_deg", "ry_deg", "rz_deg"): "rotation vector",
    ("qw", "qx", "qy", "qz"): "quaternion",
}
_PLACES = (("x_mm", "y_mm", "z_mm"), ("x_m", "y_m", "z_m"))


class _Pose(RootModel[dict[str, Annotated[float, Field(strict=False, allow_inf_nan=False)]]]):
    """Numbers of a place and of one orientation convention; those that are left out are 0."""

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
    """Frames and tools from TOML: `[frames.NAME]` and `[tools.NAME]` with x_mm …
    and an orientation.

    Orientations: roll_deg pitch_deg yaw_deg or w_deg p_deg r_deg about the fixed axes x, y, z;
    a_deg b_deg c_deg about z, the new y and the new x; rx_rad ry_rad rz_rad, a rotation vector; qw
    qx qy qz. What is left out is 0. Raises InputError for anything else in the file.
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
    """Poses (N, 4, 4) of x, y, z (m) and an orientation (rad), (N, 6) or (N, 7), see
    `Literal.orientation`.
    """
    values = np.asarray(values, dtype=float)
    T = np.zeros((len(values), 4, 4))
    T[:, :3, 3], T[:, 3, 3] = values[:, :3], 1.0
    if len(values):
        T[:, :3, :3] = _rotation(values[:, 3:], orientation)
    return T


def _rotation(turn: Array, orientation: str) -> Array:
    """Rotation matrices (N, 3, 3)."""
    if orientation == "quaternion":
        return _of_quaternions(turn)
    if orientation == "rotation vector":
        return exp6(np.concatenate([np.zeros_like(turn), turn], axis=1))[:, :3, :3]
    return _of_fixed_angles(turn[:, ::-1] if orientation == "abc" else turn)


def _of_quaternions(q: Array) -> Array:
    """Rotation matrices (N, 3, 3) of quaternions (N, 4), scalar first, of any length."""
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _quaternions(R: Array) -> Array:
    """Unit quaternions (N, 4), scalar first, of rotation matrices (N, 3, 3)."""
    vector = log3(R)
    half = np.linalg.norm(vector, axis=1, keepdims=True) / 2
    return np.concatenate([np.cos(half), vector / 2 * np.sinc(half / np.pi)], axis=1)


def _of_fixed_angles(angles: Array) -> Array:
    """Rotation matrices (N, 3, 3) of turns about the fixed axes x, then y, then z, (N, 3)."""
    (a, b, c), (s, t, u) = np.cos(angles).T, np.sin(angles).T
    rows = [
        [c * b, c * t * s - u * a, c * t * a + u * s],
        [u * b, u * t * s + c * a, u * t * a - c * s],
        [-t, b * s, b * a],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def poses_values(T: Array, orientation: str, near: Array) -> Array:
    """Numbers of poses T (N, 4, 4), inverse of `poses`; of several answers that nearest to
    the numbers `near`.
    """
    near = np.asarray(near, dtype=float)
    if not len(T):
        return near.copy()
    old, R = near[:, 3:], T[:, :3, :3]
    if orientation == "quaternion":
        turn = _quaternions(R)
        turn = np.where((turn * old).sum(axis=1, keepdims=True) < 0, -turn, turn)
    elif orientation == "rotation vector":
        turn = _rotation_vectors(log3(R), old)
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
    axis = np.where(
        angle > 1e-12, vectors / np.maximum(angle, 1e-300), old / np.maximum(size, 1e-12)
    )
    choices = axis * (angle + 2 * np.pi * np.arange(-2, 3)[:, None, None])
    nearest = np.linalg.norm(choices - old, axis=-1).argmin(axis=0)
    result: Array = choices[nearest, np.arange(len(old))]
    return result


def _fixed_angles(R: Array, old: Array) -> Array:
    """Angles about the fixed axes x, y, z (N, 3) nearest to `old`; with the middle one at ±90 deg
    the first is kept.
    """
    horizontal = np.hypot(R[:, 0, 0], R[:, 1, 0])
    pitch = np.arctan2(-R[:, 2, 0], horizontal)
    roll, yaw = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arctan2(R[:, 1, 0], R[:, 0, 0])
    choices = np.array([[roll, pitch, yaw], [roll + np.pi, np.pi - pitch, yaw + np.pi]])
    choices = choices.transpose(0, 2, 1)
    locked = np.flatnonzero(horizontal < 1e-9)
    if len(locked):
        kept = np.stack([old[locked, 0], pitch[locked], np.zeros(len(locked))], axis=1)
        turn = _of_fixed_angles(kept)
        left = R[locked] @ np.swapaxes(turn, -1, -2)
        kept[:, 2] = np.arctan2(left[:, 1, 0], left[:, 0, 0])
        choices[:, locked] = kept
    near = choices - 2 * np.pi * np.round((choices - old) / (2 * np.pi))
    nearest = np.linalg.norm(near - old, axis=-1).argmin(axis=0)
    result: Array = near[nearest, np.arange(len(old))]
    return result
