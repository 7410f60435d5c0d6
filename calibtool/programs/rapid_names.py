"""Names of RAPID modules: the data or routine to which a name refers at a place."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from calibtool.programs.rapid import Argument, Statement, statements
from calibtool.programs.rapid_data import SHAPES, Text

TYPES = ("robtarget", "jointtarget", "tooldata", "wobjdata", "pose", "zonedata")
_PARAMETER = re.compile(
    r"\s*(?P<optional>\\)?\s*(?P<mode>(?:(?:INOUT|VAR|PERS|REF)\s+)*)(?P<type>\w+)\s+(?P<name>\w+)",
    re.IGNORECASE,
)


def placed(code: str, number: int) -> Iterator[tuple[Statement, tuple[str, ...]]]:
    """The statements of a text with their scopes, the innermost first: routine and module, or
    module.
    """
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
    """The data of a name: type, unique name of the variable, and number of indices.

    constant   nothing can change it
    reference  a parameter whose argument changes with it
    """

    type: str
    key: str
    dimensions: int = 0
    constant: bool = False
    reference: bool = False


@dataclass(frozen=True, slots=True)
class Procedure:
    """A routine: its unique name and its parameters, name and data; optional ones begin
    with a backslash.
    """

    key: str
    parameters: tuple[tuple[str, Data], ...]

    def matched(self, given: Sequence[Argument]) -> Iterator[tuple[Data, Argument | None]]:
        """The parameters, each with its argument."""
        plain = [argument for argument in given if not argument.option]
        options = {argument.option: argument for argument in given if argument.option}
        for name, data in self.parameters:
            if name[0] == "\\":
                yield data, options.get(name[1:])
            else:
                yield data, plain.pop(0) if plain else None


@dataclass(eq=False)
class Names:
    """Data and routines of the modules of one task, names in lower case.

    everywhere  global data
    inside      data of a module or routine, by its name
    elements    names of an array's elements, by the array's name
    changed     names that a routine assigns or that may change as arguments
    targets     variables of positions
    procedures  unique names of routines that instructions call
    unfollowed  functions and traps
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
    targets: set[str] = field(default_factory=set)
    procedures: set[str] = field(default_factory=set)
    unfollowed: set[str] = field(default_factory=set)

    def data(self, name: str, scopes: Sequence[str]) -> Data | None:
        """The data of a name in these scopes, the innermost first."""
        name = name.lower()
        for scope in scopes:
            found = self.inside.get(scope, {}).get(name)
            if found is not None:
                return found
        return self.everywhere.get(name)

    def routine(self, name: str, module: str) -> Procedure | None:
        """The routine of a name in a module."""
        return self.routines.get(f"{module}|{name.lower()}") or self.routines.get(name.lower())

    def read(self, text: Text) -> None:
        """Read the names of a text."""
        for statement, scopes in placed(text.code, text.number):
            name = statement.name.lower()
            if statement.word == "routine":
                local = text.code[statement.position : statement.position + 5].upper() == "LOCAL"
                procedure = Procedure(scopes[0], self._parameters(text, statement, scopes[0]))
                self.routines[scopes[0] if local else name] = procedure
                head = text.code[statement.position : statement.start]
                called = re.match(r"(?:LOCAL\s+)?PROC\b", head, re.IGNORECASE)
                (self.procedures if called else self.unfollowed).add(scopes[0])
            elif statement.word == "data" and statement.more[2] in TYPES:
                scope, _, type_, dimensions = statement.more
                inside = scopes[0] if len(scopes) > 1 or scope == "local" else ""
                key = f"{inside}|{name}" if inside else name
                space = self.inside.setdefault(inside, {}) if inside else self.everywhere
                count = dimensions.count(",") + 1 if dimensions else 0
                space[name] = Data(type_, key, count, statement.more[1] == "const")
                if type_ in SHAPES:
                    self.targets.add(key)
            elif statement.word == "assign":
                self.changed.add(name)
            elif statement.word == "instruction" and not name.startswith("move"):
                given = text.code[statement.start : statement.end].lower()
                self.changed.update(re.findall(r"\w+", given))

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
            type_, key = match["type"].lower(), f"{routine}|{name}"
            data = Data(type_, key, part.count("{"), reference=bool(match["mode"]))
            if type_ in SHAPES:
                self.targets.add(key)
            if data.type in TYPES:
                space[name] = data
            found.append((("\\" if match["optional"] else "") + name, data))
        return tuple(found)
