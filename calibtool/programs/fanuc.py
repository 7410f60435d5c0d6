"""FANUC programs in ASCII (.LS): their motions, and what their instructions do to frames and to the order."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from calibtool.programs.characters import beyond_ascii_blanked
from calibtool.programs.configurations import has_postures
from calibtool.programs.motions import (
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
    Program,
    Return,
    Routine,
    Source,
    Unknown,
    Value,
)
from calibtool.programs.motions import Statement as Step
from calibtool.programs.targets import Lines, Remark
from calibtool.programs.tp import Motion, Point, Section, Statement, motion, parts, sections, statements
from calibtool.programs.tp_frames import Listed, Selection, is_listing
from calibtool.programs.tp_positions import HELD, Positions, Taught, turn_axes
from calibtool.robot.model import Robot
from calibtool.robot.se3 import Array

NAME = "fanuc-ls"
SUFFIXES = (".ls",)
_START = re.compile(r"(?:^|[\r\n])[ \t]*/(?:PROG\b|POS[ \t]*(?:[\r\n]|$))")
_INC = frozenset({"INC", "INK", "INKR"})
_OFFSETS = frozenset({"OFFSET", "TOOL_OFFSET", "VOFFSET", "WKZ_OFFSET"})
_SELECT = re.compile(r"(UFRAME|BENUTZER|UTOOL|WKZ)_NUM\s*(?:\[([^\]]*)\])?\s*=\s*(.+)", re.IGNORECASE)
_SET = re.compile(r"(UFRAME|BENUTZER|UTOOL|WKZ)\s*\[\s*(?:GP(\d)\s*:)?\s*([^=]*)\]\s*=", re.IGNORECASE)
_WRITTEN = re.compile(r"P\s*\[\s*(\d+)[^\]]*\]\s*=")
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
_LISTED = 5  # lines in a note


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


def program(sources: Sequence[Source], robot: Robot) -> Program:
    """The positions of motion group 1 and the motions to them; listings of variables give frames and tools."""
    listed = Listed()
    texts: dict[int, str] = {}
    for number, source in enumerate(sources):
        text = re.sub(r"\r(?!\n)", "\n", source.text)
        if is_listing(text):
            listed.read(text, number)
        else:
            texts[number] = beyond_ascii_blanked(text)
    axes = listed.turn_axes or turn_axes(list(texts.values()), robot)
    literals: list[Literal] = []
    remarks = listed.remarks
    routines: list[_Routine] = []
    for number, code in texts.items():
        lines = Lines(code)
        reader = Positions(
            sources[number].text, code, number, lines, robot, axes, literals, remarks
        )
        routines += [_Routine(code, section, lines, reader) for section in sections(code)]
    changed = _changed(routines)
    selections = tuple(
        Selection(kind, listed.frames, changed[kind]) for kind in (FRAME, TOOL)
    )
    names = {routine.name: routine.key for routine in reversed(routines)}
    for routine in routines:
        routine.alone(selections, literals)
    return Program(
        tuple(sources),
        tuple(literals),
        tuple(
            Routine(one.key, tuple(_reached(one.steps(selections, names))), one.source) for one in routines
        ),
        selections[0].declared() | selections[1].declared(),
        tuple(remarks),
        tuple(note for routine in routines for note in routine.notes()),
    )


def _changed(routines: Sequence["_Routine"]) -> dict[str, dict[str, str]]:
    """Why frames and tools are no constants, by kind and number: they are assigned."""
    changed: dict[str, dict[str, str]] = {FRAME: {}, TOOL: {}}
    for statement in (one for routine in routines for one in routine.statements):
        for part in parts(statement.text):
            match = _SET.match(part)
            if match and match[2] in (None, "1"):
                number = str(int(match[3])) if match[3].strip().isdecimal() else ""
                why = f"it is assigned (line {statement.line})"
                changed[_kind(match[1])].setdefault(number, why)
    return changed


def _reached(steps: Iterable[Step]) -> Iterator[Step]:
    """The steps without those between a jump and the next label or end of a branch: nothing leads there."""
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


class _Routine:
    """One program: its statements, its positions, and the steps that come of them."""

    def __init__(self, code: str, section: Section, lines: Lines, reader: Positions) -> None:
        self.name, self.source, self.section = section.name, reader.source, section
        self.key = f"{reader.source}|{section.instructions[0]}|{section.name}"
        self.statements = list(statements(code, section.instructions, lines))
        self.motions = {
            k: found
            for k, one in enumerate(self.statements)
            if (found := motion(one)) is not None
        }
        self.labels = [m[1] for one in self.statements if (m := _LABEL.match(one.text))]
        relative = self._relative()
        left = self._left(relative)
        self.taught = reader.read(section.positions, left, relative)

    def _relative(self) -> dict[int, int]:
        """Numbers of positions that are distances, and lines of their motions."""
        return {
            point.number: found.line
            for found in reversed(self.motions.values())
            for point in found.points
            if found.options & _INC and point.kind == "P" and point.number is not None
        }

    def _left(self, relative: dict[int, int]) -> Callable[[int], str]:
        """Why positions of this program are none to correct, by their numbers."""
        left = {number: f"a relative motion (INC in line {line})" for number, line in relative.items()}
        for one in self.statements:
            if match := _WRITTEN.match(one.text):
                left[int(match[1])] = f"it is assigned (line {one.line})"
        points = [(found, point) for found in self.motions.values() for point in found.points]
        moved_to = {point.number for _, point in points if point.kind == "P"}
        somewhere = next(
            (
                f"may be used by a relative motion ({point.text[:30]} with INC in line {found.line})"
                for found, point in points
                if found.options & _INC and point.kind == "P" and point.number is None
            ),
            "",
        )
        return lambda number: left.get(number, "" if number in moved_to else somewhere)

    def alone(self, selections: tuple[Selection, Selection], literals: list[Literal]) -> None:
        """Let positions that no motion goes to be corrected in their own frame."""
        for taught in self.taught.values():
            literal = literals[taught.literal]
            if not literal.left:
                aim = self._aim(taught, selections)
                if literal.kind == JOINT:
                    aim = Aim(taught.literal)
                literals[taught.literal] = replace(literal, alone=aim)

    def _aim(self, taught: Taught, selections: tuple[Selection, Selection]) -> Aim:
        frame, tool = selections
        where = frame.of(taught.frame)
        if self.section.tracking:
            where = Unknown("line tracking: a conveyor moves it")
        return Aim(taught.literal, where, tool.of(taught.tool))

    # --- steps -------------------------------------------------------------------------------------------------------

    def steps(
        self, selections: tuple[Selection, Selection], names: dict[str, str]
    ) -> Iterator[Step]:
        """What the statements do, in their order."""
        self._selections, self._names = selections, names
        for k, statement in enumerate(self.statements):
            found = self.motions.get(k)
            if found is None:
                yield from self._instruction(statement.line, statement.text)
                continue
            aims = tuple(self._point(point, found) for point in found.points)
            yield Move(found.line, found.letter, aims)
            if found.label:
                yield Jump(found.label, always=False)

    def _point(self, point: Point, found: Motion) -> Aim:
        if point.kind == "PR":
            return Aim(Unknown("a register: its value is not in the program"))
        if point.number is None:
            which = f"which position it is, a register tells ({point.text[:30]})"
            relative = "a relative motion (INC): " if found.options & _INC else ""
            return Aim(Unknown(relative + which))
        taught = self.taught.get(point.number)
        if taught is None:
            return Aim(Unknown(f"P[{point.number}] is not among the positions for group 1"))
        if found.options & _INC:
            return Aim(Unknown("a relative motion", quiet=True))
        aim = self._aim(taught, self._selections)
        if "RTCP" in found.options:
            return replace(aim, tool=Unknown(f"a remote TCP (RTCP in line {found.line}): {HELD}"))
        return aim

    def _instruction(self, line: int, text: str) -> Iterator[Step]:
        """What an instruction does that is no motion."""
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
                yield from self._instruction(line, action)
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
            yield from self._call(line, match[1])
        elif match := _SELECT.match(text):
            if match[2] is None or match[2].strip().upper() in ("1", "GP1"):
                kind = _kind(match[1])
                selection = next(one for one in self._selections if one.kind == kind)
                yield selection.select(line, match[3].strip())
        elif match := _TIMEOUT.search(text):
            yield Jump(match[1], always=False)

    def _call(self, line: int, name: str) -> Iterator[Step]:
        key = self._names.get(name.upper())
        if key is not None:
            yield Call(line, key)
            return
        for selection in self._selections:
            yield selection.called(line, name)

    def notes(self) -> Iterator[str]:
        """What a reader of the summary has to know: motions whose offsets are not in the program."""
        places = [
            (one.line, point)
            for one in self.motions.values()
            if one.options & _OFFSETS and not one.options & _INC
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
