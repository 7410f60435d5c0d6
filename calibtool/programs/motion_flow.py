"""Uses of positions by motions: routines are followed with all possible values of their variables.

At every place a variable has a set of values: after a branch those of all alternatives, in a loop
those of all rounds, in a routine those of all calls. The position of the robot is such a variable,
too, so that the possible predecessors of every motion are known.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

from calibtool.programs.frames import NamedFrames
from calibtool.programs.motions import Frame, Program, Setting, Unknown
from calibtool.programs.numbers import Remark
from calibtool.programs.routines import ROUNDS, Node, Routines
from calibtool.programs.values import Atoms
from calibtool.programs.variables import BEFORE, NOWHERE, State


@dataclass(frozen=True, slots=True, eq=False)
class Use:
    """A literal as the target of a motion.

    literal        its number in the program
    line, motion   its line and instruction; 0 and "" for a literal to which no motion goes
    frames, tools  their possible values
    obeyed         whether its configuration data are obeyed there; None where it depends
    near           literals that choose the branch instead of the position of the robot
    before         uses from which the robot may come; sure: there are no others
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


Circle = tuple[int, frozenset[int], frozenset[int]]


@dataclass(frozen=True, eq=False)
class Flow:
    """The result of `follow`.

    uses     in the order in which routines are followed: called ones before those that call them
    spoiled  literals whose value changes, and why
    edited   literals to which motions go with other components
    seeds    literals that choose the branch of others
    frames   literals that are frames or tools
    remarks  motions to targets that are not written in the program
    circles  line of each motion through two points, and the possible literals of both
    """

    uses: tuple[Use, ...]
    spoiled: dict[int, str]
    edited: frozenset[int]
    seeds: frozenset[int]
    frames: frozenset[int]
    remarks: tuple[Remark, ...]
    circles: tuple[Circle, ...] = ()


def follow(program: Program, given: NamedFrames) -> Flow:
    """Follow all routines. given: frames and tools by name, which override the program's."""
    kept: State = {}
    for _ in range(ROUNDS):
        routines = Routines(program, given, kept)
        after, variables = routines.run(), routines.variables
        more = {n: variables.joined(n, variables.begin(n), atoms) for n, atoms in after.items()}
        if not program.persistent or all(more[name] == variables.begin(name) for name in more):
            return _Uses(program, routines).flow()
        kept |= more
    unsettled = frozenset([Unknown("changes from one run of the program to the next")])
    routines = Routines(program, given, dict.fromkeys(kept, unsettled))
    routines.run()
    return _Uses(program, routines).flow()


class _Uses:
    """The values that the calls of routines give to the uses in them."""

    def __init__(self, program: Program, routines: Routines) -> None:
        self.program, self.routines, self.variables = program, routines, routines.variables

    def flow(self) -> Flow:
        """Uses with the values of the routines' calls, and literals to which no motion goes."""
        entries: dict[str, State] = {name: {} for name in self.routines.order}
        for name in reversed(self.routines.order):
            at_entry = self._entered(entries[name])
            for callee, values in self.routines.summaries[name].calls.values():
                for variable, atoms in values.items():
                    found = self.variables.evaluation.entered(atoms, at_entry)
                    held = entries[callee].get(variable, frozenset())
                    entries[callee][variable] = self.variables.joined(variable, held, found)
        found_at: list[list[int]] = []
        result: list[Use] = []
        came: list[Atoms] = []
        circles: dict[int, tuple[int, set[int], set[int]]] = {}
        for node in self.routines.nodes:
            at_entry = self._entered(entries[node.routine.name])
            found_at.append([])
            points: set[int] = set()
            if len(node.move.aims) == 2:
                circle = circles.setdefault(id(node.move), (node.move.line, set(), set()))
                points = circle[1] if node.aim is node.move.aims[0] else circle[2]
            for atom in self.variables.evaluation.entered(frozenset([node.atom]), at_entry):
                if isinstance(atom, int):
                    points.add(atom)
                    found_at[-1].append(len(result))
                    result.append(self._use(node, atom, at_entry))
                    came.append(self.variables.evaluation.entered(node.before, at_entry))
                elif isinstance(atom, Unknown):
                    self.routines.nowhere(atom, node.move, node.routine)
        self.routines.nodes.clear()
        for k, use in enumerate(result):
            before, sure = _before(came[k], found_at)
            came[k] = frozenset()  # 50,000 of them are 11 MB
            result[k] = replace(use, before=before, sure=sure)
        seeds = frozenset(k for use in result for k in use.near)
        frames = frozenset(self.variables.evaluation.frames)
        used = {use.literal for use in result} | seeds | frames
        result += self._alone(used, len(result))
        return Flow(
            tuple(result),
            self.variables.evaluation.spoiled,
            frozenset(self.routines.edited),
            seeds,
            frames,
            tuple(self.routines.remarks.values()),
            tuple((line, frozenset(a), frozenset(b)) for line, a, b in circles.values()),
        )

    def _entered(self, entry: State) -> Callable[[str], Atoms]:
        return lambda name: entry.get(name) or self.variables.begin(name)

    def _use(self, node: Node, literal: int, at_entry: Callable[[str], Atoms]) -> Use:
        frames, tools, obeyed, near = (
            self.variables.evaluation.entered(atoms, at_entry)
            for atoms in (node.frames, node.tools, node.obeyed, node.near)
        )
        relative = bool(node.aim.relative)
        line, motion = node.move.line, node.move.name
        return Use(
            literal, line, motion, _frames(frames), _frames(tools), _agreed(obeyed),
            tuple(sorted(k for k in near if isinstance(k, int))), (), False, relative,
        )  # fmt: skip

    def _alone(self, used: Iterable[int], count: int) -> Iterable[Use]:
        """Literals to which no motion goes, in order, if something is known of them."""
        before: tuple[int, ...] = ()
        for number, literal in enumerate(self.program.literals):
            if number in used or literal.alone is None:
                continue
            frames, tools, obeyed = (
                self.variables.evaluation.atoms(value, self.variables.begin)
                for value in (literal.alone.frame, literal.alone.tool, literal.alone.obeyed)
            )
            known = _frames(frames), _frames(tools), _agreed(obeyed)
            yield Use(number, 0, "", *known, (), before, False, False)
            before = (count,)
            count += 1


def _before(atoms: Atoms, found_at: list[list[int]]) -> tuple[tuple[int, ...], bool]:
    numbers = [k for k in atoms if isinstance(k, int) and k != NOWHERE]
    uses = sorted(use for k in numbers for use in found_at[k])
    sure = len(numbers) == len(atoms) and all(found_at[k] for k in numbers)
    return tuple(uses[:BEFORE]), sure and len(uses) <= BEFORE


@lru_cache(maxsize=1000)
def _frames(atoms: Atoms) -> frozenset[Frame | Unknown]:
    return frozenset(
        atom if isinstance(atom, Frame | Unknown) else Unknown("is no frame") for atom in atoms
    )


def _agreed(atoms: Atoms) -> bool | None:
    found = {atom.on if isinstance(atom, Setting) else None for atom in atoms}
    return next(iter(found)) if len(found) == 1 else None
