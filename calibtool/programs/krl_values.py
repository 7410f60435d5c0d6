"""Values of expressions of KRL: positions, frames, and frame data of inline forms."""

import re

import numpy as np

from calibtool.programs.krl import Factor, product, reference
from calibtool.programs.krl_data import Text
from calibtool.programs.krl_names import COMPONENTS, POSITIONS, Names
from calibtool.programs.motions import (
    BASE,
    FLANGE,
    FRAME,
    TOOL,
    Either,
    Frame,
    Product,
    Unknown,
    Value,
    frame_of,
)

BASE_NOW, TOOL_NOW, MODE_NOW = "$base", "$tool", "$ipo_mode"
AS_FRAME = "~"  # behind the name of a variable: what it holds where it is used as a frame
FORM = "fdat_act"
# $IPO_MODE=#BASE: nothing stands between base and position
ON_BASE = frame_of(FRAME, None, np.eye(4))
ORDER = ("x", "y", "z", "a", "b", "c")
_ITEM = {
    key: re.compile(rf"\b{key}\s+#?(-?\w+)", re.IGNORECASE)
    for key in ("TOOL_NO", "BASE_NO", "IPO_FRAME")
}
_OF_FORM = re.compile(r"(?:STOOL2?|SBASE|SIPO_MODE)\s*\(([^()]*)\)", re.IGNORECASE)
_MEMBER = re.compile(r"([^.]*)\.\s*(?:TOOL_NO|BASE_NO|IPO_FRAME)", re.IGNORECASE)


class Values:
    """Values in one text.

    declared  values of variables at the start; frames and tools by number are added to it
    held      whether the robot holds the work piece somewhere in the program
    scopes    the routine that is read, if there is one, and the module
    """

    def __init__(self, text: Text, names: Names, declared: dict[str, Value], held: bool) -> None:
        self.text, self.code, self.names, self.declared = text, text.code, names, declared
        self.held = held
        self.scopes: tuple[str, ...] = (text.module,)

    def target(self, word: str) -> Value | None:
        """The variable of a word, or elements of an array; None for a word without a value."""
        found = reference(word)
        if found is None:
            return None
        name, index, parts = found
        if parts and parts.strip(".") not in COMPONENTS:
            key = self.names.key(f"{name}{f'[{index}]' if index else ''}{parts}", self.scopes)
            return key if key in self.names.valued else None
        key = self.names.key(name, self.scopes)
        if not index:
            return key if key in self.names.valued else None
        if re.fullmatch(r"\d+(?:,\d+)*", index):
            key = f"{key}[{index}]"
            return key if key in self.names.valued else self.anywhere(name)
        return self.anywhere(name)

    def anywhere(self, name: str) -> Value | None:
        """Any element of an array, that is all assigned ones; None if there is none."""
        key = self.names.key(name, self.scopes)
        elements = tuple(self.names.elements.get(key, ()))
        if not elements:
            return None
        if name in self.names.rewritten:
            return Either(elements)
        every = f"{key}[]"
        self.declared.setdefault(every, Either(elements))
        return every

    def variables(self, target: Value | None) -> tuple[str, ...]:
        """The variables to which `target` may refer."""
        held = self.declared.get(target, target) if isinstance(target, str) else target
        parts = held.parts if isinstance(held, Either) else (held,)
        return tuple(part for part in parts if isinstance(part, str))

    def frame(self, start: int, end: int, kind: str, line: int) -> Value:
        """A frame in code[start:end], or a product of frames; line: where it is assigned."""
        factors, stop = product(self.code, start, end)
        if not factors or self.code[stop:end].strip():
            return Unknown(f"is computed (line {line})")
        values = tuple(self._factor(factor, kind, line) for factor in factors)
        return values[0] if len(values) == 1 else Product(kind, values)

    def _factor(self, factor: Factor, kind: str, line: int) -> Value:
        if factor.items:
            T = self.text.frame(factor.start, factor.end)
            if T is None:
                return Unknown(f"is not given by six numbers (line {line})")
            return frame_of(kind, None, T, line)
        if factor.call:
            return self._called(factor, kind, line)
        found = reference(factor.word)
        if found is None:
            return Unknown(f"is computed (line {line})")
        name, index, parts = found
        if name in ("$nullframe", "$world"):
            return BASE if kind == FRAME else FLANGE
        if name in (BASE_NOW, TOOL_NOW) and not parts:
            return name
        if name in ("base_data", "tool_data") and not parts:
            return self.numbered(name, index, line)
        if name.startswith("$"):
            return Unknown(f"is read from the robot ({factor.word}, line {line})")
        value = self.target(factor.word)
        if value is None or parts.strip(".") in COMPONENTS:
            return Unknown(
                f"is computed from {factor.word[:30]}, which no file gives a value (line {line})"
            )
        return Either(tuple(f"{part}{AS_FRAME}" for part in self.variables(value)))

    def _called(self, factor: Factor, kind: str, line: int) -> Value:
        """`STOOL2(FP1)` and `SBASE(FP1.BASE_NO)` of the inline forms of spline motions."""
        word = f"{factor.word}{factor.call}"
        found = _OF_FORM.fullmatch(word)
        if found is None:
            return Unknown(f"is computed ({word[:30]}, line {line})")
        which = "tool" if kind == TOOL else "base"
        inner = found[1].strip()
        member = _MEMBER.fullmatch(inner)
        if re.fullmatch(r"-?\d+", inner):
            return self.numbered(f"{which}_data", inner, line)
        return self.form(member[1] if member else inner, which, line)

    def numbered(self, table: str, index: str, line: int) -> Value:
        """`BASE_DATA[index]` or `TOOL_DATA[index]`; 0 is the robot's root or the flange."""
        kind = FRAME if table == "base_data" else TOOL
        index = self.names.constants.get(index, index)
        if not re.fullmatch(r"-?\d{1,6}", index):
            return Unknown(f"its number is a variable ({index[:30]}, line {line})")
        if int(index) <= 0:
            return BASE if kind == FRAME else FLANGE
        key = f"{table}[{int(index)}]"
        self.declared.setdefault(key, Frame(kind, str(int(index))))
        return key

    def mode(self, word: str, line: int) -> Value:
        """`$IPO_MODE`."""
        if word.strip().upper() in ("#BASE", "#NONE", "BASE", "NONE"):
            return ON_BASE
        return Unknown(
            f"the robot holds the work piece and not the tool ($IPO_MODE=#TCP, line {line})"
            if word.strip().upper().endswith("TCP")
            else f"$IPO_MODE is computed (line {line})"
        )

    def form(self, word: str, which: str, line: int) -> Value:
        """The base, tool or mode of frame data, such as `FP1`."""
        found = reference(word)
        name = "" if found is None else f"{found[0]}{f'[{found[1]}]' if found[1] else ''}"
        key = f"{self.names.key(name, self.scopes)}.{which}" if name != FORM else f"{FORM}.{which}"
        if key not in self.names.valued:
            return Unknown(f"no file holds {word.strip()[:30]} (line {line})")
        return key

    def form_items(self, start: int, end: int, line: int) -> dict[str, Value] | None:
        """Base, tool and mode of `{TOOL_NO 1,BASE_NO 0,…}`; None for other aggregates."""
        found = {key: item.search(self.code, start, end) for key, item in _ITEM.items()}
        base, tool, mode = found["BASE_NO"], found["TOOL_NO"], found["IPO_FRAME"]
        if not base and not tool:
            return None
        return {
            "base": self.numbered("base_data", base[1], line) if base else BASE,
            "tool": self.numbered("tool_data", tool[1], line) if tool else FLANGE,
            "mode": self.mode(mode[1], line) if mode else ON_BASE,
        }

    def on(self, base: Value, mode: Value) -> Value:
        """The frame of a motion: its base; unknown if the robot holds the work piece."""
        return Product(FRAME, (mode, base)) if self.held else base

    def is_position(self, name: str) -> bool:
        """Whether a name is declared as a position or is the target of a motion."""
        return self.names.type(name, self.scopes) in POSITIONS[:-1] or name in self.names.driven
