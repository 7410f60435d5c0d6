"""Motions of KRL as steps of a routine, and what sets their base and tool."""

import re
from collections.abc import Iterator

from calibtool.programs.krl import Factor, Statement, product, reference
from calibtool.programs.krl_assignments import Assignments
from calibtool.programs.krl_data import Text
from calibtool.programs.krl_names import Names
from calibtool.programs.krl_values import (
    BASE_NOW,
    FORM,
    MODE_NOW,
    ON_BASE,
    TOOL_NOW,
)
from calibtool.programs.motions import (
    BASE,
    FRAME,
    OFF,
    ON,
    TOOL,
    Aim,
    Assign,
    Move,
    Unknown,
    Value,
)
from calibtool.programs.motions import Statement as Step

_KINDS = {"$base": FRAME, "base_data": FRAME, "$tool": TOOL, "tool_data": TOOL}
_TABLES = ("load_data", "machine_def", "$load", "$robroot")
_BAS = re.compile(r"\(\s*#(\w+)\s*(?:,([^,)]*))?\)")
_WITH = re.compile(r"\$(TOOL|BASE|IPO_MODE)\s*=\s*", re.IGNORECASE)
_STANDS = ("$pos_act", "$axis_act", "$pos_act_mes", "$axis_act_mes", "$pos_for", "$axis_for")
_RELATIVE = "a relative motion"


class Motions(Assignments):
    """Steps of one text. block: base, tool and mode of the open spline block."""

    def __init__(self, text: Text, names: Names, declared: dict[str, Value], held: bool) -> None:
        super().__init__(text, names, declared, held)
        self.block: dict[str, Value] = {}

    # --- base and tool ---

    def bas(self, start: int, end: int, line: int) -> Iterator[Step]:
        """`BAS(#command,value)`: effect of KUKA's own routine on base, tool and mode."""
        found = _BAS.match(self.code, start, end)
        command, number = (
            (found[1].lower(), (found[2] or "").strip().lower()) if found else ("", "")
        )
        if command == "initmov":
            yield Assign(line, BASE_NOW, BASE)
            yield Assign(line, TOOL_NOW, self.numbered("tool_data", "1", line))
            yield Assign(line, MODE_NOW, ON_BASE)
        elif command in ("base", "tool"):
            yield Assign(line, f"${command}", self.numbered(f"{command}_data", number, line))
        elif command == "ex_base":
            yield Assign(line, BASE_NOW, Unknown(f"an external kinematic moves it (line {line})"))
        elif command in ("frames", "ptp_params", "cp_params"):
            for which, name in (("base", BASE_NOW), ("tool", TOOL_NOW), ("mode", MODE_NOW)):
                yield Assign(line, name, self.form(FORM, which, line))

    def settings(self, start: int, end: int, line: int) -> dict[str, Value]:
        """Base, tool and mode after WITH, which are valid for one motion or spline block."""
        found: dict[str, Value] = {}
        for match in _WITH.finditer(self.code, start, end):
            factors, stop = product(self.code, match.end(), end)
            stop = stop if factors else match.end()
            name = f"${match[1].lower()}"
            if name == MODE_NOW:
                found[name] = self._mode(factors, self.code[match.end() : end], line)
            else:
                found[name] = self.frame(match.end(), stop, _KINDS[name], line)
        return found

    def _mode(self, factors: list[Factor], word: str, line: int) -> Value:
        """`#BASE`, `#TCP`, or `SIPO_MODE(FP1.IPO_FRAME)`."""
        if factors and factors[0].call:
            return self.form(re.split(r"[(.)]", word)[1], "mode", line)
        return self.mode(re.split(r"[\s,]", word)[0], line)

    # --- motions ---

    def motion(self, statement: Statement, line: int) -> Iterator[Step]:
        """The motion of an instruction through its points: a circle has two."""
        name, code, end = statement.name.upper(), self.code, statement.end
        if statement.word == "relative":
            yield Move(line, name, (Aim(Unknown(_RELATIVE)),))
            return
        aims: list[Aim] = []
        position, count = statement.start, 2 if name.endswith("CIRC") else 1
        while len(aims) < count:
            factors, stop = product(code, position, end)
            if not factors:
                if "{" in code[position:end] and "}" not in code[position:end]:
                    self._unclosed(position, name)
                    return
                aims.append(Aim(Unknown(f"an expression ({code[position:end][:40]})")))
                break
            if len(factors) == 1 and factors[0].word.lower() in _STANDS:
                return  # where the robot stands already
            aims.append(self._aim(factors, name))
            position = stop + 1
            if code[stop : stop + 1] != ",":
                break
        own = self.block | self.settings(position, end, line)
        frame = self.on(own.get(BASE_NOW, BASE_NOW), own.get(MODE_NOW, MODE_NOW))
        tool = own.get(TOOL_NOW, TOOL_NOW)
        obeyed = ON if name.endswith("PTP") else OFF
        yield Move(
            line,
            name,
            tuple(Aim(aim.value, frame, tool, obeyed, relative=aim.relative) for aim in aims),
        )

    def _aim(self, factors: list[Factor], name: str) -> Aim:
        first = factors[0]
        self.text.taken.update(factor.start for factor in factors)
        word = f"{first.word}{first.call}"[:40]
        if len(factors) > 1:
            why = f"relative to {word or 'a position'}; the point itself is treated by itself"
            found = reference(first.word) if first.word and not first.call else None
            value = self.target(first.word) if found and self.is_position(found[0]) else None
            return Aim(value, relative=why) if value is not None else Aim(Unknown(why))
        if first.items:
            return Aim(self.text.position(first.start, first.end, name))
        if first.call:
            return Aim(Unknown(f"an expression ({word})"))
        if first.word.startswith("$"):
            return Aim(Unknown(f"read from the robot ({word})"))
        value = self.target(first.word)
        if value is None:
            return Aim(Unknown(f"'{word}' is a variable that no file gives a position"))
        return Aim(value)
