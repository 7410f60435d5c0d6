"""Units at the borders: columns and options name them; inside are metres and radians."""

import math
import re
from collections.abc import Iterable

from calibtool.errors import InputError

TO_SI = {"m": 1.0, "mm": 1e-3, "in": 0.0254, "rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0}
LARGEST = 1e15  # larger numbers are neither measured nor commanded; their squares would overflow
LENGTHS = ("m", "mm")
ANGLES = ("rad", "deg")

_JOINT_COLUMN = re.compile(r"j([1-9]\d{0,5})_([a-z]+)")
_STATED_COLUMN = re.compile(r"(j[1-9]\d{0,5})_(serial|controller)(_[a-z]+)")


def number_in(text: str) -> float:
    """The number that a text writes; NaN for anything else, and for LARGEST and more."""
    try:
        value = math.nan if "_" in text else float(text)  # Python would read 1_0 as ten
    except ValueError:
        return math.nan
    return value if abs(value) < LARGEST else math.nan


def joint_column(name: str) -> tuple[int, str] | None:
    """Joint index (from 0) and unit of a header such as `j3_deg`; None for others."""
    match = _JOINT_COLUMN.fullmatch(name.strip())
    return (int(match[1]) - 1, match[2]) if match else None


def without_values(name: str) -> tuple[str, str | None]:
    """A joint header without the word that states whose values it holds, and that word.

    `j3_controller_deg` is `j3_deg` and `controller`; every other name is itself and None.
    """
    match = _STATED_COLUMN.fullmatch(name.strip())
    return (match[1] + match[3], match[2]) if match else (name, None)


def joint_values(values: dict[str, float], prismatic: list[bool], place: str) -> list[float]:
    """Values named like table columns, `{j1_deg = 10, j2_mm = 5}`, in the order of the
    joints, in rad or m.

    Raises InputError for a name that is no joint of this robot, a unit that does not fit the joint,
    or a missing joint.
    """
    result: dict[int, float] = {}
    for name, value in values.items():
        index, factor = joint_and_factor(name, prismatic, place)
        if index in result:
            raise InputError(f"{place}: joint {index + 1} is given twice, again by '{name}'")
        result[index] = value * factor
    missing = [f"j{i + 1}" for i in range(len(prismatic)) if i not in result]
    if missing:
        raise InputError(f"{place}: no value for {', '.join(missing)}")
    return [result[i] for i in range(len(prismatic))]


def joint_and_factor(name: str, prismatic: list[bool], place: str) -> tuple[int, float]:
    """Joint index and factor to SI of a joint header; InputError if it is no joint."""
    parsed = joint_column(name)
    n = len(prismatic)
    if parsed is None:
        raise InputError(
            f"{place}: '{name}' is no joint name; expected j1_deg … j{n}_deg (or _rad; _mm, "
            "_m if prismatic)"
        )
    index, unit = parsed
    if index >= n:
        raise InputError(f"{place}: '{name}' names joint {index + 1}, but the robot has {n} joints")
    allowed = LENGTHS if prismatic[index] else ANGLES
    if unit not in allowed:
        kind = "prismatic" if prismatic[index] else "revolute"
        raise InputError(
            f"{place}: '{name}': joint {index + 1} is {kind}; its unit is {' or '.join(allowed)}"
        )
    return index, TO_SI[unit]


def three_digits(value: float) -> str:
    """A number for people: three significant digits, at most four decimals, never an exponent."""
    size = abs(value)
    if not math.isfinite(size) or size == 0.0:
        return f"{value:g}"
    if size < 5e-5:
        return "<0.0001" if value > 0 else ">-0.0001"
    decimals = 2 - math.floor(math.log10(float(f"{size:.2e}")))
    return f"{round(value, min(decimals, 4)):.{min(max(decimals, 0), 4)}f}"


def millimetres(metres: float) -> str:
    """A length for people, in mm: three significant digits, without an exponent from 1 µm up."""
    value = metres * 1e3
    return f"{value:.3g} mm" if abs(value) < 999.5 else f"{value:,.0f} mm"


def rounded(values: Iterable[float], decimals: int = 6) -> list[float]:
    """Numbers for JSON, without minus zero."""
    return [round(float(value), decimals) + 0.0 for value in values]


def minus(text: str) -> str:
    """Text for people with the sign − in front of negative numbers."""
    return re.sub(r"(?<![\w.])-(?=\d)", "−", text)


def count_of(count: int, one: str, many: str | None = None) -> str:
    """`1 row`, `2 rows`: a number with its noun. many: a plural that is not made by an s."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"
