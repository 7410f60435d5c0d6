"""A column's name without its unit, in small letters: `Achse 1 [°]` is `achse 1`, in deg."""

import re
from collections.abc import Iterator

UNITS = {
    spelling: unit
    for unit, spellings in {
        "mm": "mm millimeter millimetre millimeters millimetres 毫米",
        "m": "m meter metre meters metres",
        "in": 'in inch inches zoll "',
        "deg": "deg ° degree degrees grad degs grados gradi graden grader graus degrés stopni 度",
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
# Lengths in units that are not read; a number in them must not be taken for one in another.
_OTHER_LENGTHS = frozenset(
    ("cm", "dm", "km", "um", "µm", "μm", "nm", "micron", "microns", "ft", "feet", "mil", "thou")
)
_DEGREES = str.maketrans({"º": "°", "˚": "°"})
_BRACKETED = re.compile(r"(.*?)[\s_.,/:]*[\[({<]\s*([^\[({<\])}>]*?)\s*[\])}>]")
_TRAILING = re.compile(r'(.*?)[\s_.,/]+(?:in\s+)?([^\W\d_]+|"|°c?)', re.IGNORECASE)
_ATTACHED = re.compile(r"(.*?\w)(°c?)", re.IGNORECASE)
_LONGEST = 32  # characters that a unit has at most, with brackets and separators
_GAPS = re.compile(r"[\s_.\-/:]+")


def split_unit(column: str) -> tuple[str, str | None]:
    """A name without its unit, and the unit as calibtool writes it; None without a known unit."""
    for name, unit in _ends(column):
        if (known := UNITS.get(unit.lower())) is not None:
            return name, known
    return _plain(column), None


def unread_length(column: str) -> tuple[str, str] | None:
    """A name without its unit, and the unit, where that is one of length that is not read: cm."""
    ends = ((name, unit) for name, unit in _ends(column) if unit.lower() in _OTHER_LENGTHS)
    return next(ends, None)


def _plain(column: str) -> str:
    return " ".join(column.replace("Â°", "°").translate(_DEGREES).split())


def _ends(column: str) -> Iterator[tuple[str, str]]:
    """The ways to split a name into one without unit and what may be a unit."""
    text = _plain(column)
    # Only the end is searched: the time of the patterns grows with the square of the length.
    front, end = text[:-_LONGEST], text[-_LONGEST:]
    for pattern in (_BRACKETED, _TRAILING, _ATTACHED):
        match = pattern.fullmatch(end)
        if match and (front or match[1]):
            yield front + match[1], match[2]


def spelt(column: str) -> str:
    """The name without its unit in small letters, words separated by single blanks."""
    return _GAPS.sub(" ", split_unit(column)[0].lower()).strip()


def with_unit(name: str, unit: str | None) -> str:
    """`x` and `mm` are `x_mm`."""
    return f"{name}_{unit}" if unit else name
