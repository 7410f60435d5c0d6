"""The YAML in which the ROS driver of Universal Robots keeps an arm's factory calibration."""

import math
import re

import yaml

from calibtool.errors import InputError, near_names
from calibtool.robot.constant_placements import Step
from calibtool.units import number_in

FRAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_POSITION, _ANGLES = ("x", "y", "z"), ("roll", "pitch", "yaw")
_START = re.compile(r"^[ \t{]*[\"']?kinematics[\"']?[ \t]*:", re.MULTILINE)


def is_frames(text: str) -> bool:
    """Whether a text holds a key `kinematics`, as the YAML of the UR driver does."""
    return _START.search(text) is not None


def ur_frames(text: str, name: str) -> list[list[Step]]:
    """The seven products of placements of `chain_of` in a UR calibration.

    `kinematics:` holds the placement of each joint in the previous one, x y z in m and roll pitch
    yaw in rad about the fixed axes; joints turn about z. The first frame is K_0, which the
    controller calls Base; the flange (tool0) is after the last joint. Raises InputError with file,
    line and key for anything else.
    """
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
    return [*([_step(frames[frame], name, f"kinematics.{frame}")] for frame in FRAMES), []]


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

    def value(part: str) -> float:
        node = values[part]
        word = node.value if isinstance(node, yaml.ScalarNode) else ""
        return number(word, f"{name}{_line(node)}: {key}.{part}")

    x, y, z, roll, pitch, yaw = (value(part) for part in (*_POSITION, *_ANGLES))
    return Step((x, y, z), (roll, pitch, yaw))


def _line(node: yaml.Node | None) -> str:
    return "" if node is None else f":{node.start_mark.line + 1}"


def number(word: str, place: str) -> float:
    """A word as a number. InputError with `place` for anything else."""
    value = number_in(word)
    if math.isnan(value):
        raise InputError(f"{place} is '{word.strip()[:30]}'; expected a number")
    return value
