"""Variables of a program: their assignments, and their values at the beginning."""

from collections.abc import Iterable

from calibtool.programs.control_flow import Block
from calibtool.programs.frames import NamedFrames
from calibtool.programs.motions import Assign, Call, Either, Program, Unknown, Value
from calibtool.programs.values import MANY, Atoms, ValueAnalysis, joined

ROBOT_AT = ""  # the variable that holds the uses at which the robot may be
NOWHERE = -1  # among these uses: the robot may also be at an unknown place
BEFORE = 8  # number of earlier uses among which the branch of a position is looked for
_POSITIONS = 1000  # a variable that can hold more literals than this counts as unknown
# Above this number of blocks times variables, a variable holds all its values everywhere
_WORK = 5_000_000
_EMPTY: Atoms = frozenset([Unknown("a variable that no file gives a value")])

State = dict[str, Atoms]


class Variables:
    """Variables of a program whose routines have these blocks.

    kept      possible values at the beginning besides the declared ones
    assigned  values that are assigned to variables somewhere, without variables that always hold
              one literal
    """

    def __init__(
        self, program: Program, graphs: Iterable[list[Block]], given: NamedFrames, kept: State
    ) -> None:
        self.program, self.kept = program, kept
        self.assigned = self._assigned(graphs)
        self.evaluation = ValueAnalysis(program.literals, given, self.owners)
        self._beginning: dict[str, Atoms | None] = {}

    def _assigned(self, graphs: Iterable[list[Block]]) -> dict[str, list[Value]]:
        """Values assigned to variables, without variables that always hold one literal."""
        found: dict[str, list[Value]] = {}
        parameters: set[str] = set()
        self.owners: dict[int, set[str]] = {}
        for name, value in self.program.declared.items():
            _own(self.owners, name, value)
        size = 0
        for graph in graphs:
            size += len(graph)
            for action in (action for block in graph for action in block.actions):
                if isinstance(action, Assign):
                    found.setdefault(action.name, []).append(action.value)
                    _own(self.owners, action.name, action.value)
                elif isinstance(action, Call):
                    parameters |= {name for name, _ in action.arguments}
                    for name, value in action.arguments:
                        found.setdefault(name, []).append(value)
        once = {
            name: values[0]
            for name, values in found.items()
            if len(values) == 1 and name not in self.program.declared and name not in parameters
        }
        self.fixed: dict[str, list[Value]] = {
            name: [value] for name, value in once.items() if isinstance(value, int)
        }
        found = {name: values for name, values in found.items() if name not in self.fixed}
        if size * len(found) > _WORK:
            self.fixed |= {name: values + self._declared(name) for name, values in found.items()}
            found = {}
        return found

    def _declared(self, name: str) -> list[Value]:
        return [self.program.declared[name]] if name in self.program.declared else []

    def begin(self, name: str) -> Atoms:
        """The value of a variable at the beginning; constant if nothing is assigned."""
        known = self._beginning.get(name, frozenset())
        if known:
            return known
        if name == ROBOT_AT:
            return frozenset([NOWHERE])
        if known is None:
            return frozenset([Unknown("is made of itself")])
        self._beginning[name] = None
        result = self.kept.get(name, frozenset())
        for value in self.fixed.get(name) or self._declared(name):
            result = joined(result, self.evaluation.atoms(value, self.begin))
        self._beginning[name] = result = result or _EMPTY
        return result

    def joined(self, name: str, one: Atoms, other: Atoms) -> Atoms:
        """The union of possible values; with very many, literals are no constants."""
        both = joined(one, other)
        if len(both) <= BEFORE or (name != ROBOT_AT and len(both) <= _POSITIONS):
            return both
        literals = [atom for atom in both if isinstance(atom, int)]
        if name == ROBOT_AT:  # the lowest, and perhaps others
            first = sorted(number for number in literals if number != NOWHERE)[:BEFORE]
            return both.difference(literals) | {*first, NOWHERE}
        for number in literals:
            self.evaluation.spoiled.setdefault(number, "its variable takes too many positions")
        return frozenset([MANY])


def _own(owners: dict[int, set[str]], name: str, value: Value) -> None:
    """Note that a variable holds literals themselves."""
    for part in value.parts if isinstance(value, Either) else (value,):
        if isinstance(part, int):
            owners.setdefault(part, set()).add(name)
