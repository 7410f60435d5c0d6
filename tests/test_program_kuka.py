"""KRL: what is found in programs and data lists, where it is used, what is left alone, and what is
refused, by line.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify
from calibtool.errors import InputError, NoSolutionError
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.programs.agreement import Position, positions
from calibtool.programs.compensate import compensate_program, compensate_texts
from calibtool.programs.correction import ProgramOptions
from calibtool.programs.formats import read_program
from calibtool.programs.frames import NamedFrames, pose, poses
from calibtool.programs.motion_flow import Flow, follow
from calibtool.programs.motions import Program, ProgramText
from calibtool.robot.catalogue import load_robot
from calibtool.robot.inverse import inverse_kinematics
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, inverse

FOLDER = Path(__file__).parent / "programs"
HOME = "PTP {A1 12,A2 14,A3 -6,A4 8,A5 -66,A6 15}"
FIRST = "{X 2300.597,Y 438.964,Z 606.965,A -149.8734,B 1.7156,C -171.7508}"
SECOND = "{X 2299.837,Y 706.587,Z 457.323,A -150.2565,B -8.9167,C -175.9581}"
THIRD = "{X 2046.373,Y 890.356,Z 478.859,A -145.0649,B 2.8136,C -170.7258}"
ZERO = ["$TOOL=$NULLFRAME", "$BASE=$NULLFRAME"]
SHIFT, TURN = "{X 100,Y 0,Z 0,A 0,B 0,C 0}", "{X 0,Y 0,Z 0,A 90,B 0,C 0}"


@cache
def robot(name: str = "fanuc-m1000ia") -> Robot:
    return load_robot(name)


@cache
def calibration() -> Calibration:
    simulation = Simulation(seed=7, workspace=robot().workspace(), configurations=60)
    return identify(simulate(robot(), simulation), "local-poe")


def routine(*lines: str, start: Sequence[str] = ZERO) -> str:
    return "\n".join(["DEF a( )", *start, *lines, "END", ""])


def read(*texts: str, name: str = "fanuc-m1000ia") -> Program:
    """A program of texts, data lists with the name `a.dat`."""
    sources = [ProgramText("a.dat" if "DEFDAT" in text else "a.src", text) for text in texts]
    return read_program("kuka-krl", sources, robot(name))


def followed(*texts: str) -> tuple[Program, Flow, list[Position], dict[int, str]]:
    """The program, its uses, positions that can be corrected, and why others are left, by line."""
    program = read(*texts)
    flow = follow(program, NamedFrames())
    found, left = positions(program, flow)
    return program, flow, found, {program.literals[k].line: why for k, why in left.items()}


def whys(*texts: str) -> dict[int, str]:
    """Why something is left, by line."""
    program, flow, _, left = followed(*texts)
    return left | {r.line: r.why for r in (*program.remarks, *flow.remarks)}


def places(*texts: str) -> dict[int, tuple[Array, Array]]:
    """Base and tool of the positions that can be corrected, by line."""
    program, _, found, _ = followed(*texts)
    return {
        program.literals[p.literal].line: (p.frame.T, p.tool.T)
        for p in found
        if p.frame is not None and p.tool is not None
    }


def bad(text: str, name: str = "fanuc-m1000ia") -> dict[int, str]:
    """Errors by line."""
    program = read(text, name=name)
    return {r.line: r.why for r in program.remarks if r.bad} | {
        literal.line: literal.not_corrected for literal in program.literals if literal.bad
    }


def frame(text: str) -> Array:
    """T (4, 4) of an aggregate."""
    numbers = [float(part.split()[1]) for part in text.strip("{}").split(",")]
    return pose([*np.array(numbers[:3]) * 1e-3, *np.deg2rad(numbers[3:])], "intrinsic-zyx")


# --- samples --------------------------------------------------------------------------------------


def text_of(sample: str) -> str:
    return (FOLDER / sample).read_text(encoding="latin-1")


def test_a_program() -> None:
    program, _, found, left = followed(text_of("drill.src"))
    assert {program.literals[p.literal].line for p in found} == {9, 10, 11}
    assert left == {
        13: "a position without A2, A3, A4, A5, A6: the rest is where the robot stands",
        14: "a variable or an expression (X is 'xpos')",
        17: "frame '7' is not known; give it with --frames, [frames.7]",
    }
    assert whys(text_of("drill.src")) == left | {
        12: "a relative motion",
        15: "'XHOME' is a variable that no file gives a position",
    }
    base, tool = places(text_of("drill.src"))[10]
    np.testing.assert_allclose(base, frame(SHIFT))
    np.testing.assert_allclose(tool, np.eye(4))


def test_a_data_list() -> None:
    """Tool and base of XP1 are those of FP1; a frame that no motion goes to and load
    data are no targets.
    """
    program, _, found, left = followed(text_of("drill.dat"))
    assert [program.literals[p.literal].name for p in found] == ["XP0", "XP1"]
    assert left == {
        11: "tool '4' is not known; give it with --frames, [tools.4]",
        12: "external axes beside a pose",
        13: "a FRAME that no motion of this program goes to",
    }


@pytest.mark.parametrize(
    ("position", "why"),
    [
        ("{X NaN,Y 0,Z 0,A 0,B 0,C 0}", "X is 'NaN'"),
        ("{X 1e99,Y 0,Z 0,A 0,B 0,C 0}", "X is '1e99'"),
        ("{X 1,Y 0,Z 0,A 0,B 0,C 0,Q 4}", "'Q' is not known"),
        ("{X 1,Y 0,Z 0,A1 0,B 0,C 0}", "axes and a pose"),
        ("{X 1,Y 0,Z 0,A 0,B 0,C 0,S x}", "S or T"),
        ("{X 1,Y 0,Z 0", "not closed"),
    ],
)
def test_errors(position: str, why: str) -> None:
    assert why in bad(f"DEF a()\n\nPTP {position}\nEND\n")[3]
    assert why in bad(f"DEFDAT a\n\nDECL E6POS XP1={position}\nENDDAT\n")[3]


def test_axes_of_another_robot() -> None:
    text = "DEF a()\nPTP {A1 0,A2 0,A3 0,A4 0,A5 0,A6 0}\nEND\n"
    assert "has 4 joints" in bad(text, "scara")[2]


# --- base and tool --------------------------------------------------------------------------------


def test_base_and_tool_by_number_by_value_and_by_bas() -> None:
    where = places(
        routine(
            f"TOOL_DATA[3]={SHIFT}",
            "BAS(#TOOL,3)",
            "BAS (#BASE, 0)",
            f"LIN {FIRST}",
            f"$BASE={{FRAME: {SHIFT[1:]}",
            "$TOOL=$NULLFRAME",
            f"LIN {SECOND}",
            start=(),
        )
    )
    np.testing.assert_allclose(where[5], (np.eye(4), frame(SHIFT)))
    np.testing.assert_allclose(where[8], (frame(SHIFT), np.eye(4)))


def test_initmov_is_the_world_and_tool_1() -> None:
    """As KUKA's own bas.src does it."""
    text = routine(f"$BASE={SHIFT}", "BAS(#INITMOV,0)", f"LIN {FIRST}", start=())
    assert "tool '1' is not known" in whys(text)[4]
    data = f"DEFDAT $CONFIG\nTOOL_DATA[1]={SHIFT}\nENDDAT\n"
    np.testing.assert_allclose(places(text, data)[4], (np.eye(4), frame(SHIFT)))


@pytest.mark.parametrize(
    ("lines", "T"),
    [
        ([f"$BASE={SHIFT}:{TURN}"], frame(SHIFT) @ frame(TURN)),
        ([f"$BASE={TURN}", f"$BASE=$BASE:{SHIFT}"], frame(TURN) @ frame(SHIFT)),
        ([f"BASE_DATA[2]={TURN}", "BASE_DATA[2].Z=-300", "$BASE=BASE_DATA[2]"],
            frame(TURN.replace("Z 0", "Z -300"))),
        (["DECL FRAME F", f"F={TURN}", "F.X=100", "$BASE=F"], frame(TURN.replace("X 0", "X 100"))),
        (["DECL FRAME F", "DECL FRAME G", f"G={TURN}", f"F=G:{SHIFT}", "$BASE=F"],
            frame(TURN) @ frame(SHIFT)),
        ([f"$BASE=$WORLD:{TURN}"], frame(TURN)),
    ],
)  # fmt: skip
def test_the_base_is_followed(lines: list[str], T: Array) -> None:
    text = routine(*lines, f"LIN {FIRST}")
    (base, _) = places(text)[text[: text.index("LIN")].count("\n") + 1]
    np.testing.assert_allclose(base, T, atol=1e-12)


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        (["IF $IN[1] THEN", f"$BASE={SHIFT}", "ENDIF"], "several frames"),
        (["FOR i=1 TO 3", f"$BASE=$BASE:{SHIFT}", "ENDFOR"], "different|several"),
        (["WHILE $IN[1]", f"$BASE={SHIFT}", "ENDWHILE"], "several frames"),
        (["REPEAT", f"$BASE={SHIFT}", f"LIN {SECOND}", "$BASE=$NULLFRAME", "UNTIL TRUE",
            f"$BASE={TURN}"], None),
        (["$BASE=BASE_DATA[nr]"], r"its number is a variable \(nr, line 4\)"),
        (["$BASE=measured(3)"], "computed"),
        (["$BASE=$POS_ACT"], "read from the robot"),
        (["$BASE.X=$BASE.X+10"], "a component of it is assigned"),
        (["BAS(#EX_BASE,1)"], "an external kinematic"),
        (["$IPO_MODE=#TCP"], "the robot holds the work piece"),
    ],
)  # fmt: skip
def test_a_base_that_is_not_known(lines: list[str], why: str | None) -> None:
    text = routine(*lines, f"LIN {FIRST}")
    last = text.count("\n") - 1
    if why is None:
        assert last in places(text)
    else:
        assert any(part in whys(text)[last] for part in why.replace("\\", "").split("|"))


def test_a_base_that_a_routine_sets() -> None:
    text = routine("turned( )", f"LIN {FIRST}") + f"DEF turned( )\n$BASE={TURN}\nEND\n"
    np.testing.assert_allclose(places(text)[5][0], frame(TURN))


def test_a_routine_that_no_file_holds_is_noted() -> None:
    text = routine("GRIP_OPEN( )", f"LIN {FIRST}")
    assert read(text).notes == (
        "no file holds GRIP_OPEN: taken to leave $BASE and $TOOL as they are",
    )
    assert read(text + "DEF GRIP_OPEN( )\nEND\n").notes == ()


# --- inline forms ---------------------------------------------------------------------------------

LIST = (
    "DEFDAT a PUBLIC\n"
    f"DECL E6POS XP1={FIRST[:-1]},S 2,T 35,E1 0.0,E2 9E9}}\n"
    'DECL FDAT FP1={TOOL_NO 2,BASE_NO 1,IPO_FRAME #BASE,POINT2[] " "}\n'
    "ENDDAT\n"
)
TABLES = (
    f"DEFDAT $CONFIG\nDECL FRAME TOOL_DATA[16]\nTOOL_DATA[2]={SHIFT}\nBASE_DATA[1]={TURN}\nENDDAT\n"
)
FORMS = [
    ["FDAT_ACT=FP1", "BAS(#CP_PARAMS,2)", "LIN XP1 C_DIS"],
    ["FDAT_ACT={TOOL_NO 2,BASE_NO 1,IPO_FRAME #BASE}", "BAS(#FRAMES)", "PTP XP1"],
    ["SLIN XP1 WITH $VEL=SVEL_CP(2,,LC), $TOOL=STOOL2( FP1), $BASE= SBASE(FP1.BASE_NO),"
     "$IPO_MODE=SIPO_MODE(FP1.IPO_FRAME) C_SPL"],
    ["SPLINE WITH $TOOL=STOOL2(FP1), $BASE=SBASE(FP1.BASE_NO)", "SPL XP1", "ENDSPLINE"],
    ["$TOOL=TOOL_DATA[2]", "$BASE=BASE_DATA[1]", "SPTP XP1 C_SPL"],
]  # fmt: skip


@pytest.mark.parametrize("lines", FORMS)
def test_inline_forms(lines: list[str]) -> None:
    text = routine(";FOLD LIN P1 Tool[9]:x Base[9];%{PE}", *lines, ";ENDFOLD")
    program, flow, found, left = followed(text, LIST, TABLES)
    (position,) = found
    assert program.literals[position.literal].name == "XP1"
    np.testing.assert_allclose(places(text, LIST, TABLES)[2], (frame(TURN), frame(SHIFT)))
    assert [use.obeyed for use in flow.uses] == ["PTP" in text]
    assert not left


def test_a_setting_of_one_motion_holds_for_it_alone() -> None:
    text = routine(f"SLIN {FIRST} WITH $BASE={SHIFT} C_SPL", f"SLIN {SECOND}")
    where = places(text)
    np.testing.assert_allclose(where[4][0], frame(SHIFT))
    np.testing.assert_allclose(where[5][0], np.eye(4))


def test_a_point_of_a_data_list_alone_has_the_frames_of_its_form() -> None:
    np.testing.assert_allclose(places(LIST, TABLES)[2], (frame(TURN), frame(SHIFT)))
    held = LIST.replace("#BASE", "#TCP")
    assert "the robot holds the work piece" in whys(held, TABLES)[2]
    assert "does not state its frame" in whys(LIST.replace("FP1", "FP2"))[2]


# --- positions ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "circle",
    [f"CIRC XP1,{SECOND},CA 90 C_DIS", f"SCIRC {FIRST} , XP2 WITH $VEL.CP=1", "CIRC P[1],P[2]"],
)
def test_both_points_of_a_circle(circle: str) -> None:
    points = f"XP1={FIRST}", f"XP2={SECOND}", f"P[1]={FIRST}", f"P[2]={SECOND}"
    used = [p for p in points if p.split("=")[0] in circle]
    _, flow, found, left = followed(routine(*used, HOME, circle))
    assert [(use.motion, use.obeyed) for use in flow.uses[1:]] == [(circle.split()[0], False)] * 2
    assert len(found) == 3
    assert not left


def test_arrays_in_programs_and_lists() -> None:
    data = f"DEFDAT a\nDECL E6POS P[3]\nP[1]={FIRST}\nP[2]={SECOND}\nENDDAT\n"
    text = routine("FOR i=1 TO 2", "LIN P[i]", "ENDFOR")
    _, flow, found, left = followed(text, data)
    assert sorted(use.literal for use in flow.uses) == [0, 1]
    assert len(found) == 2
    assert not left
    assert "does not state its frame" in whys(routine("LIN P[1]"), data)[4]


@pytest.mark.parametrize("change", ["XP1.A=12", "XP1.S=2", "XP1 . E1 = track", "P[1].Y=P[1].Y+5"])
def test_a_component_that_is_assigned(change: str) -> None:
    name = change.split(".")[0].strip()
    text = routine(f"{name}={FIRST}", change, f"LIN {name}")
    assert whys(text) == {4: "a component of it is assigned (line 5)"}


@pytest.mark.parametrize(
    ("lines", "line", "why"),
    [
        ([f"XP1={FIRST}", f"XP2=XP1:{SHIFT}", "LIN XP2"], 6, "is relative to XP1 (line 5)"),
        ([f"DECL E6POS XP1={FIRST}", "PART=XP1", f"LIN {SHIFT}:XP1"], 4,
            "is used as a frame too (line 6)"),
        (["XP1=$POS_ACT", "LIN XP1"], 5, "is read from the robot ($POS_ACT, line 4)"),
        (["LIN $POS_INT"], 4, "read from the robot ($POS_INT)"),
        (["LIN near(XP1)"], 4, "an expression (near(XP1))"),
        (["LIN_REL {Z 50} C_DIS"], 4, "a relative motion"),
        (["SPTP_REL {A1 5}"], 4, "a relative motion"),
        (["PTP {E1 100}"], 4,
            "a position without X, Y, Z, A, B, C: the rest is where the robot stands"),
        ([f"LIN {FIRST[:-1]},E1 250.0}}"], 4, "external axes beside a pose"),
        ([f"DECL FRAME F={FIRST}"], 4, "a FRAME that no motion of this program goes to"),
    ],
)  # fmt: skip
def test_positions_left_alone(lines: list[str], line: int, why: str) -> None:
    assert whys(routine(*lines))[line] == why


def test_external_axes_beside_axes_and_axes_that_are_none() -> None:
    text = routine(HOME[:-1] + ",E1 250.0}", f"LIN {FIRST[:-1]},E1 0,E2 9E9,E3 9E+09}}")
    assert whys(text) == {}


def test_where_the_robot_stands_is_no_motion() -> None:
    assert whys(routine("PTP $POS_ACT", "PTP $AXIS_ACT")) == {}


def test_status_and_turn_are_obeyed_by_ptp_alone() -> None:
    moves = ["PTP", "SPTP", "LIN", "SLIN"]
    _, flow, _, _ = followed(routine(*(f"{move} {FIRST[:-1]},S 2,T 35}}" for move in moves)))
    assert [use.obeyed for use in flow.uses] == [True, True, False, False]


def test_parameters_and_local_names() -> None:
    """A position passed to a routine; the same name in two routines means two variables."""
    text = routine(f"XP1={FIRST}", "go(XP1)", "IF ok( XP1 ) THEN LIN XP1") + (
        f"DEF go(P:IN)\nDECL E6POS P\nDECL E6POS XP1\nXP1={SECOND}\nLIN P\nLIN XP1\nEND\n"
        "DEFFCT BOOL ok(Q:OUT)\nE6POS Q\nQ.Z=1\nRETURN TRUE\nENDFCT\n"
    )
    _, flow, _, left = followed(text)
    assert {(use.line, use.literal) for use in flow.uses} >= {(13, 1)}
    assert left[4] == "is changed by a routine (line 6)"
    assert 4 not in whys(text.replace("Q:OUT", "Q:IN"))
    assert 11 not in left


def test_a_structure_is_followed_by_its_member() -> None:
    text = routine(f"Pick.Above={FIRST}", "LIN Pick.Above")
    assert list(places(text)) == [4]
    inside = f"DEFDAT a\nDECL PICK P={{N 1,POS {FIRST}}}\nENDDAT\n"
    assert whys(inside) == {2: "stands in something that is not followed"}
    assert whys(routine(f"MOVE_TO({SECOND},100)"))[4] == "stands in something that is not followed"
    assert whys(f"DEFDAT a\nDECL LOAD L={{M 1,CM {FIRST},J {{X 0,Y 0,Z 0}}}}\nENDDAT\n") == {}


def test_a_frame_that_leads_a_product_is_no_position() -> None:
    text = routine("DECL FRAME PALLET", f"PALLET={SHIFT}", f"XP1={FIRST}", "LIN PALLET:XP1")
    assert whys(text) == {
        6: "is used as a frame too (line 7)",
        7: "relative to PALLET; the point itself is treated by itself",
    }


def test_tables_that_are_changed_by_a_variable_number() -> None:
    text = routine(f"BASE_DATA[1]={TURN}", f"BASE_DATA[nr]={SHIFT}", "BAS(#BASE,1)", f"LIN {FIRST}")
    assert "may be changed (its number is a variable, line 5)" in whys(text)[7]


def test_jumps_and_loops_that_are_left() -> None:
    text = routine(
        f"$BASE={TURN}", "LOOP", "IF $IN[1] THEN", "EXIT", "ENDIF", "$BASE=$NULLFRAME", "GOTO L",
        "ENDLOOP", "L:",
        f"LIN {FIRST}",
    )  # fmt: skip
    assert "several frames" in whys(text)[13]


# --- files, bytes and errors ----------------------------------------------------------------------


def test_lists_that_disagree_are_refused() -> None:
    other = TABLES.replace("X 100", "X 200").replace("$CONFIG", "cell")
    files = [("a.dat", LIST, True), ("$config.dat", TABLES, False), ("cell.dat", other, False)]
    texts = [(name, text.encode(), edited) for name, text, edited in files]
    with pytest.raises(InputError, match=r"cell\.dat:3: tool_data\[2\]: .* gives it another value"):
        compensate_texts(calibration(), texts, "kuka-krl")


def test_a_list_beside_a_program_is_corrected_with_it() -> None:
    program = routine(HOME, "FDAT_ACT=FP1", "BAS(#CP_PARAMS,2)", "LIN XP1", start=())
    data = LIST.replace("TOOL_NO 2,BASE_NO 1", "TOOL_NO 0,BASE_NO 0")
    texts = [("a.src", program.encode(), True), ("a.dat", data.encode(), True)]
    result = compensate_texts(calibration(), texts, "kuka-krl")
    alone = compensate_program(
        calibration(), routine(HOME, f"LIN {FIRST}").encode(), "a", "kuka-krl"
    )
    assert (result.targets, result.changed, result.left_alone) == (2, 2, ())
    new = result.texts[1].decode().split("=")[1].partition(",S")[0]
    assert new in alone.data.decode()


def test_line_ends_and_comments_of_any_bytes() -> None:
    """CR alone, comments in Shift JIS and GBK whose second bytes look like brackets, a
    semicolon in a string.
    """
    comment = ';\x83[\x83\x7b {X 1,Y 2,Z 3,A 0,B 0,C 0} \xd7\x7d "\r'
    text = (
        routine(HOME, 'MsgNotify("a;b{")', f"LIN {FIRST}")
        .replace("\n", "\r")
        .replace("PTP", comment + "PTP")
    )
    data = text.encode("latin-1")
    result = compensate_program(calibration(), data, "a.src", "kuka-krl")
    assert (result.targets, result.changed, result.left_alone) == (2, 2, ())
    assert result.data.count(b"\r") == data.count(b"\r")
    assert comment.encode("latin-1") in result.data


def test_untaught_axes_and_poses_are_reported() -> None:
    text = routine(HOME, "LIN {X 0,Y 0,Z 0,A 0,B 0,C 0}", "LIN {X 1,Y 0,Z 0,A 0,B 0,C 0}")
    options = ProgramOptions(on_error="skip")
    result = compensate_program(calibration(), text.encode(), "a", "kuka-krl", options)
    left = {remark.line: remark.why for remark in result.left_alone}
    assert left[5] == "not taught: its numbers are zero"
    assert "unreachable" in left[6]
    with pytest.raises(NoSolutionError, match=r"^a:6: LIN: the pose is unreachable"):
        compensate_program(calibration(), text.encode(), "a", "kuka-krl")


def test_a_routine_that_calls_itself() -> None:
    flow = followed("DEF a( )\na( )\nEND\n")[1]
    assert [(r.line, r.why, r.bad) for r in flow.remarks] == [(2, "calls itself without end", True)]


def test_many_lines_take_no_time_in_vain() -> None:
    """Unclosed braces and brackets on many lines are found by each line for itself."""
    text = "DEF a( )\n" + "LIN {X 1,Y (((([[[[\n" * 20000 + "END\n"
    assert len(bad(text)) == 20000
    blanks = " " * 50000
    for line in (
        f"a{blanks}b",
        f"a.b{blanks}c",
        f"BAS(#BASE,{blanks}",
        f"LIN a{blanks}(",
        f"$BASE=SBASE({blanks}",
    ):
        assert bad(routine(line)) == {}


# --- laws -----------------------------------------------------------------------------------------


@cache
def reached() -> Array:
    """Joint positions (N, 6) in deg near each other, so that a motion from any to any
    keeps its branch.
    """
    steps = np.random.default_rng(3).uniform(-6, 6, (12, 6))
    return np.round(np.array([12.0, 14, -6, 8, -66, 15]) + steps, 3)


def written(T: Array, base: Array, tool: Array) -> str:
    """A pose (4, 4) in a base and with a tool as KRL writes it."""
    here = inverse(base) @ T @ tool
    angles = Rotation.from_matrix(here[:3, :3]).as_euler("ZYX", degrees=True)
    numbers = [*here[:3, 3] * 1e3, *angles]
    return "{" + ", ".join(f"{k} {v:.7f}" for k, v in zip("XYZABC", numbers, strict=True)) + "}"


@pytest.mark.parametrize(
    "more",
    [
        "DEF in(q:OUT)\nE6POS q\nq.X=5\nEND\n",
        "DEF in(q:OUT)\nE6POS q\nin2(q)\nEND\nDEF in2(r:OUT)\nr={X 1,Y 0,Z 0,A 0,B 0,C 0}\nEND\n",
        "DEF in(q:OUT)\nE6POS q\nelsewhere(q)\nEND\n",
    ],
)
def test_a_position_that_inner_routines_change(more: str) -> None:
    """By reference through several routines; a copy on the way (`:IN`) ends it."""
    text = routine(f"XP1={FIRST}", "out(XP1)", "LIN XP1")
    outer = "DEF out(p{kind})\nE6POS p\nin(p)\nEND\n"
    assert whys(text + outer.format(kind=":OUT") + more)[4] == "is changed by a routine (line 5)"
    assert 4 not in whys(text + outer.format(kind=":IN") + more)


@pytest.mark.parametrize(
    "call",
    ["ext1(XP1)", 'SREAD(S[],ST,OF,"%f,",XP1.X)', 'RET=EKI_GetFrame("a,","b",XP1)', "CREAD(H,XP1)"],
)
def test_a_position_that_a_routine_elsewhere_may_change(call: str) -> None:
    """Its argument is passed by reference unless its declaration says
    `:IN`; an expression is none.
    """
    lines = [f"XP1={FIRST}", call, "LIN XP1"]
    assert whys(routine(*lines))[4].endswith(" (line 5)")
    name = call.removeprefix("RET=").partition("(")[0]
    kinds = ",".join(["E6POS :IN"] * 6)
    assert whys(f"EXT {name}({kinds})\n" + routine(*lines)) == {}
    assert whys(routine(*lines).replace("XP1)", "1+XP1.X)").replace("XP1.X)", "1)")) == {}


@pytest.mark.parametrize(
    "change",
    [
        'RET=EKI_GetFrame("a","b",$BASE)',
        'SREAD(S[],ST,OF,"%r",$BASE)',
        "ANIN ON $BASE.Z = 1.0*$ANIN[1]",
    ],
)
def test_a_base_that_is_read_from_outside(change: str) -> None:
    program, _, _, left = followed(routine(f"LIN {SECOND}", change, f"LIN {FIRST}"))
    assert list(left) == [6]
    assert left[6].startswith("its frame: ")
    assert left[6].endswith("line 5)")
    assert not program.notes


ASIDE = [
    ("INTERRUPT DECL 3 WHEN $IN[1] DO sub(XP1)", "INTERRUPT ON 3"),
    ("GLOBAL INTERRUPT DECL N WHEN $IN[1]==TRUE DO sub(XP1)", "INTERRUPT ON"),
    ("", "TRIGGER WHEN PATH=0 DELAY=0 DO sub(XP1) PRIO=-1"),
]


@pytest.mark.parametrize(("declares", "starts"), ASIDE)
@pytest.mark.parametrize("change", ["$BASE", "$TOOL"])
def test_what_changes_beside_the_motions(declares: str, starts: str, change: str) -> None:
    """Base and tool that an interrupt or trigger sets are uncertain from there on,
    also once set anew.
    """
    lines = [
        declares,
        f"LIN {SECOND}",
        starts,
        f"LIN {FIRST}",
        f"{change}=$NULLFRAME",
        f"LIN {THIRD}",
    ]
    sub = f"DEF sub(p:IN)\ninner()\nEND\nDEF inner()\n{change}={SHIFT}\nEND\n"
    found = whys(routine(*lines) + sub)
    kind = "frame" if change == "$BASE" else "tool"
    why = (
        f"its {kind}: may be changed at any time "
        f"({starts.partition(' WHEN')[0].removesuffix(' 3')} in line 6)"
    )
    assert found == {7: why, 9: why}
    assert whys(routine(*lines).replace(starts, "") + sub) == {}
    assert whys(routine("LOOP", *lines, "ENDLOOP") + sub).keys() == {6, 8, 10}


@pytest.mark.parametrize(("declares", "starts"), ASIDE)
def test_positions_that_change_beside_the_motions(declares: str, starts: str) -> None:
    text = routine(f"XP1={FIRST}", declares, starts, "LIN XP1", f"LIN {SECOND}")
    sub = "DEF sub(p:OUT)\nE6POS p\np.X=5\nEND\n"
    found = whys(text + sub)
    assert found.keys() == {4}
    assert "line " in found[4]
    assert whys(text + "DEF sub(p:OUT)\nE6POS p\nEND\n") == {}


@pytest.mark.parametrize("change", ["XP1.Z=600", "outside(XP1)", "XP2=XP1\nXP2.Z=600\nLIN XP2"])
def test_a_pose_that_is_left_beside_corrected_ones(change: str) -> None:
    """The path has a step there; joint targets are corrected beside it without one."""
    lines = [HOME, f"XP1={FIRST}", change, "LIN XP1"]
    for more, steps in (("", 0), (f"LIN {SECOND}", 1)):
        text = routine(*lines, more)
        result = compensate_program(calibration(), text.encode(), "a", "kuka-krl")
        assert result.changed == 1 + steps
        assert result.inconsistent == steps


@pytest.mark.parametrize(
    ("argument", "lines"), [("P[1]", {5}), ("P[]", {5, 6}), ("P[i].X", {5, 6})]
)
def test_elements_that_a_routine_elsewhere_may_change(argument: str, lines: set[int]) -> None:
    text = ["DECL E6POS P[2]", f"P[1]={FIRST}", f"P[2]={SECOND}", f"other({argument})"]
    assert whys(routine(*text, "LIN P[1]", "LIN P[2]")).keys() == lines


@pytest.mark.parametrize("what", ["$TOOL.Z", "BASE_DATA[2].X"])
def test_cyclic_reading_goes_on(what: str) -> None:
    """What is assigned behind it is overwritten again."""
    name = what.partition(".")[0]
    lines = [
        "$BASE=BASE_DATA[2]",
        f"LIN {SECOND}",
        f"ANIN ON {what} = 2*VOLT",
        f"{name}=$NULLFRAME",
        "$BASE=BASE_DATA[2]",
    ]
    text = routine("BASE_DATA[2]=$NULLFRAME", *lines, f"LIN {FIRST}")
    found = whys(text)
    assert list(found) == [10]
    assert found[10].endswith("(ANIN ON in line 7)")
    assert whys(text.replace("ANIN ON", "ANIN OFF")) == {}


@pytest.mark.parametrize("word", ["PTP", "SPTP"])
def test_the_mastering_position_stays(word: str) -> None:
    """All joints 0, in a motion and in a data list."""
    zero = "{A1 0,A2 0.0,A3 0,A4 0,A5 0,A6 0}"
    why = "a mastering position: all joints are zero"
    assert whys(routine(HOME, f"{word} {zero}")) == {5: why}
    assert whys(routine(f"{word} XH"), f"DEFDAT a\nDECL E6AXIS XH={zero}\nENDDAT\n") == {2: why}


@pytest.mark.parametrize("edit", ["XP2.Z=650", "XP2.X=XP2.X+5"])
def test_a_copy_that_is_edited_leaves_its_source(edit: str) -> None:
    """One literal cannot serve both places; it can where nothing goes to the copy."""
    lines = ["DECL E6POS XP1,XP2", f"XP1={FIRST}", "XP2=XP1", edit, "LIN XP1"]
    why = "a component of it is assigned (line 7)"
    assert whys(routine(*lines, "LIN XP2")) == {
        5: f"serves two places: of a copy, {why}",
        9: why,
    }
    assert whys(routine(*lines)) == {}


@st.composite
def programs(draw: st.DrawFn) -> tuple[str, list[int]]:
    """A program with bases, tools, arrays, circles and branches, and the configuration of each
    literal in order.
    """
    frames = {
        "$NULLFRAME": np.eye(4),
        SHIFT: frame(SHIFT),
        f"{TURN}:{SHIFT}": frame(TURN) @ frame(SHIFT),
    }
    base = tool = np.eye(4)
    poses_ = robot().mechanism.forward(np.deg2rad(reached()))
    lines, rows = [HOME], [-1]
    for k in range(draw(st.integers(1, 6))):
        row = draw(st.integers(0, len(poses_) - 1))
        kind = draw(
            st.sampled_from(["LIN", "PTP", "named", "array", "circle", "axes", "base", "tool"])
        )
        if kind in ("base", "tool"):
            choice = draw(st.sampled_from(sorted(frames)))
            lines.append(f"${kind.upper()}={choice}")
            base, tool = (frames[choice], tool) if kind == "base" else (base, frames[choice])
            continue
        here = written(poses_[row], base, tool)
        rows.append(row)
        if kind == "axes":
            lines.append(
                "PTP {"
                + ", ".join(f"A{j + 1} {v:.3f}" for j, v in enumerate(reached()[row]))
                + "} ; axes"
            )
        elif kind == "named":
            lines += [f"XP{k}={here}", "IF $IN[1] THEN", f"LIN XP{k} C_DIS", "ENDIF"]
        elif kind == "array":
            lines += [f"P{k}[1]={here}", f"SLIN P{k}[i]"]
        elif kind == "circle":
            rows.append(row)
            lines.append(f"CIRC {here},{here},CA 90 ; circle")
        else:
            lines.append(f"{kind} {here}")
    ends = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    return routine(*lines).replace("\n", ends), rows


@given(programs())
def test_corrections_come_back_and_other_bytes_stay(made: tuple[str, list[int]]) -> None:
    """The nominal arm at the corrected numbers stands where the corrected joints bring it; all
    else is as it was.
    """
    text, rows = made
    result = compensate_program(calibration(), text.encode("latin-1"), "a", "kuka-krl")
    assert not result.left_alone
    after = result.data.decode("latin-1")
    old, new = read(text), read(after)
    pieces = []
    for program, whole in ((old, text), (new, after)):
        spans = sorted((n.start, n.end) for literal in program.literals for n in literal.numbers)
        starts, ends = [0, *(end for _, end in spans)], [*(start for start, _ in spans), len(whole)]
        pieces.append([whole[a:b] for a, b in zip(starts, ends, strict=True)])
    assert pieces[0] == pieces[1]
    flow = follow(new, NamedFrames())
    found, left = positions(new, flow)
    assert not left
    for position in found:
        literal = new.literals[position.literal]
        row = rows[position.literal]
        q = np.array([12.0, 14, -6, 8, -66, 15]) if row < 0 else reached()[row]
        asked = robot().mechanism.forward(np.deg2rad(q[None]))[0]
        if literal.kind == "joint":
            T = calibration().forward(np.array([literal.values]))[0]
        else:
            assert position.frame is not None
            assert position.tool is not None
            T = (
                position.frame.T
                @ poses(np.array([literal.values]), "intrinsic-zyx")[0]
                @ inverse(position.tool.T)
            )
            nominal = inverse_kinematics(robot(), T[None], np.deg2rad(q[None]))
            assert nominal.reached[0]
            T = calibration().forward(nominal.q)[0]
        np.testing.assert_allclose(T, asked, atol=2e-6)


@given(st.text(alphabet='LINPTCRXP1{}[]:,=.() $;"\n\rAE69IFEND', max_size=200))
def test_any_text_is_read(text: str) -> None:
    follow(read(f"DEF a( )\n{text}\nEND\n"), NamedFrames())
