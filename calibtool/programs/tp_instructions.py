"""Instructions of a TP program: motions, selections of frames, and their order."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace

from calibtool.programs.motions import (
    EXTERNAL,
    FRAME,
    JOINT,
    TOOL,
    Aim,
    Begin,
    Call,
    Else,
    End,
    Jump,
    Label,
    Literal,
    Move,
    Return,
    Unknown,
)
from calibtool.programs.motions import Statement as Step
from calibtool.programs.numbers import LineNumbers, Remark
from calibtool.programs.tp import Motion, Point, Section, motion, parts, statements
from calibtool.programs.tp_frames import Selection
from calibtool.programs.tp_positions import HELD, Positions, Taught

_INC = frozenset({"INC", "INK", "INKR"})
_OFFSETS = frozenset({"OFFSET", "TOOL_OFFSET", "VOFFSET", "WKZ_OFFSET", "SEARCH"})
# the motions behind it
_SHIFTED = re.compile(r"(?:TOUCH\s+OFFSET|TRACK|DPM|MPOFFSET)\s+(END\b)?", re.IGNORECASE)
_SELECT = re.compile(
    r"(UFRAME|BENUTZER|UTOOL|WKZ)_NUM\s*(?:\[([^\]]*)\])?\s*=\s*(.+)", re.IGNORECASE
)
_SET = re.compile(
    r"(UFRAME|BENUTZER|UTOOL|WKZ)\s*\[\s*(?:GP(\d)\s*:)?\s*([^=]*)\]\s*=", re.IGNORECASE
)
_WRITTEN = re.compile(r"P\s*\[\s*(?:(\d{1,9})\b[^\]]*|.*)\]\s*=(?!=)")
_CALL = re.compile(r"(?:CALL|AUFRUF)\s+([\w-]+)", re.IGNORECASE)
_JUMP = re.compile(r"(?:JMP|SPRUNG)\s+(?:LBL|LABEL)\s*\[\s*([^\]:]*)", re.IGNORECASE)
_LABEL = re.compile(r"(?:LBL|LABEL)\s*\[\s*(\d+)", re.IGNORECASE)
_IF = re.compile(r"(?:IF|WENN)\b", re.IGNORECASE)
_CASE = re.compile(r"(?:SELECT|IST|ELSE|SONST)\b|=", re.IGNORECASE)
_THEN = re.compile(r"\b(?:THEN|DANN)$", re.IGNORECASE)
_TIMEOUT = re.compile(r",\s*(?:LBL|LABEL)\s*\[\s*(\d+)[^\]]*\]$", re.IGNORECASE)
_PLAIN: dict[str, tuple[Step, ...]] = {
    "ELSE": (Else(last=True),), "SONST": (Else(last=True),), "ENDIF": (End(),), "ENDWENN": (End(),),
    "ENDFOR": (End(),), "END": (Return(),), "ENDE": (Return(),), "ABORT": (Return(),),
}  # fmt: skip
_FOR = re.compile(r"FOR\b", re.IGNORECASE)
_LISTED = 5  # number of lines named in a note


class Instructions:
    """A program: its statements, and their steps once its positions are read."""

    def __init__(self, code: str, section: Section, lines: LineNumbers, reader: Positions) -> None:
        self.name, self.source, self.section = section.name, reader.source, section
        self.key = f"{reader.source}|{section.instructions[0]}|{section.name}"
        self.statements = list(statements(code, section.instructions, lines))
        found = ((k, motion(one)) for k, one in enumerate(self.statements))
        self.motions = {k: one for k, one in found if one is not None}
        self.labels = [m[1] for one in self.statements if (m := _LABEL.match(one.text))]
        relative = self._relative()
        self.written = list(self._written())
        for line, position, which in self.written:
            if which is None:
                why = "which position is assigned, a register tells"
                reader.remarks.append(Remark(line, position, why, source=reader.source))
        self.taught = reader.read(section.positions, self._not_corrected(relative), relative)

    def changed(self) -> Iterator[tuple[tuple[str, str], str]]:
        """Frames and tools that are assigned, by kind and number ("" if unknown), and why."""
        for one in self.statements:
            for part in parts(one.text) if "[" in one.text else ():
                match = _SET.match(part)
                if match and match[2] in (None, "1"):
                    number = match[3].strip().lstrip("0") if match[3].strip().isdecimal() else ""
                    yield (_kind(match[1]), number), f"it is assigned (line {one.line})"

    def select_from(self, frame: Selection, tool: Selection) -> None:
        """Set the frames and tools that exist."""
        self.frame, self.tool = frame, tool

    def _relative(self) -> dict[int, int]:
        """Numbers of positions that are distances, and lines of their motions."""
        return {
            point.number: found.line
            for found in reversed(self.motions.values())
            for point in found.points
            if found.options & _INC and point.kind == "P" and point.number is not None
        }

    def _written(self) -> Iterator[tuple[int, str, int | None]]:
        """Assignments of positions, also conditional ones: line, position, its number if known."""
        for one in self.statements:
            for part in parts(one.text) if "=" in one.text else ():
                if match := _WRITTEN.match(part):
                    position = match[0].rstrip("= ")[:30]
                    yield one.line, position, int(match[1]) if match[1] else None

    def _not_corrected(self, relative: dict[int, int]) -> Callable[[int], str]:
        """Why positions of this program are not corrected, by their numbers."""
        reasons = {
            number: f"a relative motion (INC in line {line})" for number, line in relative.items()
        }
        for line, _, number in self.written:
            if number is not None:
                reasons[number] = f"it is assigned (line {line})"
        points = [(found, point) for found in self.motions.values() for point in found.points]
        moved_to = {point.number for _, point in points if point.kind == "P"}
        assigned = [
            f"may be assigned ({p}, line {line})"
            for line, p, which in self.written
            if which is None
        ]
        somewhere = next(
            (
                f"may be used by a relative motion ({point.text[:30]} with INC in "
                f"line {found.line})"
                for found, point in points
                if found.options & _INC and point.kind == "P" and point.number is None
            ),
            next(iter(assigned), ""),
        )
        return lambda number: reasons.get(number, "" if number in moved_to else somewhere)

    def alone(self, literals: list[Literal]) -> None:
        """Allow positions to which no motion goes to be corrected in their own frame."""
        for one in self.taught.values():
            literal = literals[one.literal]
            if literal.not_corrected in ("", EXTERNAL):
                aim = Aim(one.literal) if literal.kind == JOINT else self._aim(one)
                literals[one.literal] = replace(literal, alone=aim)

    def _aim(self, taught: Taught) -> Aim:
        where = self.frame.of(taught.frame)
        if self.section.tracking:
            where = Unknown("line tracking: a conveyor moves it")
        return Aim(taught.literal, where, self.tool.of(taught.tool))

    # --- steps ------------------------------------------------------------------------------------

    def steps(self, names: Mapping[str, str]) -> Iterator[Step]:
        """The steps of the statements in order; names: keys of programs that can be called."""
        return _reached(self._steps(names))

    def _steps(self, names: Mapping[str, str]) -> Iterator[Step]:
        for k, statement in enumerate(self.statements):
            found = self.motions.get(k)
            if found is None:
                yield from self._instruction(statement.line, statement.text, names)
                continue
            name = " ".join([found.letter, *(point.text[:30] for point in found.points)])
            yield Move(found.line, name, tuple(self._point(p, found) for p in found.points))
            if found.label:
                yield Jump(found.label, always=False)

    def _point(self, point: Point, found: Motion) -> Aim:
        if point.kind == "PR":
            return Aim(Unknown("a register: its value is not in the program"))
        if point.kind != "P":
            return Aim(
                Unknown(
                    f"a position of a pallet: its value is not in the program ({point.text[:30]})"
                )
            )
        if point.number is None:
            which = f"which position it is, a register tells ({point.text[:30]})"
            relative = "a relative motion (INC): " if found.options & _INC else ""
            return Aim(Unknown(relative + which))
        taught = self.taught.get(point.number)
        if taught is None:
            return Aim(Unknown(f"P[{point.number}] is not among the positions for group 1"))
        if found.options & _INC:
            return Aim(Unknown("a relative motion", quiet=True))
        aim = self._aim(taught)
        if "RTCP" in found.options:
            return replace(aim, tool=Unknown(f"a remote TCP (RTCP in line {found.line}): {HELD}"))
        return aim

    def _instruction(self, line: int, text: str, names: Mapping[str, str]) -> Iterator[Step]:
        """The effect of an instruction that is no motion."""
        plain = _PLAIN.get(text.upper())
        if plain is not None:
            yield from plain
        elif _IF.match(text) and _THEN.search(text):
            yield Begin()
        elif _FOR.match(text):
            yield Begin(loop=True)
        elif _IF.match(text) or _CASE.match(text):
            yield Begin()
            for action in parts(text)[1:]:
                yield from self._instruction(line, action, names)
            yield End()
        elif match := _JUMP.match(text):
            if match[1].strip().isdecimal():
                yield Jump(match[1].strip())
            else:
                for label in self.labels:
                    yield Jump(label, always=False)
        elif match := _LABEL.match(text):
            yield Label(match[1])
        elif match := _CALL.match(text):
            if match[1].upper() in names:
                yield Call(line, names[match[1].upper()])
            else:
                yield self.frame.called(line, match[1])
                yield self.tool.called(line, match[1])
        elif match := _SELECT.match(text):
            if match[2] is None or match[2].strip().upper() in ("1", "GP1"):
                selection = self.frame if _kind(match[1]) == FRAME else self.tool
                yield selection.select(line, match[3].strip())
        elif match := _TIMEOUT.search(text):
            yield Jump(match[1], always=False)

    def _offset(self) -> Iterator[Motion]:
        """Motions with their own offset, or in a section where a sensor shifts all of them."""
        shifted = False
        for k, one in enumerate(self.statements):
            found = self.motions.get(k)
            if match := _SHIFTED.match(one.text):
                shifted = match[1] is None
            elif found is not None and (shifted or found.options & _OFFSETS):
                yield found

    def notes(self) -> Iterator[str]:
        """Notes for the summary: motions whose offsets are not in the program."""
        places = [
            (one.line, point)
            for one in self._offset()
            if not one.options & _INC
            for point in one.points
            if point.kind == "P" and point.number in self.taught
        ]
        if len(places) == 1:
            line, point = places[0]
            yield f"line {line}: P[{point.number}] is corrected without its offset"
        elif places:
            lines = list(dict.fromkeys(line for line, _ in places))
            more = f" and {len(lines) - _LISTED} more" if len(lines) > _LISTED else ""
            shown = ", ".join(map(str, lines[:_LISTED]))
            yield f"lines {shown}{more}: positions are corrected without their offsets"


def _reached(steps: Iterable[Step]) -> Iterator[Step]:
    """The steps without those between a jump and the next label, which are never executed."""
    level, dead = 0, -1  # of nested branches; that of the jump, -1 where there was none
    for step in steps:
        if isinstance(step, Begin):
            level += 1
        if isinstance(step, Label) or (isinstance(step, Else | End) and level <= dead):
            dead = -1
        if isinstance(step, End):
            level -= 1
        if dead < 0 or isinstance(step, Begin | Else | End):
            yield step
        if dead < 0 and (isinstance(step, Return) or (isinstance(step, Jump) and step.always)):
            dead = level


def _kind(word: str) -> str:
    return FRAME if word.upper() in ("UFRAME", "BENUTZER") else TOOL
