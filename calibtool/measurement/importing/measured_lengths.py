"""Lengths by the names of a header: wires and ball-bars, heights above planes, gaps to spheres."""

import re
from collections.abc import Callable

from calibtool.errors import InputError
from calibtool.measurement.importing.column_map import LengthColumns
from calibtool.measurement.importing.names import Named
from calibtool.measurement.importing.spelling import spelt, split_unit

_DISTANCE = re.compile(
    r"(?:distance|dist|abstand|length|länge|laenge|wire|wire length|cable|string|rope|seil|draht|"
    r"encoder|range|ball ?bar|l|d) ?(\d{1,3})?"
)
_POLAR = {"azimuth", "az", "hz", "hzangle", "hz angle", "vtangle", "phi", "zenith"}
_FROM_CENTRE = re.compile(r"radius|centre distance|center distance|r")
_HEIGHT = re.compile(
    r"[xyz]|height|höhe|hoehe|gap|spalt|clearance|dial|dial gauge|indicator|messuhr|deviation|"
    r"abweichung|error|fehler"
)


def measured_lengths(
    names: Named, unit_of: Callable[[str | None, str], str]
) -> LengthColumns | None:
    """Numbered distances, or one value alone: the height above a plane, or above a sphere where a
    column names it. On spheres a radius or a distance is from the centre. Labels of planes or
    spheres without any value: contacts.

    unit_of: the unit of a column from what its name says and the column. Raises InputError for
    two units, several values on a sphere, or the distance of polar coordinates.
    """
    words = {name: (spelt(name), split_unit(name)[1]) for name in names.original}
    on_sphere, on_plane = ("sphere" in words), ("plane" in words)
    if polar := [names.original[name] for name, (word, _) in words.items() if word in _POLAR]:
        raise InputError(
            f"{names.table.name}: polar coordinates ('{polar[0]}') are not read; export x, y and z"
        )
    found: dict[int, tuple[str, str | None]] = {}
    for name, (word, unit) in words.items():
        if match := _DISTANCE.fullmatch(word):
            found[int(match[1] or 1)] = (name, unit)
    what = "centre" if on_sphere else "distance"
    if not found:
        centre = [name for name, (word, _) in words.items() if _FROM_CENTRE.fullmatch(word)]
        heights = [name for name, (word, _) in words.items() if _HEIGHT.fullmatch(word)]
        chosen = centre if on_sphere and len(centre) == 1 else heights
        if len(chosen) == 1:
            found[1] = (chosen[0], words[chosen[0]][1])
            what = what if chosen is centre else ("sphere" if on_sphere else "plane")
    if not found and not (on_sphere or on_plane):
        return None
    if on_sphere and len(found) > 1:
        raise InputError(f"{names.table.name}: on spheres one length is measured per row")
    if not found:
        what = "sphere" if on_sphere else "plane"
        return LengthColumns.model_validate({"columns": [], "unit": "mm", "of": what})
    units = {unit_of(unit, name) for name, unit in found.values()}
    if len(units) > 1:
        raise InputError(f"{names.table.name}: the measured lengths have different units")
    columns = [names.original[found[k][0]] for k in sorted(found)]
    return LengthColumns.model_validate({"columns": columns, "unit": units.pop(), "of": what})
