"""Names of RAPID modules: which data or routine a name means at a place."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from calibtool.programs.rapid import Statement, statements
from calibtool.programs.rapid_data import Text

TYPES = ("robtarget", "jointtarget", "tooldata", "wobjdata", "pose", "zonedata")
_PARAMETER = re.compile(
    r"\s*(?P<optional>\\)?\s*(?:(?:INOUT|VAR|PERS|REF)\s+)*(?P<type>\w+)\s+(?P<name>\w+)",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class Data:
    """What a name stands for: its type, the name of its variable in motions, and how many indices it has."""

    type: str
    key: str
    dimensions: int = 0


@dataclass(frozen=True, slots=True)
class Procedure:
    """A routine: its unique name and its parameters, name and data; optional ones begin with a backslash."""

    key: str
    parameters: tuple[tuple[str, Data], ...]


@dataclass(eq=False)
class Names:
    """Data and routines of the modules of one task, names in lower case.

    everywhere  global data; inside: those of a module or routine, by its name
    elements    names of an array's elements, by the array's
    changed     names that a routine assigns to or that instructions fill
    """

    everywhere: dict[str, Data] = field(
        default_factory=lambda: {
            "tool0": Data("tooldata", "tool0"),
            "wobj0": Data("wobjdata", "wobj0"),
        }
    )
    inside: dict[str, dict[str, Data]] = field(default_factory=dict)
    routines: dict[str, Procedure] = field(default_factory=dict)
    elements: dict[str, list[str]] = field(default_factory=dict)
    changed: set[str] = field(default_factory=set)

    def data(self, name: str, scopes: Sequence[str]) -> Data | None:
        """What a name stands for where these scopes, the innermost first, are in force."""
        name = name.lower()
        for scope in scopes:
            found = self.inside.get(scope, {}).get(name)
            if found is not None:
                return found
        return self.everywhere.get(name)

    def routine(self, name: str, module: str) -> Procedure | None:
        """The routine that a name means in a module."""
        return self.routines.get(f"{module}|{name.lower()}") or self.routines.get(name.lower())

    def read(self, text: Text) -> None:
        """Take in the names of a module."""
        module, routine = f"{text.number}", ""
        for statement in statements(text.code):
            if statement.word == "routine":
                local = text.code[statement.position : statement.position + 5].upper() == "LOCAL"
                name = statement.name.lower()
                routine = f"{module}|{name}"
                procedure = Procedure(routine, self._parameters(text, statement, routine))
                self.routines[routine if local else name] = procedure
            elif statement.word in ("endproc", "endfunc", "endtrap", "endmodule"):
                routine = ""
            elif statement.word == "data" and statement.more[2] in TYPES:
                scope, _, type_, dimensions = statement.more
                inner = routine or (module if scope == "local" else "")
                name = statement.name.lower()
                key = f"{inner}|{name}" if inner else name
                count = dimensions.count(",") + 1 if dimensions else 0
                space = self.inside.setdefault(inner, {}) if inner else self.everywhere
                space[name] = Data(type_, key, count)
            elif statement.word == "assign":
                self.changed.add(statement.name.lower())

    def _parameters(
        self, text: Text, statement: Statement, routine: str
    ) -> tuple[tuple[str, Data], ...]:
        found: list[tuple[str, Data]] = []
        space = self.inside.setdefault(routine, {})
        inner = text.code[statement.start + 1 : max(statement.start + 1, statement.end - 1)]
        for part in re.split(r"[,|]|(?=\\)", inner):
            match = _PARAMETER.match(part)
            if match is None:
                continue
            name = match["name"].lower()
            data = Data(match["type"].lower(), f"{routine}|{name}", part.count("{"))
            if data.type in TYPES:
                space[name] = data
            found.append((("\\" if match["optional"] else "") + name, data))
        return tuple(found)
