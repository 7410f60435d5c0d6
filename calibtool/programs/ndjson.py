"""Newline-delimited JSON: one object per line with the names of a table's columns as keys."""

import json
import re

import numpy as np

from calibtool.errors import InputError
from calibtool.programs.frames import UNIT_TOLERANCE
from calibtool.programs.targets import NUMBER, Lines, Number, Program, Remark, Target
from calibtool.robot.model import Robot
from calibtool.units import TO_SI, joint_and_factor, joint_column

NAME = "ndjson"
SUFFIXES = (".ndjson", ".jsonl")
_PAIR = re.compile(rf'"((?:[^"\\]|\\.)*)"\s*:\s*({NUMBER}|NaN|-?Infinity|null|"(?:[^"\\]|\\.)*")?')
_ORIENTATIONS = {
    "quaternion": ("qw", "qx", "qy", "qz"),
    "rotation vector": ("rx_rad", "ry_rad", "rz_rad"),
    "wpr": ("roll_deg", "pitch_deg", "yaw_deg"),
}


def matches(text: str) -> bool:
    """Whether the first line that is not empty is one JSON object."""
    first = text.lstrip().split("\n", 1)[0].strip()
    return first.startswith("{") and first.endswith("}") and '"' in first


def read(text: str, robot: Robot) -> Program:
    """Joints, or a pose, or both (the joints choose the branch and both are corrected) of every line."""
    lines = Lines(text)
    targets: list[Target] = []
    remarks: list[Remark] = []
    for match in re.finditer(r"[^\r\n]+", text):
        if not match[0].strip():
            continue
        line = lines(match.start())
        try:
            found = _target(match[0], match.start(), line, robot)
        except (InputError, ValueError) as error:
            found = Remark(line, "", str(error), bad=True)
        if isinstance(found, Target):
            targets.append(found)
        else:
            remarks.append(found)
    return Program(text, tuple(targets), tuple(remarks))


def _target(text: str, offset: int, line: int, robot: Robot) -> Target | Remark:
    try:
        loaded = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"not JSON: {error.msg} (column {error.colno})") from None
    if not isinstance(loaded, dict):
        raise InputError("not a JSON object")
    spans = {match[1]: match.span(2) for match in _PAIR.finditer(text)}
    joint_keys: dict[int, str] = {}
    for key in loaded:
        if joint_column(key) is None:
            continue
        index, _ = joint_and_factor(key, robot.prismatic, "a key")
        if index in joint_keys:
            raise InputError(f"joint {index + 1} is given twice, '{joint_keys[index]}' and '{key}'")
        joint_keys[index] = key
    if joint_keys and len(joint_keys) != robot.n:
        raise InputError(f"holds {len(joint_keys)} joints, but {robot.name} has {robot.n}")

    def numbers(keys: list[str]) -> tuple[Number, ...]:
        found = []
        for key in keys:
            value = loaded[key]
            if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
                raise InputError(f"'{key}' holds {json.dumps(value)[:30]}; expected a number")
            unit = key.split("_")[1] if "_" in key else ""
            start, end = spans[key]
            found.append(Number(offset + start, offset + end, unit, float(value) * TO_SI.get(unit, 1.0)))
        return tuple(found)

    joints = numbers([joint_keys[k] for k in range(robot.n)]) if joint_keys else ()
    for unit in ("mm", "m"):
        position = [f"{axis}_{unit}" for axis in "xyz"]
        for orientation, keys in _ORIENTATIONS.items():
            if all(key in loaded for key in (*position, *keys)):
                found = numbers([*position, *keys])
                length = float(np.linalg.norm([number.value for number in found[3:]]))
                if orientation == "quaternion" and abs(length - 1) > UNIT_TOLERANCE:
                    raise InputError(f"quaternion of length {length:.4g}; expected 1")
                return Target("pose", found, line, "", orientation, joints=joints)
    if not joints:
        return Remark(line, "", "neither joints nor a pose")
    return Target("joint", joints, line, "")
