"""Laws of the kinematics: the product of exponentials, its derivatives,
and what must not matter.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from cases import examples
from derivatives import assert_derivative
from hypothesis import given
from hypothesis import strategies as st
from strategies import (
    DrawnChain,
    calibrated,
    configurations,
    drawn_chains,
    geometric,
    measured,
    network,
    perfect,
    plain_chain,
    robots,
    seeds,
    with_motion_errors,
)

from calibtool.equivalent.joints import ELEMENTARY, EquivalentRobot
from calibtool.equivalent.loss import task_loss
from calibtool.errormodel.family import offset_columns
from calibtool.errormodel.placements import placement_columns
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errormodel.twists import twist_columns
from calibtool.identification.parameters import Parameters, State
from calibtool.measurement.observation import observation_matrix, target_columns
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, readonly, relative_error, transform_points


def assert_slope(
    function: Callable[[Array], Array], derivative: Array, rng: np.random.Generator
) -> None:
    """`derivative` (…, k) is that of `function` at zero (k,), along three random directions: every
    column is in each.
    """
    directions = rng.normal(size=(derivative.shape[-1], 3))
    assert_derivative(lambda x: function(directions @ x), derivative @ directions, np.zeros(3))


@examples(40)
@given(robots(), seeds)
def test_forward_kinematics_is_the_plain_product_of_exponentials(robot: Robot, seed: int) -> None:
    q = configurations(robot, 3, np.random.default_rng(seed))
    chain = plain_chain(robot)
    expected = np.array([chain.forward(row) for row in q])
    np.testing.assert_allclose(robot.mechanism.forward(q), expected, atol=1e-12)
    np.testing.assert_allclose(RobotErrors.of(robot).frames(q).tool, expected, atol=1e-12)


@examples(40)
@given(robots(), seeds, st.sampled_from([1e-9, 1e-6, 1e-3, 0.3]))
def test_a_robot_with_errors_is_the_plain_product_of_changed_exponentials(
    robot: Robot, seed: int, size: float
) -> None:
    rng = np.random.default_rng(seed)
    errors, q = geometric(robot, rng, size), configurations(robot, 3, rng)
    chain = plain_chain(robot).with_errors(errors["placements"], errors["twists"])
    expected = np.array([chain.forward(row + errors["offsets"]) for row in q])
    np.testing.assert_allclose(errors.frames(q).tool, expected, atol=1e-11)
    np.testing.assert_allclose(errors.mechanism.forward(q), expected, atol=1e-11)


@examples(20)
@given(robots(), seeds)
def test_jacobians_are_derivatives(robot: Robot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    errors, q = geometric(robot, rng), configurations(robot, 1, rng)
    built = errors.mechanism
    pose, jacobian = built.forward_and_jacobian(q)

    def moved(x: Array) -> Array:
        return relative_error(built.forward(x[None]), pose)[0]

    assert_derivative(moved, jacobian[0], q[0])
    virtual = EquivalentRobot(robot.n, ELEMENTARY[: max(6 - robot.n, 0)])
    _, J = virtual.forward_and_jacobian(built, q)
    columns = np.eye(6)[virtual.virtual_columns]

    assert_slope(
        lambda x: relative_error(pose @ exp6(x @ columns), pose)[0], J[0, :, robot.n :], rng
    )


@examples(20)
@given(robots(), seeds)
def test_error_columns_are_derivatives(robot: Robot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    errors, q = geometric(robot, rng), configurations(robot, 1, rng)
    frames = errors.frames(q)
    n = robot.n

    def change(placements: Array, twists: Array, offsets: Array) -> Array:
        stepped = errors.moved(
            placements=placements.reshape(n + 1, 6), twists=twists.reshape(n, 6), offsets=offsets
        )
        return relative_error(stepped.frames(q).tool, frames.tool)[0]

    twists, driven = robot.chain.twists + errors["twists"], q + errors["offsets"]
    none = np.zeros((n + 1, 6)), np.zeros((n, 6)), np.zeros(n)
    assert_slope(lambda x: change(x, *none[1:]), placement_columns(frames)[0], rng)
    assert_slope(
        lambda x: change(none[0], x, none[2]), twist_columns(frames, twists, driven)[0], rng
    )
    assert_slope(lambda x: change(*none[:2], x), offset_columns(frames, twists)[0], rng)


@examples(12)
@given(robots(), seeds, st.booleans())
def test_columns_of_the_complete_model_are_derivatives_of_what_is_seen(
    robot: Robot, seed: int, pose: bool
) -> None:
    """Every parameter: δζ, δξ, δq, harmonics, wind-up, instrument frame, targets,
    orientation of a sensor.
    """
    rng = np.random.default_rng(seed)
    q = configurations(robot, 1, rng)
    frame = exp6(rng.normal(size=6))
    setup = replace(
        measured(robot, q, perfect(robot), rng, pose=pose, frame=frame).setup,
        frame_known=False,
        targets_known=False,
    )
    parameters = Parameters.of(robot, setup, twists=1, harmonics=2, gravity=1)
    state = State(with_motion_errors(geometric(robot, rng), rng), setup)
    context = state.errors.context(q)
    frames = context.frames
    columns = observation_matrix(setup, frames.tool) @ parameters.pose_columns(context)
    columns = np.concatenate([columns, target_columns(setup, frames.tool)], axis=-1)

    def seen(moved: State) -> Array:
        """In the instrument's frame, brought to K_0 with the frame of `state`."""
        back = np.linalg.inv(setup.T_instrument_base) @ moved.setup.T_instrument_base
        tool = back @ moved.frames(q).tool
        points = transform_points(tool, moved.setup.targets).ravel()
        if moved.setup.R_tool_sensor is None:
            return points
        turned, before = np.eye(4)[None].repeat(2, axis=0)
        turned[:3, :3] = tool[0, :3, :3] @ moved.setup.R_tool_sensor
        before[:3, :3] = frames.tool[0, :3, :3] @ setup.R_tool_sensor
        return np.concatenate([points, relative_error(turned, before)[3:]])

    scale = np.ones(parameters.count)
    scale[parameters.blocks["gravity"]] = (
        1e-3  # rad per N m: a step of the others' size would turn the arm over
    )
    assert_slope(lambda x: seen(state.moved(parameters, x * scale)), columns[0] * scale, rng)


@examples(10)
@given(robots(), seeds)
def test_slope_of_the_loss_is_the_derivative_by_the_weights(robot: Robot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = configurations(robot, 4, rng)
    p = max(robot.n, 6)
    start = replace(network(robot, p, q, rng), output_scale=readonly(np.ones(p)))
    loss = task_loss(q, rng.normal(size=(4, 9, p)), rng.normal(size=(4, 9)))
    _, J = loss.residual_and_jacobian(start)
    assert_slope(lambda w: -loss.residual(start.with_weights(start.weights + w)).ravel(), J, rng)


# --- what must not matter -------------------------------------------------------------------------

bases = st.tuples(*[st.floats(-2, 2)] * 6).map(lambda x: np.round(x, 3))


@examples(25)
@given(drawn_chains(), seeds, bases)
def test_a_base_frame_after_a_stand_is_the_robot_without_the_stand(
    chain: DrawnChain, seed: int, base: Array
) -> None:
    q = configurations(chain.robot(), 3, np.random.default_rng(seed))
    expected = chain.robot().mechanism.forward(q)
    named = chain.robot(base=base, base_frame="base").mechanism.forward(q)
    np.testing.assert_allclose(named, expected, atol=1e-12)
    whole = chain.robot(base=base).mechanism.forward(q)
    np.testing.assert_allclose(
        whole @ np.linalg.inv(expected), np.broadcast_to(stand_of(base), (3, 4, 4)), atol=1e-11
    )


def stand_of(base: Array) -> Array:
    pose = np.eye(4)
    for axis, angle in zip(np.eye(3)[::-1], base[:2:-1], strict=True):
        pose = pose @ exp6(np.concatenate([np.zeros(3), axis * angle]))
    pose[:3, 3] = base[:3]
    return pose


@examples(25)
@given(drawn_chains(), seeds)
def test_names_of_links_do_not_matter(chain: DrawnChain, seed: int) -> None:
    a, b = (
        calibrated(chain.robot(), np.random.default_rng(seed)),
        calibrated(chain.robot(tool_name="z9"), np.random.default_rng(seed)),
    )
    assert np.array_equal(a.forward(a.q), b.forward(a.q))


@examples(25)
@given(drawn_chains(), seeds, st.sampled_from([0.01, 0.1, 30.0]))
def test_lengths_times_s_give_positions_times_s(chain: DrawnChain, seed: int, scale: float) -> None:
    small, large = chain.robot(), chain.robot(scale=scale)
    q = configurations(small, 3, np.random.default_rng(seed))
    stretched = q * np.where(small.prismatic, scale, 1.0)
    expected, found = small.mechanism.forward(q), large.mechanism.forward(stretched)
    np.testing.assert_allclose(found[:, :3, :3], expected[:, :3, :3], atol=1e-12)
    np.testing.assert_allclose(found[:, :3, 3] / scale, expected[:, :3, 3], atol=1e-12)
    if not any(
        small.prismatic
    ):  # a slide's column is 1 m over the characteristic length, which slides bound
        np.testing.assert_allclose(large.length / scale, small.length, rtol=1e-12)
        distance = small.singularity_distance(q)
        np.testing.assert_allclose(
            large.singularity_distance(stretched), distance, rtol=1e-6, atol=1e-7
        )
