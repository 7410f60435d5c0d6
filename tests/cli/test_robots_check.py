"""calibtool robots --check and --picture: a user's description looked at before
anything is measured.
"""

from pathlib import Path

from commandline import answer, refused, run

from calibtool.robot.catalogue import shipped

URDF = """<robot name="r"><link name="base"/><link name="arm"/><link name="tip"/>
<joint name="one" type="{one}"><parent link="base"/><child link="arm"/>
<axis xyz="0 0 1"/>{limit}</joint>
<joint name="two" type="revolute"><parent link="arm"/><child link="tip"/>
<origin xyz="1 0 0"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/>{mimic}</joint>{more}</robot>"""
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
FINGER = """<link name="finger"/>
<joint name="grip" type="prismatic"><parent link="arm"/><child link="finger"/>
<axis xyz="0 1 0"/><limit lower="0" upper="0.1" effort="1" velocity="1"/></joint>"""


def urdf(one: str = "revolute", limit: str = LIMIT, mimic: str = "", more: str = "") -> str:
    Path("mine.urdf").write_text(URDF.format(one=one, limit=limit, mimic=mimic, more=more))
    return "mine.urdf"


def test_a_built_in_robot() -> None:
    value = answer("robots", "--check", "planar-3r")
    assert value["schema"] == "calibtool/robot-check"
    assert value["reach_mm"]["from_base"] <= 1100
    text = run("robots", "--check", "planar-3r")
    assert "home_singular" in text.stdout
    assert "warnings" not in text.stdout
    assert text.stderr.startswith("warning: the URDF has no masses")


def test_a_copy_of_a_built_in_robot_is_distinguished_from_it() -> None:
    path = shipped("robots") / "planar-3r"
    Path("own").mkdir()
    for name in ("robot.toml", "robot.urdf"):
        Path("own", name).write_text((path / name).read_text())
    assert any(
        "also a robot of the catalogue" in w
        for w in answer("robots", "--check", "./own")["warnings"]
    )


def test_a_bare_urdf() -> None:
    warnings = answer("robots", "--check", urdf(more=FINGER))["warnings"]
    taken = (
        'a bare URDF, taken as [kinematics] tool_frame = "tip", locked_joints = { "grip" = 0.0 }'
    )
    assert warnings[0].startswith(taken)


def test_what_was_assumed_is_said_again_wherever_the_robot_is_used() -> None:
    """And what cannot be meant: limits in degrees."""
    wide = LIMIT.replace('"1"', '"90"', 1)
    path = urdf(limit=wide, more=FINGER)
    made = run("simulate", path, "-n", "40", "-o", "m.h5")
    fitted = run("identify", "m.h5", "-o", "c.h5")
    planned = run("plan", path, "-n", "10", "-o", "plan.csv")
    judged = run("report", "c.h5", "--on", "m.h5", "-o", "page.html")
    for said in (made, fitted, planned, judged):
        assert 'warning: mine: a bare URDF, taken as [kinematics] tool_frame = "tip"' in said.stderr
        assert "warning: mine: the limits of j1 look like degrees" in said.stderr
    for file in ("m.h5", "c.h5"):
        assert answer("info", file)["assumed"].startswith("a bare URDF, taken as [kinematics]")
    assert "a bare URDF, taken as [kinematics]" in Path("page.html").read_text()


def test_an_ambiguous_tool_is_asked_for_and_answered_on_the_spot() -> None:
    other = """<link name="left"/><link name="right"/>
    <joint name="l" type="fixed"><parent link="tip"/><child link="left"/></joint>
    <joint name="r" type="fixed"><parent link="tip"/><child link="right"/></joint>"""
    path = urdf(more=other)
    for command in (["robots", "--check", path], ["simulate", path, "-o", "m.h5"], ["plan", path]):
        said = refused(2, *command)
        assert said.startswith("mine: several links could be the tool: left, right; say which")
        run(*command, "--tool", "right", *(["-n", "8"] if "plan" in command else []))
    assert answer("info", "m.h5")["assumed"].startswith(
        'a bare URDF, taken as [kinematics] tool_frame = "right"'
    )
    assert "--tool needs a robot" in refused(2, "robots", "--tool", "right")
    assert "has its tool" in refused(2, "simulate", "ur5", "--tool", "tool0", "-o", "n.h5")


def test_what_is_wrong_ends_with_place_and_remedy() -> None:
    assert "no such file" in refused(2, "robots", "--check", "nowhere/robot.toml")
    message = refused(
        3, "robots", "--check", urdf(one="prismatic", limit='<limit effort="1" velocity="1"/>')
    )
    assert message.startswith("mine: slide 'one' has no limits")
    assert "[limits] j1_mm = " in message
    message = refused(3, "robots", "--check", urdf(mimic='<mimic joint="none"/>'))
    assert "joint 'two' between base and tool mimics 'none'" in message
    assert "lock it there" in message
    urdf()
    Path("mine.urdf").write_text(Path("mine.urdf").read_text().replace('<origin xyz="1 0 0"/>', ""))
    message = refused(3, "robots", "--check", "mine.urdf")
    assert "every configuration is singular" in message
    assert "lock one of them" in message
    urdf()
    floating = (
        Path("mine.urdf").read_text().replace('"two" type="revolute"', '"two" type="floating"')
    )
    Path("mine.urdf").write_text(floating)
    message = refused(3, "robots", "--check", "mine.urdf", "--tool", "tip")
    assert "'two' has 6 degrees of freedom" in message
    assert "make it fixed" in message


def test_a_picture() -> None:
    assert "home_singular" in run("robots", "--check", "planar-3r", "--picture", "arm.svg").stdout
    assert b"<svg" in Path("arm.svg").read_bytes()
    assert "arm.svg" in refused(2, "robots", "planar-3r", "--picture", "arm.svg")
    assert "plots are written as .png, .svg or .pdf" in refused(
        2, "robots", "planar-3r", "--picture", "arm.eps"
    )


def test_check_and_picture_need_a_robot() -> None:
    assert "--check needs a robot" in refused(2, "robots", "--check")
    assert "--picture needs a robot" in refused(2, "robots", "--picture", "a.png")
