"""RAPID: what is found in modules, where it is used, what is left alone, and what is
refused, by line.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from program_reading import reader

from calibtool.programs.agreement import Position, positions
from calibtool.programs.frames import NamedFrames
from calibtool.programs.motion_flow import Flow, follow
from calibtool.programs.motions import Program
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

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
    flow = follow(program, NamedFrames())
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
        literal.line: literal.not_corrected for literal in program.literals if literal.bad
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
        (found,) = whys(
            f"MODULE A\nPROC m()\n{before}\n MoveL {target},v10,fine,tool0;\nENDPROC\n"
        ).values()
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
    text = procedure(
        "MoveL p{1},v1,fine,tool0;", before=f"CONST robtarget p{{2}}:=[{GOOD},{GOOD}];"
    )
    program, flow, _, left = followed(text)
    assert [literal.name for literal in program.literals] == ["p{1}", "p{2}"]
    assert [(use.literal, use.obeyed) for use in flow.uses] == [(0, True)]
    assert left == {2: program.unused}
    (use,) = followed(text.replace("PROC main()", "PROC main()\nConfL\\Off;"))[1].uses
    assert use.obeyed is False


def test_an_instruction_that_does_not_end_or_close_is_reported() -> None:
    def said(move: str) -> set[str]:
        return set(whys(f"MODULE A\nPROC m()\n {move}\nENDPROC\nENDMODULE\n").values())

    assert "no ; at its end" in said("MoveL p10,v10,fine,tool0")
    assert "a bracket is not closed" in said("MoveL [[1,2,3],v10,fine,tool0;")
    assert said("MoveExtJ p10,v10,fine;") == set()


# --- kinds of programs ----------------------------------------------------------------------------

A, B = GOOD, GOOD.replace("[1,2,3]", "[4,5,6]")
GUN = "PERS tooldata gun:=[TRUE,[[0,0,150],[1,0,0,0]],[4,[0,0,60],[1,0,0,0],0,0,0]];"
FIX = 'PERS wobjdata fix:=[FALSE,TRUE,"",[[600,0,0],[1,0,0,0]],[[0,50,0],[1,0,0,0]]];'
ONE = f"{GUN} {FIX} CONST robtarget p:={A};"
CELL = f"{ONE} CONST robtarget r:={B};"


def uses(*lines: str, before: str = CELL) -> list[tuple[int, str, list[float], list[float]]]:
    """Line and name of each use in order, and where frame and tool are, in m."""
    program, flow, _, _ = followed(procedure(*lines, before=before))
    found = []
    for use in flow.uses:
        (frame,), (tool,) = use.frames, use.tools
        name = program.literals[use.literal].name
        found.append((use.line, name, [*frame.T[:3, 3]], [*tool.T[:3, 3]]))
    return sorted(found)


HERE, THERE, FLANGE = [0.0, 0.0, 0.0], [0.6, 0.05, 0.0], [0.0, 0.0, 0.15]


@pytest.mark.parametrize(
    "instruction",
    [
        "MoveL p,v1,fine,gun\\WObj:=fix;",
        "MoveL\\Conc,p,v1,fine,gun,\\WObj:=fix;",
        "MoveL \\Conc, p, v1\\T:=2, z10\\Inpos:=inpos50, gun \\WObj:=fix \\TLoad:=load1;",
        "movej p \\ID:=10, v1, z10, gun \\WObj:=fix;",
        "MoveJDO p,v1,fine,gun\\WObj:=fix,do1,1;",
        'MoveLSync p,v1,z10,gun\\WObj:=fix,"proc";',
        "MoveJAO p,v1,z10,gun\\WObj:=fix,ao1,5.5;",
        "TriggL p,v1,trigg1\\T2:=trigg2,z10,gun\\WObj:=fix;",
        "TriggJIOs p,v1\\TriggData1:=trigg1,z10,gun\\WObj:=fix;",
        "ArcL p,v1,seam1,weld1\\Weave:=weave1,z10,gun\\WObj:=fix;",
        "SpotJ p,v1,spot1,gun1,gun\\WObj:=fix;",
        "PaintL p,v1,z10,gun\\WObj:=fix;",
        "SearchL\\PStop,di1,found,p,v1,gun\\WObj:=fix;",
        "NutL p,v1,nut1,z10,gun\\WObj:=fix;",
        "MyOwnWeld p,v1,3,gun,TRUE\\WObj:=fix;",
    ],
)
def test_tool_and_work_object_are_those_that_are_named(instruction: str) -> None:
    assert uses(instruction, before=CELL + "VAR robtarget found;") == [(4, "p", THERE, FLANGE)]


@pytest.mark.parametrize(
    "instruction",
    [
        "MoveC p,r,v1,fine,tool0;",
        "movec p, r, v1, fine, tool0;",
        "MoveCDO p,r,v1,fine,tool0,do1,1;",
        'MoveCSync p,r,v1,fine,tool0,"proc";',
        "ArcCEnd p,r,v1,seam1,weld1,fine,tool0;",
        "TriggC p,r,v1,trigg1,fine,tool0;",
        "SearchC\\Stop,di1,found,p,r,v1,tool0;",
        "CapC p,r,v1,cap1,mv1,z10,tool0;",
    ],
)
def test_both_points_of_a_circle(instruction: str) -> None:
    found = uses(instruction, before=CELL + "VAR robtarget found;")
    assert [name for _, name, _, _ in found] == ["p", "r"]


@pytest.mark.parametrize(
    ("instruction", "why"),
    [
        (f"Gripper {A},1;", "its tool: Gripper is no instruction whose tool is known"),
        (f"rPick {A};", "its tool: rPick is no instruction whose tool is known"),
        (f"MoveL {A},v1,fine,tools{{i}};", "its tool: an expression"),
        (
            f"MoveL {A},v1,fine,gripper;",
            "tool 'gripper' is not known; give it with --frames, [tools.gripper]",
        ),
        (f"MoveL {A},v1,fine,tool0\\WObj:=table;", "frame 'table' is not known; give it with"),
        (f"list.start := {A};", "stands in something that is not followed"),
    ],
)
def test_no_position_is_passed_over(instruction: str, why: str) -> None:
    assert whys(procedure(instruction))[4].startswith(why)


def test_a_position_found_by_a_search_is_no_constant() -> None:
    text = procedure(
        "SearchL di1,s,p,v1,tool0;", "MoveL s,v1,fine,tool0;", before=CELL + "VAR robtarget s;"
    )
    assert whys(text)[5] == "is found by SearchL (line 4)"


def test_assignments_are_followed() -> None:
    before = f"{GUN} VAR robtarget v:={A}; CONST robtarget r:={B};"
    program, flow, _, left = followed(
        procedure(
            "IF di1=1 v:=r;",
            "MoveL v,v1,fine,tool0;",
            "v:=CRobT();",
            "MoveL v,v1,fine,tool0;",
            before=before,
        )
    )
    assert sorted((use.line, program.literals[use.literal].name) for use in flow.uses) == [
        (5, "r"),
        (5, "v"),
    ]
    assert left == {}
    assert {r.line: r.why for r in flow.remarks} == {
        5: "is computed (line 6)",  # in the next cycle
        7: "is computed (line 6)",
    }


@pytest.mark.parametrize(
    ("change", "left"),
    [
        ("v.trans.x:=v.trans.x+1;", True),
        ("v.rot:=[1,0,0,0];", True),
        ("v.robconf.cf1:=1;", True),
        ("change v;", True),
        ("w:=v; w.trans.z:=7;", False),
    ],
)
def test_a_component_that_is_assigned(change: str, left: bool) -> None:
    text = procedure(
        change, "MoveL v,v1,fine,tool0;", before=f"VAR robtarget v:={A}; VAR robtarget w;"
    )
    text = text.replace(
        "ENDMODULE", "PROC change(INOUT robtarget v)\nv.trans.x:=1;\nENDPROC\nENDMODULE"
    )
    assert ("(line 4)" in whys(text).get(2, "")) == left


@pytest.mark.parametrize(
    ("change", "after"),
    [
        ("fix.uframe.trans:=[700,0,0];", [0.7, 0.05, 0.0]),
        ("fix.oframe.trans.y:=-20;", [0.6, -0.02, 0.0]),
        ("fix.uframe:=[[0,0,300],[1,0,0,0]];", [0.0, 0.05, 0.3]),
        ('fix:=[FALSE,TRUE,"",[[1,2,3],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];', [0.001, 0.002, 0.003]),
        ("other:=fix; fix:=other;", THERE),
        ("place;", [0.9, 0.05, 0.0]),
    ],
)
def test_a_work_object_is_the_one_in_force(change: str, after: list[float]) -> None:
    text = procedure(
        change, "MoveL p,v1,fine,tool0\\WObj:=fix;", before=CELL + "VAR wobjdata other;"
    )
    if "place" in change:
        text = text.replace(
            "ENDMODULE", "PROC place()\nfix.uframe.trans:=[900,0,0];\nENDPROC\nENDMODULE"
        )
    found = next(position for position in followed(text)[2] if position.frame is not None)
    np.testing.assert_allclose(found.frame.T[:3, 3], after, atol=1e-12)


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        (["IF di1=1 fix.uframe.trans:=[700,0,0];"], "several frames"),
        (
            ["FOR i FROM 1 TO 3 DO", "fix.oframe.trans.x:=i*100;", "ENDFOR"],
            "a component of it is assigned (line 5)",
        ),
        (["fix:=measured();"], "is computed (line 4)"),
        (["gun.tframe.trans.z:=160;", "IF a gun:=other;"], "its tool: "),
        (
            ["TEST part", "CASE 1:", "gun:=long;", "DEFAULT:", "gun:=short;", "ENDTEST"],
            "several tools",
        ),
        (["PDispOn p,tool0;"], "a program displacement (line 4)"),
    ],
)
def test_a_frame_that_is_not_known_at_a_motion(lines: list[str], why: str) -> None:
    short = GUN.replace("gun", "short").replace("150", "120")
    before = ONE + short + short.replace("short", "long").replace("120", "180")
    text = procedure(*lines, "MoveL p,v1,fine,gun\\WObj:=fix;", before=before)
    assert why in whys(text)[2]


def test_a_displacement_by_a_constant_is_taken_in() -> None:
    lines = [
        "PDispSet [[10,0,0],[1,0,0,0]];",
        "MoveL p,v1,fine,tool0;",
        "PDispOff;",
        "MoveL r,v1,fine,tool0;",
    ]
    assert uses(*lines) == [(5, "p", [0.01, 0, 0], HERE), (7, "r", HERE, HERE)]


@pytest.mark.parametrize(
    "data",
    [
        "PERS tooldata nail:=[FALSE,[[1,2,3],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];",
        'PERS wobjdata held:=[TRUE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];',
    ],
)
def test_a_work_piece_in_the_robots_hand(data: str) -> None:
    tool, frame = ("nail", "wobj0") if "nail" in data else ("tool0", "held")
    text = procedure(f"MoveL p,v1,fine,{tool}\\WObj:={frame};", before=ONE + data)
    assert "the robot holds the work piece" in whys(text)[2]
    assert "--frames" not in whys(text)[2]


@pytest.mark.parametrize(
    ("target", "why"),
    [
        ("[[0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,0,0,0]]", "not taught"),
        (f"[[x,2,3],[1,0,0,0],[0,0,0,0],{EXTERNAL}]", "a variable or an expression (x)"),
        (f"[spot,[1,0,0,0],[0,0,0,0],{EXTERNAL}]", "a variable or an expression (spot)"),
        (
            f"[[1,2,3],OrientZYX(0,0,0),[0,0,0,0],{EXTERNAL}]",
            "a variable or an expression (OrientZYX(0,0,0))",
        ),
        ("[[1,2,3],[1,0,0,0],[0,0,0,0],[0,350.5,9E9,9E9,9E9,9E9]]", "external axes beside a pose"),
    ],
)
def test_a_position_that_is_none_does_not_stop_the_others(target: str, why: str) -> None:
    text = procedure(f"MoveL {target},v1,fine,tool0;", f"MoveL {B},v1,fine,tool0;")
    _, _, found, left = followed(text)
    assert len(found) == 1
    assert why in left[4]
    assert bad(text) == {}


@pytest.mark.parametrize(
    "external", ["[9E9,9E9,9E9,9E9,9E9,9E9]", "[0,0,0,0,0,0]", "[0.0,9E+09,1E10,0,9e9,0]"]
)
def test_values_of_no_external_axis(external: str) -> None:
    assert whys(procedure(f"MoveL {A.replace(EXTERNAL, external)},v1,fine,tool0;")) == {}


def test_names_of_modules_and_routines_hide_others() -> None:
    text = (
        f"MODULE A\nCONST robtarget p:={A};\nPROC one()\nVAR robtarget p:={B};\n"
        "MoveL p,v1,fine,tool0;\nENDPROC\n"
        f"PROC two()\nMoveL p,v1,fine,tool0;\nENDPROC\nENDMODULE\n"
        f"MODULE B\nLOCAL CONST robtarget p:={B};\nPROC three()\nMoveL p,v1,fine,tool0;\nENDPROC\n"
        "ENDMODULE\n"
    )
    program, flow, _, left = followed(text)
    assert left == {}
    assert sorted((use.line, program.literals[use.literal].line) for use in flow.uses) == [
        (5, 4),
        (8, 2),
        (14, 12),
    ]


def test_arguments_of_routines() -> None:
    text = procedure("weld p,gun\\w:=fix;", "weld r,gun;", before=CELL).replace(
        "ENDMODULE",
        "PROC weld(robtarget at,PERS tooldata t\\PERS wobjdata w)\nMoveL at,v1,fine,t\\WObj?w;\n"
        "ENDPROC\nENDMODULE",
    )
    program, flow, _, _ = followed(text)
    assert sorted(program.literals[use.literal].name for use in flow.uses) == ["p", "r"]
    assert {use.line for use in flow.uses} == {8}
    assert all(len(use.frames) > 1 for use in flow.uses)  # with and without a work object


def test_uses_follow_the_order_of_execution() -> None:
    text = procedure(
        "near;",
        "MoveL p,v1,fine,tool0;",
        "WHILE TRUE DO",
        "MoveL r,v1,fine,tool0;",
        "ENDWHILE",
        before=CELL,
    )
    text = text.replace(
        "PROC main",
        f"PROC near()\nMoveAbsJ [[1,2,3,4,5,6],{EXTERNAL}],v1,fine,tool0;\nENDPROC\nPROC main",
    )
    _, flow, _, _ = followed(text)
    line = {number: use.line for number, use in enumerate(flow.uses)}
    came = {use.line: sorted(line[number] for number in use.before) for use in flow.uses}
    assert came == {4: [], 8: [4], 10: [8, 10]}
    assert all(use.sure for use in flow.uses if use.line > 4)


@pytest.mark.parametrize("end", ["\r\n", "\r", "\n"])
def test_line_ends(end: str) -> None:
    text = procedure("! a comment [", "MoveL p,v1,fine,tool0;", before=CELL)
    _, flow, _, left = followed(text.replace("\n", end))
    assert [use.line for use in flow.uses] == [5]
    assert list(left) == [2]


def test_recursion_is_followed_and_refused_without_end() -> None:
    menu = procedure(
        "MoveL p,v1,fine,tool0;",
        "IF a THEN",
        "main;",
        "ENDIF",
        "MoveL r,v1,fine,tool0;",
        before=CELL,
    )
    _, flow, _, _ = followed(menu)
    came = {use.line: {flow.uses[k].line for k in use.before} for use in flow.uses}
    assert came[8] == {4, 8}
    assert bad(menu) == {}
    assert (
        "calls itself without end"
        in whys(procedure("MoveL p,v1,fine,tool0;", "main;", before=CELL))[5]
    )


# --- data that are changed where no assignment says so --------------------------------------------


CHANGING = (
    'PERS wobjdata fix:=[FALSE,TRUE,"",[[600,100,-200],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n'
    f"CONST robtarget p:={GOOD};\n"
    f"VAR robtarget v:={GOOD};\n"
) + grip
TO_FIX = "MoveL p,v1,fine,grip\\WObj:=fix;"


@pytest.mark.parametrize(
    ("instruction", "move", "line"),
    [
        ("Add v.trans.z,25;", "MoveL v,v1,fine,tool0;", 4),
        ("ok:=StrToVal(word,v);", "MoveL v,v1,fine,tool0;", 4),
        ("IF StrToVal(word,v.trans.x) Stop;", "MoveL v,v1,fine,tool0;", 4),
        ('SetDataVal "v",other;', "MoveL v,v1,fine,tool0;", 4),
        ("SetDataVal name,other;", "MoveL v,v1,fine,tool0;", 4),
        ("Clear fix.oframe.trans.x;", TO_FIX, 3),
        ("MyOwnCalibration a,grip;", TO_FIX, 3),
    ],
)
def test_what_an_instruction_may_change_is_no_constant(
    instruction: str, move: str, line: int
) -> None:
    left = followed(procedure(instruction, move, before=CHANGING))[3]
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
    _, _, found, _ = followed(
        procedure(instruction, TO_FIX, "MoveL v,v1,fine,grip\\WObj:=fix;", before=CHANGING)
    )
    assert len(found) == 2


@pytest.mark.parametrize(
    ("pace", "moves"), [("vmax", True), ("v200", True), ("z5", True), ("3", False)]
)
def test_what_gets_a_speed_or_a_zone_is_a_motion_and_only_reads(pace: str, moves: bool) -> None:
    text = procedure(f"OwnMove v,{pace},grip;", "MoveL v,v1,fine,grip;", before=CHANGING)
    assert (len(followed(text)[2]) == 1) == moves


@pytest.mark.parametrize(
    ("call", "routine"),
    [
        ("n:=setw();", "FUNC num setw()\nfix.uframe.trans.x:=700;\nRETURN 1;\nENDFUNC"),
        ("WaitTime setw();", "FUNC num setw()\nfix.uframe.trans.x:=700;\nRETURN 1;\nENDFUNC"),
        ('%"setw"%;', "PROC setw()\nfix.uframe.trans.x:=700;\nENDPROC"),
        ("%name%;", "PROC setw()\nfix.uframe.trans.x:=700;\nENDPROC"),
        ('CallByVar "set",n;', "PROC set3()\nfix.uframe.trans.x:=700;\nENDPROC"),
        ("CONNECT i WITH t;", "TRAP t\nfix.uframe.trans.x:=700;\nENDTRAP"),
        (
            "CONNECT i WITH t;",
            "TRAP t\nsetw;\nENDTRAP\nPROC setw()\nfix.uframe.trans.x:=7;\nENDPROC",
        ),
    ],
)
def test_frames_that_routines_change_at_times_that_are_not_followed(
    call: str, routine: str
) -> None:
    first = "fix.uframe:=[[600,100,-200],[1,0,0,0]];"
    text = (
        procedure(first, call, TO_FIX, before=CHANGING) + "MODULE B\n" + routine + "\nENDMODULE\n"
    )
    line = text[: text.index("trans.x:=7")].count("\n") + 1
    why = followed(text)[3][3]
    assert why.startswith("its frame: ")
    assert why.endswith(f"changes it, and when is not known (line {line})")


def test_frames_that_an_error_handler_changes() -> None:
    first = "fix.uframe:=[[600,100,-200],[1,0,0,0]];"
    for handler in ("fix.uframe.trans.x:=700;", "fix.oframe:=[[1,2,3],[1,0,0,0]];"):
        why = followed(procedure(first, TO_FIX, "ERROR", handler, "RETRY;", before=CHANGING))[3][3]
        assert "main's error handler changes it" in why
        assert "(line 10)" in why


@pytest.mark.parametrize("change", ["q.trans.x:=5;", "Incr q.trans.x;"])
@pytest.mark.parametrize("mode", ["INOUT ", ""])
def test_arguments_that_a_routine_of_a_routine_changes(change: str, mode: str) -> None:
    text = procedure("one v;", "MoveL v,v1,fine,tool0;", before=CHANGING)
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
    left = whys(procedure(*moves, "MoveL v,v1,fine,tool0;", before=CHANGING))
    assert "serves two places" in left[3]
    assert "(line 8)" in left[3]
    assert 3 not in followed(procedure(*moves, before=CHANGING))[3]  # nothing moves to it


@pytest.mark.parametrize("zeros", ["0,0,0,0,0,0", "0.0,-0,0,0.00,0,0"])
def test_a_mastering_position_is_left(zeros: str) -> None:
    text = procedure(f"MoveAbsJ [[{zeros}],{EXTERNAL}],v1,fine,tool0;",
        "MoveAbsJ home,v1,fine,tool0;",
                     before=f"CONST jointtarget home:=[[{zeros}],{EXTERNAL}];")  # fmt: skip
    assert followed(text)[3] == dict.fromkeys((2, 4), "a mastering position: all joints are zero")
    assert not bad(text)
    assert len(followed(text.replace("[[0", "[[1"))[2]) == 2


@pytest.mark.parametrize("point", ["p", GOOD])
def test_joints_of_a_position_are_treated_as_the_position(point: str) -> None:
    move = f"MoveAbsJ CalcJointT({point},grip\\WObj:=fix),v1,fine,tool0;"
    program, _, found, _ = followed(procedure(move, before=CHANGING))
    (one,) = found
    assert program.literals[one.literal].kind == "pose"
    assert one.frame is not None
    assert one.tool is not None
    np.testing.assert_allclose(one.frame.T[:3, 3], [0.6, 0.1, -0.2])
    np.testing.assert_allclose(one.tool.T[:3, 3], [0, 0, 0.009])


@pytest.mark.parametrize(("move", "moved_to"), [("MoveAbsJ jt,v1,fine,grip;", 1), ("Stop;", 0)])
def test_joints_of_a_position_in_a_variable(move: str, moved_to: int) -> None:
    solved = f"jt:=CalcJointT({GOOD},grip);"
    program = read(procedure("VAR jointtarget jt;", solved, move, before=CHANGING))
    assert sum(literal.moved_to for literal in program.literals) == moved_to
