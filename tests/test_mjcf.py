"""MJCF as a robot: poses of MuJoCo itself, closed loops with an answer on paper, and refusals."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibtool.errors import InputError
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

RICH = """<mujoco model="rich">
  <compiler angle="degree" eulerseq="ZYx"/>
  <default>
    <joint axis="0 1 0" range="-100 100"/>
    <site size="0.01"/>
    <default class="turned">
      <joint axis="1 0 1" range="-1 2" limited="false"/>
      <site euler="0 0 30"/>
    </default>
  </default>
  <worldbody>
    <body name="table" pos="0 0 2"><freejoint/></body>
    <frame pos="0 0 0.5" euler="10 20 30">
      <body name="base" pos="0.1 0 0" quat="1 1 0 0">
        <inertial pos="0 0 0.1" mass="3" diaginertia="1 1 1"/>
        <body name="shoulder" pos="0 0 0.2" axisangle="1 2 0 40">
          <joint name="j1" pos="0.1 0.2 0.3" ref="15"/>
          <joint name="j2" class="turned"/>
          <inertial pos="0 0 0.1" mass="2" fullinertia="1 1 1 0.1 0.2 0.3"/>
          <frame pos="0 0.1 0" zaxis="1 1 1">
            <joint name="j3" type="slide" axis="0 0 2" range="-0.5 0.5" ref="0.1"/>
            <body name="elbow" pos="0.3 0 0" xyaxes="0 1 0 -2 1 0" childclass="turned">
              <joint name="j4" pos="0 0.05 0"/>
              <inertial pos="0 0 0.1" mass="1" diaginertia="1 1 1"/>
              <body pos="0.2 0 0" euler="0 -90 0">
                <joint name="j5" class="main" range="-2 2"/>
                <inertial pos="0 0 0.1" mass="1" diaginertia="1 1 1"/>
                <site name="tool_point" pos="0 0 0.1"/>
              </body>
            </body>
          </frame>
        </body>
      </body>
    </frame>
  </worldbody>
</mujoco>
"""
# Where MuJoCo 4.0 puts tool_point: mj_kinematics, site_xmat and site_xpos.
RICH_Q = np.array([[0, 0, 0, 0, 0], [0.3, -0.4, 0.2, 0.5, -0.6], [-0.7, 1.1, -0.3, -0.2, 0.9]])
RICH_POSES = [
    [
        [0.864809723082, -0.460195188801, 0.200809688679, 0.258185540778],
        [-0.455457147368, -0.550665633273, 0.699518511008, 0.09135661043],
        [-0.21133605886, -0.696410617765, -0.685820181746, 0.632936972343],
    ],
    [
        [0.808098819679, -0.007951446419, -0.588993270024, 0.177230695927],
        [0.463002213104, -0.609571534552, 0.643468332496, 0.012516155155],
        [-0.364150035417, -0.792691187515, -0.488912500292, 0.593957300736],
    ],
    [
        [-0.359022760995, -0.826762594638, 0.433089216207, 0.549163532847],
        [-0.871206882404, 0.130400831167, -0.473280246031, 0.043915016139],
        [0.334815210437, -0.547228686509, -0.767098129004, 0.732758603104],
    ],
]


@pytest.fixture
def read(tmp_path: Path) -> Callable[..., Robot]:
    def reading(text: str, tool: str | None = None, **others: str) -> Robot:
        for name, contents in others.items():
            (tmp_path / f"{name}.xml").write_text(contents)
        (tmp_path / "sample.xml").write_text(text)
        return load_robot(str(tmp_path / "sample.xml"), tool)

    return reading


def test_poses_are_those_of_mujoco(read: Callable[..., Robot]) -> None:
    robot = read(RICH)
    assert "tool_point" in str(robot.source.description.assumed)
    found = robot.mechanism.forward(RICH_Q)[:, :3]
    np.testing.assert_allclose(found, RICH_POSES, atol=2e-12)


def test_limits_references_and_masses_are_read(read: Callable[..., Robot]) -> None:
    robot = read(RICH)
    hundred = np.deg2rad(100)
    np.testing.assert_allclose(robot.lower, [-hundred, -np.pi, -0.5, -np.pi, -np.deg2rad(2)])
    np.testing.assert_allclose(robot.upper, [hundred, np.pi, 0.5, np.pi, np.deg2rad(2)])
    assert [inertia.mass for inertia in robot.chain.bodies.inertias] == [0.0, 0.0, 2.0, 1.0, 1.0]
    bare = RICH.replace(
        '<inertial pos="0 0 0.1" mass="2" fullinertia="1 1 1 0.1 0.2 0.3"/>', "<geom/>"
    )
    assert not any(inertia.mass for inertia in read(bare).chain.bodies.inertias)


def test_included_files_are_read_in_their_place(read: Callable[..., Robot]) -> None:
    start, end = RICH.index("<default>"), RICH.index("</default>\n  <world") + len("</default>")
    part = f"<mujocoinclude>{RICH[start:end]}</mujocoinclude>"
    robot = read(RICH[:start] + '<include file="part.xml"/>' + RICH[end:], part=part)
    np.testing.assert_array_equal(
        robot.mechanism.forward(RICH_Q), read(RICH).mechanism.forward(RICH_Q)
    )


# --- closed loops ---

R, S, H = 0.5, 0.25, 0.7  # base and platform radius, height in m
BASE = np.array(
    [[R * np.cos(a), R * np.sin(a), 0] for a in np.deg2rad([10, 110, 130, 230, 250, 350])]
)
TOP = np.array(
    [[S * np.cos(a), S * np.sin(a), H] for a in np.deg2rad([50, 70, 170, 190, 290, 310])]
)
LENGTHS = np.linalg.norm(TOP - BASE, axis=1)


def words(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)


def hexapod(sites: bool = False) -> str:
    """Six legs of two hinges and a slide each from the world to a platform that floats.

    sites: the legs are joined to it at sites, 10 mm above their ends.
    """
    legs, cuts, motors, sockets = "", "", "", ""
    for k, (foot, head) in enumerate(zip(BASE, TOP, strict=True)):
        legs += (
            f'<body name="cylinder{k}" pos="{words(foot)}" zaxis="{words(head - foot)}">'
            f'<joint name="x{k}" axis="1 0 0"/><joint name="y{k}" axis="0 1 0"/>'
            f'<body name="rod{k}" pos="0 0 {float(LENGTHS[k])!r}">'
            f'<joint name="leg{k}" type="slide" range="-0.2 0.2"/>'
            f'<site name="head{k}" pos="0 0 0.01"/></body></body>'
        )
        ends = f'body1="rod{k}" body2="platform" anchor="0 0 0"'
        if sites:
            ends = f'site1="head{k}" site2="socket{k}"'
        cuts += f'<connect name="ball{k}" {ends}/>'
        sockets += f'<site name="socket{k}" pos="{words(head - [0, 0, H])}"/>'
        motors += f'<position joint="leg{k}"/>'
    return (
        f'<mujoco model="hexapod"><worldbody>{legs}<body name="platform" pos="0 0 {H}">'
        f'<freejoint/>{sockets}<site name="tool" pos="0 0 0.05"/></body></worldbody>'
        f"<equality>{cuts}</equality><actuator>{motors}</actuator></mujoco>"
    )


def test_a_hexapod_whose_platform_floats_is_a_closed_robot(read: Callable[..., Robot]) -> None:
    """Its legs are as long as the poses of its platform say."""
    robot = read(hexapod())
    assert robot.chain.bodies.joints[:6] == tuple(f"leg{k}" for k in range(6))
    assert robot.chain.mobility == 6
    q = np.random.default_rng(0).uniform(-0.08, 0.08, (50, 6))
    poses = robot.mechanism.forward(q)
    heads = TOP - np.array([0, 0, H + 0.05])
    joined = np.einsum("nij,kj->nki", poses[:, :3, :3], heads) + poses[:, None, :3, 3]
    np.testing.assert_allclose(np.linalg.norm(joined - BASE, axis=2), LENGTHS + q, atol=1e-12)


def test_sites_close_loops_too(read: Callable[..., Robot]) -> None:
    """A connection of two sites, which do not touch where MuJoCo starts."""
    robot, plain = read(hexapod(sites=True)), read(hexapod())
    q = np.random.default_rng(1).uniform(-0.05, 0.05, (20, 6))
    np.testing.assert_allclose(
        robot.mechanism.forward(q - 0.01), plain.mechanism.forward(q), atol=1e-11
    )


FOURBAR = """<mujoco><worldbody>
  <body name="crank"><joint name="motor" axis="0 1 0" range="-30 30"/>
    <body name="coupler" pos="0 0 0.2"><joint name="knee" axis="0 1 0" range="-90 90"/>
      <site name="tool" pos="0.5 0 0.1"/></body></body>
  <body name="rocker" pos="0.3 0 0"><joint name="passive" axis="0 1 0" range="-90 90"/></body>
  </worldbody>
  <equality><{cut} body1="coupler" body2="rocker" {where}/></equality>
  <actuator><motor joint="motor"/></actuator></mujoco>"""


ON_ONE_BODY = (
    FOURBAR.format(cut="connect", where='anchor="0.3 0 0"')
    .replace(
        '<site name="tool"',
        '<site name="back"/><site name="tool"',
    )
    .replace('body1="coupler" body2="rocker" anchor="0.3 0 0"', 'site1="{a}" site2="{b}"')
)


def test_a_parallelogram_only_shifts_its_coupler(read: Callable[..., Robot]) -> None:
    robot = read(FOURBAR.format(cut="connect", where='anchor="0.3 0 0"'))
    q = np.linspace(-0.5, 0.5, 11)[:, None]
    poses = robot.mechanism.forward(q)
    np.testing.assert_allclose(poses[:, :3, :3], np.tile(np.eye(3), (11, 1, 1)), atol=1e-12)
    expected = np.stack([0.2 * np.sin(q[:, 0]) + 0.5, 0 * q[:, 0], 0.2 * np.cos(q[:, 0]) + 0.1], 1)
    np.testing.assert_allclose(poses[:, :3, 3], expected, atol=1e-12)


def test_joint_equalities_are_followed(read: Callable[..., Robot]) -> None:
    text = """<mujoco><compiler angle="radian"/><worldbody>
      <body name="a"><joint name="j1" type="slide" axis="0 0 1" range="0 1"/>
        <body name="b"><joint name="j2" type="slide" axis="0 0 1" range="0 1"/>
          <body name="tool"><joint name="j3" axis="0 1 0" range="-2 2"/></body></body></body>
      </worldbody>
      <equality><joint joint1="j1" joint2="j2" polycoef="0.1 2"/></equality>
      <tendon><fixed name="both"><joint joint="j1"/><joint joint="j2"/></fixed></tendon>
      <actuator><position tendon="both"/><position joint="j3"/></actuator></mujoco>"""
    robot = read(text)
    assert robot.chain.bodies.joints == ("j2", "j3", "j1")
    heights = robot.mechanism.forward(np.array([[0.0, 0.0], [0.2, 0.3]]))[:, 2, 3]
    np.testing.assert_allclose(heights, [0.1, 0.1 + 3 * 0.2], atol=1e-14)


def test_what_does_not_move_the_tool_is_left_out(read: Callable[..., Robot]) -> None:
    """The loops of a gripper, an equality that is off, a body that is moved from outside."""
    arm = """<mujoco><worldbody><body name="hand_target" mocap="true"/>
      <body name="a"><joint name="j1" axis="0 0 1" range="-90 90"/>
        <body name="b" pos="0.3 0 0"><joint name="j2" axis="0 1 0" range="-90 90"/>
          <site name="tcp"/>
          <body name="finger_1"><joint name="g1" axis="0 0 1" range="-90 90"/></body>
          <body name="finger_2" pos="0 0.1 0"><joint name="g2" axis="0 0 1" range="-90 90"/></body>
        </body></body></worldbody>
      <equality><connect body1="finger_1" body2="finger_2" anchor="0 0.05 0"/>
        <weld body1="hand_target" body2="b"/><connect active="false" body1="b" anchor="0 0 0"/>
      </equality>
      <actuator><motor joint="j1"/><motor joint="j2"/><motor joint="g1"/></actuator></mujoco>"""
    robot = read(arm)
    assert robot.chain.tree is None
    assert (robot.n, set(robot.source.description.kinematics.locked_joints)) == (2, {"g1", "g2"})


def test_gravity_of_a_mounting_is_read(read: Callable[..., Robot]) -> None:
    option = '<option gravity="0 9.81 0"/><worldbody>'
    found = read(RICH.replace("<worldbody>", option)).chain.bodies.gravity
    np.testing.assert_allclose(found / np.linalg.norm(found), [0, 1, 0])


@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        (
            "<worldbody>",
            "<worldbody><attach model='m'/>",
            "<attach> is not read; save the compiled",
        ),
        ("<worldbody>", "<worldbody><replicate count='3'/>", "<replicate> is not read"),
        ('class="main"', 'class="nowhere"', "no default class 'nowhere'"),
        ('quat="1 1 0 0"', 'quat="0 0 0 0"', "quat has no direction"),
        ('quat="1 1 0 0"', 'quat="1 1 0"', "quat='1 1 0'; expected 4 numbers"),
        ('ref="15"', 'ref="often"', "'often' is no number"),
        ('pos="0.1 0.2 0.3"', 'pos="0.1 nan 0.3"', "'nan' is no number"),
        ('eulerseq="ZYx"', 'eulerseq="abc"', "eulerseq is 'abc'"),
        ('angle="degree"', 'coordinate="global"', "coordinates are global"),
        ('axis="0 0 2"', 'axis="0 0 0"', "joint 'j3' has no axis"),
        ('type="slide"', 'type="screw"', "a joint of type 'screw'"),
        ("<default>", '<include file="gone.xml"/><default>', "No such file"),
        ("<default>", '<include file="../gone.xml"/><default>', "is outside of .*--allow"),
        ("<default>", '<include file="sample.xml"/><default>', "included twice"),
        (
            "</mujoco>",
            '<equality><weld body1="elbow" body2="x"/></equality></mujoco>',
            "of elbow, x",
        ),
        (
            "</mujoco>",
            '<equality><tendon tendon1="t1"/></equality></mujoco>',
            'an equality <tendon> is not modelled.*active="false"',
        ),
        (
            "</mujoco>",
            '<equality><distance geom1="a" geom2="b"/></equality></mujoco>',
            "an equality <distance> is not modelled",
        ),
        (
            "</mujoco>",
            '<equality><joint joint1="j1" joint2="j2" polycoef="0 1 1"/></equality></mujoco>',
            "'j1' follows 'j2' by a polynomial of a higher degree",
        ),
        (
            "</mujoco>",
            '<equality><connect name="rod 1" body1="elbow" body2="elbow"/></equality></mujoco>',
            "loop 'rod 1' joins 'elbow' to itself",
        ),
        ("<mujoco", "<!DOCTYPE m []><mujoco", "document type or entities"),
    ],
)
def test_what_is_not_read_is_refused(
    old: str, new: str, finding: str, read: Callable[..., Robot]
) -> None:
    assert old in RICH
    with pytest.raises(InputError, match=finding) as caught:
        read(RICH.replace(old, new))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "finding"),
    [
        (
            FOURBAR.format(cut="connect", where='anchor="0.3 0 0"').replace("actuator>", "custom>"),
            "actuated is missing: .*robot.toml .*<position joint=.*joints: motor, knee, passive$",
        ),
        (
            hexapod(sites=False).replace("<position joint", "<position body"),
            "actuated is missing: .*robot.toml .*<position joint=.*joints: platform_.* leg1 …$",
        ),
        (
            FOURBAR.format(cut="weld", where='relpose="0.3 0.1 0 1 0 0 0"'),
            "over-constrained|does not close",
        ),
        (FOURBAR.format(cut="connect", where='name="pin"'), "loop 'pin': <connect> has no anchor"),
        (FOURBAR.format(cut="connect", where=""), "loop 'loop1': <connect> has no anchor"),
        (ON_ONE_BODY.format(a="tool", b="back"), "loop 'loop1': 'tool' and 'back' are on the same"),
        (ON_ONE_BODY.format(a="back", b="tool"), "loop 'loop1': 'back' and 'tool' are on the same"),
        ("<mujoco><worldbody><body name='a'/></worldbody></mujoco>", "without joints"),
    ],
)
def test_loops_that_are_no_mechanism_are_refused(
    text: str, finding: str, read: Callable[..., Robot]
) -> None:
    with pytest.raises(InputError, match=finding):
        read(text)
