"""A circle is corrected with both of its points, or with neither."""

from functools import cache

import pytest

from calibtool.calibration import Calibration, identify
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.programs.agreement import half_circles
from calibtool.programs.compensate import compensate_program
from calibtool.robot.catalogue import load_robot

VIA = "{X 2299.837, Y 706.587, Z 457.323, A -150.2565, B -8.9167, C -175.9581}"
END = "{X 2300.597, Y 438.964, Z 606.965, A -149.8734, B 1.7156, C -171.7508}"
NONE = "9E9,9E9,9E9,9E9,9E9,9E9"
P_VIA = f"[[2299.837,706.587,457.323],[-0.066061,-0.25837,0.962275,-0.053919],[0,0,0,0],[{NONE}]]"
P_END = f"[[2300.597,438.964,606.965],[0.03311,-0.258144,0.96331,-0.065566],[0,0,0,0],[{NONE}]]"


@cache
def calibration() -> Calibration:
    robot = load_robot("fanuc-m1000ia")
    return identify(simulate(robot, Simulation(configurations=30, seed=7)), base="local-poe")


def krl(circle: str) -> str:
    home = "PTP {A1 12,A2 14,A3 -6,A4 8,A5 -66,A6 15}"
    frames = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n"
    return f"DEF weld( )\n{frames}{home}\n{circle}\nEND\n"


def rapid(circle: str) -> str:
    points = f" CONST robtarget p1:={P_VIA};\n CONST robtarget p2:={P_END};\n"
    return f"MODULE M\n{points} PROC main()\n  {circle}\n ENDPROC\nENDMODULE\n"


@pytest.mark.parametrize(
    ("text", "language", "why"),
    [
        (krl(f"CIRC {VIA},XOTHER"), "kuka-krl", "'XOTHER' is a variable"),
        (krl(f"CIRC XOTHER,{END}"), "kuka-krl", "'XOTHER' is a variable"),
        (krl(f"CIRC {VIA},{END[:-1]},E1 300}}"), "kuka-krl", "external axes"),
        (krl(f"SCIRC {VIA},{{X 10,Y 20}}"), "kuka-krl", "a position without Z"),
        (rapid("MoveC p1,pOther,v100,fine,tool0;"), "abb-rapid", "'pOther' is a variable"),
        (rapid("MoveC p1,CRobT(),v100,fine,tool0;"), "abb-rapid", "MoveC"),
    ],
)
def test_where_one_point_is_left_the_other_is_too(text: str, language: str, why: str) -> None:
    result = compensate_program(calibration(), text.encode(), "x", language)
    before, after = (
        [line for line in each.splitlines() if "PTP" not in line]
        for each in (text, result.texts[0].decode())
    )
    assert after == before
    told = "\n".join(result.summary("x"))
    assert "the other point of its circle is not corrected" in told
    assert why in told


@pytest.mark.parametrize(
    ("text", "language"),
    [
        (krl(f"CIRC {VIA},{END}"), "kuka-krl"),
        (rapid("MoveC p1,p2,v100,fine,tool0;"), "abb-rapid"),
        (rapid("MoveC p1,Offs(p2,0,0,5),v100,fine,tool0;"), "abb-rapid"),
    ],
)
def test_whole_circles_are_corrected(text: str, language: str) -> None:
    result = compensate_program(calibration(), text.encode(), "x", language)
    assert "circle" not in "\n".join(result.summary("x"))
    for number in ("2299.837", "2300.597"):
        assert number not in result.texts[0].decode()


def test_circles_that_share_points_are_left_together() -> None:
    both = [(1, frozenset({0}), frozenset({1})), (2, frozenset({1}), frozenset({2}))]
    assert half_circles(both, [0, 1, 2]) == {}
    assert set(half_circles(both, [0, 1])) == {0, 1}
    several = [(1, frozenset({0, 1}), frozenset({2, 3}))]
    assert half_circles(several, [0, 2, 3]) == {}
    assert set(half_circles(several, [2, 3])) == {2, 3}
