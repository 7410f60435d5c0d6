"""ABB programs (RAPID): jointtarget and robtarget, declared or in a move instruction."""

import re
from dataclasses import dataclass, replace

import numpy as np

from calibtool.programs.configurations import Abb, Digit
from calibtool.programs.frames import UNIT_TOLERANCE, pose
from calibtool.programs.lists import Item, closing, item, split
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

NAME = "abb-rapid"
SUFFIXES = (".mod", ".modx", ".prg", ".sys", ".sysx")
UNUSED = 9e9
_LONGEST = 20_000  # characters of an instruction
_START = re.compile(
    r"^[^\S\n]*(?:MODULE\s+\w+|%%%)|\b(?:robtarget|jointtarget)\s+\w+\s*:=", re.MULTILINE | re.IGNORECASE
)
_DECLARED = re.compile(
    r"\b(robtarget|jointtarget|tooldata|wobjdata)\s+(\w+)\s*+(?:\{[^}]{0,99}\}\s*+)?:=\s*(?=\[)", re.IGNORECASE
)
_MOVE = re.compile(
    r"\b(MoveAbsJ|MoveExtJ|Move[JLC]\w*|Trigg[JLC]|Search[LC]|Arc[LC]\w*|Paint[LC]|Spot[LJ])\b", re.IGNORECASE
)
_MODIFIED = re.compile(r"(Offs|RelTool)\s*\(\s*(\w+)", re.IGNORECASE)


@dataclass(frozen=True)
class _Use:
    """One use of a position: tool and work object (None: not known), and whether the configuration is looked at."""

    tool: str | None
    frame: str | None
    configured: bool


def matches(text: str) -> bool:
    """Whether this is a RAPID module."""
    return _START.search(text) is not None


def read(text: str, robot: Robot) -> Program:
    """Targets of a module. A declared robtarget takes tool and work object from the instructions that use it."""
    return _Reader(text, robot).program()


class _Reader:
    """What was found so far, and how positions are used."""

    def __init__(self, text: str, robot: Robot) -> None:
        self.text, self.robot, self.lines = text, robot, Lines(text)
        self.code = comments_blanked(text, r"![^\r\n]*")
        off = re.findall(r"\b(ConfJ|ConfL)\s*\\Off", self.code, re.IGNORECASE)
        self.unconfigured = {word.lower() for word in off}
        self.positions = {match[2].lower() for match in _DECLARED.finditer(self.code)}
        self.frames: dict[str, Array] = {}
        self.tools: dict[str, Array] = {}
        self.uses: dict[str, list[_Use]] = {}
        self.targets: list[Target] = []
        self.remarks: list[Remark] = []

    def program(self) -> Program:
        declared = []
        for match in _DECLARED.finditer(self.code):
            end = closing(self.code, match.end())
            if end is None:
                self._bad(match.start(), match[2], "a bracket is not closed")
                continue
            declared.append((match[1].lower(), match[2], item(self.code, match.end(), end + 1)))
        for kind, name, value in declared:
            if kind in ("tooldata", "wobjdata"):
                self._frame(kind, name, value)
        moves = list(_MOVE.finditer(self.code))
        following = [move.start() for move in moves[1:]] + [len(self.code)]
        for move, limit in zip(moves, following, strict=False):
            self._move(move, limit)
        for kind, name, value in declared:
            if kind in ("robtarget", "jointtarget"):
                self._declared(kind, name, value)
        displaced = re.search(r"\bPDisp(?:On|Set)\b", self.code, re.IGNORECASE)
        if displaced:
            self._displaced(self.lines(displaced.start()))
        return Program(self.text, by_position(self.targets), tuple(self.remarks), self.frames, self.tools)

    def _bad(self, position: int, name: str, why: str) -> None:
        self.remarks.append(Remark(self.lines(position), name, why, bad=True))

    def _frame(self, kind: str, name: str, value: Item) -> None:
        """tooldata [robhold, tframe, load] and wobjdata [robhold, ufprog, ufmec, uframe, oframe], where the robot holds
        the tool and not the work object."""
        parts = value.parts or ()
        words = [self.code[part.start : part.end].strip().upper() for part in parts]
        if kind == "tooldata" and len(parts) == 3 and words[0] == "TRUE":
            tool = self._pose(parts[1])
            if tool is not None:
                self.tools[name.lower()] = tool
        if kind == "wobjdata" and len(parts) == 5 and words[:2] == ["FALSE", "TRUE"]:
            user, thing = self._pose(parts[3]), self._pose(parts[4])
            if user is not None and thing is not None:
                self.frames[name.lower()] = user @ thing

    def _pose(self, value: Item) -> Array | None:
        if value.shape() != (3, 4):
            return None
        numbers = [
            self._number(part, "mm" if k == 0 else "")
            for k, row in enumerate(value.parts or ())
            for part in row.parts or ()
        ]
        if any(number is None for number in numbers):
            return None
        values = [number.value for number in numbers if number is not None]
        return pose(values, "quaternion") if _unit(values[3:]) else None

    def _number(self, part: Item, unit: str) -> Number | None:
        return number_at(self.text, part.start, part.end, unit)

    def _move(self, move: re.Match[str], limit: int) -> None:
        """An instruction, which ends before `limit`: the next one begins there, whether or not this one was ended."""
        end = self.code.find(";", move.end(), min(limit, move.end() + _LONGEST))
        if end < 0:
            self.remarks.append(Remark(self.lines(move.start()), move[1], "no ; at its end"))
            return
        spans = split(self.code, move.end(), end)
        words = [self.code[a:b].strip() for a, b in spans]
        while words and re.fullmatch(r"\\Conc", words[0], re.IGNORECASE):
            words, spans = words[1:], spans[1:]
        for word, span in zip(words, spans, strict=True):
            if word.startswith("[") and closing(self.code, self.code.index("[", span[0])) is None:
                self._bad(move.start(), move[1], "a bracket is not closed")
                return
        instruction = move[1].lower()
        if len(words) < 2 or instruction == "moveextj":
            return
        joint = instruction == "moveabsj"
        configured = ("confj" if instruction.endswith("j") else "confl") not in self.unconfigured
        last = re.match(r"(\w+)", words[-1])
        frame = re.search(r"\\WObj\s*+:=\s*+(\w+)", words[-1], re.IGNORECASE)
        use = _Use(
            None if last is None else _named(last[1], "tool0"),
            _named(frame[1], "wobj0") if frame else "",
            configured,
        )
        for word, span in list(zip(words, spans, strict=True))[: 2 if re.fullmatch(r"\w+C", move[1]) else 1]:
            self._point(word, span, use, joint, move[1])

    def _point(self, word: str, span: tuple[int, int], use: _Use, joint: bool, instruction: str) -> None:
        line = self.lines(span[0] + len(self.code[slice(*span)]) - len(self.code[slice(*span)].lstrip()))
        if word.startswith("["):
            first = self.code.index("[", span[0])
            end = closing(self.code, first)
            assert end is not None  # seen before the instruction was split
            value = item(self.code, first, end + 1)
            self._add("jointtarget" if joint else "robtarget", f"{instruction} […]", value, [use])
        elif modified := _MODIFIED.match(word):
            self.uses.setdefault(modified[2].lower(), []).append(use)
            self.remarks.append(Remark(line, word, "a relative motion; the point it starts from is treated by itself"))
        elif name := re.match(r"(\w++)\s*+(?:\{[^}]*\}\s*+)?(?:\\.*)?$", word):
            self.uses.setdefault(name[1].lower(), []).append(use)
            if name[1].lower() not in self.positions:
                self.remarks.append(Remark(line, name[1], "a variable that this file gives no position"))
        else:
            self.remarks.append(Remark(line, word[:40], "an expression"))

    def _declared(self, kind: str, name: str, value: Item) -> None:
        uses = self.uses.get(name.lower(), [])
        elements = value.parts or ()
        single = value.shape() is not None or not elements or elements[0].shape() is None
        for k, element in enumerate([value] if single else elements):
            self._add(kind, name if single else f"{name}{{{k + 1}}}", element, uses)

    def _add(self, kind: str, name: str, value: Item, uses: list[_Use]) -> None:
        line = self.lines(value.start)
        expected = (6, 6) if kind == "jointtarget" else (3, 4, 4, 6)
        if value.shape() != expected:
            form = (
                "[[6 joints],[6 external]]"
                if kind == "jointtarget"
                else "[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[6 external]]"
            )
            self._bad(value.start, name, f"is no {kind}; expected {form}")
            return
        rows = [list(row.parts or ()) for row in value.parts or ()]
        found = self._joints(rows, name, line) if kind == "jointtarget" else self._robtarget(rows, name, line, uses)
        if isinstance(found, Target):
            self.targets.append(found)
        else:
            self.remarks.append(found)

    def _strange(self, part: Item, name: str, line: int) -> Remark:
        word = self.text[part.start : part.end]
        if is_not_finite(word):
            return Remark(line, name, f"'{word}'; expected a number", bad=True)
        return Remark(line, name, f"a variable or an expression ({word[:30]})")

    def _joints(self, rows: list[list[Item]], name: str, line: int) -> Target | Remark:
        numbers = []
        for k, part in enumerate(rows[0]):
            number = self._number(part, "mm" if k < self.robot.n and self.robot.prismatic[k] else "deg")
            if number is None:
                return self._strange(part, name, line)
            if abs(float(self.text[number.start : number.end])) < UNUSED:
                numbers.append(number)
        if len(numbers) != self.robot.n:
            why = f"holds {len(numbers)} joints, but {self.robot.name} has {self.robot.n}"
            return Remark(line, name, why, bad=True)
        return Target("joint", tuple(numbers), line, name)

    def _robtarget(self, rows: list[list[Item]], name: str, line: int, uses: list[_Use]) -> Target | Remark:
        numbers, digits = [], []
        for row, unit in ((rows[0], "mm"), (rows[1], "")):
            for part in row:
                number = self._number(part, unit)
                if number is None:
                    return self._strange(part, name, line)
                numbers.append(number)
        quaternion = [number.value for number in numbers[3:]]
        if not _unit(quaternion):
            why = f"quaternion of length {np.linalg.norm(quaternion):.4g}; expected 1"
            return Remark(line, name, why, bad=True)
        for part in rows[2]:
            word = self.text[part.start : part.end]
            if not re.fullmatch(r"-?\d{1,9}", word):
                return self._strange(part, name, line)
            digits.append(Digit(part.start, part.end, int(word)))
        for part in rows[3]:
            number = self._number(part, "")
            if number is None or number.value < UNUSED:
                return Remark(line, name, "external axes beside a pose")
        if not uses:
            return Remark(line, name, "no instruction of this file moves there: its tool and work object are not known")
        if len({(use.tool, use.frame) for use in uses}) > 1:
            return Remark(line, name, "used with several tools or work objects")
        configuration = Abb((digits[0], digits[1], digits[2]), digits[3].value)
        looked_at = any(use.configured for use in uses)
        tool, frame = uses[0].tool, uses[0].frame
        return Target(
            "pose", tuple(numbers), line, name, "quaternion", frame, tool, configuration if looked_at else None
        )

    def _displaced(self, line: int) -> None:
        why = f"a program displacement (line {line}) moves it"
        self.remarks += [Remark(t.line, t.name, why) for t in self.targets if t.kind == "pose"]
        self.targets = [replace(t) for t in self.targets if t.kind != "pose"]


def _named(name: str, nothing: str) -> str:
    return "" if name.lower() == nothing else name.lower()


def _unit(quaternion: list[float]) -> bool:
    return bool(abs(np.linalg.norm(quaternion) - 1.0) <= UNIT_TOLERANCE)
