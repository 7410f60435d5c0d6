"""Columns of joint values by their usual names: J1, A1, `Achse 1`, joint_1, a URDF's joint."""

import re
from collections.abc import Sequence

from calibtool.measurement.importing.spelling import spelt, split_unit, with_unit

_READ = {"actual", "act", "ist", "measured", "meas", "read", "feedback", "encoder", "mess"}
_ASKED = {
    "commanded",
    "command",
    "cmd",
    "soll",
    "target",
    "desired",
    "demand",
    "setpoint",
    "nominal",
}
_MOST_WORDS = 20  # number of words in the name of a joint
_AROUND = {
    *_READ,
    *_ASKED,
    "pos",
    "position",
    "positions",
    "angle",
    "axis",
    "joint",
    "joints",
    "states",
    "value",
    *("field", "data", "msg", "topic", "log", "jointtarget", "robax", "e6axis", "aipos", "herej"),
}
_NUMBERED = re.compile(
    r"(?:joint|jnt|jt|j|axis|axe|achse|gelenk|eje|asse|eixo|akse|axel|osa|oś|ось|关节|關節|関節|轴|軸"
    r"|ax|a|q|theta|th|θ|rax|robax|(?:cur )?jpos|axisact|position|pos)"
    r" ?[\[(]? ?(\d{1,3})[\])]?"
)
_OWN = re.compile(r"j\d+(?:_(?:read|serial|controller))?_(?:deg|rad|mm|m)")
_MAKERS = (
    ("s", "l", "u", "r", "b", "t"),  # Yaskawa
    ("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3"),  # Universal Robots
)
_QUATERNIONS = (("q1", "q2", "q3", "q4"), ("q0", "q1", "q2", "q3"))  # both scalar first


def joint_names(columns: Sequence[str], joints: Sequence[str]) -> dict[str, str]:
    """The meaning of columns: `j1_deg`, `j1`, `j1_read_deg`, `read_j1`; `qw` … for a quaternion
    that is numbered as joints are.

    joints: names of the joints in the URDF, in their order.
    """
    quaternion = _quaternion(columns, joints)
    own = {column: column.lower() for column in columns if _OWN.fullmatch(column.lower())}
    found = {
        column: numbered
        for column in columns
        if column not in quaternion
        and column not in own
        and (numbered := _number(column, joints)) is not None
    }
    if not found and not own:
        return quaternion | _by_letters(columns, len(joints))
    numbers = {number for number, _ in found.values()}
    from_zero = 0 in numbers and len(joints) not in numbers
    only_read = not own and all(read for _, read in found.values())
    named = own | quaternion
    for column, (number, read) in found.items():
        name, unit = f"j{number + from_zero}", split_unit(column)[1]
        if read and not only_read:
            name = f"{name}_read" if unit else f"read_{name}"  # a bare one is no unit called read
        named[column] = with_unit(name, unit)
    return named


def _number(column: str, joints: Sequence[str]) -> tuple[int, bool] | None:
    """Number of the joint that a column holds, and whether it was read back; None for no joint."""
    name = spelt(column).lstrip("$ ")
    for i, joint in enumerate(joints):
        rest = re.fullmatch(rf"(.*?) ?\b{re.escape(spelt(joint))} ?(.*)", name)
        if rest and set(f"{rest[1]} {rest[2]}".split()) <= _AROUND:
            return i + 1, bool(set(rest[0].split()) & _READ)
    words = name.split(" ")
    if len(words) > _MOST_WORDS:  # the search takes the square of their number
        return None
    for start in range(len(words)):
        for length in (2, 1):
            middle = " ".join(words[start : start + length])
            match = _NUMBERED.fullmatch(middle)
            around = {*words[:start], *words[start + length :]}
            if match and around <= _AROUND:
                return int(match[1]), bool(around & _READ)
    return None


def _quaternion(columns: Sequence[str], joints: Sequence[str]) -> dict[str, str]:
    """q1 q2 q3 q4 (ABB) or q0 q1 q2 q3 where the joints stand in other columns."""
    named = {spelt(column): column for column in columns if split_unit(column)[1] is None}
    numbered = {name for name in named if re.fullmatch(r"q\d+", name)}
    others = any(
        _OWN.fullmatch(c.lower()) or (not re.fullmatch(r"q ?\d+", spelt(c)) and _number(c, joints))
        for c in columns
    )
    for four in _QUATERNIONS:
        if numbered == set(four) and (others or len(joints) != 4):
            return {named[name]: f"q{axis}" for name, axis in zip(four, "wxyz", strict=True)}
    return {}


def _by_letters(columns: Sequence[str], n: int) -> dict[str, str]:
    """The letters or words by which makers call six joints, if all of them are there."""
    named = {re.sub(r"(?<=[a-z])(?=\d)", " ", spelt(column)): column for column in columns}
    for names in _MAKERS:
        if n == len(names) and all(name in named for name in names):
            return {
                named[name]: with_unit(f"j{i}", split_unit(named[name])[1])
                for i, name in enumerate(names, start=1)
            }
    return {}
