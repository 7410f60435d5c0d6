"""Frame and tool on which all uses of a position agree, or the reason why it is not corrected."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from calibtool.programs.motion_flow import Circle, Flow, Use
from calibtool.programs.motions import FRAME, JOINT, Frame, Program, Unknown

SEED = "only a start of the controller's inverse kinematics"
AS_FRAME = "a frame or tool of others"
_ROUNDING = 1e-9  # m: frames that differ by less are the same, computed in two ways
_LINES = 5  # number of lines named in one reason


@dataclass(frozen=True, eq=False, slots=True)
class Position:
    """A literal that can be corrected: number, uses, and the frame and tool of a pose."""

    literal: int
    uses: tuple[int, ...]
    frame: Frame | None = None
    tool: Frame | None = None


def positions(program: Program, flow: Flow) -> tuple[list[Position], dict[int, str]]:
    """Positions that are corrected, in the order of the literals; reasons for the others."""
    uses: list[list[int]] = [[] for _ in program.literals]
    for number, use in enumerate(flow.uses):
        uses[use.literal].append(number)
    found: list[Position] = []
    reasons: dict[int, str] = {}
    for number, literal in enumerate(program.literals):
        here = [flow.uses[k] for k in uses[number]]
        if literal.not_corrected:
            reasons[number] = literal.not_corrected
        elif number in flow.spoiled:
            reasons[number] = flow.spoiled[number]
        elif number in flow.frames:
            reasons[number] = AS_FRAME
        elif not here:
            reasons[number] = SEED if number in flow.seeds else program.unused
        elif literal.kind == JOINT:
            found.append(Position(number, tuple(uses[number])))
        else:
            frame, tool = (agreed(which, here) for which in ("frame", "tool"))
            if isinstance(frame, Frame) and isinstance(tool, Frame):
                found.append(Position(number, tuple(uses[number]), frame, tool))
            else:
                reasons[number] = next(why for why in (frame, tool) if isinstance(why, str))
    return found, reasons


def half_circles(circles: Sequence[Circle], corrected: Iterable[int]) -> dict[int, str]:
    """Literals that must not be corrected because the other point of their circle is not.

    Correcting only one of the two points would change the radius.
    """
    rest, reasons = set(corrected), dict[int, str]()
    while True:
        more = {
            literal: f"the other point of its circle is not corrected (line {line})"
            for line, *points in circles
            for here, there in (points, points[::-1])
            if not there & rest
            for literal in here & rest
        }
        if not more:
            return reasons
        reasons |= more
        rest -= more.keys()


def agreed(which: str, uses: Iterable[Use]) -> Frame | str:
    """The frame or tool of all uses, or why there is not one."""
    uses = list(uses)
    several = False
    set_anew: set[int] = set()
    result: Frame | None = None
    for use in uses:
        for atom in sorted(use.frames if which == FRAME else use.tools, key=str):
            if isinstance(atom, Unknown):
                return f"its {which}: {atom.why}"
            if atom.values is None:
                return _not_given(atom)
            set_anew.add(atom.line)
            result = result or atom
            several = several or not same_values(result, atom)
    if several:
        anew = f"; set in {_places(set_anew - {0})}" if set_anew - {0} else ""
        return f"used with several {which}s ({_places({use.line for use in uses})}{anew})"
    assert result is not None
    return result


def same_values(one: Frame, other: Frame) -> bool:
    """Whether two frames are equal up to rounding."""
    pairs = zip(one.values or (), other.values or (), strict=True)
    return one.values == other.values or all(abs(a - b) < _ROUNDING for a, b in pairs)


def _places(lines: set[int]) -> str:
    where = sorted(lines)
    more = " …" if len(where) > _LINES else ""
    return f"line{'s' if len(where) > 1 else ''} {', '.join(map(str, where[:_LINES]))}{more}"


def _not_given(frame: Frame) -> str:
    kind, name = frame.kind, frame.name
    if name is None:
        what, key = f"the program does not state its {kind}", "default"
    else:
        what, key = f"{kind} '{name}' is not known", name
    return f"{what}; give it with --frames, [{kind}s.{key}]"
