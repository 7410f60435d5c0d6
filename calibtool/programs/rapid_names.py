"""Names of RAPID modules: which data or routine a name means at a place."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from calibtool.programs.rapid import Statement, statements
from calibtool.programs.rapid_data import Text

TYPES = ("robtarget", "jointtarget", "tooldata", "wobjdata", "pose", "zonedata")
_PARAMETER = re.compile(
    r"\s*(?P<optional>\\)?\s*(?:(?:INOUT|VAR|PERS|REF)\s+)*(?P<type>\w+)\s+(?P<name>\w+)",
    re.IGNORECASE,
)


def placed(code: str, number: int) -> Iterator[tuple[Statement, tuple[str, ...]]]:
    """The statements of a text with the scopes in force at each, the innermost first: routine and module, or module."""
    inside = f"{number}"
    scopes: tuple[str, ...] = (inside,)
    for statement in statements(code):
        if statement.word == "module":
            inside = f"{number}.{statement.name.lower()}"
        if statement.word == "routine":
            scopes = (f"{inside}|{statement.name.lower()}", inside)
        elif statement.word in ("module", "endmodule", "endproc", "endfunc", "endtrap"):
            scopes = (inside,)
        yield statement, scopes


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
        """Take in the names of a text."""
        for statement, scopes in placed(text.code, text.number):
            name = statement.name.lower()
            if statement.word == "routine":
                local = text.code[statement.position : statement.position + 5].upper() == "LOCAL"
                procedure = Procedure(scopes[0], self._parameters(text, statement, scopes[0]))
                self.routines[scopes[0] if local else name] = procedure
            elif statement.word == "data" and statement.more[2] in TYPES:
                scope, _, type_, dimensions = statement.more
                inside = scopes[0] if len(scopes) > 1 or scope == "local" else ""
                key = f"{inside}|{name}" if inside else name
                space = self.inside.setdefault(inside, {}) if inside else self.everywhere
                space[name] = Data(type_, key, dimensions.count(",") + 1 if dimensions else 0)
            elif statement.word == "assign":
                self.changed.add(name)

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
