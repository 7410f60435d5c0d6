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
_BRACKETED = re.compile(r"(.*?)[\s_.,/:]*[\[({<]\s*([^\])}>]*?)\s*[\])}>]")
_TRAILING = re.compile(r'(.*?)[\s_.,/]+(?:in\s+)?([a-z"]+|°c?)', re.IGNORECASE)
_ATTACHED = re.compile(r"(.*?\w)(°c?)", re.IGNORECASE)
_GAPS = re.compile(r"[\s_.\-/:]+")


def split_unit(column: str) -> tuple[str, str | None]:
    """A name without its unit, and the unit as calibtool writes it; None where it has none that is
    known.
    """
    text = " ".join(column.replace("Â°", "°").translate(_DEGREES).split())
    for pattern in (_BRACKETED, _TRAILING, _ATTACHED):
        match = pattern.fullmatch(text)
        if match and match[1] and (unit := UNITS.get(match[2].lower())) is not None:
            return match[1], unit
    return text, None


def spelt(column: str) -> str:
    """The name without its unit in small letters, words separated by single blanks."""
    return _GAPS.sub(" ", split_unit(column)[0].lower()).strip()


def with_unit(name: str, unit: str | None) -> str:
    """`x` and `mm` are `x_mm`."""
    return f"{name}_{unit}" if unit else name
