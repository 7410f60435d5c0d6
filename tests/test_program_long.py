"""KRL as long as backups of controllers: many changes of one variable, and many interrupts."""

import numpy as np
import pytest

from calibtool.programs.agreement import positions
from calibtool.programs.formats import read_program
from calibtool.programs.frames import NamedFrames
from calibtool.programs.motion_flow import follow
from calibtool.programs.motions import ProgramText
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array

POSE = "{X 2300.597,Y 438.964,Z 606.965,A -149.8734,B 1.7156,C -171.7508}"
STEP = "$BASE=$BASE:{X 1,Y 0,Z 0,A 0,B 0,C 0}"


def bases(*lines: str) -> tuple[dict[int, Array], dict[int, str]]:
    """The bases of positions that can be corrected, and why others are not, by line."""
    program = read_program("kuka-krl", [ProgramText("a.src", "\n".join(lines))], load_robot("ur5"))
    found, left = positions(program, follow(program, NamedFrames()))
    lines_of = [literal.line for literal in program.literals]
    known = {lines_of[one.literal]: one.frame.T for one in found if one.frame is not None}
    return known, {lines_of[k]: why for k, why in left.items()}


@pytest.mark.parametrize(
    ("step", "moved"), [(STEP, 1000.0), ("$BASE.Y=5", 0.0), ("$BASE.X=9", 9.0)]
)
def test_many_changes_of_a_frame_in_a_routine(step: str, moved: float) -> None:
    """A thousand products or assigned components are followed as one is."""
    start = ["DEF a( )", "$TOOL=$NULLFRAME", "$BASE=$NULLFRAME", "b( )", f"LIN {POSE}", "END"]
    known, left = bases(*start, "DEF b( )", *[step] * 1000, "END")
    assert not left
    np.testing.assert_allclose(known[5][0, 3], moved * 1e-3, atol=1e-12)
    assert known[5][1, 3] == (5e-3 if "Y=" in step else 0)


def test_a_component_that_is_not_known_stays_unknown() -> None:
    """Whichever of several assigned components of a frame is computed."""
    start = ["DEF a( )", "$TOOL=$NULLFRAME", "$BASE=$NULLFRAME", "b( )", f"LIN {POSE}", "END"]
    for steps in (["$BASE.X=r", "$BASE.Y=5"], ["$BASE.Y=5", "$BASE.X=r"]):
        known, left = bases(*start, "DEF b( )", *steps, "END")
        assert not known
        assert "a component of it is assigned" in left[5]


@pytest.mark.parametrize("word", ["TRIGGER WHEN DISTANCE=0 DELAY=0 DO b( )", "INTERRUPT ON"])
def test_many_interrupts_that_change_a_frame(word: str) -> None:
    """The base is known up to the first of them, and never after it."""
    declared = [f"INTERRUPT DECL {k} WHEN $IN[{k}] DO b( )" for k in range(1, 61)]
    starts = [word] * 60
    change = ["$BASE=$NULLFRAME", f"LIN {POSE}"]
    lines = ["DEF a( )", *declared, "$TOOL=$NULLFRAME", *change, *starts, *change, *starts, *change]
    sub = ["END", "DEF b( )", "$BASE={X 1,Y 0,Z 0,A 0,B 0,C 0}", "END"]
    known, left = bases(*lines, *sub)
    places = [k for k, line in enumerate(lines, 1) if line.startswith("LIN")]
    assert list(known) == places[:1]
    assert list(left) == places[1:]
    assert all("may be changed at any time" in why for why in left.values())


def test_steps_behind_a_start_are_counted_in_the_routine_itself() -> None:
    """Where the second start stands does not depend on what the first one may change."""
    trigger = "TRIGGER WHEN DISTANCE=0 DELAY=0 DO {}( )"
    lines = [
        "DEF a( )",
        *["$TOOL=$NULLFRAME", "$BASE=$NULLFRAME"],
        trigger.format("b"),
        *["$TOOL=$NULLFRAME"] * 8,
        "$BASE={X 7,Y 0,Z 0,A 0,B 0,C 0}",
        f"LIN {POSE}",
        trigger.format("c"),
        f"LIN {POSE}",
        "END",
    ]
    subs = ["DEF b( )", "$TOOL=$NULLFRAME", "END", "DEF c( )", "$BASE=$NULLFRAME", "END"]
    left = bases(*lines, *subs)[1]
    assert [why.partition(":")[0] for why in left.values()] == ["its tool", "its frame"]


@pytest.mark.parametrize("argument", ["PAR[1].TXT[]", "TXT[]", "PAR.TXT[ ]"])
def test_texts_as_arguments(argument: str) -> None:
    """A member that is an array of characters is passed like any other argument."""
    lines = ["DEF a( )", "$TOOL=$NULLFRAME", "$BASE=$NULLFRAME", f'{argument}="x"']
    known, left = bases(*lines, f"SREAD({argument},S,O)", f"LIN {POSE}", "END")
    assert list(known) == [6]
    assert not left


def test_system_variables_are_no_targets() -> None:
    """Machine data hold axes that are tolerances and places to be monitored, not motions."""
    axes = "{A1 2.0,A2 -90.0,A3 90.0,A4 2.0,A5 2.0,A6 2.0,E1 0.0}"
    lines = [
        "DEFDAT $MACHINE PUBLIC",
        f"E6AXIS $H_POS={axes}",
        f"E6AXIS $H_POS_TOL={axes}",
        f"$AXIS_HOME[1]={axes}",
        f"DECL E6AXIS XHOME={axes}",
        "ENDDAT",
    ]
    sources = [ProgramText("$machine.dat", "\n".join(lines))]
    literals = read_program("kuka-krl", sources, load_robot("ur5")).literals
    assert [one.line for one in literals if not one.not_corrected] == [5]
    said = {one.not_corrected for one in literals} - {""}
    assert said == {"a system variable of the controller"}
