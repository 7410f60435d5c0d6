"""Assignments and declarations of KRL: the values that variables get."""

import re
from collections.abc import Iterator

from calibtool.programs.krl import Declared, Factor, Statement, product, reference
from calibtool.programs.krl_data import Text
from calibtool.programs.krl_names import COMPONENTS, FORM_NAMES, FORM_PARTS, POSITIONS, Names
from calibtool.programs.krl_values import (
    AS_FRAME,
    FORM,
    MODE_NOW,
    ORDER,
    Values,
)
from calibtool.programs.motions import (
    FRAME,
    TOOL,
    Assign,
    Edited,
    Either,
    Frame,
    Unknown,
    Value,
    frame_of,
)
from calibtool.programs.numbers import Remark, number_at
from calibtool.robot.orientation import TURNED_ANGLES

_KINDS = {"$base": FRAME, "base_data": FRAME, "$tool": TOOL, "tool_data": TOOL}
_BAS = re.compile(r"\(\s*#(\w+)\s*(?:,\s*([^,)]*?)\s*)?\)")
_WITH = re.compile(r"\$(TOOL|BASE|IPO_MODE)\s*=\s*", re.IGNORECASE)
_STANDS = ("$pos_act", "$axis_act", "$pos_act_mes", "$axis_act_mes", "$pos_for", "$axis_for")
_RELATIVE = "a relative motion"


class Assignments(Values):
    """The values that variables get by the assignments and declarations of one text."""

    def __init__(self, text: Text, names: Names, declared: dict[str, Value], held: bool) -> None:
        super().__init__(text, names, declared, held)
        self.remarks: list[Remark] = []

    # --- assignments ---

    def assigned(self, statement: Statement, line: int) -> Iterator[Assign]:
        """The values that an assignment gives to variables; line: its line, 0 in a data list."""
        name, (index, parts) = statement.name.lower(), statement.more
        index, part = re.sub(r"[\s\[\]]", "", index).lower(), parts.lower().strip(".")
        item = Declared(statement.name, index, statement.start, statement.end)
        if name == MODE_NOW:
            yield Assign(line, MODE_NOW, self.mode(self.code[item.start : item.end], line))
        elif name in _KINDS:
            yield from self._system(item, part, line)
        elif name == FORM or part in FORM_NAMES or self.names.type(name, self.scopes) == "FDAT":
            yield from self._form(item, part, line)
        elif part in COMPONENTS:
            yield from self._component(item, part, line)
        elif part:
            member = f"{statement.name}{f'[{index}]' if index else ''}.{part}"
            yield from self.given(Declared(member, "", item.start, item.end), "", line)
        else:
            yield from self.given(item, self.names.type(name, self.scopes), line)

    def _system(self, item: Declared, part: str, line: int) -> Iterator[Assign]:
        """$BASE, $TOOL, BASE_DATA[n], TOOL_DATA[n], or a component of one."""
        name = item.name.lower()
        kind = _KINDS[name]
        target: Value = name
        if "data" in name:
            target = self.numbered(name, item.index, line)
            if isinstance(target, Unknown):
                yield from self._any(
                    name, f"may be changed (its number is a variable, line {line})", line
                )
                return
        if not isinstance(target, str):
            return
        if part:
            edited = f"a component of it is assigned (line {line})"
            numbers = self._number(item, part)
            yield Assign(line, target, Edited(target, numbers, TURNED_ANGLES, line, edited))
            return
        value = self.frame(item.start, item.end, kind, line)
        if isinstance(value, Frame) and value.values is not None and "data" in name:
            value = frame_of(kind, item.index, value.T, line)
        yield Assign(line, target, value)

    def _any(self, table: str, why: str, line: int) -> Iterator[Assign]:
        """Any frame of a table may change."""
        known = [key for key in self.declared if key.startswith(f"{table}[")]
        yield from (Assign(line, key, Either((key, Unknown(why)))) for key in known)

    def changed(self, word: str, why: str, line: int) -> Iterator[Assign]:
        """The value of a variable, or of its component, after something else has changed it."""
        found = reference(word)
        name = found[0] if found else ""
        if found and name in (*_KINDS, MODE_NOW):
            target = self.numbered(name, found[1], line) if "data" in name else name
            if isinstance(target, Unknown):
                yield from self._any(name, why, line)
            elif isinstance(target, str):
                yield Assign(line, target, Unknown(why))
        else:
            for variable in self.variables(self.target(word) or self.anywhere(name)):
                for key in (variable, f"{variable}{AS_FRAME}"):
                    yield Assign(line, key, Edited(key, (), TURNED_ANGLES, line, why))

    def _number(self, item: Declared, part: str) -> tuple[tuple[int, float], ...]:
        if part not in ORDER:
            return ()
        unit = "mm" if part in ORDER[:3] else "deg"
        number = number_at(self.text.text, item.start, item.end, unit)
        return () if number is None else ((ORDER.index(part), number.value),)

    def _form(self, item: Declared, part: str, line: int) -> Iterator[Assign]:
        """Frame data of inline forms: `FDAT_ACT=FP1`, `FDAT_ACT={TOOL_NO 1,…}`, `FP1.BASE_NO=2`."""
        name = item.name.lower()
        key = FORM if name == FORM else self.names.key(name, self.scopes)
        word = self.code[item.start : item.end]
        if part:
            which = {"tool_no": "tool", "base_no": "base", "ipo_frame": "mode"}.get(part)
            if which is not None:
                value = (
                    self.mode(word, line)
                    if which == "mode"
                    else self.numbered(f"{which}_data", word.strip().lower(), line)
                )
                yield Assign(line, f"{key}.{which}", value)
            return
        items = self.form_items(item.start, item.end, line) if word.startswith("{") else None
        for which in FORM_PARTS:
            value = self.form(word, which, line) if items is None else items[which]
            yield Assign(line, f"{key}.{which}", value)

    def _component(self, item: Declared, part: str, line: int) -> Iterator[Assign]:
        target = self.target(f"{item.name}[{item.index}]" if item.index else item.name)
        why = f"a component of it is assigned (line {self.text.lines(item.start)})"
        numbers = self._number(item, part)
        for key in self.variables(target):
            yield Assign(line, key, Edited(key, (), TURNED_ANGLES, line, why))
            if item.name.lower() in self.names.framed:
                twin = f"{key}{AS_FRAME}"
                yield Assign(line, twin, Edited(twin, numbers, TURNED_ANGLES, line, why))

    def given(self, item: Declared, type_: str, line: int) -> Iterator[Assign]:
        """The value of a variable to which code[item.start:item.end] is assigned."""
        index = re.sub(r"[\s\[\]]", "", item.index).lower()
        key = self.names.key(item.name.lower(), self.scopes)
        if item.name.lower() in _KINDS:
            yield from self._system(Declared(item.name, index, item.start, item.end), "", line)
        elif not index or re.fullmatch(r"\d+(?:,\d+)*", index):
            key = f"{key}[{index}]" if index else key
            yield from self.held_by(key, item, type_, line)
        else:
            for element in self.names.elements.get(key, ()):
                for step in self.held_by(element, item, type_, line):
                    several = Either((step.name, step.value))
                    yield Assign(
                        line, step.name, step.value if step.name.endswith(f"[{index}]") else several
                    )

    def held_by(self, key: str, item: Declared, type_: str, line: int) -> Iterator[Assign]:
        """The same for a variable by its unique name."""
        name, word = item.name, self.code[item.start : item.end]
        low = name.lower()
        here = line or self.text.lines(item.start)
        shown = f"{name}[{item.index.strip('[] ')}]" if item.index else name
        if word.startswith("{"):
            if not word.endswith("}"):
                self._unclosed(item.start, shown)
            elif "{" not in word[1:]:
                yield from self._aggregate(key, item, type_, line, shown)
            return
        factors, stop = product(self.code, item.start, item.end)
        self.text.taken.update(factor.start for factor in factors)
        plain = bool(factors) and not self.code[stop : item.end].strip()
        if low in self.names.framed:
            yield Assign(line, f"{key}{AS_FRAME}", self.frame(item.start, item.end, FRAME, here))
        if type_ not in POSITIONS and low not in self.names.driven:
            return
        value = self._copied(factors, here) if plain else Unknown(f"is computed (line {here})")
        if value is not None:
            yield Assign(line, key, value)

    def _copied(self, factors: list[Factor], line: int) -> Value | None:
        first = factors[0]
        if first.call:
            return Unknown(f"is computed (line {line})")
        if len(factors) > 1:
            return Unknown(f"is relative to {first.word or 'a position'} (line {line})")
        if first.word.startswith("$"):
            return Unknown(f"is read from the robot ({first.word}, line {line})")
        found = reference(first.word)
        if found is None or found[2].strip(".") in COMPONENTS:
            return None
        value = self.target(first.word)
        if value is None:
            return Unknown(f"'{first.word}' is a variable that no file gives a position")
        return value

    def _aggregate(
        self, key: str, item: Declared, type_: str, line: int, shown: str
    ) -> Iterator[Assign]:
        start, end, low = item.start, item.end, item.name.lower()
        items = self.form_items(start, end, line) if "_NO" in self.code[start:end].upper() else None
        if items is not None and type_ in ("FDAT", ""):
            for which, value in items.items():
                yield Assign(line, f"{key}.{which}", value)
            return
        line_framed = self.names.framed.get(low)
        if line_framed is not None:
            yield Assign(line, f"{key}{AS_FRAME}", self.frame(start, end, FRAME, line))
        driven = low in self.names.driven
        if type_ == "FRAME" and line_framed is not None and not driven:
            return  # a frame, which is no position
        if type_ not in POSITIONS and not driven and (type_ or not self.text.complete(start, end)):
            return  # load data, motion parameters, something else
        not_corrected = ""
        if low.startswith("$"):  # $AXIS_HOME, $H_POS, $H_POS_TOL of the machine data
            not_corrected = "a system variable of the controller"
        elif type_ == "FRAME" and not driven:
            not_corrected = "a FRAME that no motion of this program goes to"
        elif line_framed is not None:
            not_corrected = f"is used as a frame too (line {line_framed})"
        frames = self._alone(low, line) if low not in self.names.used else None
        yield Assign(line, key, self.text.position(start, end, shown, not_corrected, frames))

    def _alone(self, name: str, line: int) -> tuple[Value, Value] | None:
        """Base and tool of a taught point: those of its frame data, `FP1` for `XP1`."""
        key = self.names.key(f"f{name[1:]}", self.scopes)
        if name.startswith("x") and f"{key}.base" in self.names.valued:
            return self.on(f"{key}.base", f"{key}.mode"), f"{key}.tool"
        return (Frame(FRAME, None), Frame(TOOL, None)) if not line else None

    def _unclosed(self, position: int, name: str) -> None:
        why = "a brace is not closed"
        self.remarks.append(Remark(self.text.lines(position), name, why, True, self.text.number))
