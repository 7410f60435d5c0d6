"""Columns of measured points by their usual names: X1 Y1 Z1, `T1 X (mm)`, SMR_A X [mm], x y z."""

import re
from collections.abc import Collection, Sequence

from calibtool.errors import InputError
from calibtool.measurement.importing.spelling import split_unit, unread_length, with_unit

_OWN = re.compile(r"(?:t\d+_(?:nominal_|error_)?|ref\d+_)?[xyz](?:_(?:mm|m|in))?")
_AXIS_LAST = re.compile(r"(?P<who>.*?)(?:(?<![a-z])|(?<=\b[tp]))(?P<axis>[xyz])")
_AXIS_FIRST = re.compile(r"(?P<axis>[xyz])(?![a-z])(?P<who>.*)")
_NUMBERED = re.compile(r"[a-z]* ?0*(\d{1,9})")
_LAST = re.compile(r"(.*?)0*(\d{1,9})")
_WORDS = """
    t p pos position point coord coordinate coordinates koordinate meas measured measurement actual
    act ist mess messwert value translation trans tvec tracker laser target smr prism reflector
    probe sensor punkt pose transform field data mes mesure mesuré mesurée misurato misurata medido
    medida wert center centre mittelpunkt location
"""
_PLAIN = set(_WORDS.split())
_SURVEYED = {  # of a total station: right-handed in this order
    **dict.fromkeys(("east", "easting", "rechtswert", "ostwert"), "x"),
    **dict.fromkeys(("north", "northing", "hochwert", "nordwert"), "y"),
    **dict.fromkeys(("height", "elevation", "höhe", "hoehe", "up"), "z"),
}
ROBOT = {"robot", "tcp", "flange", "tool", "cart", "cartesian", "base", "world"}
_OTHERS = """
    nominal nom soll theoretical theo design cmd command commanded d delta dev deviation error err
    diff abweichung sigma std stdev rms unc uncertainty u v vel velocity speed acc acceleration f
    force torque moment n normal q r rot rvec rotvec rodrigues quat rotation euler orientation ref
    reference abw abweichungen ecart écart scarto scostamento desviacion desviación tol tolerance
    residual resid theorique théorique teorico nennwert nennmaß nominale nominell sollwert sollmaß
"""
_OTHER = set(_OTHERS.split())  # values that are no measured point


def point_names(
    columns: Sequence[str], place: str, turned: Collection[frozenset[str]] = ()
) -> tuple[dict[str, str], frozenset[str]]:
    """The meaning of columns: `x_mm`, `t2_y_mm`, `x` …, and the words before the names of a single
    point. A robot's own positions count only where nothing else was measured.

    turned: words before the names of orientations; a single point of that name is a pose. Raises
    InputError where two columns have the same meaning, or two sets of columns may be the measured
    points.
    """
    meant = own_names(columns)
    groups: dict[tuple[str, str | None], dict[str, str]] = {}
    for column in columns:
        name, unit = split_unit(column)
        if unit is None and (other := unread_length(column)) and _who_axis(other[0]):
            raise InputError(
                f"{place}: column '{column}' is in {other[1]}; lengths are read in mm, m or in: "
                "convert them"
            )
        who_axis = None if column in meant and column[0] in "tTrR" else _who_axis(name)
        if who_axis is None:
            continue
        axes = groups.setdefault((who_axis[0], unit), {})
        if axes.setdefault(who_axis[1], column) != column:
            raise InputError(
                f"{place}: columns '{axes[who_axis[1]]}' and '{column}' mean the same; rename one, "
                "or map the columns with --columns MAP.toml"
            )
    whole = {key: axes for key, axes in groups.items() if len(axes) == 3}
    plain, numbered, others, robot = _sorted(list(whole))
    if not plain and not numbered and not others and _series(robot):
        numbered, robot = robot, []  # markers of a body that is called Tool
    alike = len({who for who, _ in plain}) <= 1  # in two units it is still one point
    kinds = [kind for kind in (plain, numbered, others) if kind]
    if len(kinds) > 1 or not alike or (not kinds and len(robot) > 1):
        sets = [whole[kind[0]]["x"] for kind in kinds] if len(kinds) > 1 else []
        sets = sets or [whole[key]["x"] for key in plain or robot]
        raise InputError(
            f"{place}: more than one set of columns may be the measured points, those of "
            f"{' and of '.join(repr(c) for c in sets)}; map the columns with --columns MAP.toml"
        )
    single = kinds[0][0] if len(kinds) == 1 and len(kinds[0]) == 1 else None
    if not kinds and len(robot) == 1:
        single = robot[0]
    who = frozenset() if single is None else owner(single[0].split())
    if single is not None and who in set(map(owner, turned)):
        plain, numbered, others = [single], [], []
    for key in plain or ([] if kinds or any(c[0] in "tT" for c in meant) else robot):
        meant |= {column: with_unit(axis, key[1]) for axis, column in whole[key].items()}
    for number, key in [(_number(key[0]), key) for key in numbered] or enumerate(others, start=1):
        meant |= {c: with_unit(f"t{number}_{axis}", key[1]) for axis, c in whole[key].items()}
    return meant, who


def own_names(columns: Sequence[str]) -> dict[str, str]:
    """Columns that have calibtool's own names: `x_mm`, `t2_y_mm`, `ref1_x_mm` …"""
    return {column: column.lower() for column in columns if _OWN.fullmatch(column.lower())}


def owner(words: Collection[str]) -> frozenset[str]:
    """The object of a value: the words of its name that do not name the quantity."""
    return frozenset(words) - _PLAIN


def _who_axis(name: str) -> tuple[str, str] | None:
    """Whose coordinate a name without unit is, in small letters, and the axis."""
    name = re.sub(r"(?<=[a-z])(?=[XYZ]$)|(?<=^[XYZ])(?=[A-Z][a-z])", " ", name)  # posX, XCoord
    lower = re.sub(r"[\s_.\-/:]+", " ", name.lower()).strip()
    if lower in _SURVEYED:
        return "coordinates", _SURVEYED[lower]
    match = _AXIS_LAST.fullmatch(lower) or _AXIS_FIRST.fullmatch(lower)
    if match is None or re.search(r"[\[\](){}<>]", lower):  # an unknown unit
        return None
    who = match["who"].strip()
    return (
        None
        if set(who.split()) & _OTHER or re.fullmatch(r"ref ?\d+", who)
        else (who, match["axis"])
    )


def _number(who: str) -> int:
    match = _LAST.fullmatch(_bare(who))
    assert match is not None
    return int(match[2])


def _bare(who: str) -> str:
    """The words of a name that do not name the quantity."""
    words = who.split()
    return " ".join(word for word in words if word not in _PLAIN or len(words) == 1)


def _series(keys: Sequence[tuple[str, str | None]]) -> bool:
    """Whether names differ in the number at their end alone: tool m1, tool m2."""
    matches = [_LAST.fullmatch(_bare(who)) for who, _ in keys]
    found = [(match[1], int(match[2])) for match in matches if match]
    alike = len({stem for stem, _ in found}) == 1 and len({k for _, k in found}) == len(keys)
    return len(keys) > 1 and len(found) == len(keys) and alike


def _sorted(
    keys: list[tuple[str, str | None]],
) -> tuple[list[tuple[str, str | None]], ...]:
    """One unnamed point; numbered ones; those under other names; the robot's own position."""
    kinds: tuple[list[tuple[str, str | None]], ...] = ([], [], [], [])
    for key in keys:
        words = set(key[0].split())
        if words <= _PLAIN:
            kinds[0].append(key)
        elif words & ROBOT:
            kinds[3].append(key)
        else:
            kinds[1 if _NUMBERED.fullmatch(key[0]) else 2].append(key)
    return kinds
