"""Factory calibrations of Universal Robots: the YAML of the ROS driver, and calibration.conf."""

import configparser
import re
from collections.abc import Mapping

import numpy as np

from calibtool.errors import InputError
from calibtool.robot.constant_placements import Step, chain_of, chain_urdf, near_frames
from calibtool.robot.denavit_hartenberg import DhRow, DhTable, steps_of
from calibtool.robot.robot import Robot
from calibtool.robot.standard_form import standard_rows
from calibtool.robot.ur_frames import FRAMES, number, ur_frames

SECTION = "mounting"
_CHANGES = ("delta_a", "delta_alpha", "delta_d", "delta_theta")  # in the order of DhRow
_LINEARISED = "2"  # calibration_status of a finished calibration
_SAME = 1e-6  # m and rad: how exactly a robot must be in the DH form that is changed
_JOINTS = len(FRAMES)
_START = re.compile(rf"^[ \t]*(?:\[{SECTION}\]|delta_(?:theta|alpha|a|d)[ \t]*=)", re.MULTILINE)


def is_changes(text: str) -> bool:
    """Whether a text holds a section or key of a UR controller's calibration.conf."""
    return _START.search(text) is not None


def frames_model(text: str, name: str, robot: Robot) -> Robot:
    """The arm of the YAML that the UR driver's ur_calibration writes, see `ur_frames`.

    InputError, too, for a robot that is no arm of six revolute joints.
    """
    _check_joints(robot, name)
    return chain_of(ur_frames(text, name), [False] * _JOINTS, name)


def changes_model(text: str, name: str, robot: Robot) -> Robot:
    """The arm of a UR controller's `calibration.conf`, see `changed_steps`."""
    return chain_of(changed_steps(text, name, robot), [False] * _JOINTS, name)


def calibrated_urdf(kind: str, text: str, name: str, nominal: Robot) -> str:
    """The URDF of an arm by its calibration ("ur-conf" or "ur-yaml"), with the nominal limits."""
    _check_joints(nominal, name)
    steps = changed_steps(text, name, nominal) if kind == "ur-conf" else ur_frames(text, name)
    pairs = zip(nominal.lower.tolist(), nominal.upper.tolist(), strict=True)
    return chain_urdf(near_frames(steps), [False] * _JOINTS, "ur", dict(enumerate(pairs)))


def changed_steps(text: str, name: str, robot: Robot) -> list[list[Step]]:
    """The products of placements of `chain_of` for changes of DH parameters, m and rad.

    T = Π_j Rz(q_j + δθ_j) Tz(d_j + δd_j) Tx(a_j + δa_j) Rx(α_j + δα_j), a, α, d those of the
    nominal robot. The δd of parallel axes may be metres; they cancel each other. Raises InputError
    for a file without six numbers each, a calibration that is not finished, or a nominal robot that
    is not in this form.
    """
    _check_joints(robot, name)
    parser = configparser.ConfigParser(interpolation=None, inline_comment_prefixes=("#", ";"))
    try:
        parser.read_string(text, name)
    except configparser.Error as error:
        raise InputError(
            f"{name}: {error.message.splitlines()[0]}; expected a controller's calibration.conf"
        ) from None
    if not parser.has_section(SECTION):
        raise InputError(
            f"{name}: no section [{SECTION}]; expected the calibration.conf of a controller"
        )
    values = parser[SECTION]
    changes = np.array([_six(values, key, name) for key in _CHANGES])
    status = values.get("calibration_status", _LINEARISED).strip()
    if status != _LINEARISED and changes.any():
        raise InputError(
            f"{name}: calibration_status is {status}, not 2: the calibration is not finished"
        )
    nominal = standard_rows(robot.mechanism, _JOINTS)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (20, _JOINTS))
    rebuilt = chain_of(_steps(nominal), [False] * _JOINTS, name)
    difference = rebuilt.mechanism.forward(q) - robot.mechanism.forward(q)
    if not np.abs(difference).max() < _SAME:
        raise InputError(
            f"{name}: changes of DH parameters are for a UR arm, whose K_0 is the controller's "
            f"Base and whose tool is the flange; {robot.name} is not in that form (base_frame, "
            "tool_frame in its robot.toml)"
        )
    return _steps([DhRow(*row) for row in (np.array(nominal) + changes.T).tolist()])


def _steps(rows: list[DhRow]) -> list[list[Step]]:
    return steps_of(DhTable(rows, [], []), "standard")


def _check_joints(robot: Robot, name: str) -> None:
    if robot.n != _JOINTS or any(robot.prismatic):
        raise InputError(
            f"{name}: the calibration of an arm with six revolute joints, and {robot.name} is none"
        )


def _six(values: Mapping[str, str], key: str, name: str) -> list[float]:
    """The numbers of `key = [a, b, c, d, e, f]`."""
    if key not in values:
        raise InputError(f"{name}: [{SECTION}] has no {key}; expected {', '.join(_CHANGES)}")
    text = values[key].strip()
    words = text[1:-1].split(",") if text.startswith("[") and text.endswith("]") else []
    if len(words) != _JOINTS:
        raise InputError(
            f"{name}: [{SECTION}] {key} = '{text[:60]}'; expected six numbers, [a, b, c, d, e, f]"
        )
    return [number(word, f"{name}: [{SECTION}] {key}") for word in words]
