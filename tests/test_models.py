"""Models that are handed out: Pinocchio alone, with its own calls, comes to the same poses."""

import numpy as np
import pinocchio as pin
import pytest
from poe import poe_frames, random_positions

from calibtool.calibration import Calibration
from calibtool.errormodel.actual import ErrorScales, random_actual
from calibtool.errormodel.placements import placement_columns
from calibtool.robot.gravity_torque import gravity_model, gravity_torque
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6


def tool_poses(model: pin.Model, configuration: Array) -> Array:
    data = model.createData()
    poses = []
    for row in configuration:
        pin.framesForwardKinematics(model, data, row)
        poses.append(data.oMf[model.nframes - 1].homogeneous)
    return np.array(poses)


def test_the_nominal_model_takes_joint_positions_and_has_the_limits(
    robot: Robot, rng: np.random.Generator
) -> None:
    model, q = robot.model, random_positions(robot, rng, 3)
    expected = poe_frames(robot.chain.placements, robot.chain.twists, q).tool
    np.testing.assert_allclose(tool_poses(model, q), expected, atol=1e-12)
    np.testing.assert_array_equal(model.lowerPositionLimit, robot.lower)
    np.testing.assert_array_equal(model.upperPositionLimit, robot.upper)
    assert model.frames[model.nframes - 1].name == robot.source.description.kinematics.tool_frame


def test_an_actual_robot_is_its_model_at_its_configuration(
    robot: Robot, rng: np.random.Generator
) -> None:
    truth = random_actual(robot, ErrorScales(), rng)
    q = random_positions(robot, rng, 3)
    errors, chain = truth.errors, robot.chain
    placements = chain.placements @ exp6(errors["placements"])
    expected = poe_frames(placements, chain.twists + errors["twists"], q + errors["offsets"]).tool
    np.testing.assert_allclose(
        tool_poses(truth.model, truth.mechanism.configuration(q)), expected, atol=1e-12
    )


def test_a_calibration_states_what_its_model_leaves_out(
    fanuc_local_poe: Calibration, fanuc_network: Calibration
) -> None:
    q = fanuc_local_poe.q[:5]
    assert fanuc_local_poe.beyond_model == ()
    found = tool_poses(fanuc_local_poe.model, fanuc_local_poe.base_mechanism.configuration(q))
    np.testing.assert_allclose(found, fanuc_local_poe.forward(q), atol=1e-12)
    assert fanuc_network.beyond_model == ("network",)


def test_a_model_that_was_handed_out_can_be_changed(fanuc: Robot) -> None:
    q = np.zeros((1, 6))
    before = fanuc.mechanism.forward(q)
    fanuc.model.jointPlacements[1] = pin.SE3.Random()
    np.testing.assert_array_equal(fanuc.mechanism.forward(q), before)


def test_columns_of_placement_errors_are_those_of_pinocchios_regressor(
    robot: Robot, rng: np.random.Generator
) -> None:
    """`computeFrameKinematicRegressor` has them at the tool, in the tool's frame."""
    q = random_positions(robot, rng, 2)
    frames, model = robot.mechanism.frames(q), robot.model
    data = model.createData()
    columns = placement_columns(frames)
    for row, tool, found in zip(q, frames.tool, columns, strict=True):
        pin.computeJointJacobians(model, data, row)
        pin.updateFramePlacements(model, data)
        regressor = pin.computeFrameKinematicRegressor(model, data, model.nframes - 1, pin.LOCAL)
        expected = pin.SE3(tool).action @ regressor
        np.testing.assert_allclose(found[:, : 6 * robot.n], expected, atol=1e-11)


def test_gravity_loads_are_the_slope_of_the_potential_energy(
    robot: Robot, rng: np.random.Generator
) -> None:
    """By Pinocchio's `computePotentialEnergy`, along one direction."""
    model = gravity_model(robot)
    data = model.createData()
    q, direction = random_positions(robot, rng, 1)[0], rng.normal(size=robot.n)
    step = 1e-5 * direction
    energies = [pin.computePotentialEnergy(model, data, q + k * step) for k in (-2, -1, 1, 2)]
    slope = (8 * (energies[2] - energies[1]) - (energies[3] - energies[0])) / 12e-5
    torque = gravity_torque(robot, q[None])[0]
    assert slope == pytest.approx(
        torque @ direction, rel=1e-6, abs=1e-6 * (1 + np.abs(torque).max())
    )
