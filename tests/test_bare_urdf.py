"""Robots as they come: kinds of files, the tool, locked branches, implausible numbers."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from calibtool.errors import InputError, UsageError
from calibtool.evaluation.robot_check import check_robot
from calibtool.robot.catalogue import load_robot
from calibtool.robot.markup import decoded_xml, parse_xml
from calibtool.robot.plausibility import implausible
from calibtool.robot.robot import Robot

Q = np.random.default_rng(3).uniform(-1.5, 1.5, (20, 6))


def joint(name: str, parent: str, child: str, kind: str = "fixed", more: str = "") -> str:
    """A joint with the link that it carries."""
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}">'
        f'<parent link="{parent}"/><child link="{child}"/>{more}</joint>'
    )


def limit(low: object, high: object) -> str:
    return f'<limit lower="{low}" upper="{high}" effort="1" velocity="1"/>'


def arm(more: str = "", root: str = "base", joints: str = "joint", flange: str = "tool0") -> str:
    """Six joints from `base`; `flange` is 0.1 m behind the last one, unless it is empty."""
    at = ["0 0 0.3", "0.1 0 0.1", "0 0 0.5", "0.1 0 0.07", "0.3 0 0", "0.1 0 0"]
    parts, link = [], root
    for k, (axis, origin) in enumerate(zip(AXES, at, strict=True), start=1):
        inside = f'<origin xyz="{origin}"/><axis xyz="{axis}"/>{limit(-2.5, 2.5)}'
        parts.append(joint(f"{joints}_{k}", link, f"link_{k}", "revolute", inside))
        link = f"link_{k}"
    end = joint("mount", link, flange, more='<origin xyz="0 0 0.1"/>') if flange else ""
    return f'<robot name="sample"><link name="base"/>\n{"".join(parts)}{end}{more}</robot>'


AXES = ["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"]


def finger(name: str, on: str, more: str = "", kind: str = "prismatic") -> str:
    inside = f'<axis xyz="0 1 0"/>{limit(0, 0.04)}{more}'
    return joint(name, on, f"{name}_link", kind, inside)


@pytest.fixture
def read(tmp_path: Path) -> Callable[..., Robot]:
    """The robot of a text or of bytes in a file of some name."""

    def reading(text: str | bytes, name: str = "sample.urdf", tool: str | None = None) -> Robot:
        path = tmp_path / name
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return load_robot(str(path), tool)

    return reading


def chosen(robot: Robot) -> tuple[str, dict[str, float]]:
    kinematics = robot.source.description.kinematics
    return kinematics.tool_frame, kinematics.locked_joints


PALM = joint("palm_mount", "tool0", "palm")
MIMIC = '<mimic joint="left_finger" multiplier="-1" offset="0.01"/>'


@pytest.mark.parametrize(
    ("more", "flange", "tool", "locked"),
    [
        ("", "tool0", "tool0", {}),
        (joint("t", "link_6", "tcp") + joint("c", "link_6", "wrist_camera"), "", "tcp", {}),
        (joint("t", "tool0", "gripper_tcp"), "tool0", "tool0", {}),
        (joint("t", "link_6", "robot_flange"), "mounting_plate", "robot_flange", {}),
        (joint("t", "link_6", "aaa") + joint("u", "link_6", "ee_link"), "", "ee_link", {}),
        (joint("t", "link_6", "EndEffector"), "zzz", "EndEffector", {}),
        (joint("c", "link_6", "camera_optical_frame"), "", "link_6", {}),
        (joint("c", "link_6", "link_6_collision"), "", "link_6", {}),
        (joint("p", "link_6", "plate") + joint("c", "link_6", "ft_sensor"), "", "plate", {}),
        (finger("left_finger", "tool0"), "tool0", "tool0", {"left_finger": 0.0}),
        (
            PALM + finger("left_finger", "palm") + finger("right_finger", "palm", MIMIC),
            "tool0",
            "tool0",
            {"left_finger": 0.0, "right_finger": 0.01},
        ),
        (finger("left_finger", "link_6"), "", "link_6", {"left_finger": 0.0}),
        (finger("a", "link_6") + finger("b", "link_6", '<mimic joint="a"/>'), "", "link_6", "ab"),
        (finger("counterweight_piston", "link_2"), "tool0", "tool0", {"counterweight_piston": 0.0}),
        (
            joint("lid", "base", "box", "revolute", f'<axis xyz="0 1 0"/>{limit(0.2, 1)}'),
            "tool0",
            "tool0",
            {"lid": 0.2},
        ),
        (joint("ball", "base", "marker", "floating"), "tool0", "tool0", {"ball": 0.0}),
    ],
)
def test_the_tool_is_told_by_its_name_and_branches_are_locked(
    more: str, flange: str, tool: str, locked: object, read: Callable[..., Robot]
) -> None:
    robot = read(arm(more, flange=flange))
    assert robot.n == 6
    assert chosen(robot) == (tool, dict.fromkeys(locked, 0.0) if locked == "ab" else locked)
    assumed = robot.source.description.assumed
    assert assumed is not None
    assert "\n" not in assumed
    assert f'tool_frame = "{tool}"' in assumed
    assert all(name in assumed for name in chosen(robot)[1])


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_a_base_that_moves_freely_is_locked(kind: str, read: Callable[..., Robot]) -> None:
    robot = read(arm(joint("world_joint", "base", "footprint", kind), root="footprint"))
    assert (robot.n, chosen(robot)) == (6, ("tool0", {"world_joint": 0.0}))
    fixed = read(arm())
    np.testing.assert_array_equal(robot.mechanism.forward(Q), fixed.mechanism.forward(Q))


def test_a_camera_is_no_tool_in_other_languages(read: Callable[..., Robot]) -> None:
    text = arm(joint("k", "link_6", "kamera") + joint("f", "link_6", "flansch"), flange="")
    assert chosen(read(text))[0] == "flansch"
    text = arm(joint("k", "link_6", "kamera"), flange="")
    assert chosen(read(text))[0] == "link_6"


def test_names_of_public_urdfs(read: Callable[..., Robot]) -> None:
    """What public descriptions of arms call their frames, and what is beside them."""
    kuka = joint("a", "link_6", "iiwa_link_ee") + joint("b", "link_6", "iiwa_link_ee_kuka")
    assert chosen(read(arm(kuka, flange="")))[0] == "iiwa_link_ee"
    shapes = joint("a", "link_6", "fr3_link7_sc") + joint("b", "link_6", "fr3_link8")
    assert chosen(read(arm(shapes, flange="")))[0] == "fr3_link8"
    static = joint("m", "link_6", "palm_link") + joint("s", "palm_link", "gripper_static_link")
    moving = finger("gripper", "palm_link")
    assert chosen(read(arm(static + moving, flange=""))) == ("palm_link", {"gripper": 0.0})
    fingers = finger("hand_index_flex", "hand", kind="revolute")
    more = fingers + finger("hand_index_tip", "hand_index_flex_link", kind="revolute")
    hand = read(arm(joint("h", "link_6", "hand") + more, flange=""))
    assert (hand.n, chosen(hand)[0]) == (6, "hand")


def test_what_pinocchio_refuses_beside_the_kinematics_is_read(read: Callable[..., Robot]) -> None:
    plain = read(arm())
    for text in (
        arm().replace('<robot name="sample">', "<robot>"),
        arm().replace('effort="1"', 'effort="-1"'),
        arm().replace(' effort="1" velocity="1"', ""),
        arm('<material name="m"><color rgba="a b"/></material>'),
    ):
        np.testing.assert_array_equal(read(text).mechanism.forward(Q), plain.mechanism.forward(Q))


def two_arms() -> str:
    left = arm(joints="left", flange="left_tool0")
    other = (
        left.replace("link_", "other_")
        .replace('"left_', '"right_')
        .replace('"mount"', '"right_mount"')
    )
    return left.replace("</robot>", other[other.index("\n") :])


def test_where_two_links_could_be_the_tool_it_asks_and_tool_answers(
    read: Callable[..., Robot],
) -> None:
    with pytest.raises(UsageError, match=r"left_tool0, right_tool0; say which with --tool"):
        read(two_arms())
    robot = read(two_arms(), tool="right_tool0")
    assert chosen(robot) == ("right_tool0", {f"left_{k}": 0.0 for k in range(1, 7)})
    with pytest.raises(UsageError, match="plate_a, plate_b"):
        read(arm(joint("p", "link_6", "plate_a") + joint("o", "link_6", "plate_b"), flange=""))
    with pytest.raises(UsageError, match=r"--tool: 'tool_0' is no link .* did you mean tool0"):
        read(arm(), tool="tool_0")


def test_the_tool_of_a_description_is_not_asked_for(
    tmp_path: Path, read: Callable[..., Robot]
) -> None:
    with pytest.raises(UsageError, match="the robot ur5 of the catalogue has its tool"):
        load_robot("ur5", "tool0")
    read(arm())
    (tmp_path / "robot.toml").write_text(read(arm()).source.toml_text.replace("robot.", "sample."))
    with pytest.raises(UsageError, match=r"--tool: .*robot.toml names its tool_frame, 'tool0'"):
        load_robot(str(tmp_path), "tool0")
    assert load_robot(str(tmp_path)).n == 6


FOLLOWS = '<mimic joint="joint_2" multiplier="-1"/></joint>'
BEHIND_3 = '<link name="link_4"/>'
MIMICS = arm().replace(f"</joint>{BEHIND_3}", f"{FOLLOWS}{BEHIND_3}")


@pytest.mark.parametrize(
    "text",
    [
        MIMICS,
        MIMICS.replace("</robot>", "<gazebo><sensor:camera/></gazebo></robot>"),
        MIMICS.replace('name="sample"', 'name="sample" xmlns="http://example.org/arm"'),
        "\n" + '<?xml version="1.0"?>' + MIMICS,
        MIMICS.replace("<mimic ", "<u:mimic "),
        MIMICS.replace("<mimic ", "<Mimic "),
        MIMICS.replace("<", "<u:")
        .replace("<u:/", "</u:")
        .replace("u:robot ", 'u:robot xmlns:u="http://example.org/arm" '),
        f"<!-- a -- comment -->{MIMICS}",
    ],
    ids=[
        "plain",
        "prefix",
        "namespace",
        "blank line",
        "mimic prefix",
        "capital",
        "all prefixed",
        "hyphens",
    ],
)
def test_a_mimic_on_the_way_is_refused_however_the_xml_is_written(
    text: str, read: Callable[..., Robot]
) -> None:
    assert "mimic" in text.lower()
    with pytest.raises(InputError, match="joint 'joint_3' between base and tool mimics 'joint_2'"):
        read(text)
    assert read(text.replace(' joint="joint_2"', "").replace("imic ", "imicked ")).n == 6


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("ARM.URDF", arm().encode()),
        ("robot_description.xml", arm().encode()),
        ("robot_description", arm().encode()),
        ("latin.urdf", f"<?xml version='1.0' encoding='ISO-8859-1'?><!--ü-->{arm()}".encode("l1")),
        ("sixteen.urdf", f'<?xml version="1.0" encoding="UTF-16"?>{arm()}'.encode("utf-16")),
        ("cp.urdf", f"<?xml version='1.0' encoding='cp1252'?><!-- – -->{arm()}".encode("cp1252")),
        ("marked.urdf", arm().encode("utf-8-sig")),
        ("model.urdf", f'<?xml version="1.0"?><?xml-model href="urdf.xsd"?>{arm()}'.encode()),
        ("type.urdf", f"<!-- no <!DOCTYPE robot> here -->{arm()}".encode()),
    ],
)  # fmt: skip
def test_a_urdf_is_told_by_its_contents_and_read_by_its_encoding(
    name: str, data: bytes, read: Callable[..., Robot]
) -> None:
    plain = read(arm())
    np.testing.assert_array_equal(read(data, name).mechanism.forward(Q), plain.mechanism.forward(Q))


@pytest.mark.parametrize(
    ("name", "data", "word"),
    [
        ("scene.xml", '<mujoco model="arm"><worldbody/></mujoco>', "an MJCF of MuJoCo"),
        ("model.sdf", '<sdf version="1.6"><model name="a"/></sdf>', "an SDF of Gazebo"),
        ("mesh.urdf", "<COLLADA/>", "a COLLADA mesh"),
        ("odd.xml", "<settings/>", "an XML file with the root <settings>"),
        ("m.h5", b"\x89HDF\r\n\x1a\n\0\0", "an HDF5 file"),
        ("r.zip", b"PK\x03\x04\0\0", "a ZIP archive"),
        ("r.stl", "solid arm\nendsolid", "an STL mesh"),
        ("r.json", '{"joints": []}', "a JSON file"),
        ("r.txt", "an arm of six joints", "a text file of another kind"),
        ("r.bin", b"abc\0\0\1\2", "a binary file"),
        ("calibration.conf", "[mounting]\ndelta_a = [0, 0, 0, 0, 0, 0]\n", "calibration.conf"),
        ("b.urdf", b"<?xml version='1.0' encoding='odd'?><robot/>", "unknown encoding 'odd'"),
        ("c.urdf", b"<robot name='\xff'/>", "not a UTF-8 text file"),
    ],
)  # fmt: skip
def test_what_is_no_robot_is_refused_with_what_it_is(
    name: str, data: str | bytes, word: str, read: Callable[..., Robot]
) -> None:
    with pytest.raises(InputError) as caught:
        read(data, name)
    assert word in str(caught.value)
    assert name in str(caught.value)


def test_without_xacrodoc_the_way_to_expand_a_file_is_said(
    monkeypatch: pytest.MonkeyPatch, read: Callable[..., Robot]
) -> None:
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    for name in ("arm.xacro", "arm.urdf"):
        with pytest.raises(InputError, match=rf"{name}: a xacro file.* xacro {name} > robot.urdf"):
            read(arm().replace('"0 0 0.3"', '"0 0 ${h}"'), name)


def test_a_xacro_file_is_expanded_where_xacrodoc_is_installed(
    read: Callable[..., Robot],
) -> None:
    pytest.importorskip("xacrodoc")
    text = (
        arm()
        .replace('"0 0 0.3"', '"0 0 ${3 * h}"')
        .replace(
            '<link name="base"/>', '<xacro:property name="h" value="0.1"/><link name="base"/>', 1
        )
    )
    text = text.replace("<robot ", '<robot xmlns:xacro="http://ros.org/wiki/xacro" ')
    robot, plain = read(text, "sample.xacro"), read(arm())
    assert "a bare xacro file" in str(robot.source.description.assumed)
    np.testing.assert_allclose(robot.mechanism.forward(Q), plain.mechanism.forward(Q), atol=1e-12)
    with pytest.raises(InputError, match="xacro cannot expand it"):
        read(text.replace("3 * h", "no_such_property"), "sample.xacro")


UNUSED = '<xacro:property name="width" value="0.2"/>'


def test_a_property_that_nothing_refers_to_makes_no_xacro_file(
    monkeypatch: pytest.MonkeyPatch, read: Callable[..., Robot]
) -> None:
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    text = arm().replace("<robot ", '<robot xmlns:xacro="http://ros.org/wiki/xacro" ')
    head, tail = text.split('<link name="base"/>', 1)
    robot = read(f'{head}{UNUSED}<link name="base"/>{UNUSED}{tail}')
    np.testing.assert_array_equal(robot.mechanism.forward(Q), read(arm()).mechanism.forward(Q))
    inertial = '<inertial><mass value="${width}"/><origin xyz="0 0 0"/></inertial>'
    for more in (f'<link name="base">{inertial}</link>', '<xacro:arm/><link name="base"/>'):
        with pytest.raises(InputError, match="a xacro file"):
            read(f"{head}{UNUSED}{more}{tail}")


@pytest.mark.parametrize(
    ("follower", "leader"), [("joint_2", "joint_3"), ("joint_3", "joint_3"), ("joint_5", "joint_6")]
)
def test_a_joint_of_the_arm_that_mimics_itself_or_one_behind_is_no_gripper(
    follower: str, leader: str, read: Callable[..., Robot]
) -> None:
    before, behind = arm().split(f'<joint name="{follower}"')
    mimic = f'<mimic joint="{leader}"/></joint>'
    text = f'{before}<joint name="{follower}"{behind.replace("</joint>", mimic, 1)}'
    with pytest.raises(InputError, match=f"'{follower}' between base and tool mimics '{leader}'"):
        read(text)


def test_links_in_a_circle_are_named(read: Callable[..., Robot]) -> None:
    text = arm().replace('<parent link="base"/>', '<parent link="link_2"/>')
    with pytest.raises(InputError, match=r"in a circle .*link_2, link_1"):
        read(text)


def test_a_single_limit_leaves_the_other_at_zero(read: Callable[..., Robot]) -> None:
    """http://wiki.ros.org/urdf/XML/joint: lower and upper are 0 where they are not given."""
    robot = read(arm().replace('lower="-2.5" ', "", 1))
    assert (robot.lower[0], robot.upper[0]) == (0.0, 2.5)


def test_a_link_with_two_parents_is_named_with_its_joints(read: Callable[..., Robot]) -> None:
    rod = '<joint name="rod" type="revolute"><parent link="base"/><child link="link_3"/></joint>'
    with pytest.raises(
        InputError, match="link 'link_3' has two parent joints, 'joint_3' and 'rod'"
    ):
        read(arm(rod))


@pytest.mark.parametrize("name", ['tool"0', "grip\\tip", "werkzeug ü", "a'b", "tab\there", "]#="])
def test_every_name_goes_through_robot_toml(name: str, read: Callable[..., Robot]) -> None:
    quoted = name.replace('"', "&quot;").replace("\t", "&#9;")
    odd = joint(f"{quoted}_lid", "base", "box", "continuous")
    robot = read(arm(odd, flange=quoted))
    assert chosen(robot) == (name, {f"{name}_lid": 0.0})


def test_the_kinematics_are_those_that_pinocchio_reads_from_the_file(
    tmp_path: Path, read: Callable[..., Robot]
) -> None:
    text = arm(finger("left_finger", "tool0") + finger("lid_piston", "base"))
    robot = read(text)
    model = pin.buildModelFromUrdf(str(tmp_path / "sample.urdf"))
    data, poses = model.createData(), robot.mechanism.forward(Q)
    ids = [model.joints[model.getJointId(f"joint_{k}")].idx_q for k in range(1, 7)]
    for q, pose in zip(Q, poses, strict=True):
        full = pin.neutral(model)
        full[ids] = q
        pin.framesForwardKinematics(model, data, full)
        np.testing.assert_allclose(
            pose, data.oMf[model.getFrameId("tool0")].homogeneous, atol=1e-12
        )


@pytest.mark.parametrize(
    ("limits", "finding"),
    [
        (limit(-160, 160), "the limits of j5 look like degrees"),
        (limit(-25, 90), "the limits of j5 look like degrees"),
        (limit("-1e16", "1e16"), "j5 has limits beyond every joint's range: ±180 deg are assumed"),
        (limit(-1.0, 5e4), "j5 has limits beyond"),
        (limit(2, -2), "j5 has a lower limit above the upper one"),
        (limit(1, 1), "j5 has a lower limit equal to the upper one"),
        (limit(0, 0), "no limits for j5"),
        ("", "no limits for j5"),
        ('<limit effort="3" velocity="1"/>', "no limits for j5"),
    ],
)
def test_limits_that_cannot_be_meant_are_said(
    limits: str, finding: str, read: Callable[..., Robot]
) -> None:
    before, behind = arm().split('<origin xyz="0.3 0 0"/>')  # joint 5
    robot = read(f'{before}<origin xyz="0.3 0 0"/>{behind.replace(limit(-2.5, 2.5), limits, 1)}')
    assert robot.n == 6
    found = implausible(robot)
    assert any(finding in line for line in found), found
    assert set(found) <= set(check_robot(robot, "sample.urdf").warnings)
    if "are assumed" in finding:
        assert (robot.lower[4], robot.upper[4]) == (-np.pi, np.pi)


def test_limits_in_rad_that_are_read_as_degrees_are_said(read: Callable[..., Robot]) -> None:
    """MuJoCo's unit is the degree; the finding takes the place of a remedy that would not help."""
    bodies = [f'<body pos="0 0 0.3"><joint axis="{a}" range="-3.1 3.1"/>' for a in AXES]
    text = "<mujoco>{}<worldbody>" + "".join(bodies) + "</body>" * 6 + "</worldbody></mujoco>"
    degrees = read(text.format(""), "arm.xml")
    assert any("at most 3.1 deg, which look like rad" in line for line in implausible(degrees))
    radians = read(text.format('<compiler angle="radian"/>'), "arm.xml")
    np.testing.assert_allclose(radians.upper, np.rad2deg(degrees.upper), rtol=1e-9)
    assert implausible(radians) == []
    narrow = read(text.format("").replace("-3.1 3.1", "-0.1 0.1"), "arm.xml")
    with pytest.raises(InputError, match=r"every configuration is singular.* look like rad"):
        check_robot(narrow, "arm.xml")


def test_a_plausible_arm_has_no_findings(read: Callable[..., Robot]) -> None:
    turns = arm().replace(limit(-2.5, 2.5), limit(-12.6, 12.6))
    assert implausible(read(arm())) == implausible(read(turns)) == []
    for name in ("ur5", "gantry", "fanuc-m1000ia", "tiago-arm"):
        assert implausible(load_robot(name)) == []


def test_lengths_in_other_units_and_far_bases_are_said(read: Callable[..., Robot]) -> None:
    numbers = '"0 0 0.3"', '"0.1 0 0.1"', '"0 0 0.5"', '"0.1 0 0.07"', '"0.3 0 0"', '"0.1 0 0"'

    def scaled(factor: float) -> str:
        text = arm()
        for number in numbers:
            values = [f"{float(v) * factor:.12g}" for v in number.strip('"').split()]
            text = text.replace(number, f'"{" ".join(values)}"')
        return text

    assert "look like mm" in " ".join(implausible(read(scaled(1e3))))
    for factor in (100.0, 1 / 0.0254):
        assert "look like mm, cm or inches" in " ".join(implausible(read(scaled(factor))))
    tiny = scaled(1e-6).replace('"0 0 0.1"', '"0 0 1e-7"')
    assert "check the unit" in " ".join(implausible(read(tiny)))
    far = arm().replace('"0 0 0.3"', '"999999 0 0.3"')
    assert "name a base_frame near the arm" in " ".join(implausible(read(far)))


@pytest.mark.parametrize("rpy", ["0 90 0", "0 0 -180", "45 0 0"])
def test_angles_of_frames_in_degrees_are_said(rpy: str, read: Callable[..., Robot]) -> None:
    turned = arm().replace('<origin xyz="0 0 0.1"/>', f'<origin xyz="0 0 0.1" rpy="{rpy}"/>')
    assert "the rpy of mount looks like degrees" in " ".join(implausible(read(turned)))


def test_joints_locked_beyond_their_limits_are_said(
    tmp_path: Path, read: Callable[..., Robot]
) -> None:
    robot = read(arm(finger("left_finger", "tool0")))
    toml = robot.source.toml_text.replace("robot.urdf", "sample.urdf")
    (tmp_path / "robot.toml").write_text(toml.replace('"left_finger" = 0.0', '"left_finger" = 40'))
    found = implausible(load_robot(str(tmp_path)))
    assert found == ["locked beyond their limits: left_finger at 40 (limits 0 to 0.04); rad or m"]


def test_a_slide_with_limits_that_are_none_is_refused(read: Callable[..., Robot]) -> None:
    def slide(limits: str) -> str:
        inside = f'<axis xyz="0 0 1"/>{limits}'
        return arm(joint("z", "link_6", "tool0", "prismatic", inside), flange="")

    assert read(slide(limit(0, 0.3))).n == 7
    for limits, what in (
        ("", "has no limits"),
        (limit(1, 0), "has a lower limit above the upper one"),
        (limit(-1e16, 1e16), "has limits beyond every joint's range"),
    ):
        with pytest.raises(InputError, match=f"slide 'z' {what} in the URDF; give them in"):
            read(slide(limits))


def test_xml_that_is_none_says_its_line() -> None:
    with pytest.raises(InputError, match=r"x: the URDF cannot be read: line 3: mismatched tag"):
        parse_xml("<robot>\n<link>\n</robot>", "x", "URDF")
    with pytest.raises(InputError, match="nested deeper"):
        parse_xml("<a>" * 1000 + "</a>" * 1000, "x", "URDF")
    assert decoded_xml("<a>ü</a>".encode("utf-16"), "x") == "<a>ü</a>"


def slides(limits: str, turn: str) -> str:
    """The arm on a base of two slides and a turn."""
    axis = '<axis xyz="{}"/>'
    more = (
        joint("base_x", "base", "x", "prismatic", axis.format("1 0 0") + limits)
        + joint("base_y", "x", "y", "prismatic", axis.format("0 1 0") + limits)
        + joint(turn, "y", "footprint", "continuous", axis.format("0 0 1"))
    )
    return arm(more, root="footprint")


def test_a_base_on_wheels_is_locked_and_a_track_is_not(read: Callable[..., Robot]) -> None:
    free = dict.fromkeys(("base_x", "base_y", "base_theta"), 0.0)
    for limits in (limit(-999999, 999999), "", limit("-inf", "inf")):
        robot = read(slides(limits, "base_theta"))
        assert (robot.n, chosen(robot)[1]) == (6, free)
    assert read(slides(limit(-3, 3), "base_theta")).n == 9


def test_a_stroke_beyond_a_kilometre_is_no_stroke(
    tmp_path: Path, read: Callable[..., Robot]
) -> None:
    toml = read(slides(limit(-3, 3), "base_theta")).source.toml_text
    toml = toml.replace("robot.urdf", "sample.urdf") + "[limits]\nj1_m = [-999999, 999999]\n"
    (tmp_path / "robot.toml").write_text(toml)
    with pytest.raises(InputError, match=r"limits\.j1_m: -999999 to 999999 is beyond a kilometre"):
        load_robot(str(tmp_path))
