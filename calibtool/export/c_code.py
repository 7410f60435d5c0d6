"""A calibration as C99 source: the one-step correction (Eq. 24) for a robot's controller."""

import re
from functools import partial
from typing import Any

from calibtool.calibration import Calibration
from calibtool.errors import UsageError
from calibtool.export.closed_loop_code import taught_c, taught_values
from calibtool.export.rendering import (
    LINE,
    Precision,
    check_words,
    compensator_values,
    digits,
    render,
    wrapped,
)
from calibtool.robot.coupling import JointValues
from calibtool.robot.se3 import Array


def calibration_as_c(
    calibration: Calibration,
    prefix: str = "calibtool",
    precision: Precision = "double",
    joint_values: JointValues = "serial",
    header_name: str | None = None,
) -> tuple[str, str]:
    """Header and source, to be saved as `<prefix>.h` and `<prefix>.c`: functions
    `<prefix>_correct`, `<prefix>_network`. The source includes `header_name` instead of
    `<prefix>.h` if one is given.

    `<prefix>_correct` is `compensation.one_step` in C99: joint positions q (n,) in rad or m to q_m
    and a status, of type double or float. The source needs only <math.h>, does not allocate memory,
    and is plain ASCII. Numbers have 17 significant digits (9 for float); the same calibration gives
    the same text. joint_values: the kind of the joint values q and q_m. Raises UsageError when
    `prefix` is no C identifier, or `header_name` has other characters than ASCII letters, digits,
    spaces and `_ . + -`.
    """
    check_words(joint_values, precision)
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", prefix):
        raise UsageError(
            f"'{prefix}' cannot begin the names of C functions; use letters, digits and _, "
            "no digit first (--prefix NAME)"
        )
    header_name = header_name or f"{prefix}.h"
    if not re.fullmatch(r"[A-Za-z0-9_.+ -]+", header_name):
        raise UsageError(
            f"'{header_name}' cannot be the name of a header; use letters, digits, spaces and _.+-"
        )
    loops = calibration.robot.chain.tree is not None
    values = {
        **(
            taught_values(calibration, precision)
            if loops
            else compensator_values(calibration, precision, joint_values)
        ),
        "prefix": prefix,
        "PREFIX": prefix.upper(),
        "header_name": header_name,
        "real": "double" if precision == "double" else "float",
        "f": ""
        if precision == "double"
        else "f",  # suffix of constants and of functions of <math.h>
    }
    if loops:
        number = partial(_number, precision)
        return taught_c(values, {"number": number, "array": partial(_array, number)})
    values["stack"] = _stack(values, 8 if precision == "double" else 4)
    number = partial(_number, precision)
    filters = {"number": number, "array": partial(_array, number), "poses": partial(_poses, number)}
    header, source = (render(f"compensator.{suffix}.j2", values, **filters) for suffix in "hc")
    return header, source


def _number(precision: Precision, value: float) -> str:
    return digits(value, precision) + ("" if precision == "double" else "f")


def _array(number: Any, values: Array) -> str:
    """Initialiser of a real[] or a real[][]."""
    if values.ndim == 1:
        line = _row(number, values)
        return line if len(line) < LINE / 2 else f"{{\n{wrapped(line[1:-1])},\n}}"
    return "{\n" + "".join(f"{wrapped(_row(number, row), hanging=1)},\n" for row in values) + "}"


def _poses(number: Any, poses: Array) -> str:
    """Initialiser of a pose[], from (N, 4, 4)."""
    texts = []
    for pose in poses:
        rotation = ",\n      ".join(_row(number, row) for row in pose[:3, :3])
        texts.append(f"    {{{{{rotation}}},\n     {_row(number, pose[:3, 3])}}},\n")
    return "{\n" + "".join(texts) + "}"


def _row(number: Any, values: Array) -> str:
    return "{" + ", ".join(number(value) for value in values) + "}"


def _stack(values: dict[str, Any], size: int) -> int:
    """Bytes of stack of one correction at the deepest call, under gcc -O2 on a 64-bit machine."""
    n, network = values["n"], values["network"]
    if not values["corrects"]:
        return 50
    chain = 38 * n + 12 if values["varying"] or not values["kinematic"] else 0
    chain += 24 * (n + 1) if values["turns"] else 0  # two sets of placements
    return int(size * (55 * n + 305 + chain + (network.hidden + n if network else 0)) + 200)
