"""Intrinsics of a camera from a file: ROS' camera_info, OpenCV's YAML, or the same as JSON."""

import re
from typing import Any

import numpy as np
import yaml

from calibtool.errors import InputError
from calibtool.robot.se3 import Array

_MATRIX = ("camera_matrix", "K", "k", "cameraMatrix", "camera matrix", "mtx", "M")
_DISTORTION = ("distortion_coefficients", "D", "d", "distCoeffs", "dist_coeffs", "dist")


def parse_intrinsics(text: str, name: str) -> Array:
    """f_x, f_y, c_x, c_y in px, k_1, k_2, p_1, p_2, k_3: (9,).

    The camera matrix and the coefficients are found by their usual names, as lists or as `data`
    of a matrix. Raises InputError for what is no such file, or a distortion of another model.
    """
    plain = re.sub(r"!!opencv-matrix|^%YAML.*$", "", text, flags=re.MULTILINE)
    try:
        keys = yaml.safe_load(plain)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"{name}: neither YAML nor JSON: {reason}") from None
    if not isinstance(keys, dict):
        raise InputError(f"{name}: no camera_matrix in it; expected ROS' camera_info or OpenCV's")
    model = keys.get("distortion_model", "plumb_bob")
    if model not in ("plumb_bob", "rational_polynomial", "brown_conrady", "none", ""):
        raise InputError(f"{name}: distortion model '{model}' is not known; use plumb_bob")
    matrix = _numbers(keys, _MATRIX, name)
    if len(matrix) != 9:
        raise InputError(f"{name}: the camera matrix has {len(matrix)} numbers; expected 9")
    fx, skew, cx, _, fy, cy = matrix[:6]
    if not (fx > 0 and fy > 0) or abs(skew) > 1e-6 * fx:
        raise InputError(f"{name}: focal lengths {fx:g}, {fy:g} px; expected two above zero")
    distortion = np.zeros(5)
    if any(key in keys for key in _DISTORTION):
        given = _numbers(keys, _DISTORTION, name)
        if len(given) > 5 and np.abs(given[5:]).max() > 0:
            raise InputError(
                f"{name}: {len(given)} distortion coefficients; k1, k2, p1, p2, k3 are known here"
            )
        distortion[: len(given[:5])] = given[:5]
    return np.array([fx, fy, cx, cy, *distortion])


def _numbers(keys: dict[str, Any], names: tuple[str, ...], name: str) -> Array:
    """The numbers under the first of these names, flat."""
    found = next((keys[key] for key in names if key in keys), None)
    if isinstance(found, dict):
        found = found.get("data")
    try:
        values = np.array(found, dtype=float).ravel()
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if found is None or not np.isfinite(values).all():
        raise InputError(f"{name}: no numbers under {names[0]}")
    return values
