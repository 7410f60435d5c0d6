"""robot.toml: what is wrong in it is said in one line, with its place,
before anything is computed.
"""

from importlib.metadata import PackageNotFoundError
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from calibtool.errors import InputError, UsageError
from calibtool.robot.catalogue import load_robot
from calibtool.robot.plausibility import implausible
from calibtool.robot.robot import Robot
from calibtool.robot.source import (
    Source,
    example_robot_data,
    parse_source,
    read_source,
    source_from_urdf,
)

LINKS = """
  <link name="base_link"/>
  <link name="arm"/>
  <link name="slide"/>
  <link name="tool0"/>
  <joint name="shoulder" type="revolute">
    <parent link="base_link"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="lift" type="prismatic">
    <parent link="arm"/><child link="slide"/><origin xyz="0.5 0 0"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.3" effort="1" velocity="1"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="slide"/><child link="tool0"/><origin xyz="0 0 -0.1"/>
  </joint>
"""
URDF = f'<robot name="crane">{LINKS}</robot>'
GRIPPER = """
  <link name="finger"/>
  <joint name="grip" type="prismatic">
    <parent link="arm"/><child link="finger"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.05" effort="1" velocity="1"/>
  </joint>
"""
TOML = """\
name = "crane"
title = "A crane of two joints"

[kinematics]
urdf = "crane.urdf"
tool_frame = "tool0"

[limits]
j1_deg = [-90, 90]

[targets]
points_mm = [[100, 0, 0], [0, 100, 0], [0, 0, 100]]

[workspaces.yard]
home = { j1_deg = 10, j2_mm = 150 }
box_m = [0.2, 0.2, 0.1]
cone_deg = 20
"""


def crane(folder: Path, toml: str = TOML, urdf: str = URDF) -> Path:
    """The path of a robot.toml with its URDF beside it."""
    (folder / "crane.urdf").write_text(urdf)
    (folder / "robot.toml").write_text(toml)
    return folder / "robot.toml"


def test_the_description_used_here_is_a_good_one(tmp_path: Path) -> None:
    robot = load_robot(str(crane(tmp_path)))
    assert (robot.name, robot.n, robot.prismatic) == ("crane", 2, [False, True])


# what stands in the good robot.toml, what stands there instead, what the message must say
BAD_TOML = {
    "unknown key": (
        'title = "A',
        'note = ["x"]\ntitle = "A',
        ["unknown key 'note'", "did you mean notes"],
    ),
    "misspelt required key": (
        'title = "A',
        'titel = "A',
        ["unknown key 'titel'", "did you mean title"],
    ),
    "unknown key of a table": (
        'urdf = "crane.urdf"',
        'urfd = "crane.urdf"',
        ["kinematics.urfd", "did you mean urdf"],
    ),
    "missing title": ('title = "A crane of two joints"', "", ["title", "required"]),
    "missing tool frame": ('tool_frame = "tool0"', "", ["kinematics.tool_frame", "required"]),
    "missing targets": (
        "[targets]\npoints_mm = [[100, 0, 0], [0, 100, 0], [0, 0, 100]]",
        "",
        ["targets", "required"],
    ),
    "no target point": ("[[100, 0, 0], [0, 100, 0], [0, 0, 100]]", "[]", ["targets.points_mm"]),
    "target of two coordinates": ("[100, 0, 0]", "[100, 0]", ["targets.points_mm.0"]),
    "two sources": (
        'urdf = "crane.urdf"',
        'urdf = "crane.urdf"\nexample_robot_data = "x.urdf"',
        ["kinematics", "exactly one of 'urdf' and 'example_robot_data'"],
    ),
    "no source": (
        'urdf = "crane.urdf"',
        "",
        ["kinematics", "exactly one of 'urdf' and 'example_robot_data'"],
    ),
    "unknown joint in limits": (
        "j1_deg = [-90, 90]",
        "j3_deg = [-90, 90]",
        ["limits", "'j3_deg'", "2 joints"],
    ),
    "no joint in limits": (
        "j1_deg = [-90, 90]",
        "shoulder = [-90, 90]",
        ["limits", "'shoulder'", "j1_deg"],
    ),
    "wrong unit in limits": (
        "j1_deg = [-90, 90]",
        "j2_deg = [-90, 90]",
        ["limits", "'j2_deg'", "prismatic", "mm"],
    ),
    "lower limit above upper": (
        "[-90, 90]",
        "[90, -90]",
        ["limits.j1_deg", "90 is not below the upper limit -90"],
    ),
    "empty joint range": ("[-90, 90]", "[90, 90]", ["limits.j1_deg", "not below"]),
    "limit that is no number": ("[-90, 90]", "[nan, 90]", ["limits.j1_deg.0"]),
    "infinite limit": ("[-90, 90]", "[-90, inf]", ["limits.j1_deg.1"]),
    "the whole range as a workspace's name": (
        "workspaces.yard",
        "workspaces.full",
        ["'full' is built in"],
    ),
    "home without a joint": (
        "home = { j1_deg = 10, j2_mm = 150 }",
        "home = { j1_deg = 10 }",
        ["yard.home", "j2"],
    ),
    "home in a wrong unit": (
        "j2_mm = 150",
        "j2_deg = 150",
        ["workspaces.yard.home", "'j2_deg'", "prismatic"],
    ),
    "negative box": ("box_m = [0.2,", "box_m = [-0.2,", ["workspaces.yard.box_m.0"]),
    "flat box": ("[0.2, 0.2, 0.1]", "[0.2, 0.2]", ["workspaces.yard.box_m"]),
    "cone beyond the sphere": ("cone_deg = 20", "cone_deg = 200", ["workspaces.yard.cone_deg"]),
    "unknown tool frame": ('"tool0"', '"tool1"', ["frame 'tool1'", "did you mean", "tool0"]),
    "unknown base frame": (
        '"tool0"',
        '"tool0"\nbase_frame = "bass_link"',
        ["frame 'bass_link'", "base_link"],
    ),
    "moving base frame": (
        '"tool0"',
        '"tool0"\nbase_frame = "arm"',
        ["base frame 'arm'", "shoulder"],
    ),
    "unknown locked joint": (
        '"tool0"',
        '"tool0"\nlocked_joints = { left = 0 }',
        ["locked joint 'left'", "did you mean", "lift"],
    ),
    "every joint locked": (
        '"tool0"',
        '"tool0"\nlocked_joints = { shoulder = 0, lift = 0 }',
        ["no joint"],
    ),
    "tool that no joint moves": (
        '"tool0"',
        '"base_link"\nlocked_joints = { lift = 0 }',
        ["shoulder", "not between base and tool"],
    ),
    "virtual joint of no kind": (
        "[targets]",
        '[equivalent]\nvirtual_joints = ["w"]\n[targets]',
        ["virtual_joints"],
    ),
    "too few virtual joints": (
        "[targets]",
        '[equivalent]\nvirtual_joints = ["rx"]\n[targets]',
        ["4 different"],
    ),
    "a virtual joint twice": (
        "[targets]",
        '[equivalent]\nvirtual_joints = ["rx", "ry", "rx", "y"]\n[targets]',
        ["4 different"],
    ),
    "name with a blank": ('name = "crane"', 'name = "my crane"', ["name"]),
    "no TOML": ('title = "A', "title = A", ["not valid TOML", "line 2"]),
    "missing URDF": (
        'urdf = "crane.urdf"',
        'urdf = "ladder.urdf"',
        ["ladder.urdf", "No such file"],
    ),
    "missing URDF of example-robot-data": (
        'urdf = "crane.urdf"',
        'example_robot_data = "crane_description/crane.urdf"',
        ["crane_description", "No such file"],
    ),
}


@pytest.mark.parametrize("case", BAD_TOML)
def test_a_bad_description_is_refused_in_one_line_with_its_place(case: str, tmp_path: Path) -> None:
    good, bad, findings = BAD_TOML[case]
    assert TOML.count(good) == 1
    path = crane(tmp_path, TOML.replace(good, bad))
    with pytest.raises(InputError) as caught:
        load_robot(str(path))
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith((str(path), str(tmp_path / "ladder.urdf"), str(example_robot_data())))
    for finding in findings:
        assert finding in message


def test_a_joint_with_two_limits_in_different_units_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="j1"):
        load_robot(
            str(
                crane(
                    tmp_path,
                    TOML.replace("j1_deg = [-90, 90]", "j1_deg = [-90, 90]\nj1_rad = [-1, 1]"),
                )
            )
        )


def test_limits_of_the_description_take_the_place_of_those_in_the_urdf(tmp_path: Path) -> None:
    robot = load_robot(str(crane(tmp_path)))
    assert robot.lower.tolist() == pytest.approx([-3.141592653589793 / 2, 0.0])
    assert robot.upper.tolist() == pytest.approx([3.141592653589793 / 2, 0.3])


def test_a_branching_tree_is_refused_until_its_other_joints_are_locked(tmp_path: Path) -> None:
    urdf = URDF.replace("</robot>", GRIPPER + "</robot>")
    with pytest.raises(InputError, match=r"grip .*lock"):
        load_robot(str(crane(tmp_path, urdf=urdf)))
    locked = TOML.replace(
        'tool_frame = "tool0"', 'tool_frame = "tool0"\nlocked_joints = { grip = 0.01 }'
    )
    assert load_robot(str(crane(tmp_path, locked, urdf))).n == 2


@pytest.mark.parametrize(
    ("urdf", "finding"),
    [
        ("", "cannot be read"),
        ("<robot", "cannot be read"),
        ('<robot name="r"><link name="a"/></robot>', "no movable joint"),
        (URDF.replace('"revolute"', '"floating"'), "shoulder.*degrees of freedom"),
        (URDF.replace('"revolute"', '"planar"'), "shoulder.*degrees of freedom"),
    ],
)
def test_a_urdf_without_a_serial_chain_is_refused(urdf: str, finding: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=finding):
        load_robot(str(crane(tmp_path, urdf=urdf)))


def test_a_folder_without_a_description_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"robot\.toml.*No such file"):
        load_robot(str(tmp_path))


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_bytes(b'name = "\xff\xfe"')
    with pytest.raises(InputError, match="UTF-8"):
        load_robot(str(tmp_path))


def test_the_texts_of_a_source_are_enough_to_build_it_again(tmp_path: Path) -> None:
    path = crane(tmp_path)
    source = read_source(path)
    assert source.toml_text == path.read_text()
    assert source.urdf_text == URDF
    again = parse_source(source.toml_text, source.urdf_text, "a file")
    assert again.description == source.description


def test_a_description_cannot_be_changed(tmp_path: Path) -> None:
    description = read_source(crane(tmp_path)).description
    with pytest.raises(ValidationError, match="frozen"):
        description.title = "another"


@pytest.mark.parametrize("name", ["crane", "my crane (v2)", "_crane", "Кран", "2nd"])
def test_a_bare_urdf_gets_a_description_whatever_its_file_is_called(name: str) -> None:
    source = source_from_urdf(URDF, name)
    assert isinstance(source, Source)
    assert source.description.kinematics.tool_frame == "tool0"
    assert Robot.from_source(source).n == 2


def test_a_slide_without_limits_takes_them_from_the_description_or_is_refused(
    tmp_path: Path,
) -> None:
    urdf = URDF.replace(
        '<limit lower="0" upper="0.3" effort="1" velocity="1"/>', '<limit effort="1" velocity="1"/>'
    )
    with pytest.raises(
        InputError,
        match=r"robot\.toml: slide 'lift' has no limits .* \[limits\] j2_mm = \[lower, upper\]",
    ):
        load_robot(str(crane(tmp_path, urdf=urdf)))
    given = TOML.replace("j1_deg = [-90, 90]", "j1_deg = [-90, 90]\nj2_mm = [0, 250]")
    assert load_robot(str(crane(tmp_path, given, urdf))).upper[1] == pytest.approx(0.25)


def test_a_joint_that_mimics_another_follows_it_on_the_way_and_may_be_locked_beside_it(
    tmp_path: Path,
) -> None:
    limit = 'upper="0.3" effort="1" velocity="1"/>'
    way = URDF.replace(limit, f'{limit}<mimic joint="shoulder" multiplier="0.1"/>')
    alone = TOML[: TOML.index("[workspaces")]  # whose home has two joints
    robot = load_robot(str(crane(tmp_path, alone, way)))
    assert robot.n == 1
    height = robot.mechanism.forward(np.array([[0.0], [1.0]]))[:, 2, 3]
    assert height[1] - height[0] == pytest.approx(0.1)  # 0.1 m per rad
    finger = GRIPPER.replace("</joint>", '<mimic joint="lift"/></joint>')
    locked = TOML.replace(
        'tool_frame = "tool0"', 'tool_frame = "tool0"\nlocked_joints = { grip = 0.01 }'
    )
    assert (
        load_robot(str(crane(tmp_path, locked, URDF.replace("</robot>", finger + "</robot>")))).n
        == 2
    )


def test_targets_in_metres_under_millimetres_are_said(tmp_path: Path) -> None:
    metres = TOML.replace("100", "0.1")
    assert "points_mm looks like m" in " ".join(
        implausible(load_robot(str(crane(tmp_path, metres))))
    )
    assert implausible(load_robot(str(crane(tmp_path)))) == []


def test_a_floating_joint_is_locked_at_0_only(tmp_path: Path) -> None:
    urdf = URDF.replace("</robot>", GRIPPER.replace("prismatic", "floating") + "</robot>")

    def locked(value: float) -> Robot:
        lines = f'tool_frame = "tool0"\nlocked_joints = {{ grip = {value} }}'
        return load_robot(str(crane(tmp_path, TOML.replace('tool_frame = "tool0"', lines), urdf)))

    assert locked(0.0).n == 2
    with pytest.raises(
        InputError, match=r"'grip' has 6 degrees of freedom; .*at 0 only, or made fixed in the URDF"
    ):
        locked(0.01)


def test_a_bare_urdf_that_branches_has_its_gripper_locked() -> None:
    source = source_from_urdf(URDF.replace("</robot>", GRIPPER + "</robot>"), "crane")
    assert source.description.kinematics.locked_joints == {"grip": 0.0}
    assert Robot.from_source(source).n == 2


def test_a_joint_and_a_link_may_share_a_name(tmp_path: Path) -> None:
    twins = URDF.replace('"slide"', '"lift"').replace('"flange"', '"tool0"')
    robot, plain = (load_robot(str(crane(tmp_path, urdf=urdf))) for urdf in (twins, URDF))
    assert list(robot.chain.model.names)[1:] == ["shoulder", "lift"]
    q = [[0.3, 0.1]]
    assert (robot.mechanism.forward(np.array(q)) == plain.mechanism.forward(np.array(q))).all()


def test_without_example_robot_data_the_remedy_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.distribution", missing)
    with pytest.raises(InputError, match="pip install example-robot-data"):
        example_robot_data()


def test_a_tolerance_of_a_joint_that_is_not_there_is_refused(tmp_path: Path) -> None:
    def described(joint: int) -> Robot:
        tolerance = f"[tolerances.joints.j{joint}]\nlength_mm = 2\nangle_mrad = 2\n"
        return load_robot(str(crane(tmp_path, TOML + tolerance)))

    assert described(3).n == 2  # j3 is the tool
    with pytest.raises(
        InputError, match=r"tolerances\.joints\.j4: the robot has 2 joints \(j3 is the tool\)"
    ):
        described(4)


def test_without_a_temporary_folder_the_remedy_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = crane(tmp_path)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    with pytest.raises(
        UsageError, match=r"temporary folder: No such file or directory; make room, or set TMPDIR"
    ):
        load_robot(str(folder))
