"""Names of URScript: the function or variable to which a name refers at a place."""

from dataclasses import dataclass, field

TCP = "set_tcp"  # sets the tool, and the variable that holds it


@dataclass(frozen=True, slots=True)
class Function:
    """A function: its unique name, the function around it, where it is defined, and its
    parameters.
    """

    key: str
    parent: str
    position: int
    parameters: tuple[str, ...]


@dataclass(eq=False)
class Names:
    """Names of all scripts, by text and name, and those to which a name of another text may refer.

    elements  of lists, by the list's variable
    called    names that a function calls, by its unique name
    solved    variables that hold only joints by get_inverse_kin, which are treated as its pose
    computed  variables that hold something else
    """

    functions: dict[tuple[int, str], Function] = field(default_factory=dict)
    variables: set[tuple[int, str]] = field(default_factory=set)
    elements: dict[str, list[str]] = field(default_factory=dict)
    called: dict[str, set[str]] = field(default_factory=dict)
    solved: set[str] = field(default_factory=set)
    computed: set[str] = field(default_factory=set)
    texts: int = 0

    def function(self, text: int, name: str) -> Function | None:
        """The function of a name in a text."""
        places = [text, *range(self.texts)]
        return next((f for k in places if (f := self.functions.get((k, name)))), None)

    def sets_tool(self, text: int, function: Function) -> bool:
        """Whether a function, or one that it calls, sets the tool."""
        seen, waiting = {function.key}, [function]
        while waiting:
            called = self.called.get(waiting.pop().key, set())
            if TCP in called:
                return True
            found = [f for name in sorted(called) if (f := self.function(text, name))]
            waiting += [f for f in found if f.key not in seen]
            seen |= {f.key for f in found}
        return False

    def variable(self, text: int, name: str) -> str:
        """The variable of a name in a text."""
        places = [k for k in (text, *range(self.texts)) if (k, name) in self.variables]
        return f"{places[0] if places else text}|{name}"
