"""Where the motions of a program go: routines are followed with everything that their variables can hold.

At every place a variable holds a set of values: after a selection those of all its branches, in a loop those of all
rounds, in a routine those of all its calls. Where the robot stands is such a variable too, so that every motion knows
from which others the robot comes.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache

from calibtool.programs.control import Action, Block, blocks
from calibtool.programs.frames import Frames
from calibtool.programs.motions import (
    Aim,
    Assign,
    Call,
    Edited,
    Either,
    Entry,
    Frame,
    Move,
    Program,
    Routine,
    Setting,
    Unknown,
    Value,
)
from calibtool.programs.targets import Remark
from calibtool.programs.values import Atom, Atoms, Evaluation, joined

_STANDS = ""  # the variable that holds at which uses the robot stands
_NOWHERE = -1  # among them: or somewhere that nobody knows
_ROUNDS = 4  # of a program whose variables keep their values
_BEFORE = 8  # uses from which the branch of a position is looked for
_WORK = 5_000_000  # blocks times variables: beyond it a variable holds all its values everywhere
_EMPTY: Atoms = frozenset([Unknown("a variable that no file gives a value")])

_State = dict[str, Atoms]


@dataclass(frozen=True, slots=True, eq=False)
class Use:
    """A literal as the target of a motion.

    literal        its number in the program
    line, motion   where, and the instruction; 0 and "" for a literal that no motion goes to
    frames, tools  what they can be
    obeyed         whether its configuration data are obeyed there; None where it depends
    near           literals that choose the branch in place of where the robot stands
    before         uses from which the robot comes; sure: it can come from nowhere else
    relative       the robot only goes near it, see `Aim`
    """

    literal: int
    line: int
    motion: str
    frames: frozenset[Frame | Unknown]
    tools: frozenset[Frame | Unknown]
    obeyed: bool | None
    near: tuple[int, ...]
    before: tuple[int, ...]
    sure: bool
    relative: bool


@dataclass(frozen=True, eq=False)
class Flow:
    """What `follow` found.

    uses     in the order in which routines are followed: callees before those that call them
    spoiled  literals that are no constants, and why
    seeds    literals that choose the branch of others
    frames   literals that are frames or tools
    remarks  motions that go to nothing written
    """

    uses: tuple[Use, ...]
    spoiled: dict[int, str]
    seeds: frozenset[int]
    frames: frozenset[int]
    remarks: tuple[Remark, ...]


def follow(program: Program, given: Frames) -> Flow:
    """Follow all routines. given: frames and tools by name, which win over those that the program declares."""
    kept: _State = {}
    for _ in range(_ROUNDS):
        analysis = _Analysis(program, given, kept)
        after = analysis.run()
        more = {name: joined(analysis.begin(name), atoms) for name, atoms in after.items()}
        if not program.persistent or all(more[name] == analysis.begin(name) for name in more):
            return analysis.flow()
        kept |= more
    unsettled = frozenset([Unknown("changes from one run of the program to the next")])
    analysis = _Analysis(program, given, dict.fromkeys(kept, unsettled))
    analysis.run()
    return analysis.flow()


@dataclass(slots=True, eq=False)
class _Node:
    """What an aim can be, a literal or a parameter, with what was found of it so far."""

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
class _Summary:
    """What a routine leaves in variables, and what it calls with what in those that the callee asks for."""

    after: _State = field(default_factory=dict)
    asked: set[str] = field(default_factory=set)
    calls: dict[int, tuple[str, _State]] = field(default_factory=dict)


class _Analysis:
    """One pass over all routines. kept: what variables may hold at the beginning beside what is declared."""

    def __init__(self, program: Program, given: Frames, kept: _State) -> None:
        self.program = program
        self.routines = {routine.name: routine for routine in program.routines}
        self.graphs = {routine.name: blocks(routine.body) for routine in program.routines}
        self.kept = kept
        self.assigned = self._assigned()
        self.evaluation = Evaluation(program.literals, given, self.owners)
        self.constants: dict[str, Atoms | None] = {}
        self.nodes: list[_Node] = []
        self.numbers: dict[tuple[int, int | Entry | Edited], int] = {}
        self.remarks: dict[tuple[int, str], Remark] = {}
        self.summaries: dict[str, _Summary] = {}
        self.order = _callees_first(self.graphs)
        self.recursive: dict[str, int] = {}  # routines that call one that is not ended, and where
        self.called = {name for graph in self.graphs.values() for name in _called(graph)}

    # --- variables ----------------------------------------------------------------------------------------------------

    def _assigned(self) -> dict[str, list[Value]]:
        """What is assigned to variables somewhere, without those that hold one literal all the time."""
        found: dict[str, list[Value]] = {}
        parameters: set[str] = set()
        self.owners: dict[int, set[str]] = {}
        for name, value in self.program.declared.items():
            _own(self.owners, name, value)
        size = 0
        for graph in self.graphs.values():
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
        """What a variable holds where the program begins, all the time if nothing is assigned to it."""
        known = self.constants.get(name, frozenset())
        if known:
            return known
        if name == _STANDS:
            return frozenset([_NOWHERE])
        if known is None:
            return frozenset([Unknown("is made of itself")])
        self.constants[name] = None
        result = self.kept.get(name, frozenset())
        for value in self.fixed.get(name) or self._declared(name):
            result = joined(result, self.evaluation.atoms(value, self.begin))
        self.constants[name] = result = result or _EMPTY
        return result

    # --- routines ----------------------------------------------------------------------------------------------------

    def run(self) -> _State:
        """Follow every routine, callees first: what variables hold when those that nobody calls have ended.

        Where a routine calls itself, what it leaves is at first that of its ways without such a call, and then grows.
        """
        for _ in range(_ROUNDS):
            before = {name: summary.after for name, summary in self.summaries.items()}
            for name in self.order:
                self.summaries[name] = self._routine(self.routines[name], name not in self.called)
            after = {name: summary.after for name, summary in self.summaries.items()}
            if not self.recursive or after == before:
                break
        else:
            for name in self.recursive:
                unsettled = frozenset(
                    [Unknown(f"is assigned by {_said(name)}, which calls itself")]
                )
                self.summaries[name].after |= dict.fromkeys(self.assigned, unsettled)
        end: _State = {}
        for name in self.order:
            for variable, atoms in self.summaries[name].after.items():
                if variable != _STANDS and name not in self.called:
                    end[variable] = joined(end.get(variable, frozenset()), atoms)
        return end

    def _routine(self, routine: Routine, root: bool) -> _Summary:
        summary = _Summary()

        def entry(name: str) -> Atoms:
            if root or (name not in self.assigned and name != _STANDS):
                return self.begin(name)
            summary.asked.add(name)
            return frozenset([Entry(name)])

        graph = self.graphs[routine.name]
        states: list[_State | None] = [None] * len(graph)
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
                    if _merge(states, following, state, entry):
                        waiting.add(following)
        if states[-1] is None and routine.name in self.recursive:
            line = self.recursive[routine.name]
            self._remark(line, _said(routine.name), "calls itself without end", routine, bad=True)
        summary.after = states[-1] or {}
        return summary

    def _act(
        self,
        action: Action,
        state: _State,
        entry: Callable[[str], Atoms],
        routine: Routine,
        summary: _Summary,
    ) -> bool:
        """Take an action in; whether the routine goes on behind it."""

        def variable(name: str) -> Atoms:
            return state[name] if name in state else entry(name)

        if isinstance(action, Move):
            for aim in action.aims:
                state[_STANDS] = self._aim(action, aim, variable, routine)
        elif isinstance(action, Assign):
            if action.name in self.assigned:
                state[action.name] = self.evaluation.atoms(action.value, variable)
        elif action.routine in self.summaries:
            callee = self.summaries[action.routine]
            given = {name: self.evaluation.atoms(v, variable) for name, v in action.arguments}
            asked = {name: given.get(name) or variable(name) for name in sorted(callee.asked)}
            _, before = summary.calls.get(id(action), ("", {}))
            found = {n: joined(atoms, before.get(n, frozenset())) for n, atoms in asked.items()}
            summary.calls[id(action)] = action.routine, found
            for name, atoms in callee.after.items():
                state[name] = self.evaluation.entered(atoms, asked.__getitem__)
        elif action.routine in self.routines:
            self.recursive.setdefault(routine.name, action.line)
            return False
        return True

    def _aim(
        self, move: Move, aim: Aim, variable: Callable[[str], Atoms], routine: Routine
    ) -> Atoms:
        """Note what a motion goes to; where the robot stands then."""
        before, reached, unknown = variable(_STANDS), set[Atom](), False
        for atom in self.evaluation.atoms(aim.value, variable):
            if not isinstance(atom, int | Entry | Edited):
                unknown = True
                self.evaluation.copy_moved_to(atom)
                if not (isinstance(atom, Unknown) and atom.quiet):
                    why = atom.why if isinstance(atom, Unknown) else "is no position"
                    self._remark(move.line, move.name, why, routine)
                continue
            number = self.numbers.setdefault((id(aim), atom), len(self.nodes))
            if number == len(self.nodes):
                self.nodes.append(_Node(aim, move, routine, atom))
            node = self.nodes[number]
            for name, value in (("frames", aim.frame), ("tools", aim.tool), ("obeyed", aim.obeyed)):
                found = self.evaluation.atoms(value, variable)
                setattr(node, name, joined(getattr(node, name), found))
            if aim.near is not None:
                node.near |= self.evaluation.atoms(aim.near, variable)
            node.before = joined(node.before, before)
            reached.add(number)
        if aim.relative:
            self._remark(move.line, move.name, aim.relative, routine)
        return frozenset(reached | before | {_NOWHERE}) if unknown else frozenset(reached)

    def _remark(self, line: int, name: str, why: str, routine: Routine, bad: bool = False) -> None:
        remark = Remark(line, name, why, bad, routine.source)
        self.remarks.setdefault((line, f"{routine.source} {name} {why}"), remark)

    # --- what the calls put in ---------------------------------------------------------------------------------------

    def flow(self) -> Flow:
        """Uses with the values of the routines' calls put in, and literals that no motion goes to."""
        entries: dict[str, _State] = {name: {} for name in self.order}
        for name in reversed(self.order):
            at_entry = self._entered(entries[name])
            for callee, asked in self.summaries[name].calls.values():
                for variable, atoms in asked.items():
                    found = self.evaluation.entered(atoms, at_entry)
                    held = entries[callee].get(variable, frozenset())
                    entries[callee][variable] = joined(held, found)
        found_at: list[list[int]] = []
        result: list[Use] = []
        came: list[Atoms] = []
        for node in self.nodes:
            at_entry = self._entered(entries[node.routine.name])
            found_at.append([])
            for atom in self.evaluation.entered(frozenset([node.atom]), at_entry):
                if isinstance(atom, int):
                    found_at[-1].append(len(result))
                    result.append(self._use(node, atom, at_entry))
                    came.append(self.evaluation.entered(node.before, at_entry))
                elif isinstance(atom, Unknown) and not atom.quiet:
                    self.evaluation.copy_moved_to(atom)
                    self._remark(node.move.line, node.move.name, atom.why, node.routine)
        self.nodes.clear()
        for k, use in enumerate(result):
            before, sure = _before(came[k], found_at)
            result[k] = replace(use, before=before, sure=sure)
        seeds = frozenset(k for use in result for k in use.near)
        frames = frozenset(self.evaluation.frames)
        used = {use.literal for use in result} | seeds | frames
        result += self._alone(used, len(result))
        return Flow(
            tuple(result), self.evaluation.spoiled, seeds, frames, tuple(self.remarks.values())
        )

    def _entered(self, entry: _State) -> Callable[[str], Atoms]:
        return lambda name: entry.get(name) or self.begin(name)

    def _use(self, node: _Node, literal: int, at_entry: Callable[[str], Atoms]) -> Use:
        frames, tools, obeyed, near = (
            self.evaluation.entered(atoms, at_entry)
            for atoms in (node.frames, node.tools, node.obeyed, node.near)
        )
        relative = bool(node.aim.relative)
        line, motion = node.move.line, node.move.name
        return Use(
            literal, line, motion, _frames(frames), _frames(tools), _agreed(obeyed),
            tuple(sorted(k for k in near if isinstance(k, int))), (), False, relative,
        )  # fmt: skip

    def _alone(self, used: Iterable[int], count: int) -> Iterable[Use]:
        """Literals that no motion goes to, in the order of the text, as far as something is known of them."""
        before: tuple[int, ...] = ()
        for number, literal in enumerate(self.program.literals):
            if number in used or literal.alone is None:
                continue
            frames, tools, obeyed = (
                self.evaluation.atoms(value, self.begin)
                for value in (literal.alone.frame, literal.alone.tool, literal.alone.obeyed)
            )
            yield Use(
                number, 0, "", _frames(frames), _frames(tools), _agreed(obeyed), (), before, False, False
            )  # fmt: skip
            before = (count,)
            count += 1


def _before(atoms: Atoms, found_at: list[list[int]]) -> tuple[tuple[int, ...], bool]:
    numbers = [k for k in atoms if isinstance(k, int) and k != _NOWHERE]
    uses = sorted(use for k in numbers for use in found_at[k])
    sure = len(numbers) == len(atoms) and all(found_at[k] for k in numbers)
    return tuple(uses[:_BEFORE]), sure and len(uses) <= _BEFORE


@lru_cache(maxsize=1000)
def _frames(atoms: Atoms) -> frozenset[Frame | Unknown]:
    return frozenset(
        atom if isinstance(atom, Frame | Unknown) else Unknown("is no frame") for atom in atoms
    )


def _agreed(atoms: Atoms) -> bool | None:
    found = {atom.on if isinstance(atom, Setting) else None for atom in atoms}
    return next(iter(found)) if len(found) == 1 else None


def _own(owners: dict[int, set[str]], name: str, value: Value) -> None:
    """Note that a variable holds literals themselves."""
    for part in value.parts if isinstance(value, Either) else (value,):
        if isinstance(part, int):
            owners.setdefault(part, set()).add(name)


def _merge(
    states: list[_State | None], number: int, state: _State, entry: Callable[[str], Atoms]
) -> bool:
    """Add a state to what may hold where a block begins; whether that changed it."""
    old = states[number]
    if old is None:
        states[number] = dict(state)
        return True
    changed = False
    for name, there in state.items():
        here = old.get(name)
        if here is there:
            continue
        both = joined(entry(name) if here is None else here, there)
        changed = changed or here is None or both != here
        old[name] = both
    for name in old.keys() - state.keys():
        both = joined(old[name], entry(name))
        changed = changed or both != old[name]
        old[name] = both
    return changed


def _said(name: str) -> str:
    """How a routine is called in messages, without the names of its module and text."""
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
