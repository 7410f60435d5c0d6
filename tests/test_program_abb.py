"""RAPID: what is found in modules, where it is used, what is left alone, and what is refused, by line."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calibtool.programs.agreement import Position, positions
from calibtool.programs.flow import Flow, follow
from calibtool.programs.formats import reader
from calibtool.programs.frames import Frames
from calibtool.programs.motions import Program
from calibtool.robot.catalogue import load_robot
from calibtool.robot.model import Robot

FOLDER = Path(__file__).parent / "programs"
EXTERNAL = "[9E9,9E9,9E9,9E9,9E9,9E9]"
GOOD = f"[[1,2,3],[1,0,0,0],[0,0,0,0],{EXTERNAL}]"


@cache
def robot(name: str = "fanuc-m1000ia") -> Robot:
    return load_robot(name)


def read(text: str, name: str = "fanuc-m1000ia") -> Program:
    return reader("abb-rapid")(text, robot(name))


def followed(text: str) -> tuple[Program, Flow, list[Position], dict[int, str]]:
    """The program, its uses, positions that can be corrected, and why others are left, by line."""
    program = read(text)
    flow = follow(program, Frames())
    found, left = positions(program, flow)
    whys = {program.literals[number].line: why for number, why in left.items()}
    return program, flow, found, whys


def whys(text: str) -> dict[int, str]:
    """Why something is left, by line."""
    program, flow, _, left = followed(text)
    return left | {r.line: r.why for r in (*program.remarks, *flow.remarks)}


def bad(text: str, name: str = "fanuc-m1000ia") -> dict[int, str]:
    """Errors by line."""
    program = read(text, name)
    return {r.line: r.why for r in program.remarks if r.bad} | {
        literal.line: literal.left for literal in program.literals if literal.bad
    }


def procedure(*lines: str, before: str = "") -> str:
    return "\n".join(["MODULE A", before, "PROC main()", *lines, "ENDPROC", "ENDMODULE", ""])


def test_a_module() -> None:
    text = (FOLDER / "pick.mod").read_text(encoding="utf-8")
    program, _, found, left = followed(text)
    assert {program.literals[p.literal].line: program.literals[p.literal].name for p in found} == {
        5: "home",
        6: "p10",
        7: "p20",
        15: "MoveAbsJ […]",
        16: "MoveL […]",
    }
    assert left == {
        8: "no instruction of the program moves there: its tool and work object are not known",
        17: "frame 'vise' is not known; give it with --frames, [frames.vise]",
    }
    assert whys(text) == left | {
        12: "a relative motion; the point it starts from is treated by itself",
        14: "'pTaught' is a variable that no file gives a position",
    }
    framed = next(p for p in found if program.literals[p.literal].name == "p20")
    assert framed.frame is not None
    assert framed.tool is not None
    np.testing.assert_allclose(framed.frame.T[:3, 3], [1, 0, 0])
    np.testing.assert_allclose(framed.tool.T[:3, 3], [0, 0, 0.1])


@pytest.mark.parametrize(
    ("target", "why"),
    [
        (f"[[1,2,3],[1,0.1,0,0],[0,0,0,0],{EXTERNAL}]", "quaternion of length 1.005"),
        (f"[[1,2,nan],[1,0,0,0],[0,0,0,0],{EXTERNAL}]", "'nan'"),
        (f"[[1,2,3],[1,0,0,0],[0,0,0],{EXTERNAL}]", "is no robtarget"),
        ("[[1,2,3],[1,0,0,0],[0,0,0,0]]", "is no robtarget"),
    ],
)
def test_errors(target: str, why: str) -> None:
    assert why in bad(f"MODULE A\nPROC m()\n MoveL {target},v10,fine,tool0;\nENDPROC\n")[3]


def test_positions_left_alone() -> None:
    def why(target: str, before: str = "") -> str:
        (found,) = whys(f"MODULE A\nPROC m()\n{before}\n MoveL {target},v10,fine,tool0;\nENDPROC\n").values()
        return found

    assert "external axes" in why("[[1,2,3],[1,0,0,0],[0,0,0,0],[100,9E9,9E9,9E9,9E9,9E9]]")
    assert "expression (x+1)" in why(f"[[x+1,2,3],[1,0,0,0],[0,0,0,0],{EXTERNAL}]")
    assert "displacement (line 3)" in why(GOOD, before="PDispOn p1,tool0;")
    both = f"CONST robtarget p:={GOOD};"
    assert (
        "several tools (lines 4, 5)"
        in whys(procedure("MoveL p,v1,fine,tool0;", "MoveL p,v1,fine,grip;", before=both + grip))[2]
    )


grip = "PERS tooldata grip:=[TRUE,[[0,0,9],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"


def test_joints_that_a_robot_does_not_have() -> None:
    text = f"MODULE A\nCONST jointtarget a:=[[1,2,3,4,9E9,9E9],{EXTERNAL}];\n"
    (literal,) = read(text, "scara").literals
    assert len(literal.values) == 4
    assert "has 6" in bad(text)[2]


def test_arrays_and_switched_off_configurations() -> None:
    text = procedure("MoveL p{1},v1,fine,tool0;", before=f"CONST robtarget p{{2}}:=[{GOOD},{GOOD}];")
    program, flow, _, left = followed(text)
    assert [literal.name for literal in program.literals] == ["p{1}", "p{2}"]
    assert [(use.literal, use.obeyed) for use in flow.uses] == [(0, True)]
    assert left == {2: program.unused}
    (use,) = followed(text.replace("PROC main()", "PROC main()\nConfL\\Off;"))[1].uses
    assert use.obeyed is False


def test_an_instruction_that_does_not_end_or_close_is_said() -> None:
    def said(move: str) -> set[str]:
        return set(whys(f"MODULE A\nPROC m()\n {move}\nENDPROC\nENDMODULE\n").values())

    assert "no ; at its end" in said("MoveL p10,v10,fine,tool0")
    assert "a bracket is not closed" in said("MoveL [[1,2,3],v10,fine,tool0;")
    assert said("MoveExtJ p10,v10,fine;") == set()


FIX = (
    'PERS wobjdata fix:=[FALSE,TRUE,"",[[600,100,-200],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n'
    f"CONST robtarget p:={GOOD};\n"
    f"VAR robtarget v:={GOOD};\n"
) + grip
FIXED = "MoveL p,v1,fine,grip\\WObj:=fix;"


@pytest.mark.parametrize(
    ("instruction", "move", "line"),
    [
        ("Add v.trans.z,25;", "MoveL v,v1,fine,tool0;", 4),
        ("ok:=StrToVal(word,v);", "MoveL v,v1,fine,tool0;", 4),
        ("IF StrToVal(word,v.trans.x) Stop;", "MoveL v,v1,fine,tool0;", 4),
        ('SetDataVal "v",other;', "MoveL v,v1,fine,tool0;", 4),
        ("SetDataVal name,other;", "MoveL v,v1,fine,tool0;", 4),
        ("Clear fix.oframe.trans.x;", FIXED, 3),
        ("MyOwnCalibration a,grip;", FIXED, 3),
    ],
)
def test_what_an_instruction_may_change_is_no_constant(instruction: str, move: str, line: int) -> None:
    left = followed(procedure(instruction, move, before=FIX))[3]
    names = ("Add", "StrToVal", "SetDataVal", "Clear", "MyOwnCalibration")
    (name,) = (name for name in names if name in instruction)
    assert f"{name} may change it (line 7)" in left[line]


@pytest.mark.parametrize(
    "instruction",
    [
        "WaitTime 1;",
        "TPWrite text\\Num:=v.trans.x;",
        "n:=Distance(p.trans,v.trans);",
        "MyOwnWeld v,v1,3,grip,TRUE\\WObj:=fix;",
        "GripMove v,grip,v100,fine,grip\\WObj:=fix;",
        "Add grip.tload.mass,1;",
        "Add n,1;",
        "here:=CRobT(\\Tool:=grip\\WObj:=fix);",
    ],
)
def test_what_only_reads_leaves_its_arguments_constant(instruction: str) -> None:
    _, _, found, _ = followed(procedure(instruction, FIXED, "MoveL v,v1,fine,grip\\WObj:=fix;", before=FIX))
    assert len(found) == 2


@pytest.mark.parametrize(
    ("call", "routine"),
    [
        ("n:=setw();", "FUNC num setw()\nfix.uframe.trans.x:=700;\nRETURN 1;\nENDFUNC"),
        ("WaitTime setw();", "FUNC num setw()\nfix.uframe.trans.x:=700;\nRETURN 1;\nENDFUNC"),
        ('%"setw"%;', "PROC setw()\nfix.uframe.trans.x:=700;\nENDPROC"),
        ("%name%;", "PROC setw()\nfix.uframe.trans.x:=700;\nENDPROC"),
        ('CallByVar "set",n;', "PROC set3()\nfix.uframe.trans.x:=700;\nENDPROC"),
        ("CONNECT i WITH t;", "TRAP t\nfix.uframe.trans.x:=700;\nENDTRAP"),
        ("CONNECT i WITH t;", "TRAP t\nsetw;\nENDTRAP\nPROC setw()\nfix.uframe.trans.x:=7;\nENDPROC"),
    ],
)
def test_frames_that_routines_change_at_times_that_are_not_followed(call: str, routine: str) -> None:
    first = "fix.uframe:=[[600,100,-200],[1,0,0,0]];"
    text = procedure(first, call, FIXED, before=FIX) + "MODULE B\n" + routine + "\nENDMODULE\n"
    line = text[: text.index("trans.x:=7")].count("\n") + 1
    why = followed(text)[3][3]
    assert why.startswith("its frame: ")
    assert why.endswith(f"changes it, and when is not known (line {line})")


def test_frames_that_an_error_handler_changes() -> None:
    first = "fix.uframe:=[[600,100,-200],[1,0,0,0]];"
    for handler in ("fix.uframe.trans.x:=700;", "fix.oframe:=[[1,2,3],[1,0,0,0]];"):
        why = followed(procedure(first, FIXED, "ERROR", handler, "RETRY;", before=FIX))[3][3]
        assert "main's error handler changes it" in why
        assert "(line 10)" in why


@pytest.mark.parametrize("change", ["q.trans.x:=5;", "Incr q.trans.x;"])
@pytest.mark.parametrize("mode", ["INOUT ", ""])
def test_arguments_that_a_routine_of_a_routine_changes(change: str, mode: str) -> None:
    text = procedure("one v;", "MoveL v,v1,fine,tool0;", before=FIX)
    text += "MODULE B\nPROC one(INOUT robtarget w)\ntwo w;\nENDPROC\n"
    text += f"PROC two({mode}robtarget q)\n{change}\nENDPROC\nENDMODULE\n"
    left = followed(text)[3]
    if mode:
        assert "a routine changes it (line 7)" in left[4]
    else:  # a copy is changed
        assert 4 not in left


@pytest.mark.parametrize("change", ["v.trans.z:=500;", "Add v.trans.z,25;"])
def test_a_position_whose_changed_copy_is_moved_to_serves_two_places(change: str) -> None:
    moves = ("v:=p;", change, "MoveL p,v1,fine,tool0;")
    left = whys(procedure(*moves, "MoveL v,v1,fine,tool0;", before=FIX))
    assert "changed copy of it" in left[3]
    assert "(line 8)" in left[3]
    assert 3 not in followed(procedure(*moves, before=FIX))[3]  # nothing moves to it


@pytest.mark.parametrize("zeros", ["0,0,0,0,0,0", "0.0,-0,0,0.00,0,0"])
def test_a_mastering_position_is_left(zeros: str) -> None:
    text = procedure(f"MoveAbsJ [[{zeros}],{EXTERNAL}],v1,fine,tool0;", "MoveAbsJ home,v1,fine,tool0;",
                     before=f"CONST jointtarget home:=[[{zeros}],{EXTERNAL}];")  # fmt: skip
    assert followed(text)[3] == dict.fromkeys((2, 4), "a mastering position: all joints are zero")
    assert not bad(text)
    assert len(followed(text.replace("[[0", "[[1"))[2]) == 2


@pytest.mark.parametrize("point", ["p", GOOD])
def test_joints_of_a_position_are_treated_as_the_position(point: str) -> None:
    move = f"MoveAbsJ CalcJointT({point},grip\\WObj:=fix),v1,fine,tool0;"
    program, _, found, _ = followed(procedure(move, before=FIX))
    (one,) = found
    assert program.literals[one.literal].kind == "pose"
    assert one.frame is not None
    assert one.tool is not None
    np.testing.assert_allclose(one.frame.T[:3, 3], [0.6, 0.1, -0.2])
    np.testing.assert_allclose(one.tool.T[:3, 3], [0, 0, 0.009])


@pytest.mark.parametrize(("move", "moved_to"), [("MoveAbsJ jt,v1,fine,grip;", 1), ("Stop;", 0)])
def test_joints_of_a_position_in_a_variable(move: str, moved_to: int) -> None:
    solved = f"jt:=CalcJointT({GOOD},grip);"
    program = read(procedure("VAR jointtarget jt;", solved, move, before=FIX))
    assert sum(literal.moved_to for literal in program.literals) == moved_to
