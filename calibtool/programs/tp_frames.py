"""Frames and tools of FANUC: listings of variables, UFRAME_NUM and UTOOL_NUM."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from calibtool.programs.frames import pose
from calibtool.programs.motions import FRAME, TOOL, Assign, Frame, Unknown, Value, frame_of
from calibtool.programs.numbers import NUMBER, LineNumbers, Remark, number_at
from calibtool.robot.orientation import FIXED_ANGLES
from calibtool.robot.se3 import Array

_VARIABLE = re.compile(r"^\[\*?\w+\*?\]\$?\w+[ \t]+Storage:", re.MULTILINE)
_TABLE = re.compile(r"^\[\*SYSTEM\*\]\$MNU(FRAME|TOOL)[ \t]+Storage:[^\n]*\n", re.MULTILINE)
_NUMBERS = r"\s*".join(rf"{key}:\s*({NUMBER})" for key in "XYZWPR")
_ENTRY = re.compile(
    rf"^[ \t]*\[1,(\d+)\][ \t]*=[ \t]*(?:'[^\n]*')?\s*(?:Group:[^\n]*\n)?\s*{_NUMBERS}",
    re.MULTILINE,
)
_TURN_AXIS = re.compile(
    r"\$SCR_GRP\[1\]\.\$TURN_AXIS\b[^\n]*\n((?:[ \t]*\[\d+\][ \t]*=[ \t]*\d+[ \t]*\r?\n?)+)"
)
_ELEMENT = re.compile(r"=[ \t]*(\d{1,3})\b")


def is_listing(text: str) -> bool:
    """Whether a text lists variables of the controller, as sysframe.va and framevar.va do."""
    return _VARIABLE.search(text) is not None


@dataclass(eq=False)
class Listed:
    """The frames of listings: T_base_frame and T_flange_tool of motion group 1 by kind and number,
    and turn axes from 0.
    """

    frames: dict[tuple[str, str], Array] = field(default_factory=dict)
    turn_axes: tuple[int, ...] | None = None
    remarks: list[Remark] = field(default_factory=list)

    def read(self, text: str, source: int) -> None:
        """The tables $MNUFRAME and $MNUTOOL, and $TURN_AXIS, of a listing."""
        lines = LineNumbers(text)
        for table in _TABLE.finditer(text):
            kind = FRAME if table[1] == "FRAME" else TOOL
            after = _VARIABLE.search(text, table.end())
            for entry in _ENTRY.finditer(text, table.end(), after.start() if after else len(text)):
                units = ("mm",) * 3 + ("deg",) * 3
                numbers = [
                    number_at(text, *entry.span(k + 2), unit) for k, unit in enumerate(units)
                ]
                values = [number.value for number in numbers if number is not None]
                if len(values) == 6:
                    name = f"$MNU{table[1]}[1,{entry[1]}]"
                    self._add(
                        kind,
                        entry[1],
                        pose(values, FIXED_ANGLES),
                        name,
                        lines(entry.start(2)),
                        source,
                    )
        axes = _TURN_AXIS.search(text)
        if axes:
            found = tuple(int(one) - 1 for one in _ELEMENT.findall(axes[1]))
            self.turn_axes = found if all(0 <= axis < 6 for axis in found) else None

    def _add(self, kind: str, number: str, T: Array, name: str, line: int, source: int) -> None:
        before = self.frames.setdefault((kind, number), T)
        if abs(before - T).max() > 1e-9:
            why = "differs from that of another file"
            self.remarks.append(Remark(line, name, why, True, source))


@lru_cache(maxsize=1000)
def _frame(kind: str, number: str) -> Frame:
    """The same object for all positions of a frame: 50,000 objects would take 9 MB."""
    return Frame(kind, number)


@dataclass(frozen=True, eq=False)
class Selection:
    """Frames or tools by the numbers of positions, and the one that UFRAME_NUM or UTOOL_NUM
    selects.

    A position with a number is in that frame; the controller refuses it while another one is
    selected. A position with `F` is in the selected frame.

    kind     FRAME or TOOL
    listed   poses of frames by number
    changed  why a frame is no constant, by kind and number; with the number "" it is valid for all
    """

    kind: str
    listed: Mapping[tuple[str, str], Array]
    changed: Mapping[tuple[str, str], str]

    @property
    def variable(self) -> str:
        """The name of the variable that holds what is selected."""
        return f"selected {self.kind}"

    def of(self, number: str) -> Value:
        """The frame of a position with this number, or with `F`."""
        if number == "F":
            return self.variable
        if number == "0":
            return _frame(self.kind, "")
        why = self.changed.get((self.kind, number)) or self.changed.get((self.kind, ""))
        if why:
            return Unknown(why)
        T = self.listed.get((self.kind, number))
        return _frame(self.kind, number) if T is None else frame_of(self.kind, number, T)

    def select(self, line: int, text: str) -> Assign:
        """The effect of `UFRAME_NUM=text`."""
        if text.isdecimal():
            return Assign(line, self.variable, self.of(text.lstrip("0") or "0"))
        name = "UFRAME_NUM" if self.kind == FRAME else "UTOOL_NUM"
        return Assign(line, self.variable, Unknown(f"{name} is told by {text[:30]} (line {line})"))

    def called(self, line: int, routine: str) -> Assign:
        """The possible effect of a call of a program that is not available: it may select any
        frame.
        """
        why = f"may be selected by {routine}, which is not at hand (line {line})"
        return Assign(line, self.variable, Unknown(why))
