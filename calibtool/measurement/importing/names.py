"""Columns renamed to the names of docs/file-formats.md, whatever instruments and controllers call
them.

Capitals do not matter.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from calibtool.errors import InputError
from calibtool.measurement.importing.joint_names import joint_names
from calibtool.measurement.importing.matrix_names import matrix_names
from calibtool.measurement.importing.orientation_names import Turned, orientation_names
from calibtool.measurement.importing.point_names import ROBOT, own_names, owner, point_names
from calibtool.measurement.importing.spelling import spelt, split_unit, with_unit
from calibtool.tables import Table

_WORDS = {
    spelling: word
    for word, spellings in {
        "temperature": "temp,temperature,temperatur,arm temp,arm temperature",
        "payload": "payload,load,mass,nutzlast",
        "rx": "rx,rot x,rotx,rotation x,rvec x,rvecx,rotvec x,rodrigues x",
        "ry": "ry,rot y,roty,rotation y,rvec y,rvecy,rotvec y,rodrigues y",
        "rz": "rz,rot z,rotz,rotation z,rvec z,rvecz,rotvec z,rodrigues z",
        "qw": "qw,q w,quat w,quatw,orientation w,quaternion w",
        "qx": "qx,q x,quat x,quatx,orientation x,quaternion x",
        "qy": "qy,q y,quat y,quaty,orientation y,quaternion y",
        "qz": "qz,q z,quat z,quatz,orientation z,quaternion z",
        "time": "time,timestamp,time stamp,zeit,zeitstempel,datum,date,datetime,date time,uhrzeit,"
        "datum uhrzeit,stamp",
        "time_iso": "time iso",
        "distance": "distance,dist,abstand,length,wire,wire length,range",
        "station": "station,standpunkt,aufstellung,stand",
        "placement": "placement,aufnahme,gauge",
        "board": "board,tafel",
        "plane": "plane,ebene,plane id,plane no,face,surface,fläche,flaeche,plate,platte",
        "sphere": "sphere,kugel,ball,sphere id,sphere no,ball id",
        "status": "status",
        **{name: name for name in ("roll", "pitch", "yaw", *"abcwproet")},
    }.items()
    for spelling in spellings.split(",")
}
_NEED_UNIT = ("temperature", "payload")


@dataclass(frozen=True)
class Named:
    """A table under the names of docs/file-formats.md, with the file's own names."""

    table: Table
    original: dict[str, str]

    def has(self, columns: Iterable[str]) -> bool:
        """Whether there are all of these columns."""
        return all(column in self.original for column in columns)


def named(
    table: Table, joints: Sequence[str] = (), taken: Iterable[str] = (), chosen: bool = False
) -> Named:
    """The table's columns under standard names; a column whose name is not understood keeps it.

    joints: names of the joints in the URDF, in their order. taken: columns of the map, left out.
    chosen: whether the measured columns are among them; then others may be any points.
    Raises InputError where two columns have the same meaning.
    """
    spoken_for = set(taken)
    free = [column for column in table.header if column and column not in spoken_for]
    place = f"{table.name}:{table.header_line}"
    meant = matrix_names(table, free)
    mixed = {c for of in orientation_names(free) for c in of.columns if _mixed(of.columns)}
    meant |= joint_names([column for column in free if column not in mixed | {*meant}], joints)
    rest = [column for column in free if column not in meant]
    turned = orientation_names(rest)
    whose = [of.who for of in turned]
    points, who = (own_names(rest), None) if chosen else point_names(rest, place, whose)
    meant |= points
    if who is not None and not set(meant.values()) & {"qw", "r11"}:
        meant |= _orientation(turned, who)
    for column in free:
        word = _WORDS.get(spelt(column))
        unit = split_unit(column)[1]
        if column not in meant and word is not None and (unit or word not in _NEED_UNIT):
            meant[column] = with_unit(word, unit)
    original: dict[str, str] = {}
    for column in free:
        name = meant.get(column, column)
        if name == "time" and name in original:  # a date and a time of day: neither is a stamp
            for each in (original.pop("time"), column):
                meant[each] = original[each] = each
            continue
        if name in original:
            raise InputError(
                f"{place}: columns '{original[name]}' and '{column}' both mean {name}; rename one, "
                "or map the columns with --columns MAP.toml"
            )
        original[name] = column
    header = [
        meant.get(column, column) if column in original.values() else "" for column in table.header
    ]
    return Named(replace(table, header=header), original)


def _mixed(columns: Iterable[str]) -> bool:
    """Whether columns are a quaternion Q0 Qx Qy Qz, of which Q0 is no joint."""
    return {"0", "x"} <= {spelt(column)[-1] for column in columns}


def _orientation(turned: Sequence[Turned], who: frozenset[str]) -> dict[str, str]:
    """The orientation of the point of these words, or the only quaternion of no robot."""
    own = [of.columns for of in turned if owner(of.who) == who]
    others = [of.columns for of in turned if not of.who & ROBOT and "qw" in of.columns.values()]
    return next((found[0] for found in (own, others) if len(found) == 1), {})
