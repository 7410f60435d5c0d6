"""Universal Robots programs (URScript): literal joints and poses in movej, movel, movep, movec and servoj."""

import re
from collections import Counter

from calibtool.programs.frames import pose
from calibtool.programs.lists import closing, item, split
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

NAME = "ur-script"
SUFFIXES = (".script", ".urscript")
_CALL = re.compile(r"\b(movej|movel|movep|movec|servoj|set_tcp)\s*(?=\()")
_RELATIVE = re.compile(r"\b(?:pose_trans|pose_add|get_actual_tcp_pose|get_actual_joint_positions|get_forward_kin)\b")
_UNITS = ["m", "m", "m", "rad", "rad", "rad"]


def matches(text: str) -> bool:
    """Whether this is a URScript program."""
    return re.search(r"\b(?:movej|movel|movep|movec|servoj)\s*\(", text) is not None


def read(text: str, robot: Robot) -> Program:
    """Targets of a script. The tool is that of the last set_tcp above; without one it is the calibration's."""
    return _Reader(text, robot).program()


class _Reader:
    """The tool in force while the text is read from top to bottom, and what was found."""

    def __init__(self, text: str, robot: Robot) -> None:
        self.text, self.robot, self.lines = text, robot, Lines(text)
        self.code = comments_blanked(text, r"#[^\r\n]*")
        self.words = Counter(re.findall(r"\b[A-Za-z_]\w*\b", self.code))
        self.moved = Counter(re.findall(r"\b(?:movej|movel|movep|servoj)\s*\(\s*(\w+)\b(?!\s*[\[(])", self.code))
        self.assigned: dict[str, list[re.Match[str]]] = {}
        for match in re.finditer(r"\b([A-Za-z_]\w*)\s*=(?!=)\s*", self.code):
            self.assigned.setdefault(match[1], []).append(match)
        self.tool: str | None = ""
        self.tools: dict[str, Array] = {}
        self.targets: dict[int, Target] = {}  # by position: a variable may be used by several moves
        self.remarks: list[Remark] = []

    def program(self) -> Program:
        for call in _CALL.finditer(self.code):
            end = closing(self.code, call.end())
            if end is None:
                self._remark(call.start(), call[1], "a bracket is not closed", bad=True)
                continue
            spans = split(self.code, call.end() + 1, end)
            if call[1] == "set_tcp":
                self._set_tcp(spans[0], self.lines(call.start()))
                continue
            for span in spans[: 2 if call[1] == "movec" else 1]:
                self._point(span, call[1])
        poses = [target for target in self.targets.values() if target.kind == "pose"]
        notes = ("no set_tcp above: poses are taken as those of the calibration's tool",)
        return Program(
            self.text,
            by_position(self.targets.values()),
            tuple(self.remarks),
            tools=self.tools,
            notes=notes if any(target.tool == "" for target in poses) else (),
        )

    def _remark(self, position: int, name: str, why: str, bad: bool = False) -> None:
        self.remarks.append(Remark(self.lines(position), name, why, bad))

    def _set_tcp(self, span: tuple[int, int], line: int) -> None:
        numbers = self._literal(*span)
        self.tool = None
        if isinstance(numbers, list) and self._is_pose(*span):
            self.tool = f"set_tcp of line {line}"
            self.tools[self.tool] = pose([number.value for number in numbers], "rotation vector")

    def _is_pose(self, start: int, end: int) -> bool:
        return self.code[start:end].strip().startswith("p[")

    def _literal(self, start: int, end: int, joint_units: list[str] | None = None) -> list[Number] | str | None:
        """Numbers of `[…]` or `p[…]`; the word that is no number; None for anything else than a list."""
        if not re.match(r"\s*p?\[", self.code[start:end]):
            return None
        first = self.code.index("[", start)
        if closing(self.code, first) != start + len(self.code[start:end].rstrip()) - 1:
            return None
        parts = item(self.code, first, end).parts or ()
        units = _UNITS if self._is_pose(start, end) else joint_units or ["rad"] * len(parts)
        if len(parts) != len(units):
            return f"{len(parts)} values"
        numbers = []
        for part, unit in zip(parts, units, strict=True):
            number = number_at(self.text, part.start, part.end, unit)
            if number is None:
                return self.text[part.start : part.end]
            numbers.append(number)
        return numbers

    def _point(self, span: tuple[int, int], name: str) -> None:
        word = self.code[slice(*span)].strip()
        start = self.code.index(word, span[0]) if word else span[0]
        if _RELATIVE.search(word):
            self._remark(start, name, "a relative motion")
        elif inner := re.match(r"get_inverse_kin\s*(?=\()", word):
            first = start + inner.end()
            spans = split(self.code, first + 1, closing(self.code, first) or span[1])
            self._position(spans[0], name, self._near(spans[1:]))
        elif re.fullmatch(r"[A-Za-z_]\w*", word):
            self._variable(word, start)
        else:
            self._position(span, name)

    def _near(self, spans: list[tuple[int, int]]) -> tuple[Number, ...]:
        """Joint values beside a pose, `get_inverse_kin(p[…], qnear=[…])`."""
        for start, end in spans[:1]:
            after = re.compile(r"\s*(?:qnear\s*=)?").match(self.code, start, end)
            numbers = self._literal(after.end() if after else start, end, ["rad"] * self.robot.n)
            return tuple(numbers) if isinstance(numbers, list) else ()
        return ()

    def _position(self, span: tuple[int, int], name: str, near: tuple[Number, ...] = ()) -> None:
        start = span[0] + len(self.code[slice(*span)]) - len(self.code[slice(*span)].lstrip())
        numbers = self._literal(*span, ["rad"] * self.robot.n)
        if numbers is None:
            self._remark(start, name, f"an expression ({self.text[start : span[1]].strip()[:40]})")
        elif isinstance(numbers, str):
            if is_not_finite(numbers):
                self._remark(start, name, f"'{numbers}'; expected a number", bad=True)
            elif re.fullmatch(r"\d+ values", numbers):
                joints = "6" if self._is_pose(*span) else f"{self.robot.n} ({self.robot.name})"
                self._remark(start, name, f"holds {numbers}; expected {joints}", bad=True)
            else:
                self._remark(start, name, f"an expression ({numbers})")
        elif self._is_pose(*span):
            line = self.lines(start)
            self.targets[start] = Target(
                "pose", tuple(numbers), line, name, "rotation vector", "", self.tool, joints=near
            )
        else:
            self.targets[start] = Target("joint", tuple(numbers), self.lines(start), name)

    def _variable(self, name: str, position: int) -> None:
        """A variable is followed only where it is assigned one literal and used by moves alone."""
        assigned, moved = self.assigned.get(name, []), self.moved[name]
        used = self.words[name] - len(assigned)
        opening = re.compile(r"p?\[").match(self.code, assigned[0].end()) if len(assigned) == 1 else None
        end = closing(self.code, opening.end() - 1) if opening else None
        if end is None or used != moved:
            self._remark(position, name, "a variable")
        elif assigned[0].end() not in self.targets:
            self._position((assigned[0].end(), end + 1), name)
        else:
            known = self.targets[assigned[0].end()]
            if known.kind == "pose" and known.tool != self.tool:
                del self.targets[assigned[0].end()]
                self._remark(position, name, "used with several tools")
