"""The routines of a program, followed with all possible values of their variables."""

from collections.abc import Callable
from dataclasses import dataclass, field

from calibtool.programs.control_flow import Action, Block, blocks
from calibtool.programs.frames import NamedFrames
from calibtool.programs.motions import (
    Aim,
    Assign,
    Call,
    Edited,
    Entry,
    Move,
    Program,
    Routine,
    Unknown,
)
from calibtool.programs.numbers import Remark
from calibtool.programs.values import Atom, Atoms, joined
from calibtool.programs.variables import NOWHERE, ROBOT_AT, State, Variables

# Number of passes in which the effects of recursive routines must settle; else they are unknown
ROUNDS = 4


@dataclass(slots=True, eq=False)
class Node:
    """A possible target of an aim, a literal or a parameter, with what is known of it so far."""

    aim: Aim
    move: Move
    routine: Routine
    atom: int | Entry | Edited
    frames: Atoms = frozenset()
    tools: Atoms = frozenset()
    obeyed: Atoms = frozenset()
    near: Atoms = frozenset()
    before: Atoms = frozenset()


@dataclass(eq=False)
class Summary:
    """Values of variables after a routine, names of the variables that it reads, and its calls with
    the values that these read.
    """

    after: State = field(default_factory=dict)
    reads: set[str] = field(default_factory=set)
    calls: dict[int, tuple[str, State]] = field(default_factory=dict)


class Routines:
    """One pass over all routines. kept: as in `Variables`.

    nodes      targets of motions
    summaries  of the routines, called ones before those that call them
    remarks    motions to targets that are not written, and errors
    edited     literals to which motions go with other components
    """

    def __init__(self, program: Program, given: NamedFrames, kept: State) -> None:
        self.routines = {routine.name: routine for routine in program.routines}
        self.graphs = {routine.name: blocks(routine.body) for routine in program.routines}
        self.variables = Variables(program, self.graphs.values(), given, kept)
        self.nodes: list[Node] = []
        self.summaries: dict[str, Summary] = {}
        self.remarks: dict[tuple[int, str], Remark] = {}
        self.edited: set[int] = set()
        self.order = _callees_first(self.graphs)
        self._numbers: dict[tuple[int, int | Entry | Edited], int] = {}
        self._recursive: dict[str, int] = {}  # routines that call one that is not ended, and where
        self._called = {name for graph in self.graphs.values() for name in _called(graph)}

    def run(self) -> State:
        """Follow every routine, called ones first; returns the values of variables after all that
        nobody calls.

        For a routine that calls itself, only its paths without such a call count at first; then the
        result grows.
        """
        for _ in range(ROUNDS):
            before = {name: summary.after for name, summary in self.summaries.items()}
            for name in self.order:
                self.summaries[name] = self._routine(self.routines[name], name not in self._called)
            after = {name: summary.after for name, summary in self.summaries.items()}
            if not self._recursive or after == before:
                break
        else:
            for name in self._recursive:
                unsettled = frozenset(
                    [Unknown(f"is assigned by {_plain(name)}, which calls itself")]
                )
                self.summaries[name].after |= dict.fromkeys(self.variables.assigned, unsettled)
        end: State = {}
        for name in self.order:
            for variable, atoms in self.summaries[name].after.items():
                if variable != ROBOT_AT and name not in self._called:
                    end[variable] = self.variables.joined(
                        variable, end.get(variable, frozenset()), atoms
                    )
        return end

    def _routine(self, routine: Routine, root: bool) -> Summary:
        summary = Summary()

        def entry(name: str) -> Atoms:
            if root or (name not in self.variables.assigned and name != ROBOT_AT):
                return self.variables.begin(name)
            summary.reads.add(name)
            return frozenset([Entry(name)])

        graph = self.graphs[routine.name]
        states: list[State | None] = [None] * len(graph)
        states[0] = {}
        waiting = {0}
        while waiting:
            for number in sorted(waiting):
                waiting.discard(number)
                state = dict(states[number] or {})
                returns = [
                    self._act(action, state, entry, routine, summary)
                    for action in graph[number].actions
                ]
                for following in graph[number].next if all(returns) else ():
                    if self._merge(states, following, state, entry):
                        waiting.add(following)
        if states[-1] is None and routine.name in self._recursive:
            line = self._recursive[routine.name]
            self.remark(line, _plain(routine.name), "calls itself without end", routine, bad=True)
        summary.after = states[-1] or {}
        return summary

    def _merge(
        self,
        states: list[State | None],
        number: int,
        state: State,
        entry: Callable[[str], Atoms],
    ) -> bool:
        """Add a state to the values at the beginning of a block; returns whether they changed."""
        old = states[number]
        if old is None:
            states[number] = dict(state)
            return True
        changed = False
        for name, there in state.items():
            here = old.get(name)
            if here is there:
                continue
            both = self.variables.joined(name, entry(name) if here is None else here, there)
            changed = changed or here is None or both != here
            old[name] = both
        for name in old.keys() - state.keys():
            both = self.variables.joined(name, old[name], entry(name))
            changed = changed or both != old[name]
            old[name] = both
        return changed

    def _act(
        self,
        action: Action,
        state: State,
        entry: Callable[[str], Atoms],
        routine: Routine,
        summary: Summary,
    ) -> bool:
        """Execute an action; returns whether the routine continues after it."""

        def variable(name: str) -> Atoms:
            return state[name] if name in state else entry(name)

        if isinstance(action, Move):
            for aim in action.aims:
                state[ROBOT_AT] = self._aim(action, aim, variable, routine)
        elif isinstance(action, Assign):
            if action.name in self.variables.assigned:
                state[action.name] = self.variables.evaluation.atoms(action.value, variable)
        elif action.routine in self.summaries:
            callee = self.summaries[action.routine]
            given = {
                name: self.variables.evaluation.atoms(v, variable) for name, v in action.arguments
            }
            reads = {name: given.get(name) or variable(name) for name in sorted(callee.reads)}
            _, before = summary.calls.get(id(action), ("", {}))
            found = {
                n: self.variables.joined(n, a, before.get(n, frozenset())) for n, a in reads.items()
            }
            summary.calls[id(action)] = action.routine, found
            for name, atoms in callee.after.items():
                state[name] = self.variables.evaluation.entered(atoms, reads.__getitem__)
        elif action.routine in self.routines:
            self._recursive.setdefault(routine.name, action.line)
            return False
        return True

    def _aim(
        self, move: Move, aim: Aim, variable: Callable[[str], Atoms], routine: Routine
    ) -> Atoms:
        """Note the target of a motion; returns the position of the robot afterwards."""
        before, reached, unknown = variable(ROBOT_AT), set[Atom](), False
        for atom in self.variables.evaluation.atoms(aim.value, variable):
            if not isinstance(atom, int | Entry | Edited):
                unknown = True
                if isinstance(atom, Unknown):
                    self.nowhere(atom, move, routine)
                else:
                    self.remark(move.line, move.name, "is no position", routine)
                continue
            number = self._numbers.setdefault((id(aim), atom), len(self.nodes))
            if number == len(self.nodes):
                self.nodes.append(Node(aim, move, routine, atom))
            node = self.nodes[number]
            for name, value in (("frames", aim.frame), ("tools", aim.tool), ("obeyed", aim.obeyed)):
                found = self.variables.evaluation.atoms(value, variable)
                setattr(node, name, joined(getattr(node, name), found))
            if aim.near is not None:
                node.near |= self.variables.evaluation.atoms(aim.near, variable)
            node.before = self.variables.joined(ROBOT_AT, node.before, before)
            reached.add(number)
        if aim.relative:
            self.remark(move.line, move.name, aim.relative, routine)
        after = frozenset(reached | before | {NOWHERE} if unknown else reached)
        return self.variables.joined(ROBOT_AT, after, after)

    def nowhere(self, unknown: Unknown, move: Move, routine: Routine) -> None:
        """Note a motion to an unknown target; an edited copy makes its literal no constant."""
        if not unknown.quiet:
            self.remark(move.line, move.name, unknown.why, routine)
        if unknown.edited is not None:
            self.edited.add(unknown.edited)
            why = f"serves two places: of a copy, {unknown.why}"
            self.variables.evaluation.spoiled.setdefault(unknown.edited, why)

    def remark(self, line: int, name: str, why: str, routine: Routine, bad: bool = False) -> None:
        """Keep a remark on a motion or routine, once."""
        remark = Remark(line, name, why, bad, routine.source)
        self.remarks.setdefault((line, f"{routine.source} {name} {why}"), remark)


def _plain(name: str) -> str:
    """The name of a routine in messages, without its module and text."""
    return name.rpartition("|")[2]


def _called(graph: list[Block]) -> set[str]:
    return {a.routine for block in graph for a in block.actions if isinstance(a, Call)}


def _callees_first(graphs: dict[str, list[Block]]) -> list[str]:
    """Names of all routines, each after those that it calls, where none calls itself."""
    order: list[str] = []
    seen: set[str] = set()
    for root in graphs:
        stack = [(root, iter(sorted(_called(graphs[root]))))] if root not in seen else []
        seen.add(root)
        while stack:
            callee = next((c for c in stack[-1][1] if c in graphs and c not in seen), None)
            if callee is None:
                order.append(stack.pop()[0])
            else:
                seen.add(callee)
                stack.append((callee, iter(sorted(_called(graphs[callee])))))
    return order
