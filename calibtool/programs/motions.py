"""What a program is read as: the positions written in it, and routines of motions to them, in
order of execution.

A language module makes these from text; `flow` follows them, and nothing else knows how
a language looks.

Positions, frames, tools and settings are values: a literal's number, the name of a variable, or one
of the classes below. A variable's name is any text that the language makes unique; what it holds at
a motion is found by following the routines, so a language reports assignments where they stand and
does not ask what is in force.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calibtool.programs.configurations import Configuration
from calibtool.programs.numbers import Number, Numbers, Remark
from calibtool.robot.se3 import Array, readonly

JOINT, POSE = "joint", "pose"
EXTERNAL = "external axes beside a pose"  # why such a pose is left unless they may be ignored
FRAME, TOOL = "frame", "tool"


@dataclass(frozen=True, slots=True)
class ProgramText:
    """A text of the program, Latin-1 so that every byte is one character.

    edited  whether it is corrected; a text that is only looked up for frames and positions is not
    """

    name: str
    text: str
    edited: bool = True


# --- values ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Frame:
    """T_base_frame or T_flange_tool (4, 4) in m, row by row; None where the program
    does not give it.

    kind  FRAME or TOOL
    name  how `--frames` calls it: "" is the robot's base or flange, None where the program
          does not name it
    line  where the program sets it, 0 for what is there from the start
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
    """What the text does not tell, and why, with the line: `read from the robot (line 7)`.

    quiet   the motion to it need not be listed, because what is wrong is listed at its literal
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
    """Frames one in the other, T_1 T_2 …, or one alone; a pose that is written may be one of them.

    name: what `--frames` calls the whole, where it can
    """

    kind: str
    parts: tuple["Value", ...]
    name: str | None = None


@dataclass(frozen=True, slots=True)
class Either:
    """One of several values, as an array's element whose number is not known."""

    parts: tuple["Value", ...]


@dataclass(frozen=True, slots=True)
class Edited:
    """A value of which some components are exchanged, as `$BASE.Z = -300`.

    components   index of the component in x, y, z and the orientation's numbers → its
                 value in SI units
    orientation  as in `Literal`
    line, why    where, and the reason given for such a literal, which is then no constant
    """

    base: "Value"
    components: tuple[tuple[int, float], ...]
    orientation: str
    line: int
    why: str


@dataclass(frozen=True, slots=True)
class Entry:
    """What a variable holds when the routine begins.

    Not for languages: `motion_flow` fills in what the calls give.
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
    numbers        joints in the robot's order; or x, y, z and the orientation; empty if it
                   cannot be corrected
    line, name     for messages: the line of its first number, from 1, and how the program calls it
    orientation    of a pose, a convention of `rotation_matrices`
    configuration  data on the branch of a pose
    source         number of its text
    not_corrected  why it is no position to correct: not taught, an expression among its numbers,
                   external axes; bad: this is an error of the program
    external       beside a pose, external axes that are joints of the chain: joint
                   from 0 and number
    blank          its numbers are those of a position that nobody taught; it is one if the
                   robot cannot be there
    moved_to       a motion goes there by an expression that is not followed
    alone          what is known where no motion goes to it, with the literal's own number as
                   value; None: nothing
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
    """One point that a motion goes to.

    value        the position: a literal, a variable, or Unknown
    frame, tool  of a pose
    obeyed       whether the controller goes to the branch of the configuration data, or stays near
                 where it comes from; a Setting or the name of a variable that holds one
    near         joints that choose the branch instead, as a start of the controller's
                 inverse kinematics
    relative     why the robot does not go to the position itself, as an offset to it: it is near
                 there, and the position has this frame and tool
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
    """From here on a variable holds a value."""

    line: int
    name: str
    value: Value


@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """Another routine is executed. arguments: variables of it, its parameters, and what they hold.

    A routine that the program does not have is passed over.
    """

    line: int
    routine: str
    arguments: tuple[tuple[str, Value], ...] = ()


@dataclass(frozen=True, slots=True)
class Begin:
    """Begin of the first branch of a selection, or of a loop. once: at least one round."""

    loop: bool = False
    once: bool = False


@dataclass(frozen=True, slots=True)
class Else:
    """The next branch of a selection. last: there is no way around all branches."""

    last: bool = False


@dataclass(frozen=True, slots=True)
class End:
    """A selection or loop ends."""


@dataclass(frozen=True, slots=True)
class Break:
    """The innermost loop is left."""


@dataclass(frozen=True, slots=True)
class Label:
    """A place to jump to."""

    name: str


@dataclass(frozen=True, slots=True)
class Jump:
    """The program goes on at a label, or may do so."""

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

    literals    every position written in it, numbered by their place here
    declared    what variables hold from the start
    remarks     what else is left as it is, and errors
    notes       what a reader of the summary has to know
    persistent  variables keep what they hold when a routine is started again
    in_order    the text is the order of motion, without calls, loops and variables:
                backlash can be taken up
    unused      why a literal that no motion goes to and that has no `alone` is left
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
