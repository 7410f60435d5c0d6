"""Interrupts, triggers and cyclic reading of KRL, which assign variables at unknown times."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from calibtool.programs.motions import Assign, Begin, Call, Edited, End, Jump, Routine
from calibtool.programs.motions import Statement as Step
from calibtool.robot.orientation import TURNED_ANGLES


@dataclass(frozen=True, slots=True, eq=False)
class Started:
    """An instruction after which something may happen at any time.

    routine, place  its routine, and the step before which it stands
    line, word      its line, and its kind: `TRIGGER`, `ANIN ON`, `INTERRUPT ON`, or `INTERRUPT
                    DECL`, which only declares
    number          of the interrupt; "" for all
    steps           what happens; for `INTERRUPT ON` what is declared for the number
    """

    routine: str
    place: int
    line: int
    word: str
    number: str = ""
    steps: tuple[Step, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Change:
    """What a start may do to variables.

    inside       routines that only run then: nothing changes their own variables
    assignments  the assignment of an unknown value, for each variable
    """

    start: Started
    inside: frozenset[str]
    assignments: Mapping[str, Assign]


def uncertain(routines: Sequence[Routine], starts: Sequence[Started]) -> list[Routine]:
    """The routines, with variables unknown from the point on where something else may change them.

    An assignment makes such a variable known only if it is executed before that point.
    """
    bodies = {routine.name: routine.body for routine in routines}
    declared = [start for start in starts if start.word == "INTERRUPT DECL"]
    changes: list[_Change] = []
    for start in starts:
        if start.word == "INTERRUPT DECL":
            continue
        steps = start.steps + tuple(
            step
            for one in declared
            if start.word == "INTERRUPT ON" and _same(one.number, start.number)
            for step in one.steps
        )
        inside: set[str] = set()
        names = dict.fromkeys(_assigned(steps, bodies, inside))
        why = f"may be changed at any time ({start.word} in line {start.line})"
        assignments = {
            n: Assign(start.line, n, Edited(n, (), TURNED_ANGLES, start.line, why)) for n in names
        }
        changes.append(_Change(start, frozenset(inside), assignments))
    return [replace(one, body=tuple(_body(one, changes))) for one in routines]


def _same(declared: str, number: str) -> bool:
    known = declared.isdecimal() and number.isdecimal()
    return not known or int(declared) == int(number)


def _assigned(
    steps: Iterable[Step], bodies: Mapping[str, tuple[Step, ...]], inside: set[str]
) -> Iterator[str]:
    """Names of variables that steps assign. Routines that the steps call are added to `inside`."""
    for step in steps:
        if isinstance(step, Assign):
            yield step.name
        elif isinstance(step, Call) and step.routine in bodies and step.routine not in inside:
            inside.add(step.routine)
            yield from _assigned(bodies[step.routine], bodies, inside)


def _body(routine: Routine, changes: Iterable[_Change]) -> Iterator[Step]:
    """The steps of a routine; a variable is unknown from a start on, and after assignments."""
    straight = not any(isinstance(step, Jump) for step in routine.body)
    here: dict[int, list[Assign]] = {}  # at which step something starts
    after: dict[str, tuple[int, Assign]] = {}  # from which step on assignments are followed by it
    for change in (one for one in changes if routine.name not in one.inside):
        own = change.start.routine == routine.name
        if own:
            here.setdefault(change.start.place, []).extend(change.assignments.values())
        for name, assignment in change.assignments.items():
            known = change.start.place if own and straight else 0
            if name not in after or known < after[name][0]:
                after[name] = known, assignment
    blocks: list[bool] = []  # that are open: whether they are loops
    for k, step in enumerate(routine.body):
        yield from here.get(k, ())
        yield step
        if isinstance(step, Begin):
            blocks.append(step.loop)
        elif isinstance(step, End) and blocks:
            blocks.pop()
        elif isinstance(step, Assign) and step.name in after:
            known, assignment = after[step.name]
            if k >= known or any(blocks):
                yield assignment
    yield from here.get(len(routine.body), ())
