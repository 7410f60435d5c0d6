"""FANUC: what is found in programs, in which frame it is used, what is left alone, and what is
refused, by line.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calibtool.programs.agreement import Position, positions
from calibtool.programs.formats import read_program
from calibtool.programs.frames import NamedFrames, read_frames
from calibtool.programs.motion_flow import Flow, follow
from calibtool.programs.motions import Program, ProgramText
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

FOLDER = Path(__file__).parent / "programs"
ANY_FRAME = read_frames(
    "".join(f"[frames.{k}]\nx_mm={k}\n[tools.{k}]\nz_mm={k}\n" for k in range(1, 5)), "f"
)


@cache
def robot(name: str = "fanuc-m1000ia") -> Robot:
    return load_robot(name)


def read(*texts: str, name: str = "fanuc-m1000ia") -> Program:
    sources = [ProgramText(f"{k}", text, edited=k == 0) for k, text in enumerate(texts)]
    return read_program("fanuc-ls", sources, robot(name))


def followed(
    *texts: str, given: NamedFrames = ANY_FRAME
) -> tuple[Program, Flow, list[Position], dict[str, str]]:
    """The program, its uses, positions that can be corrected, and why others are left, by name."""
    program = read(*texts)
    flow = follow(program, given)
    found, left = positions(program, flow)
    return program, flow, found, {program.literals[k].name: why for k, why in left.items()}


def left(*texts: str) -> dict[str, str]:
    """Why positions are left, by name."""
    return followed(*texts)[3]


def corrected(*texts: str) -> list[str]:
    """Names of the positions that can be corrected."""
    program, _, found, _ = followed(*texts)
    return [program.literals[position.literal].name for position in found]


def order(*texts: str) -> list[list[str]]:
    """For every use of a position, in the order of the text: the position and those that the
    robot comes from.
    """
    program, flow, _, _ = followed(*texts)
    names = [program.literals[use.literal].name for use in flow.uses]
    uses = [
        (use.line, [names[k], *(names[b] for b in use.before)])
        for k, use in enumerate(flow.uses)
        if use.line
    ]
    return [use for _, use in sorted(uses)]


def said(*texts: str) -> dict[int, str]:
    """What is said of motions and of the program, by line."""
    program, flow, _, _ = followed(*texts)
    return {r.line: r.why for r in (*program.remarks, *flow.remarks)}


def bad(text: str, name: str = "fanuc-m1000ia") -> dict[int, str]:
    """Errors by line."""
    program = read(text, name=name)
    remarks = {r.line: r.why for r in program.remarks if r.bad}
    return remarks | {
        literal.line: literal.not_corrected for literal in program.literals if literal.bad
    }


POSE = (
    "\tUF : {uf}, UT : {ut},\t\tCONFIG : '{config}',\n\tX = 1500 mm, Y = 2 mm, Z = {z},\n"
    "\tW = 0 deg, P = 0 deg, R = 0 deg{more}\n"
)
JOINTS = (
    "\tUF : F, UT : F,\n\tJ1= 1 deg, J2= 2 deg, J3= 3 deg,\n"
    "\tJ4= 4 deg, J5= -50 deg, J6= 6 deg{more}\n"
)


def pose(
    uf: str = "0", ut: str = "0", config: str = "N U T, 0, 0, 0", z: str = "3 mm", more: str = ""
) -> str:
    return POSE.format(uf=uf, ut=ut, config=config, z=z, more=more)


def written(*instructions: str, name: str = "A", attributes: str = "", **groups: str) -> str:
    """A program: its instructions from line 4 on, and the positions P1=…, P2=…."""
    lines = "".join(f"{k:4d}:{text} ;\n" for k, text in enumerate(instructions, start=1))
    taught = "".join(f"P[{key[1:]}]{{\n   GP1:\n{group}}};\n" for key, group in groups.items())
    return f"/PROG {name}\n/ATTR {attributes}\n/MN\n{lines}/POS\n{taught}/END\n"


# --- positions ------------------------------------------------------------------------------------


def test_a_program() -> None:
    text = (FOLDER / "weld.ls").read_text(encoding="ascii")
    program, _, found, whys = followed(text, given=NamedFrames())
    literals = {program.literals[p.literal].line: program.literals[p.literal] for p in found}
    assert {line: (literal.kind, literal.name) for line, literal in literals.items()} == {
        21: ("joint", "P[1]"),
        27: ("pose", "P[2]"),
        39: ("pose", "P[4]"),
        51: ("joint", "P[6]"),
    }
    assert whys == {
        "P[3]": "a relative motion (INC in line 12)",
        "P[5]": "frame '3' is not known; give it with --frames, [frames.3]",
        "P[6] GP2": "another motion group: only group 1 is this robot",
    }
    assert said(text) == {14: "a register: its value is not in the program"}
    np.testing.assert_allclose(np.rad2deg(literals[21].values), [0, 10, -20, 0, -70, 0])
    assert literals[27].values[:3] == pytest.approx([1.904939, 0.662417, -0.093227])
    shown = [literal.configuration.text for literal in literals.values() if literal.configuration]
    assert shown == ["N U T, 0, 0, 0", "F U T, 0, 0, 0"]
    assert program.notes == ("line 13: P[4] is corrected without its offset",)


def one(**parts: str) -> str:
    return written("L P[1] 100mm/sec FINE", P1=pose(**parts))


@pytest.mark.parametrize(
    ("text", "line", "why"),
    [
        (one(z="nan mm"), 9, "Z is 'nan'"),
        (one(z="1e999 mm"), 9, "Z is '1e999'"),
        (one(z="3 deg"), 9, "Z is in deg"),
        (one(z="3"), 9, "Z is '3'"),
        (one(more=", Q = 1 mm"), 10, "holds"),
        (one(more=", END = 1 mm"), 10, "holds"),
        (one(more=", E0 = 1 mm"), 10, "holds"),
        (one(more=", E = 1 mm, EX1 = 2 deg"), 10, "holds"),
        (one(more=", HELLO"), 10, "'HELLO' is not known"),
        ("/POS\nP[1]{\n GP1:\n UF : 0, UT : 0,\n J1= 1 deg, J2= 2 deg\n};\n", 5, "has 6 joints"),
        ("/POS\nP[1]{\n};\n", 2, "no motion group"),
        ("/POS\nP[1]{\n GP1:\n}\n", 2, "is not closed"),
    ],
)
def test_errors(text: str, line: int, why: str) -> None:
    assert why in bad(text)[line]


def test_a_position_that_is_not_closed_does_not_take_the_next_one() -> None:
    text = one().replace("/POS", "/POS\nP[9]{\n GP1:\n UF : 0, UT : 0,", 1)
    assert bad(text) == {one().splitlines().index("/POS") + 2: "is not closed by };"}
    assert corrected(text) == corrected(one()) == ["P[1]"]


@pytest.mark.parametrize(
    ("group", "why"),
    [
        (pose(config="R, 0, 0, 0"), "not of a six-joint arm"),
        (pose(more=",\n\tE1 = 5 mm"), "external axes"),
        (pose(more=",\n\tE1 = 0 mm, E2 = -5 deg"), "external axes"),
        (pose(z="******** mm"), "not taught"),
        (pose(z="******** mm", more="\n\tE1 = ******** mm"), "not taught"),
        (pose(config="", z="******** mm"), "not taught"),
        (JOINTS.format(more="").replace("J2= 2", "J2= *"), "not taught"),
        (JOINTS.format(more="").replace("-50", "0").translate(str.maketrans("", "", "")), ""),
        (pose().replace("X =", "RX =").replace("Y =", "RY =").replace("Z =", "RZ =").replace("W =",
            "RW =")
         .replace("P =", "RP =").replace("R = 0 deg\n", "RR = 0 deg\n"), "remote TCP position"),
    ],
)  # fmt: skip
def test_positions_left_alone(group: str, why: str) -> None:
    found = left(written("J P[1] 100% FINE", P1=group))
    assert why in found.get("P[1]", "")
    assert bool(why) == ("P[1]" in found)
    assert not bad(written("J P[1] 100% FINE", P1=group))


def test_external_axes_of_zero_are_none_and_beside_joints_they_do_not_matter() -> None:
    assert corrected(one(more=",\n\tE1 = 0.000 mm, E2 = .000 deg")) == ["P[1]"]
    assert corrected(written("J P[1] 100% FINE", P1=JOINTS.format(more=",\n\tE1= 250 mm"))) == [
        "P[1]"
    ]


def test_other_groups_are_another_robot() -> None:
    """A second arm has joints and poses of its own; a program of group 2 alone has
    nothing for this robot.
    """
    both = pose() + "   GP2:\n" + pose(uf="1") + "   GP3:\n\tUF : 0, UT : 0,\n\tJ1= 5 mm\n"
    program, _, found, whys = followed(written("L P[1] 100mm/sec FINE", P1=both))
    assert [program.literals[p.literal].name for p in found] == ["P[1]"]
    assert {literal.name: literal.kind for literal in program.literals} == {
        "P[1]": "pose", "P[1] GP2": "pose", "P[1] GP3": "joint",
    }  # fmt: skip
    assert set(whys.values()) == {"another motion group: only group 1 is this robot"}
    second = written("L P[1] 100mm/sec FINE", P1=pose()).replace("GP1", "GP2")
    assert corrected(second) == []
    assert said(second) == {4: "P[1] is not among the positions for group 1"}


def test_a_mastering_position_stays() -> None:
    zero = "\tUF : 0, UT : 0,\n" + ", ".join(f"J{k + 1}= 0.000 deg" for k in range(6)) + "\n"
    assert left(written("J P[1] 20% FINE", P1=zero)) == {
        "P[1]": "a mastering position: all joints are zero"
    }


def test_a_position_that_is_written_twice() -> None:
    text = one()
    twice = text.replace("/END", text[text.index("P[1]{") : text.index("/END")] + "/END")
    assert left(twice) == {"P[1]": "is written more than once"}


@pytest.mark.parametrize(
    ("begin", "end"),
    [
        ("TOUCH OFFSET PR[1]", "TOUCH OFFSET END"),
        ("TRACK DPM[1]", "DPM END"),
        ("Track TAST[2:a]", "Track End"),
    ],
)
def test_motions_that_a_sensor_shifts(begin: str, end: str) -> None:
    """They are corrected without the offset, which is noted; motions before and behind are not."""
    motions = [f"L P[{k}] 100mm/sec FINE" for k in (1, 2, 3)]
    text = written(motions[0], begin, motions[1], end, motions[2], P1=pose(), P2=pose(), P3=pose())
    assert read(text).notes == ("line 6: P[2] is corrected without its offset",)
    assert corrected(text) == ["P[1]", "P[2]", "P[3]"]


@pytest.mark.parametrize("point", ["PAL_1[BTM]", "PAL_12[A_1]"])
@pytest.mark.parametrize("letter", ["L", "J"])
def test_pallets_are_reported(letter: str, point: str) -> None:
    text = written(f"{letter} {point} 100mm/sec FINE", "L P[1] 100mm/sec FINE", P1=pose())
    assert said(text) == {4: f"a position of a pallet: its value is not in the program ({point})"}


@pytest.mark.parametrize(
    "condition", ["", "IF R[1]=1,", "IF (DI[1] AND R[2,1]>3),", "WENN DI[1]=ON,"]
)
@pytest.mark.parametrize("value", ["P[1]=LPOS", "P[1:there]=PR[2]", "P[1,3]=10"])
def test_positions_that_are_assigned_also_behind_a_condition(condition: str, value: str) -> None:
    text = written(
        "L P[2] 100mm/sec FINE", condition + value, "L P[1] 100mm/sec FINE", P1=pose(), P2=pose()
    )
    assert left(text) == {"P[1]": "it is assigned (line 5)"}


@pytest.mark.parametrize("target", ["P[R[3]]", "P[AR[1]]", "P[R[3:which]]"])
@pytest.mark.parametrize("condition", ["", "IF R[1]=1,"])
def test_an_assignment_to_some_position(condition: str, target: str) -> None:
    """Which one is not known: the line is listed, and positions that no motion names are left."""
    text = written(f"{condition}{target}=LPOS", "L P[1] 100mm/sec FINE", P1=pose(), P2=pose())
    assert said(text) == {4: "which position is assigned, a register tells"}
    assert left(text) == {"P[2]": f"may be assigned ({target}, line 4)"}
    assert corrected(text) == ["P[1]"]


def test_positions_that_no_motion_goes_to_are_corrected_in_their_own_frame() -> None:
    _, _, found, whys = followed(
        written(P1=pose(uf="2", ut="1"), P2=pose(uf="F"), P3=JOINTS.format(more=""))
    )
    assert [p.frame.name if p.frame else None for p in found] == ["2", None]
    assert whys == {
        "P[2]": "the program does not state its frame; give it with --frames, [frames.default]"
    }


# --- motions --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "circle",
    [
        "C P[2] P[3] 250mm/sec FINE",
        "C P[2] : P[3] 250mm/sec FINE",
        "C P[2:via]    \n    :  P[3:end] 250mm/sec FINE",
    ],
)
def test_both_points_of_a_circle(circle: str) -> None:
    """In this order; as relative motions both are left."""
    text = written(
        "L P[1] 100mm/sec FINE",
        circle,
        "L P[4] 100mm/sec FINE",
        **{f"P{k}": pose() for k in range(1, 5)},
    )
    assert corrected(text) == ["P[1]", "P[2]", "P[3]", "P[4]"]
    assert order(text) == [["P[1]"], ["P[2]", "P[1]"], ["P[3]", "P[2]"], ["P[4]", "P[3]"]]
    whys = left(text.replace("250mm/sec FINE", "250mm/sec FINE INC"))
    assert whys == dict.fromkeys(("P[2]", "P[3]"), "a relative motion (INC in line 5)")


def test_arcs_of_single_points_and_every_kind_of_motion() -> None:
    text = written(
        "J P[1] 100% FINE", "A P[2] 100mm/sec CNT50", "A P[3] 100mm/sec CNT50",
        "S P[4] 100mm/sec FINE",
        P1=JOINTS.format(more=""), P2=pose(), P3=pose(), P4=pose(),
    )  # fmt: skip
    assert order(text) == [["P[1]"], ["P[2]", "P[1]"], ["P[3]", "P[2]"], ["P[4]", "P[3]"]]


@pytest.mark.parametrize(
    "options",
    [
        "TB .10sec,CALL INC",
        "TA .10sec,P-INC",
        "Offset,PR[5:INC]",
        "SPOT[SD=3,INC=1]",
        "DB 5.0mm,DO[3:INC]=ON",
    ],
)
def test_inc_is_the_option_alone(options: str) -> None:
    assert corrected(written(f"L P[1] R[2:INC]mm/sec FINE {options}", P1=pose())) == ["P[1]"]


@pytest.mark.parametrize(
    "options", ["INC", "Offset,PR[1] INC", "inc TB .10sec,CALL GRIP(1)", "RTCP INC"]
)
def test_relative_motions(options: str) -> None:
    text = written(
        "L P[1] 100mm/sec FINE", f"L P[2] 100mm/sec FINE {options}", P1=pose(), P2=pose()
    )
    assert left(text) == {"P[2]": "a relative motion (INC in line 5)"}
    assert "corrected without" not in "".join(read(text).notes)


def test_registers_and_indirect_positions_are_reported() -> None:
    text = written(
        "L PR[3:home] 100mm/sec FINE", "L P[R[1]] 100mm/sec FINE", "J P[R[AR[1]]] 20% FINE INC",
        "L P[9] 1cm/min FINE",
        "C P[1] P[R[2:i]] 10mm/sec FINE", P1=pose(), P2=pose(),
    )  # fmt: skip
    assert said(text) == {
        4: "a register: its value is not in the program",
        5: "which position it is, a register tells (P[R[1]])",
        6: "a relative motion (INC): which position it is, a register tells (P[R[AR[1]]])",
        7: "P[9] is not among the positions for group 1",
        8: "which position it is, a register tells (P[R[2:i]])",
    }
    assert left(text) == {
        "P[2]": "may be used by a relative motion (P[R[AR[1]]] with INC in line 6)"
    }


@pytest.mark.parametrize(
    "option",
    [
        "Offset,PR[1]",
        "Tool_Offset,PR[1]",
        "WKZ_Offset ,PR[1]",
        "OFFSET",
        "VOFFSET,VR[1]",
        "Search[X]",
    ],
)
def test_offsets_are_noted(option: str) -> None:
    text = written(f"L P[1] 100mm/sek FEIN {option}", P1=pose())
    assert corrected(text) == ["P[1]"]
    assert read(text).notes == ("line 4: P[1] is corrected without its offset",)
    many = written(*[f"L P[1] 100mm/sec FINE {option}"] * 9, P1=pose())
    assert read(many).notes == (
        "lines 4, 5, 6, 7, 8 and 4 more: positions are corrected without their offsets",
    )


@pytest.mark.parametrize(
    "line",
    ["L P[1] 100mm/sec FINE RTCP", "L P[1] 100mm/sec CNT0 ACC100\n    :  TB .1sec,P-SPS RTCP"],
)
def test_remote_tcp(line: str) -> None:
    assert left(written(line, P1=pose())) == {
        "P[1]": "its tool: a remote TCP (RTCP in line 4): the robot holds the work piece "
        "and not the tool"
    }


def test_line_tracking() -> None:
    text = written(
        "L P[1] 100mm/sec FINE", attributes="\nLINE_TRACK_SCHEDULE_NUMBER\t: 2;", P1=pose()
    )
    assert left(text) == {"P[1]": "its frame: line tracking: a conveyor moves it"}
    assert corrected(text.replace(": 2;", ": 0;")) == ["P[1]"]


def test_positions_that_are_assigned() -> None:
    text = written("P[1]=PR[2]", "L P[1] 10mm/sec FINE", P1=pose())
    assert left(text) == {"P[1]": "it is assigned (line 4)"}


# --- frames ---------------------------------------------------------------------------------------


def test_current_frames_are_those_that_are_selected() -> None:
    text = written(
        "UFRAME_NUM=2", "UTOOL_NUM=1", "L P[1] 1mm/sec FINE", "UFRAME_NUM=R[1]",
        "L P[2] 1mm/sec FINE",
        P1=pose(uf="F", ut="F"), P2=pose(uf="F", ut="F"),
    )  # fmt: skip
    _, _, found, whys = followed(text)
    assert [(p.frame.name, p.tool.name) for p in found if p.frame and p.tool] == [("2", "1")]
    assert whys == {"P[2]": "its frame: UFRAME_NUM is told by R[1] (line 7)"}


@pytest.mark.parametrize(
    ("frame", "tool"),
    [("UFRAME_NUM", "UTOOL_NUM"), ("BENUTZER_NUM", "WKZ_NUM"), ("UFRAME_NUM[GP1]", "UTOOL_NUM[1]")],
)
def test_a_position_goes_with_the_frame_that_it_names(frame: str, tool: str) -> None:
    """Whatever is selected: with another selection the controller does not move.

    `F` goes with the selection.
    """
    text = written(f"{frame}=1", f"{tool}=3", "UFRAME_NUM[GP2]=4", "L P[1] 1mm/sec FINE",
        "L P[2] 1mm/sec FINE",
                   P1=pose(uf="2"), P2=pose(uf="F", ut="F"))  # fmt: skip
    _, _, found, _ = followed(text)
    assert [(p.frame.name, p.tool.name) for p in found if p.frame and p.tool] == [
        ("2", ""),
        ("1", "3"),
    ]


def test_branches_that_select_and_jumps() -> None:
    """What may be selected in one branch is in force behind both; a jump goes around it."""
    go, taught = "L P[1] 1mm/sec FINE", pose(uf="F")
    for several in (
        ("UFRAME_NUM=2", "IF R[1]=1 OR R[3,2]=1,UFRAME_NUM=1", go),
        ("IF (R[1]=1) THEN", "UFRAME_NUM=1", "ELSE", "UFRAME_NUM=2", "ENDIF", go),
        (
            "UFRAME_NUM=2",
            "SELECT R[1]=1,JMP LBL[1]",
            "       =2,JMP LBL[2]",
            "UFRAME_NUM=1",
            "LBL[1]",
            go,
            "LBL[2]",
        ),
        ("UFRAME_NUM=2", "LBL[1]", go, "UFRAME_NUM=1", "IF R[1]<4,JMP LBL[1]"),
        ("UFRAME_NUM=2", "JMP LBL[R[1]]", "LBL[1]", "UFRAME_NUM=1", "LBL[2]", go),
        ("UFRAME_NUM=2", "FOR R[1]=1 TO 5", go, "UFRAME_NUM=1", "ENDFOR"),
        ("UFRAME_NUM=2", "WAIT DI[1]=ON TIMEOUT,LBL[1]", "UFRAME_NUM=1", "LBL[1]", go),
        ("UFRAME_NUM=2", "L P[2] 1mm/sec FINE Skip,LBL[1]", "UFRAME_NUM=1", "LBL[1]", go),
        ("BENUTZER_NUM=2", "WENN E[1]=AN,SPRUNG LABEL[1]", "BENUTZER_NUM=1", "LABEL[1]", go),
    ):
        assert "several frames" in left(written(*several, P1=taught, P2=pose()))["P[1]"]
    for word, jump, label in (
        ("UFRAME", "JMP LBL[1]", "LBL[1:go]"),
        ("BENUTZER", "SPRUNG LABEL[1]", "LABEL[1]"),
    ):
        text = written(f"{word}_NUM=2", jump, f"{word}_NUM=1", label, go, P1=taught)
        assert [p.frame.name for p in followed(text)[2] if p.frame] == ["2"]
    ended = written("UFRAME_NUM=2", go, "END", "UFRAME_NUM=1", P1=taught)
    assert corrected(ended) == ["P[1]"]


def test_calls() -> None:
    """A program that is at hand is followed; one that is not may select anything."""
    main = written("UFRAME_NUM=2", "CALL SETUP(1)", "L P[1] 1mm/sec FINE", P1=pose(uf="F"))
    setup = written("UFRAME_NUM=3", name="SETUP")
    _, _, found, _ = followed(main, setup)
    assert [p.frame.name for p in found if p.frame] == ["3"]
    assert left(main) == {
        "P[1]": "its frame: may be selected by SETUP, which is not at hand (line 5)"
    }
    german = main.replace("UFRAME", "BENUTZER").replace("CALL", "AUFRUF")
    assert followed(german, setup)[2][0].frame == found[0].frame
    own = written("UFRAME_NUM=2", "CALL SETUP", "L P[1] 1mm/sec FINE", P1=pose(uf="1"))
    assert corrected(own) == ["P[1]"]


def test_frames_that_the_program_changes() -> None:
    text = written("UFRAME[2]=PR[4]", "UTOOL[GP1:R[3]]=PR[5]", "L P[1] 1mm/sec FINE",
        "L P[2] 1mm/sec FINE",
                   P1=pose(uf="2"), P2=pose(ut="1"), P3=pose())  # fmt: skip
    assert left(text) == {
        "P[1]": "its frame: it is assigned (line 4)",
        "P[2]": "its tool: it is assigned (line 5)",
    }


LISTING = """[*SYSTEM*]$MNUFRAME  Storage: SHADOW  Access: RW  : ARRAY[2,20] OF POSITION
    [1,1] =
  Group: 1   Config: N D B, 0, 0, 0
  X:  1024.500   Y:     -.500   Z:    84.000
  W:     0.000   P:     0.000   R:    90.000
    [1,2] =   'fixture' Uninitialized
    [2,1] =
  Group: 2   Config: N D B, 0, 0, 0
  X:     7.000   Y:     7.000   Z:     7.000
  W:     0.000   P:     0.000   R:     0.000
[*SYSTEM*]$MNUTOOL  Storage: SHADOW  Access: RW  : ARRAY[2,29] OF POSITION
    [1,1] =   'gun'
  Group: 1   Config: N D B, 0, 0, 0
  X:     0.000   Y:     0.000   Z:   150.000
  W:     0.000   P:   -30.000   R:     0.000
[*SYSTEM*]$MNUTOOLNUM  Storage: SHADOW  Access: RW  : ARRAY[2] OF BYTE
  [1] = 1
"""


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_frames_from_listings(end: str) -> None:
    text = written(
        "L P[1] 1mm/sec FINE", "L P[2] 1mm/sec FINE", P1=pose(uf="1", ut="1"), P2=pose(uf="2")
    )
    _, _, found, whys = followed(text, LISTING.replace("\n", end), given=NamedFrames())
    (position,) = found
    assert position.frame is not None
    assert position.tool is not None
    quarter = [[0, -1, 0, 1.0245], [1, 0, 0, -0.0005], [0, 0, 1, 0.084], [0, 0, 0, 1]]
    np.testing.assert_allclose(position.frame.T, quarter, atol=1e-12)
    half, root = 0.5, np.sqrt(0.75)
    np.testing.assert_allclose(
        position.tool.T[:3, :3], [[root, 0, -half], [0, 1, 0], [half, 0, root]], atol=1e-12
    )
    assert whys == {"P[2]": "frame '2' is not known; give it with --frames, [frames.2]"}
    given = followed(text, LISTING, given=ANY_FRAME)[2][0].frame
    assert given is not None
    assert given.T[0, 3] == pytest.approx(0.001)


def test_listings_that_differ_are_an_error() -> None:
    program = read(one(), LISTING, LISTING.replace("150.000", "151.000"))
    (remark,) = [remark for remark in program.remarks if remark.bad]
    assert (remark.line, remark.name, remark.source) == (14, "$MNUTOOL[1,1]", 2)
    assert not read(one(), LISTING, LISTING).remarks


# --- turn numbers and encodings -------------------------------------------------------------------


def axes(*configs: str, listing: str = "", name: str = "fanuc-m1000ia") -> set[tuple[int, ...]]:
    text = written(**{f"P{k}": pose(config=config) for k, config in enumerate(configs, start=1)})
    return {
        one.configuration.axes
        for one in read(text, listing, name=name).literals
        if one.configuration
    }


def test_which_joints_turn_numbers_count() -> None:
    assert axes("N U T, 0, 0, 1") == {(0, 3, 5)}
    assert axes("N U T, 0, -1, 0") == {(0, 3, 5)}
    assert axes("N U T, 1, 0, 0", "N U T, 0, 0, 0") == {
        (3, 4, 5)
    }  # joint 1 of this robot ends at 180 deg
    assert axes("N U T, 1, 0, 0", name="ur5") == {(0, 3, 5)}
    setting = (
        "[*SYSTEM*]$SCR_GRP  Storage: CMOS  Access: RW  : ARRAY[8] OF SCR_GRP_T\n"
        "     Field: $SCR_GRP[1].$TURN_AXIS  ARRAY[3] OF INTEGER\n      [1] = 4\n      [2] = 5\n"
        "      [3] = 6\n"
    )
    assert axes("N U T, 0, 0, 1", listing=setting) == {(3, 4, 5)}


def test_turn_numbers_stand_where_they_are_stated_to() -> None:
    text = one(config="F U T, 0, -1, 2")
    (literal,) = read(text).literals
    assert literal.configuration is not None
    digits = literal.configuration.numbers
    assert [text[d.start : d.end] for d in digits] == ["0", "-1", "2"]
    assert [d.value for d in digits] == [0, -1, 2]


@pytest.mark.parametrize("config", ["N U T, 0, 0, 0", "NUT,0,0,0", "N R U T, 0, 0, 0", "N U T"])
@pytest.mark.parametrize("word", ["CONFIG", "KONFIG"])
def test_ways_to_write_a_configuration(word: str, config: str) -> None:
    assert corrected(one(config=config).replace("CONFIG", word)) == ["P[1]"]


@pytest.mark.parametrize("encoding", ["cp932", "gbk", "utf-8"])
@pytest.mark.parametrize("name", ["一", "ー", "ソ", "能ゾーン"])
def test_names_in_any_encoding(name: str, encoding: str) -> None:
    text = written(
        f"L P[1:{name}] 100mm/sec FINE",
        f"L P[2:{name}] R[1:{name}]mm/sec INC",
        P1=pose(),
        P2=pose(),
    )
    text = text.replace("P[1]{", f'P[1:"{name}"]{{').replace("P[2]{", f'P[2:"{name}"]{{')
    data = text.encode(encoding).decode("latin-1")
    assert corrected(data) == ["P[1]"]
    assert left(data) == {"P[2]": "a relative motion (INC in line 5)"}


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends(end: str) -> None:
    text = written(
        "UFRAME_NUM=1",
        "C P[1] \n  : P[2] 1mm/sec FINE",
        "UTOOL[2]=PR[1]",
        P1=pose(),
        P2=pose(ut="2"),
    )
    program, _, found, whys = followed(text.replace("\n", end))
    assert [program.literals[p.literal].name for p in found] == ["P[1]"]
    assert whys == {"P[2]": "its tool: it is assigned (line 7)"}


def test_programs_one_after_the_other_in_a_text() -> None:
    """Each has positions of its own."""
    text = written("CALL B", "L P[1] 1mm/sec FINE", P1=pose()) + written(
        "L P[1] 1mm/sec FINE", name="B", P1=pose()
    )
    assert corrected(text) == ["P[1]", "P[1]"]
    assert sorted(order(text)) == [["P[1]"], ["P[1]", "P[1]"]]


def test_a_program_that_calls_itself_is_an_error() -> None:
    _, flow, _, _ = followed(written("CALL A", P1=pose()))
    assert [(r.line, r.why, r.bad) for r in flow.remarks] == [(4, "calls itself without end", True)]


def test_a_statement_that_never_ends_takes_linear_time() -> None:
    """Quadratic readers of lines or brackets would take hours."""
    for line in ("  : TB .1sec,\n", "[x", "P[1:"):
        text = written("L P[1] 1mm/sec FINE", P1=pose()).replace("FINE ;", "FINE " + line * 300_000)
        assert corrected(text) == ["P[1]"]


def test_what_is_cut_off_or_wrong_is_read_as_far_as_it_goes() -> None:
    """Unclosed brackets, no semicolons, labels that are not there."""
    for text in (
        "L P[1 100mm/sec",
        "C P[1] :",
        "JMP LBL[9]",
        "UFRAME_NUM=",
        "IF R[1]=1,",
        "CALL",
        "L P[1]] FINE INC]",
    ):
        assert "P[1]" in {literal.name for literal in read(written(text, P1=pose())).literals}
        read(written(text, P1=pose()).split("/POS")[0])
