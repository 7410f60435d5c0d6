"""Factory calibrations of Universal Robots: the YAML of the ROS driver, and calibration.conf."""

import configparser
import math
from collections.abc import Mapping

import numpy as np
import yaml

from calibtool.controller.constant_placements import Step, chain_of
from calibtool.controller.denavit_hartenberg import DhRow, DhTable, standard_rows, steps_of
from calibtool.errors import InputError, near_names
from calibtool.robot.robot import Robot
from calibtool.units import LARGEST

FRAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
SECTION = "mounting"
_POSITION, _ANGLES = ("x", "y", "z"), ("roll", "pitch", "yaw")
_CHANGES = ("delta_a", "delta_alpha", "delta_d", "delta_theta")  # in the order of DhRow
_LINEARISED = "2"  # calibration_status of a finished calibration
_SAME = 1e-6  # m and rad: how exactly a robot must be in the DH form that is changed
_JOINTS = len(FRAMES)


def frames_model(text: str, name: str, robot: Robot) -> Robot:
    """The arm of the YAML that the UR driver's ur_calibration writes.

    Under `kinematics:` stands the placement of each joint in the one before it, x y z in m and roll
    pitch yaw in rad about the fixed axes; joints turn about z. The first frame is K_0, the frame
    that the controller calls Base; behind the last joint is the flange (tool0). Raises InputError
    with file, line and key for anything else.
    """
    _check_joints(robot, name)
    root = _mapping(_composed(text, name), name, "")
    if "kinematics" not in root:
        raise InputError(
            f"{name}: no 'kinematics:' with the frames of a UR calibration, {', '.join(FRAMES)}"
        )
    frames = _mapping(root["kinematics"], name, "kinematics")
    missing = [frame for frame in FRAMES if frame not in frames]
    if missing:
        near = near_names(missing[0], [key for key in frames if key not in FRAMES])
        hint = f"; {near}" if near.startswith("did you mean") else ""
        raise InputError(
            f"{name}: kinematics has no frame {', '.join(missing)}; a UR calibration has six: "
            f"{', '.join(FRAMES)}{hint}"
        )
    steps = [[_step(frames[frame], name, f"kinematics.{frame}")] for frame in FRAMES]
    return chain_of([*steps, []], [False] * _JOINTS, name)


def changes_model(text: str, name: str, robot: Robot) -> Robot:
    """The arm of a UR controller's `calibration.conf`: changes of DH parameters, m and rad.

    T = Π_j Rz(q_j + δθ_j) Tz(d_j + δd_j) Tx(a_j + δa_j) Rx(α_j + δα_j), a, α, d those of the
    nominal robot. The δd of parallel axes may be metres, they cancel out. Raises InputError for a
    file without six numbers each, one whose calibration is not finished, or a nominal robot that is
    not in this form.
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
    difference = _chain(nominal, name).mechanism.forward(q) - robot.mechanism.forward(q)
    if not np.abs(difference).max() < _SAME:
        raise InputError(
            f"{name}: changes of DH parameters are for a UR arm, whose K_0 is the controller's "
            f"Base and whose tool is the flange; {robot.name} is not in that form (base_frame, "
            "tool_frame in its robot.toml)"
        )
    return _chain([DhRow(*row) for row in (np.array(nominal) + changes.T).tolist()], name)


def _chain(rows: list[DhRow], name: str) -> Robot:
    return chain_of(steps_of(DhTable(rows, [], []), "standard"), [False] * _JOINTS, name)


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
    return [_number(word, f"{name}: [{SECTION}] {key}") for word in words]


# --- YAML ---------------------------------------------------------------------------------------


def _composed(text: str, name: str) -> yaml.Node | None:
    """The nodes of one document, all of them texts: YAML would take `1e-05` for a word."""
    try:
        return yaml.compose(text, Loader=yaml.BaseLoader)
    except yaml.MarkedYAMLError as error:
        line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
        raise InputError(
            f"{name}{line}: not valid YAML: {error.problem or error.context}"
        ) from None
    except yaml.YAMLError as error:
        raise InputError(f"{name}: not valid YAML: {str(error).splitlines()[0]}") from None
    except RecursionError:
        raise InputError(f"{name}: not valid YAML: nested too deeply") from None


def _mapping(node: yaml.Node | None, name: str, key: str) -> dict[str, yaml.Node]:
    """The keys of a mapping. InputError for anything else, and for a key that is there twice."""
    what = f"'{key}'" if key else "the file"
    if not isinstance(node, yaml.MappingNode):
        raise InputError(f"{name}{_line(node)}: {what} holds no keys; expected a UR calibration")
    found: dict[str, yaml.Node] = {}
    for inner, value in node.value:
        word = str(inner.value) if isinstance(inner, yaml.ScalarNode) else ""
        if word in found:
            raise InputError(f"{name}{_line(inner)}: {what} has the key '{word}' twice")
        found[word] = value
    return found


def _step(node: yaml.Node, name: str, key: str) -> Step:
    values = _mapping(node, name, key)
    missing = [part for part in (*_POSITION, *_ANGLES) if part not in values]
    if missing:
        raise InputError(
            f"{name}{_line(node)}: {key} has no {', '.join(missing)}; expected x y z roll pitch yaw"
        )

    def number(part: str) -> float:
        value = values[part]
        word = value.value if isinstance(value, yaml.ScalarNode) else ""
        return _number(word, f"{name}{_line(value)}: {key}.{part}")

    x, y, z, roll, pitch, yaw = (number(part) for part in (*_POSITION, *_ANGLES))
    return Step((x, y, z), (roll, pitch, yaw))


def _line(node: yaml.Node | None) -> str:
    return "" if node is None else f":{node.start_mark.line + 1}"


def _number(word: str, place: str) -> float:
    try:
        value = math.nan if "_" in word else float(word)  # Python would read 1_0 as ten
    except ValueError:
        value = math.nan
    if not abs(value) < LARGEST:
        raise InputError(f"{place} is '{word.strip()[:30]}'; expected a number")
    return value
