"""A joint of any twist is exact, from slides to helices whose axis is far away."""

import numpy as np
import pinocchio as pin
import pytest
from derivatives import finite_differences
from poe import expm_chain

from calibtool.robot.screw_joint import Screw
from calibtool.robot.se3 import Array

IDENTITY = np.array([np.eye(4)] * 2)


def moved(screw: Screw, q: Array) -> Array:
    """Poses of the joint itself, by Pinocchio, (N, 4, 4)."""
    model = pin.Model()
    model.addJoint(0, screw.joint, pin.SE3(np.eye(3), screw.shift), "joint")
    data = model.createData()
    poses = []
    for row in screw.coordinates(q):
        pin.forwardKinematics(model, data, row)
        poses.append(data.oMi[1].homogeneous @ pin.SE3(np.eye(3), -screw.shift).homogeneous)
    return np.array(poses)


@pytest.mark.parametrize("speed", [0.0, 1e-3, 1.0])
@pytest.mark.parametrize("turn", [0.0, 1e-300, 1e-12, 1e-9, 1e-6, 1e-3, 0.09, 0.11, 1.0, 3.0])
def test_the_motion_is_the_matrix_exponential(
    speed: float, turn: float, rng: np.random.Generator
) -> None:
    if not speed and turn < 1e-200:
        pytest.skip("no motion is no joint")
    twist = rng.normal(size=(2, 3))
    twist *= np.array([[speed], [turn]]) / np.linalg.norm(twist, axis=1, keepdims=True)
    q = np.linspace(-3.0, 3.0, 13)
    expected = expm_chain(IDENTITY, twist.reshape(1, 6), q[:, None])
    np.testing.assert_allclose(moved(Screw.of(twist.ravel()), q), expected, atol=1e-12)


def test_what_a_drawing_has_are_plain_joints_with_the_joint_position_for_a_coordinate() -> None:
    for axis, kind in zip(np.eye(3), ("RX", "RY", "RZ"), strict=True):
        screw = Screw.of(np.concatenate([np.zeros(3), axis]))
        assert screw.joint.shortname() == f"JointModel{kind}"
        np.testing.assert_array_equal(screw.coordinates(np.array([0.3]))[0], [0.3])
    skew = np.array([1.0, 2.0, 2.0]) / 3.0
    for twist in (np.concatenate([skew, np.zeros(3)]), np.concatenate([np.zeros(3), skew])):
        screw = Screw.of(twist)
        assert screw.joint.nq == 1
        np.testing.assert_array_equal(screw.rates, [1.0])


@pytest.mark.parametrize("turn", [1e-6, 1e-3, 1.0])
def test_rates_are_the_velocity_of_the_joint(turn: float, rng: np.random.Generator) -> None:
    """S(coordinates) · rates is ξ, the velocity in the frame of the joint."""
    twist = np.concatenate([rng.normal(size=3), rng.normal(size=3) * turn])
    screw = Screw.of(twist)
    pose = moved(screw, np.array([0.4]))[0]
    slope = finite_differences(lambda x: moved(screw, x)[0], np.array([0.4]))[..., 0]
    velocity = np.linalg.solve(pose, slope)
    found = np.array([*velocity[:3, 3], velocity[2, 1], velocity[0, 2], velocity[1, 0]])
    np.testing.assert_allclose(found, twist, atol=1e-9)
