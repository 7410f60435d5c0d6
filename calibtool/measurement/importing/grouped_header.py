"""Headers of several lines, as motion capture writes them: names of objects above their axes.

Motive: `Tool` above `Position` above `X`, with the unit of lengths in its first line. Vicon: the
name of an object above the first of its columns. Qualisys: a line MARKER_NAMES, no header at all,
and lengths in mm.
"""

import re
from collections.abc import Sequence

_NUMBERS = re.compile(r'[\d."+-]*')
_LENGTHS = {"meters": "m", "millimeters": "mm", "centimeters": "cm", "inches": "in"}
_AXIS = re.compile(r"(?:.*[\s:])?[XYZ]")
_ANGLE = re.compile(r"(?:.*\s)?(?:Roll|Pitch|Yaw)|.*Rotation [XYZ]")
_MARKERS, _BODIES = "MARKER_NAMES", "BODY_NAMES"


def repeated(names: Sequence[str]) -> bool:
    """Whether a name stands above several columns."""
    filled = [name for name in names if name]
    return len(set(filled)) < len(filled)


def joined(names: list[str], above: Sequence[Sequence[str]]) -> list[str]:
    """Repeated names behind those of the lines above them, the nearest first, as far as needed.

    A name of these lines holds up to the next one. Lines of numbers (identifiers) are passed over.
    Where the names stay repeated, they are unchanged.
    """
    result = names
    for cells in above:
        if not repeated(result) or len(cells) > len(names):
            break
        if not all(map(_NUMBERS.fullmatch, cells)):
            result = [f"{g} {n}".strip() for g, n in zip(_spread(cells), result, strict=False)]
            result += names[len(result) :]
    return names if repeated(result) else result


def _spread(cells: Sequence[str]) -> list[str]:
    """Cells, the empty ones with what stands before them."""
    result: list[str] = []
    for cell in cells:
        result.append(cell or (result[-1] if result else ""))
    return result


def marker_names(before: Sequence[Sequence[str]], count: int) -> list[str]:
    """Names of `count` columns of Qualisys' markers, which have no header; [] where it is none."""
    found = next((cells[1:] for cells in before if cells[:1] == [_MARKERS]), [])
    names = [f"{marker} {axis}" for marker in found if marker for axis in "XYZ"]
    return names if len(names) == count else []


def with_units(names: Sequence[str], before: Sequence[Sequence[str]]) -> list[str]:
    """Names of lengths and angles with the unit that the lines before the header tell."""
    length, angle = "", ""
    for cells in before:
        if "Length Units" in cells[:-1]:
            length = _LENGTHS.get(cells[cells.index("Length Units") + 1].lower(), "")
            angle = "" if "Quaternion" in cells else "deg"
        elif cells[:1] in ([_MARKERS], [_BODIES]):
            length, angle = "mm", "deg"
    return [f"{name} [{unit}]" if (unit := _unit(name, length, angle)) else name for name in names]


def _unit(name: str, length: str, angle: str) -> str:
    if _ANGLE.fullmatch(name):
        return angle
    return length if _AXIS.fullmatch(name) else ""
