"""Machine data of a KUKA arm ($machine.dat): its six axes as a chain.

T = $TIRORO Rz(s1 A1) Tx($LENGTH_A) Ry(s2 A2) Tx($LENGTH_B) Ry(s3 A3) $TX3P3 Rz(s4 A4) $DH_4
Rz(s5 A5) $DH_5 Rz(s6 A6) $TFLWP, s the signs of $AXIS_DIR, for a main axis system #NR with a
central wrist. A frame is Rz(A) Ry(B) Rx(C), a $DH_i Tz(D) Tx(A) Rx(ALPHA).
"""

import re
from math import radians
from typing import NamedTuple

from calibtool.errors import InputError
from calibtool.robot.constant_placements import Step

SIGNS = (-1, 1, 1, -1, -1, -1)  # $AXIS_DIR of every arm of this kind
AXES = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1), (0, 0, 1))
_NUMBER = r"([-+]?\d+\.?\d*(?:[eE][-+]?\d+)?)"
_FRAME_KEYS, _DH_KEYS = ("X", "Y", "Z", "A", "B", "C"), ("DHART_A", "DHART_D", "DHART_ALPHA")
_ANY = re.MULTILINE | re.IGNORECASE  # as KRL is
_IS = re.compile(r"^[^;\n]*\$TIRORO\s*=\s*\{", _ANY)


class MachineData(NamedTuple):
    """Lengths in mm, angles in deg, as the file has them; `mames` is what is added to $MAMES.

    frames: $TIRORO, $TX3P3, $TFLWP, X Y Z A B C. dh: $DH_4, $DH_5, A D ALPHA. limits: per axis.
    """

    frames: dict[str, tuple[float, ...]]
    lengths: tuple[float, float]
    dh: dict[str, tuple[float, ...]]
    mames: tuple[float, ...] = (0.0,) * 6
    limits: dict[int, tuple[float, float]] | None = None


def is_machine_data(text: str) -> bool:
    """Whether a text holds the machine data of a KUKA arm."""
    return _IS.search(text) is not None


def read_machine_data(text: str, name: str) -> MachineData:
    """The machine data of a text. InputError for what is missing, or another kind of arm."""
    for key, kinds in (("MAIN_AXIS", ("#NR",)), ("WRIST_AXIS", ("#ZEH",))):
        found = re.search(rf"\${key}\s*=\s*(#\w+)", text, _ANY)
        if found and found[1].upper() not in kinds:
            raise InputError(
                f"{name}: ${key} is {found[1]}; only #NR arms with a central wrist (#ZEH) are read"
            )

    def values(key: str, names: tuple[str, ...]) -> tuple[float, ...]:
        found = re.search(rf"^[^;\n]*\${key}\s*=\s*\{{([^}}]*)\}}", text, _ANY)
        inside = dict(re.findall(rf"(\w+)\s+{_NUMBER}", found[1].upper())) if found else {}
        if not found or set(names) - set(inside):
            raise InputError(f"{name}: no ${key} = {{{' …, '.join(names)} …}} in the machine data")
        return tuple(float(inside[each]) for each in names)

    def number(key: str) -> float:
        found = re.search(rf"^[^;\n]*\${key}\s*=\s*{_NUMBER}", text, _ANY)
        if not found:
            raise InputError(f"{name}: no ${key} in the machine data")
        return float(found[1])

    signs = dict(re.findall(r"\$AXIS_DIR\[(\d)\]\s*=\s*(-?1)\b", text, _ANY))
    if any(int(signs.get(str(j + 1), sign)) != sign for j, sign in enumerate(SIGNS)):
        raise InputError(f"{name}: $AXIS_DIR turns an axis the other way; expected {SIGNS}")
    more = dict(re.findall(rf"^;\s*\$MAMES\[(\d)\]\s*\+=\s*{_NUMBER}", text, _ANY))
    ends = [
        dict(re.findall(rf"\${key}\[(\d)\]\s*=\s*{_NUMBER}", text, _ANY))
        for key in ("SOFTN_END", "SOFTP_END")
    ]
    six = [str(j + 1) for j in range(6)]
    known = all(set(six) <= set(end) for end in ends)
    return MachineData(
        {key: values(key, _FRAME_KEYS) for key in ("TIRORO", "TX3P3", "TFLWP")},
        (number("LENGTH_A"), number("LENGTH_B")),
        {key: values(key, _DH_KEYS) for key in ("DH_4", "DH_5")},
        tuple(float(more.get(j, 0.0)) for j in six),
        {k: (radians(float(ends[0][j])), radians(float(ends[1][j]))) for k, j in enumerate(six)}
        if known
        else None,
    )


def machine_steps(data: MachineData) -> list[list[Step]]:
    """The seven products of placements of `chain_urdf`, for axes `SIGNS` times `AXES`."""

    def frame(key: str) -> list[Step]:
        x, y, z, a, b, c = data.frames[key]
        return [Step((x * 1e-3, y * 1e-3, z * 1e-3), (radians(c), radians(b), radians(a)))]

    def dh(key: str) -> list[Step]:
        a, d, alpha = data.dh[key]
        return [Step((a * 1e-3, 0.0, d * 1e-3), (radians(alpha), 0.0, 0.0))]

    along = [[Step((length * 1e-3, 0.0, 0.0))] for length in data.lengths]
    steps = [frame("TIRORO"), *along, frame("TX3P3"), dh("DH_4"), dh("DH_5"), frame("TFLWP")]
    for j, (sign, axis, change) in enumerate(zip(SIGNS, AXES, data.mames, strict=True)):
        turn = sign * radians(change)
        if turn:
            steps[j] = [*steps[j], Step(rpy=(0.0, axis[1] * turn, axis[2] * turn))]
    return steps
