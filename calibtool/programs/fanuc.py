"""FANUC programs in ASCII (.LS): the positions of the /POS section."""

import re

from calibtool.programs.configurations import Fanuc, has_postures
from calibtool.programs.targets import Lines, Number, Program, Remark, Target, by_position, is_not_finite, number_at
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array

NAME = "fanuc-ls"
SUFFIXES = (".ls",)
_START = re.compile(r"^/(?:PROG\b|POS\s*$)", re.MULTILINE)
_POSITION = re.compile(r"^[ \t]*P\[(\d+)[^\]\n]*\][ \t]*\{", re.MULTILINE)
_END = re.compile(r"\}[ \t]*;")
_GROUP = re.compile(r"\bGP(\d+)[ \t]*:")
_ITEM = re.compile(r"(?:'[^']*'|[^,'])+")
_VALUE = re.compile(r"([A-Z]\d*)\s*=\s*(\S+)\s*(mm|deg)?")
_FRAME = re.compile(r"(UF|UT)\s*:\s*(\w+)")
_CONFIG = re.compile(r"CONFIG\s*:\s*'([^']*)'")
_SIX_JOINTS = re.compile(r"([NF])\s+(?:[LR]\s+)?([UD])\s+([TB])\s*((?:,\s*-?\d+\s*)*)")
_MOTION = re.compile(r"^[ \t]*\d*:[ \t]*(?:[JLCAS][ \t]+)?(P|PR)\[(\d+)[^\]\n]*\]([^;\n]*)", re.MULTILINE)
_POSE = (("X", "mm"), ("Y", "mm"), ("Z", "mm"), ("W", "deg"), ("P", "deg"), ("R", "deg"))


def matches(text: str) -> bool:
    """Whether this is a FANUC program."""
    return _START.search(text) is not None


def coupling(robot: Robot) -> Array:
    """Controllers state joint values of the description; without a coupling there, six-joint arms state J3 against the
    horizontal: q3 = J3 + J2. (n, n)"""
    matrix = robot.coupling.copy()
    if not robot.coupled and has_postures(robot):
        matrix[2, 1] = 1.0
    return matrix


def read(text: str, robot: Robot) -> Program:
    """Targets of motion group 1. Incremental motions, other groups and positions not taught are left alone."""
    lines = Lines(text)
    cut = re.search(r"^/POS[ \t]*\r?$", text, re.MULTILINE)
    split = cut.end() if cut else len(text)
    remarks: list[Remark] = []
    notes: list[str] = []
    incremental: dict[str, int] = {}
    for motion in _MOTION.finditer(text, 0, split):
        kind, number, options = motion.groups()
        if kind == "PR":
            remarks.append(
                Remark(lines(motion.start(1)), f"PR[{number}]", "a register: its value is not in the program")
            )
        elif re.search(r"\bINC\b", options):
            incremental[number] = lines(motion.start(1))
        elif re.search(r"\b(?:V?OFFSET|TOOL_OFFSET)\b", options, re.IGNORECASE):
            notes.append(f"line {lines(motion.start(1))}: P[{number}] is corrected without its offset")
    targets = []
    positions = list(_POSITION.finditer(text, split))
    following = [position.start() for position in positions[1:]] + [len(text)]
    for position, limit in zip(positions, following, strict=False):
        name, line = f"P[{position[1]}]", lines(position.start(1))
        closed = _END.search(text, position.end(), limit)
        if closed is None:
            remarks.append(Remark(line, name, "is not closed by };", bad=True))
            continue
        if position[1] in incremental:
            why = f"a relative motion (INC in line {incremental[position[1]]})"
            remarks.append(Remark(line, name, why))
            continue
        groups = list(_GROUP.finditer(text, position.end(), closed.start()))
        ends = [group.start() for group in groups[1:]] + [closed.start()]
        if not groups:
            remarks.append(Remark(line, name, "no motion group; expected GP1:", bad=True))
        for group, end in zip(groups, ends, strict=False):
            if group[1] != "1":
                remarks.append(
                    Remark(lines(group.start()), f"{name} GP{group[1]}", "external axes (another motion group)")
                )
                continue
            found = _target(text, group.end(), end, name, lines, robot)
            if isinstance(found, Target):
                targets.append(found)
            else:
                remarks.append(found)
    return Program(text, by_position(targets), tuple(remarks), notes=tuple(notes))


def _target(text: str, start: int, end: int, name: str, lines: Lines, robot: Robot) -> Target | Remark:
    frame = tool = ""
    config = None
    values: dict[str, Number] = {}
    line = lines(start)
    for item in _ITEM.finditer(text, start, end):
        word = item[0].strip()
        line = lines(item.start() + len(item[0]) - len(item[0].lstrip()))
        if not word:
            continue
        if match := _FRAME.fullmatch(word):
            which = "" if match[2] == "0" else match[2]
            frame, tool = (which, tool) if match[1] == "UF" else (frame, which)
        elif match := _CONFIG.fullmatch(word):
            config = match[1]
        elif match := _VALUE.fullmatch(word):
            first = item.start() + item[0].index(word)
            number = number_at(text, first + match.start(2), first + match.end(2), match[3] or "")
            if "*" in match[2]:
                return Remark(line, name, "not taught")
            if number is None or not match[3]:
                return Remark(line, name, f"{match[1]} is '{match[2]}'; expected a number with mm or deg", bad=True)
            values[match[1]] = number
        elif is_not_finite(word):
            return Remark(line, name, f"'{word}' is not a number", bad=True)
        else:
            return Remark(line, name, f"'{word[:30]}' is not known in a position", bad=True)
    extended = any(re.fullmatch(r"E\d", key) for key in values)
    values = {key: value for key, value in values.items() if not re.fullmatch(r"E\d", key)}
    if "J1" in values:
        return _joints(values, lines, name, robot)
    if set(values) != {key for key, _ in _POSE}:
        return Remark(line, name, f"holds {', '.join(values) or 'nothing'}; expected J1 … or X Y Z W P R", bad=True)
    for key, unit in _POSE:
        if values[key].unit != unit:
            place = lines(values[key].start)
            return Remark(place, name, f"{key} is in {values[key].unit}; expected {unit}", bad=True)
    line = lines(values["X"].start)
    if extended:
        return Remark(line, name, "external axes beside a pose")
    match = _SIX_JOINTS.fullmatch((config or "").strip())
    if match is None:
        return Remark(line, name, f"a configuration that is not of a six-joint arm ('{config}')")
    if re.search("[1-9]", match[4]):
        return Remark(line, name, f"turn numbers other than 0 ('{config}'): which joints they count is a setting")
    return Target(
        kind="pose",
        numbers=tuple(values[key] for key, _ in _POSE),
        line=line,
        name=name,
        orientation="wpr",
        frame=frame,
        tool=tool,
        configuration=Fanuc(match[1], match[2], match[3]),
    )


def _joints(values: dict[str, Number], lines: Lines, name: str, robot: Robot) -> Target | Remark:
    line = lines(values["J1"].start)
    if sorted(values) != sorted(f"J{k + 1}" for k in range(robot.n)):
        return Remark(line, name, f"holds {', '.join(values)}, but {robot.name} has {robot.n} joints", bad=True)
    numbers = tuple(values[f"J{k + 1}"] for k in range(robot.n))
    for k, (number, prismatic) in enumerate(zip(numbers, robot.prismatic, strict=True)):
        if (number.unit == "mm") != prismatic:
            return Remark(line, name, f"J{k + 1} is in {number.unit}, which does not fit the joint", bad=True)
    return Target("joint", numbers, line, name)
