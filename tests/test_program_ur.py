"""URScript: what is found in scripts, where it is used, what is left alone, and what is
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
from calibtool.programs.motions import Frame, Program
from calibtool.programs.urscript import constant
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

FOLDER = Path(__file__).parent / "programs"
HOME = "[0, -1.4, 1.7, -1.9, -1.5, 0]"
POSE = "p[0.4, 0.2, 0.3, 0, 3.1, 0]"


@cache
def robot() -> Robot:
    return load_robot("ur5")


def read(text: str) -> Program:
    return reader("ur-script")(text, robot())


def followed(text: str) -> tuple[Program, Flow, list[Position], dict[int, str]]:
    """The program, its uses, positions that can be corrected, and why others are left, by line."""
    program = read(text)
    flow = follow(program, NamedFrames())
    found, left = positions(program, flow)
    whys = {program.literals[number].line: why for number, why in left.items()}
    return program, flow, found, whys


def corrected(text: str) -> dict[int, str]:
    """Kinds of the positions that can be corrected, by line."""
    program, _, found, _ = followed(text)
    return {program.literals[p.literal].line: program.literals[p.literal].kind for p in found}


def whys(text: str) -> dict[int, str]:
    """Why something is left, by line."""
    program, flow, _, left = followed(text)
    return left | {r.line: r.why for r in (*program.remarks, *flow.remarks)}


def tools(text: str) -> list[list[float]]:
    """Where the tools of all uses are, by line."""
    _, flow, _, _ = followed(text)
    found = [(use.line, tool) for use in flow.uses for tool in use.tools]
    places = [(line, tool.T[:3, 3].tolist()) for line, tool in found if isinstance(tool, Frame)]
    return [place for _, place in sorted(places)]


def test_a_script() -> None:
    text = (FOLDER / "pick.script").read_text(encoding="utf-8")
    program, flow, found, _ = followed(text)
    assert {program.literals[p.literal].line: program.literals[p.literal].kind for p in found} == {
        4: "joint",
        5: "pose",
        9: "joint",
        10: "pose",
        11: "pose",
        12: "joint",
    }
    assert whys(text) == {
        6: "a component of it is assigned (line 14)",
        13: "a relative motion (pose_trans)",
    }
    assert program.notes == ()
    for use in flow.uses:
        (tool,) = use.tools
        np.testing.assert_allclose(tool.T[:3, 3], [0, 0, 0.1])


def test_without_a_tool_it_is_reported_what_is_assumed() -> None:
    (note,) = read(f"movel({POSE})\n").notes
    assert "no set_tcp" in note
    assert read(f"set_tcp(p[0,0,0,0,0,0])\nmovel({POSE})\n").notes == ()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("movej([0, 1, 2])", "holds 3 values"),
        ("movel(p[0, 1, 2])", "holds 3 values"),
        ("movej([0, 1, 2, 3, 4, nan])", "'nan'"),
        ("movej([0, 1", "not closed"),
        ("movec(p[0,0,0,0,0,0], p[0,0,0,0,0,inf])", "'inf'"),
    ],
)
def test_errors(text: str, why: str) -> None:
    program = read(f"def a():\n  {text}\n")
    errors = [(r.line, r.why) for r in program.remarks if r.bad]
    errors += [(literal.line, literal.not_corrected) for literal in program.literals if literal.bad]
    (error,) = errors
    assert error[0] == 2
    assert why in error[1]


def test_a_start_of_the_inverse_kinematics_is_no_target() -> None:
    for text in (
        f"movej(get_inverse_kin({POSE}, qnear={HOME}))\n",
        f"movej(get_inverse_kin({POSE}, {HOME}))\n",
        f"q = {HOME}\nw = {POSE}\nmovej(get_inverse_kin(x=w, qnear=q))\n",
    ):
        program, flow, found, _ = followed(text)
        (use,) = flow.uses
        assert program.literals[use.literal].kind == "pose"
        assert [program.literals[k].kind for k in use.near] == ["joint"]
        assert [p.literal for p in found] == [use.literal]


def test_both_points_of_a_circle() -> None:
    positional = f"movec({POSE}, {POSE.replace('0.4', '0.5')}, a=1)\n"
    named = f"via = {POSE}\nmovec(pose_to={POSE.replace('0.4', '0.5')}, pose_via=via)\n"
    for text in (positional, named):
        program, flow, _, _ = followed(text)
        assert [program.literals[use.literal].values[0] for use in flow.uses] == [0.4, 0.5]
        assert [use.before for use in flow.uses] == [(), (0,)]


def test_tools_are_those_in_force() -> None:
    text = (
        f"tcp = p[0, 0, 0.2, 0, 0, 0]\nset_tcp(p[0, 0, 0.1, 0, 0, 0])\nmovel({POSE})\n"
        "set_tcp(tcp)\n"
        f"movel({POSE})\nmovej(get_inverse_kin({POSE}, tcp=p[0, 0, 0.3, 0, 0, 0]))\n"
    )
    assert tools(text) == [[0, 0, 0.1], [0, 0, 0.2], [0, 0, 0.3]]
    assert whys(text) == {1: "a frame or tool of others"}


def test_a_tool_that_depends_on_a_branch_or_an_input_is_not_known() -> None:
    branch = "if x:\n  set_tcp(p[0,0,0.1,0,0,0])\nelse:\n  set_tcp(p[0,0,0.2,0,0,0])\nend\n"
    assert "several tools" in whys(f"{branch}movel({POSE})\n")[6]
    assert "is computed" in whys(f"set_tcp(read_pose())\nmovel({POSE})\n")[2]


def test_a_variable_moved_to_with_several_tools_is_left_alone() -> None:
    text = f"a = {POSE}\nset_tcp(p[0,0,0.1,0,0,0])\nmovel(a)\nset_tcp(p[0,0,0.2,0,0,0])\nmovel(a)\n"
    assert whys(text) == {1: "used with several tools (lines 3, 5; set in lines 2, 4)"}


def test_a_variable_that_is_assigned_again_is_followed() -> None:
    text = f"a = {POSE}\nmovel(a)\na = {POSE.replace('0.4', '0.5')}\nmovel(a)\n"
    _, flow, found, left = followed(text)
    assert [(use.line, use.literal) for use in flow.uses] == [(2, 0), (4, 1)]
    assert (len(found), left) == (2, {})
    assert whys(f"a = {POSE}\na = get_actual_tcp_pose()\nmovel(a)\n") == {
        1: "no motion that is known goes there",
        3: "a relative motion (get_actual_tcp_pose)",
    }


def test_lists_of_positions() -> None:
    text = (
        f"w = [{POSE}, {POSE.replace('0.4', '0.5')}]\nmovel(w[1])\ni = 0\nwhile i < 2:\n"
        "  movel(w[i])\nend\n"
    )
    program, flow, _, _ = followed(text)
    assert [literal.name for literal in program.literals] == ["w[0]", "w[1]"]
    assert sorted((use.line, use.literal) for use in flow.uses) == [(2, 1), (5, 0), (5, 1)]
    joints = f"w = [{HOME}, {HOME}]\nmovej(w[0])\n"
    assert whys(joints) == {1: "no motion that is known goes there"}
    assert (
        "line 3" in whys(f"w = [{POSE}, {POSE}]\nmovel(w[0])\nw[0] = get_pose()\nmovel(w[0])\n")[4]
    )


def test_constant_expressions_are_numbers() -> None:
    text = "movej([d2r(90), -pi/2, 1.7, -1.9, 2*pi/3, 0])\n"
    (literal,) = read(text).literals
    np.testing.assert_allclose(literal.values, [np.pi / 2, -np.pi / 2, 1.7, -1.9, 2 * np.pi / 3, 0])
    assert [text[n.start : n.end] for n in literal.numbers] == [
        "90",
        "-pi/2",
        "1.7",
        "-1.9",
        "2*pi/3",
        "0",
    ]


@pytest.mark.parametrize(
    "text", ["x", "pi.real", "__import__('os')", "1/0", "1e999", "2**9", "(" * 190, "True", "'1'"]
)
def test_anything_else_is_no_constant(text: str) -> None:
    assert constant(text) is None


def test_functions_with_positions_as_arguments() -> None:
    text = (
        f"def go(w, depth):\n  movel(w)\nend\ndef main():\n  go({POSE}, 1)\n  v = {POSE}\n"
        "  go(depth=2, w=v)\nend\n"
    )
    program, flow, _, _ = followed(text)
    assert [(use.line, program.literals[use.literal].line) for use in flow.uses] == [(2, 5), (2, 6)]
    assert whys(text.replace(f"go({POSE}, 1)", "go(get_target_tcp_pose(), 1)"))[2].startswith(
        "a relative motion"
    )


def test_a_function_that_is_called_before_it_exists() -> None:
    text = f"def main():\n  go()\n  def go():\n    movel({POSE})\n  end\nend\n"
    assert whys(text)[2] == "is called before it exists (line 3)"
    apart = f"def main():\n  go()\nend\ndef go():\n  movel({POSE})\nend\nmain()\n"
    assert whys(apart) == {}


def test_a_pose_given_to_what_is_not_known_is_listed() -> None:
    text = f"def main():\n  my_weld({POSE}, 1)\n  force_mode({POSE}, 1)\nend\n"
    assert whys(text) == {
        2: "an argument of my_weld, which is no motion that is known",
        3: "an argument of force_mode, which is no motion that is known",
    }


@pytest.mark.parametrize("change", ["c[0]=0.1", "c[2]=c[2]+0.1"])
def test_a_position_whose_changed_copy_is_moved_to_serves_two_places(change: str) -> None:
    text = f"def a():\n b={POSE}\n c=b\n {change}\n movel(b)\n"
    left = whys(f"{text} movel(c)\nend\n")
    assert "serves two places: of a copy, a component of it is assigned (line 4)" in left[2]
    assert corrected(f"{text}end\n") == {2: "pose"}


@pytest.mark.parametrize("inner", ["set_tcp(p[0,0,0.1,0,0,0])", "sleep(1)\n tool()"])
def test_the_tool_is_not_known_once_a_thread_that_sets_it_runs(inner: str) -> None:
    tool = "def tool():\n set_tcp(p[0,0,0.1,0,0,0])\nend\n"
    text = f"{tool}thread t():\n {inner}\nend\ndef a():\n set_tcp(p[0,0,0,0,0,0])\n movel({POSE})\n"
    text += f" h = run t()\n movel({POSE})\n set_tcp(p[0,0,0,0,0,0])\n movel({POSE})\nend\n"
    start = text[: text.index("run")].count("\n") + 1
    why = f"its tool: thread t sets it too, and when is not known (line {start})"
    assert followed(text)[3] == dict.fromkeys((start + 1, start + 3), why)
    assert corrected(text) == {start - 1: "pose"}
    without = text.replace(inner, "sleep(1)")
    assert len(corrected(without)) == 3


def test_joints_that_are_solved_into_a_variable_are_treated_as_the_pose() -> None:
    tool = "p[0,0,0.1,0,0,0]"
    for given in ("", f", qnear={HOME}, tcp={tool}"):
        text = f"def a():\n set_tcp({tool})\n q=get_inverse_kin({POSE}{given})\n"
        moved = f"{text} set_tcp(p[0,0,0,0,0,0])\n movej(q, a=1)\nend\n"
        assert corrected(moved) == {3: "pose"}
        assert tools(moved) == [[0, 0, 0.1]]  # of the place where it is solved
    changed = moved.replace("movej(q", "q[0]=q[0]+1\n movej(q")
    assert corrected(changed) == {}
    assert "an argument of get_inverse_kin" in whys(changed)[3]
    elsewhere = text.replace(given, "") + f" movej({HOME})\n movej(q)\nend\n"
    assert corrected(elsewhere) == {
        4: "joint"
    }  # solved from where the robot stands before that motion


@pytest.mark.parametrize(
    ("lines", "places"),
    [
        (f"movel(pose_trans(feature, {POSE}))", 1),
        (f"b=pose_trans(feature, {POSE})\n movel(b)", 1),
        (f"b=pose_trans(feature, {POSE})", 0),
        (f"q=get_inverse_kin({POSE})\n movej({HOME})\n movej(q)", 1),
        (f"movel(pose_add({POSE}, p[0,0,0.1,0,0,0]))", 1),
        ("movel(pose_trans(get_actual_tcp_pose(), p[0,0,0.1,0,0,0]))", 0),
        (f"b={POSE}\n movel(b)\n movel(pose_trans(b, p[0,0,0.1,0,0,0]))", 0),
    ],
)
def test_places_of_motions_that_are_not_followed(lines: str, places: int) -> None:
    program = read(f"def a():\n {lines}\nend\n")
    assert sum(literal.moved_to for literal in program.literals) == places
