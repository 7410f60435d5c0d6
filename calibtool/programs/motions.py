"""The common form of programs: the positions written in them, and routines with motions in order of
execution.

The module of a language makes these objects from text, and `motion_flow` follows them. No other
module depends on the language.

Positions, frames, tools and settings are values: a literal's number, the name of a variable, or one
of the classes below. The language makes the name of each variable unique. The value of a variable
at a motion is found by following the routines. A language therefore reports assignments at their
place and does not need to know which values are in force.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calibtool.programs.configurations import Configuration
from calibtool.programs.numbers import Number, Numbers, Remark
from calibtool.robot.se3 import Array, readonly

JOINT, POSE = "joint", "pose"
# Why such a pose is not corrected, unless external axes may be ignored
EXTERNAL = "external axes beside a pose"
FRAME, TOOL = "frame", "tool"


@dataclass(frozen=True, slots=True)
class ProgramText:
    """A text of the program, Latin-1 so that every byte is one character.

    edited  whether it is corrected; other texts only define frames and positions
    """

    name: str
    text: str
    edited: bool = True


# --- values ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Frame:
    """T_base_frame or T_flange_tool (4, 4) in m, row by row; None where the program does not define
    it.

    kind  FRAME or TOOL
    name  its name in `--frames`: "" is the robot's base or flange, None where the program does not
          name it
    line  where the program sets it, 0 for values from the start
    """

    kind: str
    name: str | None
    values: tuple[float, ...] | None = None
    line: int = 0

    @property
    def T(self) -> Array:
        """The pose (4, 4); only where `values` are given."""
        return readonly(np.reshape(np.array(self.values, dtype=float), (4, 4)))


@dataclass(frozen=True, slots=True)
class Unknown:
    """A value that the text does not define, and why, with the line: `read from the robot (line
    7)`.

    quiet   a motion to it is not listed, because the problem is listed at its literal
    edited  the literal of which it is the value, or a copy, with other components
    """

    why: str
    quiet: bool = False
    edited: int | None = None


@dataclass(frozen=True, slots=True)
class Setting:
    """A switch of the controller."""

    on: bool


@dataclass(frozen=True, slots=True)
class Product:
    """Frames in each other, T_1 T_2 …, or one alone; one of them may be a written pose.

    name: the name of the whole in `--frames`, if it has one.
    """

    kind: str
    parts: tuple["Value", ...]
    name: str | None = None


@dataclass(frozen=True, slots=True)
class Either:
    """One of several values, such as an array's element whose index is not known."""

    parts: tuple["Value", ...]


@dataclass(frozen=True, slots=True)
class Edited:
    """A value of which some components are replaced, as by `$BASE.Z = -300`.

    components   index of the component in x, y, z and the orientation's numbers → its value in SI
                 units
    orientation  as in `Literal`
    line, why    the line, and the reason why such a literal is not constant
    """

    base: "Value"
    components: tuple[tuple[int, float], ...]
    orientation: str
    line: int
    why: str


@dataclass(frozen=True, slots=True)
class Entry:
    """The value of a variable at the beginning of the routine.

    Languages do not use it: `motion_flow` replaces it by the values of the calls.
    """

    name: str


Value = int | str | Frame | Unknown | Setting | Product | Either | Edited | Entry

BASE, FLANGE = Frame(FRAME, ""), Frame(TOOL, "")
ON, OFF = Setting(True), Setting(False)


# --- positions and motions ------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Literal:
    """A position as it is written.

    kind           JOINT or POSE
    numbers        joints in the robot's order; or x, y, z and the orientation; empty if it cannot
                   be corrected
    line, name     for messages: the line of its first number, from 1, and its name in the program
    orientation    of a pose, a convention of `rotation_matrices`
    configuration  data on the branch of a pose
    source         number of its text
    not_corrected  why it is not corrected: not taught, an expression among its numbers, external
                   axes; bad: this is an error of the program
    external       for a pose: external axes that are joints of the chain, joint from 0 and number
    blank          its numbers are those of a position that nobody taught; it counts as taught if
                   the robot can be there
    moved_to       a motion goes there by an expression that is not followed
    alone          its value where no motion goes to it, with the literal's number; None: unknown
    """

    kind: str
    numbers: Sequence[Number]
    line: int
    name: str
    orientation: str = ""
    configuration: Configuration | None = None
    source: int = 0
    not_corrected: str = ""
    bad: bool = False
    blank: bool = False
    moved_to: bool = False
    alone: "Aim | None" = None
    external: tuple[tuple[int, Number], ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.numbers, Numbers):
            object.__setattr__(self, "numbers", Numbers(self.numbers))

    @property
    def values(self) -> tuple[float, ...]:
        """The numbers in SI units."""
        assert isinstance(self.numbers, Numbers)
        return self.numbers.values


@dataclass(frozen=True, slots=True)
class Aim:
    """One target point of a motion.

    value        the position: a literal, a variable, or Unknown
    frame, tool  of a pose
    obeyed       whether the controller goes to the branch of the configuration data, or stays near
                 the previous position; a Setting or the name of a variable that holds one
    near         joints that choose the branch instead, such as a start of the controller's inverse
                 kinematics
    relative     why the robot goes not to the position itself but near it, such as by an offset;
                 the position has this frame and tool
    """

    value: Value
    frame: Value = BASE
    tool: Value = FLANGE
    obeyed: Value = ON
    near: Value | None = None
    relative: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """A motion through its aims in order; a circle has two. name: the instruction."""

    line: int
    name: str
    aims: tuple[Aim, ...]


@dataclass(frozen=True, slots=True)
class Assign:
    """From here on a variable has a value."""

    line: int
    name: str
    value: Value


@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """Another routine is executed. arguments: its parameters, which are variables, and their
    values.

    A routine that is not in the program is skipped.
    """

    line: int
    routine: str
    arguments: tuple[tuple[str, Value], ...] = ()


@dataclass(frozen=True, slots=True)
class Begin:
    """Begin of the first branch of a selection, or of a loop. once: there is at least one round."""

    loop: bool = False
    once: bool = False


@dataclass(frozen=True, slots=True)
class Else:
    """The next branch of a selection. last: one of the branches is always executed."""

    last: bool = False


@dataclass(frozen=True, slots=True)
class End:
    """A selection or loop ends."""


@dataclass(frozen=True, slots=True)
class Break:
    """The innermost loop is left."""


@dataclass(frozen=True, slots=True)
class Label:
    """A place to which a jump goes."""

    name: str


@dataclass(frozen=True, slots=True)
class Jump:
    """The program continues at a label, or may do so."""

    label: str
    always: bool = True


@dataclass(frozen=True, slots=True)
class Return:
    """The routine ends."""


Statement = Move | Assign | Call | Begin | Else | End | Break | Label | Jump | Return


@dataclass(frozen=True, slots=True, eq=False)
class Routine:
    """A routine by its unique name, in the text with the number `source`."""

    name: str
    body: tuple[Statement, ...]
    source: int = 0


@dataclass(frozen=True, eq=False)
class Program:
    """A program, of one text or several.

    literals    every position written in it; its index here is its number
    declared    values of variables from the start
    remarks     other things that are not corrected, and errors
    notes       further notes for the summary
    persistent  variables keep their values when a routine is started again
    in_order    the text is the order of motion, without calls, loops and variables: backlash can be
                corrected
    unused      why a literal is not corrected to which no motion goes and that has no `alone`
    """

    sources: tuple[ProgramText, ...]
    literals: tuple[Literal, ...] = ()
    routines: tuple[Routine, ...] = ()
    declared: dict[str, Value] = field(default_factory=dict)
    remarks: tuple[Remark, ...] = ()
    notes: tuple[str, ...] = ()
    persistent: bool = False
    in_order: bool = False
    unused: str = "no motion of the program goes there: its frame and tool are not known"


def frame_of(kind: str, name: str | None, T: Array, line: int = 0) -> Frame:
    """A Frame of a pose (4, 4)."""
    return Frame(kind, name, tuple(float(x) for x in np.asarray(T).ravel()), line)
