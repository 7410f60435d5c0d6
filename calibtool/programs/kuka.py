"""KUKA programs (KRL, .src and .dat): AXIS, E6AXIS, POS, E6POS and FRAME, declared, assigned or in a motion."""

import re

from calibtool.programs.configurations import Digit, Kuka
from calibtool.programs.frames import pose
from calibtool.programs.targets import (
    Lines,
    Number,
    Program,
    Remark,
    Target,
    by_position,
    comments_blanked,
    is_not_finite,
    number_at,
)
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array

NAME = "kuka-krl"
SUFFIXES = (".src", ".dat", ".sub")
_START = re.compile(
    r"^[^\S\n]*(?:&ACCESS\b|(?:GLOBAL\s+)?DEF(?:DAT\s+\w+|(?:FCT)?[^\r\n(]+\([^\r\n)]*\)(?!\s*:)))",
    re.MULTILINE | re.IGNORECASE,
)
_NAME = r"\$?[A-Za-z_][\w$]*(?:\[[\d,\s]+\])?"
_MOVES = r"S?(?:PTP|LIN|CIRC|SPL)"
_PART = re.compile(
    rf"(?P<relative>\b{_MOVES}_REL\b)[^\n]*"
    rf"|\bDECL\s+(?:GLOBAL\s+)?FDAT\s+(?P<fdat>\w+)\s*=\s*\{{(?P<fdat_items>[^{{}}]*)\}}"
    rf"|\bBAS\s*\(\s*#(?P<bas>TOOL|BASE)\s*,\s*(?P<bas_number>\w+)\s*\)"
    rf"|(?P<system>\$(?:TOOL|BASE))\s*=\s*(?:(?P<data>(?:TOOL|BASE)_DATA)\s*\[\s*(?P<data_number>\w+)\s*\]"
    rf"|(?P<null>\$NULLFRAME)|\{{(?P<system_items>[^{{}}]*)\}}|(?P<other>[^\n]+))"
    rf"|\b(?P<table>TOOL|BASE)_DATA\s*\[\s*(?P<table_number>\d+)\s*\]\s*=\s*\{{(?P<table_items>[^{{}}]*)\}}"
    rf"|(?<![\w$])(?:(?P<type>E6AXIS|AXIS|E6POS|POS|FRAME)\s+)?(?P<name>{_NAME})\s*=\s*\{{(?P<items>[^{{}}\n]*)\}}"
    rf"|\b(?:E6AXIS|AXIS|E6POS|POS)\s+(?P<open>{_NAME})\s*=\s*\{{[^{{}}\n]*$"
    rf"|\b(?P<move>{_MOVES})\b(?P<rest>[^\n]*)",
    re.IGNORECASE | re.MULTILINE,
)
_GROUP = re.compile(r"\{([^{}]*)\}")
_JOINTS = [f"A{k}" for k in range(1, 7)]
_POSE = ["X", "Y", "Z", "A", "B", "C"]
_EXTERNAL = [f"E{k}" for k in range(1, 7)]
_KNOWN = {*_JOINTS, *_POSE, *_EXTERNAL, "S", "T"}
_INTEGER = re.compile(r"(-?\d{1,9})|'B([01]{1,32})'|'H([0-9A-Fa-f]{1,8})'")


def matches(text: str) -> bool:
    """Whether this is a KRL program or data list."""
    return _START.search(text) is not None


def read(text: str, robot: Robot) -> Program:
    """Targets of a .src or .dat file; tool and base follow the text, or the FDAT of the same point."""
    return _Reader(text, robot).program()


class _Reader:
    """What is known while the text is read from top to bottom: the tool and base in force, and what was found."""

    def __init__(self, text: str, robot: Robot) -> None:
        self.text, self.robot, self.lines = text, robot, Lines(text)
        self.code = comments_blanked(text, r";[^\r\n]*")
        moved_to = re.findall(rf"\b{_MOVES}\s+({_NAME})", self.code, re.IGNORECASE)
        self.driven = {re.sub(r"\s", "", name).upper() for name in moved_to}
        self.active: dict[str, str | None] = {"TOOL": None, "BASE": None}
        self.defined: dict[str, dict[str, Array]] = {"TOOL": {}, "BASE": {}}
        self.targets: list[tuple[Target, str]] = []
        self.remarks: list[Remark] = []
        self.fdat: dict[str, tuple[str | None, str | None]] = {}

    def program(self) -> Program:
        for part in _PART.finditer(self.code):
            self._part(part)
        targets = []
        for target, variable in self.targets:
            frame, tool = self.fdat.get(f"F{variable[1:]}".upper(), (target.frame, target.tool))
            if target.kind == "pose":
                target = Target(**{**vars(target), "frame": frame, "tool": tool})
            targets.append(target)
        found = by_position(targets)
        return Program(self.text, found, tuple(self.remarks), self.defined["BASE"], self.defined["TOOL"])

    def _part(self, part: re.Match[str]) -> None:
        line = self.lines(part.start())
        if part["relative"]:
            self.remarks.append(Remark(line, part["relative"], "a relative motion"))
        elif part["fdat"]:
            self.fdat[part["fdat"].upper()] = _fdat(part["fdat_items"])
        elif part["bas"]:
            self.active[part["bas"].upper()] = _numbered(part["bas_number"])
        elif part["system"]:
            self._system(part, part["system"][1:].upper(), line)
        elif part["table"]:
            frame = self._frame(part.start("table_items"), part.end("table_items"))
            if frame is not None:
                self.defined[part["table"].upper()][part["table_number"]] = frame
        elif part["open"]:
            self.remarks.append(Remark(line, part["open"], "a brace is not closed", bad=True))
        elif part["name"] is not None:
            self._assigned(part, line)
        elif part["move"]:
            if "{" in part["rest"] and "}" not in part["rest"]:
                self.remarks.append(Remark(line, part["move"], "a brace is not closed", bad=True))
            for group in _GROUP.finditer(self.code, part.start("rest"), part.end("rest")):
                self._position(group.start(1), group.end(1), part["move"].upper(), "")

    def _system(self, part: re.Match[str], which: str, line: int) -> None:
        if part["data"]:
            self.active[which] = _numbered(part["data_number"])
        elif part["null"]:
            self.active[which] = ""
        else:
            items = part["system_items"]
            frame = None if items is None else self._frame(part.start("system_items"), part.end("system_items"))
            self.active[which] = None
            if frame is not None:
                self.active[which] = f"${which} of line {line}"
                self.defined[which][f"${which} of line {line}"] = frame

    def _assigned(self, part: re.Match[str], line: int) -> None:
        name, kind = part["name"], (part["type"] or "").upper()
        written = re.match(r"\s*(E6AXIS|AXIS|E6POS|POS|FRAME)\s*:", part["items"], re.IGNORECASE)
        kind = kind or (written[1].upper() if written else "")
        driven = re.sub(r"\s", "", name).upper() in self.driven
        if not kind and not driven:
            return  # load data, motion parameters, something else
        if kind == "FRAME" and not driven:
            self.remarks.append(Remark(line, name, "a FRAME that no motion of this file goes to"))
            return
        self._position(part.start("items"), part.end("items"), name, name)

    def _items(self, start: int, end: int) -> dict[str, tuple[int, int]]:
        """Component → span of its value. A type in front (`E6POS:`) is skipped."""
        prefix = re.compile(r"\s*[A-Za-z]\w*\s*:").match(self.code, start, end)
        start = prefix.end() if prefix else start
        found = {}
        for item in re.compile(r"[^,]+").finditer(self.code, start, end):
            match = re.compile(r"\s*([A-Za-z]\w*)\s*").match(self.code, item.start(), item.end())
            key = match[1].upper() if match else item[0].strip()
            found[key] = (match.end() if match else item.start(), item.end())
        return found

    def _frame(self, start: int, end: int) -> Array | None:
        spans = self._items(start, end)
        numbers = self._numbers(spans, _POSE, ["mm"] * 3 + ["deg"] * 3) if set(spans) >= set(_POSE) else None
        if not isinstance(numbers, tuple):
            return None
        return pose([number.value for number in numbers], "abc")

    def _numbers(
        self, spans: dict[str, tuple[int, int]], keys: list[str], units: list[str]
    ) -> tuple[Number, ...] | str:
        numbers = []
        for key, unit in zip(keys, units, strict=True):
            number = number_at(self.text, *spans[key], unit)
            if number is None:
                return f"{key} is '{self.text[slice(*spans[key])].strip()}'"
            numbers.append(number)
        return tuple(numbers)

    def _position(self, start: int, end: int, name: str, variable: str) -> None:
        line = self.lines(start)
        found = self._target(self._items(start, end), line, name)
        if isinstance(found, Target):
            self.targets.append((found, variable))
        else:
            self.remarks.append(found)

    def _target(self, spans: dict[str, tuple[int, int]], line: int, name: str) -> Target | Remark:
        robot = self.robot
        unknown = [key for key in spans if key not in _KNOWN]
        if unknown:
            return Remark(line, name, f"'{unknown[0][:30]}' is not known in a position", bad=True)
        joint = any(key in spans for key in _JOINTS)
        if joint and any(key in spans for key in [*_POSE, "S", "T"]):
            return Remark(line, name, "axes and a pose in one position", bad=True)
        keys = _JOINTS if joint else _POSE
        missing = [key for key in keys if key not in spans]
        if missing and not (joint and missing == _JOINTS[robot.n :]):
            return Remark(line, name, f"a position without {', '.join(missing)}: the rest is where the robot stands")
        if joint and len(spans.keys() & set(_JOINTS)) != robot.n:
            return Remark(line, name, f"holds {6 - len(missing)} axes, but {robot.name} has {robot.n} joints", bad=True)
        keys = keys[: robot.n] if joint else keys
        joint_units = ["mm" if prismatic else "deg" for prismatic in robot.prismatic]
        numbers = self._numbers(spans, keys, joint_units if joint else ["mm"] * 3 + ["deg"] * 3)
        if isinstance(numbers, str):
            if is_not_finite(numbers.split("'")[1]):
                return Remark(line, name, f"{numbers}; expected a number", bad=True)
            return Remark(line, name, f"a variable or an expression ({numbers})")
        if joint:
            return Target("joint", numbers, line, name)
        for key in _EXTERNAL:
            if key in spans:
                number = number_at(self.text, *spans[key], "")
                if number is None or number.value:
                    return Remark(line, name, f"external axes beside a pose ({key})")
        configuration: Kuka | None = None
        if "S" in spans or "T" in spans:
            digits = {key: self._integer(*spans[key]) for key in ("S", "T") if key in spans}
            if None in digits.values():
                return Remark(line, name, "S or T is not an integer", bad=True)
            status, turn = digits.get("S"), digits.get("T")
            configuration = Kuka(None if status is None else status.value, turn)
        tool, frame = self.active["TOOL"], self.active["BASE"]
        return Target("pose", numbers, line, name, "abc", frame, tool, configuration)

    def _integer(self, start: int, end: int) -> Digit | None:
        inner = self.text[start:end]
        first = start + len(inner) - len(inner.lstrip())
        match = _INTEGER.fullmatch(inner.strip())
        if match is None:
            return None
        value = int(match[1]) if match[1] else int(match[2], 2) if match[2] else int(match[3], 16)
        return Digit(first, first + len(inner.strip()), value)


def _numbered(number: str) -> str | None:
    """Name of a numbered tool or base: 0 is the flange or the robot's root, a variable is not known."""
    return number.lstrip("0") if number.isdecimal() else None


def _fdat(items: str) -> tuple[str | None, str | None]:
    """(base, tool) of `{TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,…}`; an external tool makes both unknown."""
    base, tool = (re.search(rf"\b{which}_NO\s+(\d+)", items, re.IGNORECASE) for which in ("BASE", "TOOL"))
    if re.search(r"IPO_FRAME\s+#TCP", items, re.IGNORECASE):
        return None, None
    return _numbered(base[1]) if base else None, _numbered(tool[1]) if tool else None
