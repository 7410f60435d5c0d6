"""SDF as a robot: poses on paper, a loop, and refusals."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibtool.errors import InputError
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

LIMIT = "<limit><lower>-1.5</lower><upper>1.5</upper></limit>"
ARM = f"""<?xml version="1.0"?>
<sdf version="1.9"><world name="hall"><model name="arm">
  <link name="base"/>
  <link name="upper"><pose relative_to="j1">0 0 0.1 0 0 0</pose>
    <inertial><mass>2</mass><pose>0 0 0.2 0 0 0</pose></inertial></link>
  <link name="fore"><pose>0.3 0 0.5 0 0.5 0</pose></link>
  <joint name="j1" type="revolute"><pose relative_to="base">0 0 0.2 0.3 0 0</pose>
    <parent>base</parent><child>upper</child>
    <axis><xyz expressed_in="base">0 0 1</xyz>{LIMIT}</axis></joint>
  <joint name="j2" type="prismatic"><parent>upper</parent><child>fore</child>
    <axis><xyz>1 0 0</xyz><limit><lower>0</lower><upper>0.4</upper></limit></axis></joint>
  <joint name="j3" type="universal"><pose degrees="true">0 0 0 0 0 90</pose><parent>fore</parent>
    <child>hand</child><axis><xyz>1 0 0</xyz>{LIMIT}</axis>
    <axis2><xyz>0 1 0</xyz>{LIMIT}</axis2></joint>
  <link name="hand"><pose relative_to="fore">0 0 0.1 0 0 0</pose></link>
  <frame name="tcp" attached_to="hand">
    <pose rotation_format="quat_xyzw">0 0 0.2 0 0 1 0</pose></frame>
</model></world></sdf>
"""


@pytest.fixture
def read(tmp_path: Path) -> Callable[..., Robot]:
    def reading(text: str) -> Robot:
        (tmp_path / "sample.sdf").write_text(text)
        return load_robot(str(tmp_path / "sample.sdf"))

    return reading


def placed(x: float = 0.0, y: float = 0.0, z: float = 0.0, turn: Array | None = None) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    pose[:3, :3] = np.eye(3) if turn is None else turn
    return pose


def about(axis: int, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[[i, j], [i, j]], turn[i, j], turn[j, i] = c, -s, s
    return turn


def test_poses_are_those_of_the_frames(read: Callable[..., Robot]) -> None:
    """Every link moves about its joint's axis from where the model has it."""
    robot = read(ARM)
    assert robot.source.description.kinematics.tool_frame == "tcp"
    fore = placed(0.3, 0, 0.5, about(1, 0.5))
    joint3 = fore @ placed(0, 0, 0.1, about(2, np.pi / 2))
    for q in np.random.default_rng(0).uniform(0, 0.4, (5, 4)):
        about_j1 = placed(z=0.2, turn=about(2, q[0])) @ placed(z=-0.2)
        slid = placed(*(fore[:3, 0] * q[1]))
        turned = joint3 @ placed(turn=about(0, q[2]) @ about(1, q[3])) @ np.linalg.inv(joint3)
        tcp = fore @ placed(0, 0, 0.1) @ placed(0, 0, 0.2, about(2, np.pi))
        expected = about_j1 @ slid @ turned @ tcp
        np.testing.assert_allclose(robot.mechanism.forward(q[None])[0], expected, atol=1e-14)
    np.testing.assert_allclose(robot.upper, [1.5, 0.4, 1.5, 1.5])
    assert [inertia.mass for inertia in robot.chain.bodies.inertias] == [2, 0, 0, 0]


def test_old_files_have_axes_in_the_model(read: Callable[..., Robot]) -> None:
    def one(version: str, more: str = "") -> Array:
        text = f"""<sdf version="{version}"><model name="a"><link name="base"/>
          <link name="tcp"><pose>0.1 0 0 0 0.7 0</pose></link>
          <joint name="j" type="revolute"><parent>base</parent><child>tcp</child><axis>
          <xyz>0 0 1</xyz>{more}</axis></joint></model></sdf>"""
        robot = read(text)
        return robot.mechanism.forward_and_jacobian(np.zeros((1, 1)))[1][0, 3:, 0]

    np.testing.assert_allclose(one("1.4"), [0, 0, 1], atol=1e-15)
    tilted = [np.sin(0.7), 0, np.cos(0.7)]
    np.testing.assert_allclose(one("1.6"), tilted, atol=1e-15)
    in_model = "<use_parent_model_frame>1</use_parent_model_frame>"
    np.testing.assert_allclose(one("1.6", in_model), [0, 0, 1], atol=1e-15)


LOOP = """<sdf version="1.8"><model name="loop"><link name="base"/>
  <link name="crank"/><link name="tcp"><pose>0 0 0.2 0 0 0</pose></link>
  <link name="rocker"><pose>0.3 0 0 0 0 0</pose></link>
  {joints}</model></sdf>"""


def hinge(name: str, parent: str, child: str, pose: str = "0 0 0 0 0 0") -> str:
    return (
        f'<joint name="{name}" type="revolute"><pose>{pose}</pose><parent>{parent}</parent>'
        f"<child>{child}</child><axis><xyz>0 1 0</xyz>{LIMIT}</axis></joint>"
    )


def test_a_second_parent_closes_a_loop(tmp_path: Path) -> None:
    """A parallelogram: a robot.toml names its motor, and its coupler does not turn."""
    joints = [
        hinge("motor", "base", "crank"),
        hinge("knee", "crank", "tcp"),
        hinge("passive", "base", "rocker"),
        hinge("last", "rocker", "tcp", "0.3 0 0 0 0 0"),
    ]
    (tmp_path / "arm.sdf").write_text(LOOP.format(joints="".join(joints)))
    with pytest.raises(
        InputError, match=r"actuated is missing: .*robot\.toml with .*joints: motor, "
    ):
        load_robot(str(tmp_path / "arm.sdf"))
    (tmp_path / "robot.toml").write_text(
        'name = "loop"\ntitle = "Parallelogram"\n[kinematics]\nurdf = "arm.sdf"\n'
        'tool_frame = "tcp"\nactuated = ["motor"]\n'
        'loops = [{ frames = ["last_a", "last_b"], joint = "revolute" }]\n'
        "[targets]\npoints_mm = [[0, 0, 0]]\n"
    )
    robot = load_robot(str(tmp_path))
    q = np.linspace(-1, 1, 9)[:, None]
    poses = robot.mechanism.forward(q)
    np.testing.assert_allclose(poses[:, :3, :3], np.tile(np.eye(3), (9, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(poses[:, 0, 3], 0.2 * np.sin(q[:, 0]), atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        ('type="prismatic"', 'type="gearbox"', "joint 'j2' is of type 'gearbox'; read are"),
        ('relative_to="fore"', 'relative_to="four"', "no frame 'four'; did you mean fore"),
        ('relative_to="base">0', 'relative_to="upper">0', "in a circle"),
        (
            "<parent>fore</parent>",
            "<parent>forearm</parent>",
            "'forearm', which is no link; did you mean fore",
        ),
        ("0.3 0 0.5 0 0.5 0", "0.3 0 0.5", "pose of 'fore': 3 numbers; expected 6"),
        ("0.3 0 0.5 0 0.5 0", "0.3 0 x 0 0.5 0", "'x'; expected a number"),
        ("<xyz>1 0 0</xyz><limit>", "<xyz>0 0 0</xyz><limit>", "axis of 'j2' is '0 0 0'"),
        ("</model>", '</model><model name="b"><joint/></model>', "several models .*: arm, b"),
    ],
)
def test_what_is_not_read_is_refused(
    old: str, new: str, finding: str, read: Callable[..., Robot]
) -> None:
    assert old in ARM
    with pytest.raises(InputError, match=finding) as caught:
        read(ARM.replace(old, new, 1))
    assert "\n" not in str(caught.value)
