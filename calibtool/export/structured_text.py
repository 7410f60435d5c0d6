"""A calibration as a function block of IEC 61131-3 Structured Text (Eq. 24)."""

import re
from collections.abc import Callable
from functools import partial
from math import prod
from typing import Any

from calibtool.calibration import Calibration
from calibtool.errors import UsageError
from calibtool.export.closed_loop_code import taught_values
from calibtool.export.rendering import (
    Code,
    Precision,
    check_words,
    compensator_values,
    digits,
    render,
    wrapped,
)
from calibtool.robot.coupling import JointValues
from calibtool.robot.se3 import Array

# What neither a function block nor a variable can be called: keywords, elementary types, standard
# functions, whatever their case.
RESERVED = """
    abs acos action add and any array asin at atan atan2 bool by byte case ceil concat
    configuration constant continue cos ctd ctu ctud date delete dint div do dt dword else elsif
    end eq exit exp expt external false find floor for from function function_block ge goto gt if
    in initial_step insert int interface interval le left len limit lint ln log lreal lt lword max
    method mid min mod move mul mux namespace ne non_retain not of on or overlap overriding
    persistent pointer priority private program protected public r_edge read_only read_write real
    ref_to reference repeat replace resource retain return right rol ror rs rtc sel shl shr sin
    single sint sqrt sr step string struct sub super tan task then this time to tod tof ton tp
    transition true trunc type udint uint ulint union until usint using var var_access var_config
    var_external var_global var_in_out var_input var_output var_temp while with word wstring xor
"""


def calibration_as_structured_text(
    calibration: Calibration,
    name: str = "calibtool",
    precision: Precision = "double",
    joint_values: JointValues = "serial",
) -> str:
    """FUNCTION_BLOCK `name` with input q (n,) in rad or m, outputs q_corrected and status, of LREAL
    or REAL.

    It computes `compensation.one_step` without recursion, own functions or memory beyond its
    variables. Plain ASCII. joint_values: the kind of the joint values q and q_corrected. Raises
    UsageError when `name` is no identifier of IEC 61131-3.
    """
    check_words(joint_values, precision)
    plain = re.fullmatch(r"[A-Za-z]\w*|_[A-Za-z0-9]\w*", name, re.ASCII)
    if not plain or "__" in name or name.endswith("_") or name.lower() in RESERVED.split():
        raise UsageError(
            f"'{name}' cannot be the name of a function block; use letters, digits and single _, "
            "no reserved word (--prefix NAME)"
        )
    loops = calibration.robot.chain.tree is not None
    values = {
        **(
            taught_values(calibration, precision)
            if loops
            else compensator_values(calibration, precision, joint_values)
        ),
        "name": name,
        "real": "LREAL" if precision == "double" else "REAL",
    }
    number = partial(digits, precision=precision)
    array = partial(_array, number)
    filters: dict[str, Callable[..., str]] = {
        "number": number,
        "array": array,
        "poses": lambda poses: array(poses[:, :3]),
    }
    if loops:
        return render("taught.st.j2", values, **filters)
    declarations = render("declarations.st.j2", values, **filters)
    memory = _memory(declarations, values["n"], 8 if precision == "double" else 4)
    return render(
        "compensator.st.j2",
        {**values, "declarations": Code(declarations), "memory": memory},
        **filters,
    )


def _array(number: Any, values: Array) -> str:
    """Initial value of an ARRAY of any dimension: the last index runs fastest."""
    return f"[\n{wrapped(', '.join(number(value) for value in values.ravel()), indent=8)}]"


def _memory(declarations: str, n: int, size: int) -> int:
    """Bytes of the declared numbers, with q and q_corrected, without the controller's padding."""
    total = 2 * n * size + 2
    for names, ranges, kind in re.findall(
        r"^ +(\w[\w, ]*) : (?:ARRAY\[(.*?)\] OF )?(\w+)", declarations, re.MULTILINE
    ):
        count = prod(int(last) for last in re.findall(r"1\.\.(\d+)", ranges))
        total += (names.count(",") + 1) * count * (2 if kind == "INT" else size)
    return total
