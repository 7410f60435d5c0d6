"""Mechanisms with closed loops against Pinocchio's own constraints, closed forms, finite
differences and small steps.
"""

from dataclasses import replace

import numpy as np
import pytest
from derivatives import assert_derivative
from pinocchio_loops import Anchored

from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.catalogue import load_robot
from calibtool.robot.closed import ClosedMechanism
from calibtool.robot.continuation import newton
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, relative_error


def inside(robot: Robot, count: int, rng: np.random.Generator) -> Array:
    return sample_configurations(robot, robot.workspace(), count, rng)


def closed_mechanism(robot: Robot) -> ClosedMechanism:
    assert isinstance(robot.mechanism, ClosedMechanism)
    return robot.mechanism


def perturbed(robot: Robot, rng: np.random.Generator, size: float = 1e-3) -> RobotErrors:
    placements = rng.normal(size=robot.chain.placements[:, :3, :2].reshape(-1, 6).shape) * size
    return RobotErrors.of(
        robot,
        placements=placements,
        twists=rng.normal(size=(robot.n, 6)) * size,
        offsets=rng.normal(size=robot.n) * size,
    )


# --- against Pinocchio ---


def test_pinocchios_anchors_are_closed_and_the_tool_is_where_its_tree_puts_it(
    closed: Robot, rng: np.random.Generator
) -> None:
    q, anchored = inside(closed, 20, rng), Anchored.of(closed)
    pose = closed.mechanism.forward(q)
    for theta, expected in zip(closed_mechanism(closed).joints(q), pose, strict=True):
        tool, residual, _, _ = anchored.at(theta)
        assert np.abs(residual).max() < 1e-12
        np.testing.assert_allclose(tool, expected, rtol=0, atol=1e-12)


def test_the_jacobian_is_that_of_pinocchios_constraint_jacobians(
    closed: Robot, rng: np.random.Generator
) -> None:
    """J_a − J_p C_p⁻¹ C_a, of matrices that Pinocchio made."""
    q, anchored, n = inside(closed, 20, rng), Anchored.of(closed), closed.n
    p = closed.chain.tree.p
    exact, (_, jacobian) = closed.mechanism.frames(q), closed.mechanism.forward_and_jacobian(q)
    np.testing.assert_allclose(jacobian, exact.jacobian, rtol=0, atol=1e-10)
    for theta, expected in zip(closed_mechanism(closed).joints(q), exact.jacobian, strict=True):
        _, _, C, J = anchored.at(theta)
        found = J[:, :n] - J[:, n : n + p] @ np.linalg.solve(C[:, n : n + p], C[:, :n])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


# --- against closed forms ---


def test_the_legs_of_the_hexapod_are_as_long_as_its_joints_say(rng: np.random.Generator) -> None:
    """|T b − a|: the inverse kinematics of a hexapod is a distance per leg."""
    robot = load_robot("hexapod")
    q = inside(robot, 50, rng)
    frames = robot.mechanism.frames(q)
    legs = [robot.chain.bodies.joints.index(f"u{k}x") for k in range(1, 7)]
    base = robot.chain.placements[legs, :3, 3]
    home = robot.mechanism.frames(robot.workspace().home[None])
    ends = np.concatenate([home.after[:, [0], :3, 3], home.cuts[:, ::2, :3, 3]], axis=1)[0]
    T_tool_base = np.linalg.inv(home.tool[0])
    on_tool = ends @ T_tool_base[:3, :3].T + T_tool_base[:3, 3]
    tips = on_tool @ np.swapaxes(frames.tool[:, :3, :3], 1, 2) + frames.tool[:, None, :3, 3]
    np.testing.assert_allclose(np.linalg.norm(tips - base, axis=-1), q, rtol=0, atol=1e-12)


def test_the_fivebar_is_where_two_circles_meet(rng: np.random.Generator) -> None:
    """Rods of 230 mm round the two elbows, 275 mm between the motors; where they do not reach, no
    pose is given.
    """
    robot = load_robot("fivebar")
    q = robot.lower + (robot.upper - robot.lower) * rng.random((400, 2))
    elbows = 0.23 * np.stack([np.cos(q), np.sin(q)], axis=-1)
    elbows[..., 0] += [-0.1375, 0.1375]
    way = elbows[:, 1] - elbows[:, 0]
    half = np.linalg.norm(way, axis=-1) / 2
    meets = half < 0.23
    np.testing.assert_array_equal(np.isfinite(robot.mechanism.forward(q)[:, 0, 0]), meets)
    up = np.stack([-way[:, 1], way[:, 0]], axis=-1)[meets] / (2 * half[meets, None])
    tip = elbows[meets].mean(axis=1) + up * np.sqrt(0.23**2 - half[meets, None] ** 2)
    found = robot.mechanism.forward(q[meets])[:, :2, 3]
    np.testing.assert_allclose(found, tip, rtol=0, atol=1e-12)


def test_the_platform_of_the_delta_keeps_its_orientation(rng: np.random.Generator) -> None:
    robot = load_robot("delta")
    pose, jacobian = robot.mechanism.forward_and_jacobian(inside(robot, 100, rng))
    np.testing.assert_allclose(
        pose[:, :3, :3], np.broadcast_to(pose[0, :3, :3], (100, 3, 3)), atol=1e-12
    )
    np.testing.assert_allclose(jacobian[:, 3:], 0.0, atol=1e-12)


def test_the_parallelogram_keeps_its_rod_parallel_to_the_lower_arm(
    rng: np.random.Generator,
) -> None:
    robot = load_robot("palletizer")
    frames = robot.mechanism.frames(inside(robot, 30, rng))
    joints = robot.chain.bodies.joints
    rod = frames.cuts[:, 1, :3, 3] - frames.after[:, joints.index("rodj"), :3, 3]
    lower = frames.after[:, joints.index("elbow"), :3, 3] - frames.after[:, 1, :3, 3]
    np.testing.assert_allclose(rod, lower, atol=1e-12)


def test_levelling_rods_keep_the_wrist_upright(rng: np.random.Generator) -> None:
    """Its tool is where the lengths and angles of both arms say, and looks down."""
    robot = load_robot("palletizer-level")
    q = inside(robot, 100, rng)
    poses = robot.mechanism.forward(q)
    np.testing.assert_allclose(poses[:, :3, 2], np.tile([0, 0, -1], (len(q), 1)), atol=1e-12)
    lower, upper = q[:, 1], q[:, 2]  # from the vertical, from the horizontal
    out = 0.2 + np.sin(lower) + 1.1 * np.cos(upper) + 0.2
    up = 0.7 + np.cos(lower) - 1.1 * np.sin(upper) - 0.25
    np.testing.assert_allclose(np.hypot(poses[:, 0, 3], poses[:, 1, 3]), out, atol=1e-12)
    np.testing.assert_allclose(poses[:, 2, 3], up, atol=1e-12)


# --- derivatives ---


@pytest.mark.parametrize("size", [0.0, 1e-3], ids=["nominal", "perturbed"])
def test_jacobian_and_error_columns_are_derivatives(
    closed: Robot, rng: np.random.Generator, size: float
) -> None:
    """Within 1e-7 of differences: joints, placements of joints, cut frames and tool, twists,
    offsets.
    """
    q = inside(closed, 1, rng)
    errors = perturbed(closed, rng, size)
    context = errors.context(q)
    start = context.frames.tool

    def pose_error(moved: RobotErrors, at: Array = q) -> Array:
        return relative_error(moved.frames(at).tool, start)[0]

    jacobian = errors.mechanism.forward_and_jacobian(q)[1][0]
    assert_derivative(lambda x: pose_error(errors, q + x), jacobian, np.zeros(closed.n), 1e-7)
    from calibtool.errormodel.families import BY_ID

    for family in ("placements", "twists", "offsets"):
        shape = errors[family].shape
        columns = BY_ID[family].columns(shape, context)[0]
        assert_derivative(
            lambda x, f=family, s=shape: pose_error(errors.moved(**{f: x.reshape(s)})),
            columns,
            np.zeros(columns.shape[1]),
            1e-7,
        )


def test_growth_of_the_links_has_the_columns_that_it_says(
    closed: Robot, rng: np.random.Generator
) -> None:
    from calibtool.errormodel.families import BY_ID
    from calibtool.errormodel.operating_conditions import Conditions
    from calibtool.robot.se3 import readonly

    q, none = inside(closed, 1, rng), RobotErrors.of(closed)
    warm = Conditions(temperature_c=readonly(np.full(1, 30.0)))
    context = none.context(q, warm)
    shape = none["temperature"].shape
    assert_derivative(
        lambda x: relative_error(
            none.moved(temperature=x).frames(q, warm).tool, context.frames.tool
        )[0],
        BY_ID["temperature"].columns(shape, context)[0],
        np.zeros(shape[0]),
        1e-7,
    )


def test_an_offset_of_a_passive_joint_changes_nothing(
    closed: Robot, rng: np.random.Generator
) -> None:
    """The loop takes it up: M_i exp6(ξ_i ε) before a passive joint leaves every pose as it was."""
    q, tree = inside(closed, 5, rng), closed.chain.tree
    expected = closed.mechanism.forward(q)
    for j in range(tree.n, tree.n + tree.p):
        placements = closed.chain.placements.copy()
        placements[j] = placements[j] @ exp6(1e-3 * closed.chain.twists[j])
        moved = closed.chain.mechanism_of(placements, closed.chain.twists)
        np.testing.assert_allclose(moved.forward(q), expected, rtol=0, atol=1e-11)
    frames = closed.mechanism.frames(q)
    from calibtool.robot.se3 import adjoint

    twists = (adjoint(frames.after) @ closed.chain.twists[:, :, None])[..., 0]
    seen = (frames.transfer[:, : tree.joints] @ twists[..., None])[:, tree.n :, :, 0]
    assert np.abs(seen).max() < 1e-12


# --- rows ---


def test_a_row_does_not_depend_on_the_rows_beside_it(
    closed: Robot, rng: np.random.Generator
) -> None:
    q = closed.lower + (closed.upper - closed.lower) * rng.random((60, closed.n))
    together, jacobians = closed.mechanism.forward_and_jacobian(q)
    for k in range(len(q)):
        pose, jacobian = closed.mechanism.forward_and_jacobian(q[k : k + 1])
        np.testing.assert_array_equal(pose[0], together[k])
        np.testing.assert_array_equal(jacobian[0], jacobians[k])


def test_no_rows_are_answered_with_none(closed: Robot) -> None:
    pose, jacobian = closed.mechanism.forward_and_jacobian(np.zeros((0, closed.n)))
    assert pose.shape == (0, 4, 4)
    assert jacobian.shape == (0, 6, closed.n)


def test_a_row_that_is_no_number_does_not_close(closed: Robot, rng: np.random.Generator) -> None:
    q = inside(closed, 3, rng)
    q[1, 0] = np.nan
    np.testing.assert_array_equal(closed.mechanism.closes(q), [True, False, True])


@pytest.mark.parametrize("name", ["fivebar", "hexapod", "delta"])
def test_no_assembly_mode_is_wrong(name: str, rng: np.random.Generator) -> None:
    """Against small steps along the straight way from the closed configuration, which needs no
    table.
    """
    robot = load_robot(name)
    mechanism, tree = closed_mechanism(robot), robot.chain.tree
    q = robot.lower + (robot.upper - robot.lower) * rng.random((400, robot.n))
    rows, home = np.arange(len(q)), tree.closed_at
    theta = np.tile(home, (len(q), 1))
    signs = None
    for part in np.linspace(0.0, 1.0, 61):
        theta[:, : tree.n] = home[: tree.n] + (q - home[: tree.n]) * part
        closed = newton(mechanism.equations, tree, theta, rows, np.full(len(q), 0.3))
        theta = closed.theta
        _, _, at = mechanism.equations(theta, rows)(rows, theta[:, tree.passive])
        sign = np.linalg.slogdet(np.nan_to_num(at.columns[:, :, tree.passive]))[0]
        signs = sign if signs is None else signs
        theta[~closed.ok | (sign != signs)] = np.nan
    found = mechanism.joints(q)
    both = np.isfinite(found).all(axis=-1) & np.isfinite(theta).all(axis=-1)
    assert both.mean() > 0.4
    np.testing.assert_allclose(found[both], theta[both], rtol=0, atol=1e-8)
    assert (np.isfinite(theta).all(axis=-1) & ~both).mean() < 0.005  # rows at the edge


def test_limits_of_passive_joints_count(rng: np.random.Generator) -> None:
    robot = load_robot("delta")
    q = inside(robot, 50, rng)
    assert robot.within_limits(q).all()
    theta = closed_mechanism(robot).joints(q)[:, robot.n]
    tree = robot.chain.tree
    upper = tree.upper.copy()
    upper[robot.n] = np.median(theta)
    chain = replace(robot.chain, tree=replace(tree, upper=upper))
    np.testing.assert_array_equal(
        replace(robot, chain=chain).within_limits(q), theta <= upper[robot.n]
    )


def test_near_a_singularity_of_the_passive_joints_the_distance_is_small() -> None:
    """A five-bar whose rods are nearly stretched: its tip moves without the motors."""
    robot = load_robot("fivebar")
    outwards = np.linspace(1.95, 2.5, 300)  # both elbows, away from each other
    q = np.stack([outwards, np.pi - outwards], axis=-1)
    pose = robot.mechanism.forward(q)
    last = int(np.flatnonzero(np.isfinite(pose[:, 0, 0]))[-1])
    distance = robot.singularity_distance(q)
    assert 0 < last < len(q) - 1
    assert distance[last] < 0.5 * distance[0]
    assert (distance[last + 1 :] == 0.0).all()
