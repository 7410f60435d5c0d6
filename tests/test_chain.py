"""The rebuilt serial chain is the URDF's own robot, with one plain coordinate per joint."""

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from poe import random_positions
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError
from calibtool.robot.catalogue import load_robot
from calibtool.robot.chain import build_chain
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.source import Source, parse_source
from calibtool.robot.tool import chosen
from calibtool.robot.tree import urdf_tree

ZIGZAG = """
<robot name="zigzag">
  <link name="world"/>
  <link name="wall"/>
  <link name="upper"><inertial><origin xyz="0.1 0.2 0.3"/><mass value="2"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="lower"/>
  <link name="rod"><inertial><mass value="3"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="tip"/>
  <joint name="mount" type="fixed">
    <parent link="world"/><child link="wall"/><origin xyz="1 2 3" rpy="0.3 1.2 -0.5"/>
  </joint>
  <joint name="a" type="continuous">
    <parent link="wall"/><child link="upper"/>
    <origin xyz="0.1 0 0.2" rpy="0.1 0.2 0.3"/><axis xyz="1 2 2"/>
  </joint>
  <joint name="b" type="continuous">
    <parent link="upper"/><child link="lower"/>
    <origin xyz="0 0.4 0" rpy="0 0 0.5"/><axis xyz="0 0 -1"/>
  </joint>
  <joint name="c" type="prismatic">
    <parent link="lower"/><child link="rod"/>
    <origin xyz="0 0 0.3" rpy="0.2 0 0"/><axis xyz="0 3 4"/>
    <limit lower="-0.2" upper="0.6" effort="1" velocity="1"/>
  </joint>
  <joint name="end" type="fixed">
    <parent link="rod"/><child link="tip"/><origin xyz="0.05 0 0.1" rpy="0 0.7 0"/>
  </joint>
</robot>
"""


TOML = (
    'name = "zigzag"\ntitle = "z"\n[targets]\npoints_mm = [[0, 0, 1]]\n'
    '[kinematics]\nurdf = "zigzag.urdf"\ntool_frame = "tip"\n'
)


def zigzag(kinematics: str = "") -> Source:
    """A robot with an inclined mounting, skew axes, continuous joints and a slide."""
    return parse_source(f"{TOML}{kinematics}\n", ZIGZAG, "zigzag")


def pinocchio_itself(robot: Robot, q: Array) -> tuple[Array, Array]:
    """T_base_tool and gravity torques of the robot's joints from the unchanged URDF model, by
    `pin.integrate`.
    """
    kinematics = robot.source.description.kinematics
    model = pin.buildModelFromXML(robot.source.urdf_text)
    data = model.createData()
    indices = [
        model.joints[model.getJointId(name)].idx_v for name in list(robot.chain.model.names)[1:]
    ]
    velocity = np.zeros(model.nv)
    velocity[indices] = q
    for name, value in kinematics.locked_joints.items():
        velocity[model.joints[model.getJointId(name)].idx_v] = value
    q_model = pin.integrate(model, pin.neutral(model), velocity)
    pin.framesForwardKinematics(model, data, q_model)
    tool = data.oMf[model.getFrameId(kinematics.tool_frame, pin.FrameType.BODY)]
    base = (
        data.oMf[model.getFrameId(kinematics.base_frame)]
        if kinematics.base_frame
        else pin.SE3.Identity()
    )
    gravity = pin.computeGeneralizedGravity(model, data, q_model)
    return base.actInv(tool).homogeneous, gravity[indices]


def assert_the_same_robot(robot: Robot, rng: np.random.Generator) -> None:
    model = robot.chain.model
    for q in random_positions(robot, rng, 5):
        pose, torque = pinocchio_itself(robot, q)
        np.testing.assert_allclose(robot.mechanism.forward(q[None])[0], pose, atol=1e-12)
        np.testing.assert_allclose(
            pin.computeGeneralizedGravity(model, model.createData(), q),
            torque,
            rtol=1e-9,
            atol=1e-10,
        )


def test_kinematics_and_weights_are_those_of_the_unchanged_urdf(
    robot: Robot, rng: np.random.Generator
) -> None:
    assert_the_same_robot(robot, rng)


def test_every_joint_is_one_plain_coordinate(robot: Robot) -> None:
    model = robot.chain.model
    assert model.nq == model.nv == model.njoints - 1 == robot.n
    assert [model.parents[j] for j in range(1, robot.n + 1)] == list(range(robot.n))


def test_kinova_has_joints_that_pinocchio_stores_as_cosine_and_sine() -> None:
    # Otherwise the comparison with the unchanged model would show nothing about them.
    model = pin.buildModelFromXML(load_robot("kinova").source.urdf_text)
    assert sum(joint.nq == 2 for joint in model.joints) == 3


def test_joint_twists_are_unit_rotations_or_unit_translations(robot: Robot) -> None:
    linear, angular = (
        np.linalg.norm(robot.chain.twists[:, :3], axis=1),
        np.linalg.norm(robot.chain.twists[:, 3:], axis=1),
    )
    np.testing.assert_allclose(linear, np.array(robot.prismatic, dtype=float), atol=1e-12)
    np.testing.assert_allclose(angular, 1.0 - np.array(robot.prismatic), atol=1e-12)


def test_limits_are_those_written_in_the_urdf(robot: Robot) -> None:
    written = {
        joint.get("name"): joint
        for joint in ElementTree.fromstring(robot.source.urdf_text).findall("joint")
    }
    kinematics = robot.source.description.kinematics
    numbers = kinematics.chain or kinematics.dh  # their URDF is made with [limits]
    assert numbers or not robot.source.description.limits
    for name, low, high in zip(
        list(robot.chain.model.names)[1:], robot.lower, robot.upper, strict=True
    ):
        joint = written[name]
        if joint.get("type") == "continuous":
            assert (low, high) == (-np.pi, np.pi)
            continue
        limit = joint.find("limit")
        assert limit is not None
        assert (low, high) == (float(str(limit.get("lower"))), float(str(limit.get("upper"))))


@pytest.mark.parametrize(
    "kinematics",
    [
        "",
        'base_frame = "wall"',
        "locked_joints = { a = 0.7 }",
        "locked_joints = { b = -2.5 }",
        "locked_joints = { c = 0.3 }",
        'base_frame = "wall"\nlocked_joints = { a = 0.7, c = -0.1 }',
    ],
)
def test_skew_axes_inclined_bases_and_locked_joints_are_those_of_the_urdf(
    kinematics: str, rng: np.random.Generator
) -> None:
    robot = Robot.from_source(zigzag(kinematics))
    assert robot.n == 3 - len(robot.source.description.kinematics.locked_joints)
    assert_the_same_robot(robot, rng)


def test_gravity_points_down_whatever_the_base_frame() -> None:
    chain = build_chain(zigzag('base_frame = "wall"'))
    turned = Rotation.from_euler(
        "xyz", [0.3, 1.2, -0.5]
    ).as_matrix()  # rpy of the URDF: fixed axes x, y, z
    np.testing.assert_allclose(turned @ chain.model.gravity.linear, [0, 0, -9.81], atol=1e-12)


def test_the_base_frame_of_the_universal_robots_is_turned_by_half_a_circle() -> None:
    ur5 = load_robot("ur5")
    toml = ur5.source.toml_text.replace('base_frame = "base"\n', "")
    with_base_link = Robot.from_source(parse_source(toml, ur5.source.urdf_text, "ur5"))
    q = np.array([[0.1, -1.2, 1.0, 0.3, 0.5, 0.7]])
    half = np.diag([-1.0, -1.0, 1.0, 1.0])
    np.testing.assert_allclose(
        with_base_link.mechanism.forward(q), half @ ur5.mechanism.forward(q), atol=1e-12
    )


def test_the_tool_of_a_bare_urdf_is_its_last_link() -> None:
    for text, tool in (
        (ZIGZAG, "tip"),
        (load_robot("fanuc-m1000ia").source.urdf_text, "tool0"),
    ):
        assert chosen(urdf_tree(text, "arm"), "arm").tool == tool


def test_arrays_of_a_chain_cannot_be_changed(fanuc: Robot) -> None:
    for array in (fanuc.chain.placements, fanuc.chain.twists, fanuc.lower, fanuc.upper):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_a_moving_base_frame_is_refused() -> None:
    with pytest.raises(InputError, match="'upper' moves with joint 'a'"):
        build_chain(zigzag('base_frame = "upper"'))


@pytest.mark.parametrize("axis", ["1 2 2", "0 0 -1", "0 3 4"])  # continuous twice, a slide
@pytest.mark.parametrize("written", ['xyz="0 0 0"', 'xyz="0 -0.0 1e-320"'])
def test_a_joint_without_an_axis_is_refused(axis: str, written: str) -> None:
    text = ZIGZAG.replace(f'<axis xyz="{axis}"/>', f"<axis {written}/>")
    with pytest.raises(InputError, match=r"joint '[abc]' has no axis"):
        Robot.from_source(parse_source(TOML, text, "zigzag"))


@pytest.mark.parametrize("size", ["1e-3", "1e6"])
def test_an_axis_of_any_length_is_a_direction(size: str, rng: np.random.Generator) -> None:
    text = ZIGZAG.replace('<axis xyz="0 0 -1"/>', f'<axis xyz="0 0 -{size}"/>')
    robot, scaled = (
        Robot.from_source(zigzag()),
        Robot.from_source(parse_source(TOML, text, "zigzag")),
    )
    q = random_positions(robot, rng, 5)
    np.testing.assert_allclose(scaled.mechanism.forward(q), robot.mechanism.forward(q), atol=1e-12)
