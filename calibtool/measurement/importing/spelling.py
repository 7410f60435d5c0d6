"""A column's name without its unit, in small letters: `Achse 1 [°]` is `achse 1`, in deg."""

import re

UNITS = {
    spelling: unit
    for unit, spellings in {
        "mm": "mm millimeter millimetre millimeters millimetres",
        "m": "m meter metre meters metres",
        "in": 'in inch inches zoll "',
        "deg": "deg ° degree degrees grad degs",
        "rad": "rad radian radians",
        "s": "s sec second seconds sekunden",
        "ms": "ms millisecond milliseconds",
        "c": "°c c degc celsius",
        "k": "k kelvin",
        "kg": "kg kilogram",
        "g": "g gram",
    }.items()
    for spelling in spellings.split()
}
_DEGREES = str.maketrans({"º": "°", "˚": "°"})
_BRACKETED = re.compile(r"(.*?)[\s_.,/:]*[\[({<]\s*([^\[({<\])}>]*?)\s*[\])}>]")
_TRAILING = re.compile(r'(.*?)[\s_.,/]+(?:in\s+)?([a-z"]+|°c?)', re.IGNORECASE)
_ATTACHED = re.compile(r"(.*?\w)(°c?)", re.IGNORECASE)
_LONGEST = 32  # characters that a unit has at most, with brackets and separators
_GAPS = re.compile(r"[\s_.\-/:]+")


def split_unit(column: str) -> tuple[str, str | None]:
    """A name without its unit, and the unit as calibtool writes it; None where it has none that is
    known.
    """
    text = " ".join(column.replace("Â°", "°").translate(_DEGREES).split())
    # Only the end is searched: the patterns take the square of the length of what they look at.
    front, end = text[:-_LONGEST], text[-_LONGEST:]
    for pattern in (_BRACKETED, _TRAILING, _ATTACHED):
        match = pattern.fullmatch(end)
        if match and (front or match[1]):
            unit = UNITS.get(match[2].lower())
            if unit is not None:
                return front + match[1], unit
    return text, None


def spelt(column: str) -> str:
    """The name without its unit in small letters, words separated by single blanks."""
    return _GAPS.sub(" ", split_unit(column)[0].lower()).strip()


def with_unit(name: str, unit: str | None) -> str:
    """`x` and `mm` are `x_mm`."""
    return f"{name}_{unit}" if unit else name
