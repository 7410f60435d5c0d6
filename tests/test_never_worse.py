"""A correction is never worse than none: bounded, inside the limits, without jumps, reported."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify, train
from calibtool.compensation.bounds import Bounds
from calibtool.compensation.jumps import LARGEST_RATIO, CorrectionPath
from calibtool.compensation.one_step import Linearised, default_bounds
from calibtool.compensation.solve import Method, compensate_joints, compensate_poses
from calibtool.compensation.status import DOUBTFUL, JUMP, MEANING, OK, UNCORRECTED
from calibtool.compensation.step import DAMPED_BELOW, bounded_step
from calibtool.compensation.stream import StreamOptions, compensate_text
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.errors import UsageError
from calibtool.evaluation.compare import evaluate
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

METHODS: tuple[Method, ...] = ("exact", "one-step")
REDUNDANT = ("panda", "xarm7", "tiago-arm")


@cache
def calibrated(name: str, base: str = "complete", workspace: str | None = "full") -> Calibration:
    robot = load_robot(name)
    chosen = robot.workspace(workspace)
    simulation = Simulation(
        seed=1, workspace=chosen, configurations=60, scales=ErrorScales(kinds=ERROR_KINDS)
    )
    data = simulate(robot, simulation)
    return (
        identify(data, base)
        if base == "complete"
        else train(data, base, TrainingOptions(regularisation="early-stopping", restarts=1))
    )


def anywhere(robot: Robot, count: int, seed: int = 3) -> Array:
    return robot.lower + (robot.upper - robot.lower) * np.random.default_rng(seed).random(
        (count, robot.n)
    )


def tool_errors(calibration: Calibration, q: Array, commanded: Array) -> Array:
    """x, y, z over the characteristic length and the turn, along the commanded tool: (N, 6)."""
    pose, R = calibration.forward(q), np.swapaxes(commanded[:, :3, :3], -1, -2)
    away = (R @ (pose - commanded)[:, :3, 3:])[..., 0] / calibration.robot.length
    turn = Rotation.from_matrix(pose[:, :3, :3] @ R).as_rotvec()
    return np.concatenate([away, (R @ turn[..., None])[..., 0]], axis=-1)


def correctable(calibration: Calibration) -> list[int]:
    virtual = calibration.equivalent.virtual_joints
    return [i for i, name in enumerate(("x", "y", "z", "rx", "ry", "rz")) if name not in virtual]


# --- never worse ----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("base", ["complete", "nominal"])
@pytest.mark.parametrize("workspace", [None, "full"])
@pytest.mark.parametrize("name", ["ur3", "panda", "so100", "gantry"])
def test_no_row_is_worse_than_the_command(
    name: str, workspace: str | None, base: str, method: Method
) -> None:
    calibration = calibrated(name, base, workspace)
    robot = calibration.robot
    q = anywhere(robot, 400)
    result = compensate_joints(calibration, q, method)
    commanded = robot.mechanism.forward(q)
    before, after = (tool_errors(calibration, joints, commanded) for joints in (q, result.q))
    for components in (range(6), correctable(calibration)):
        worse = np.linalg.norm(after[:, components], axis=-1) > np.linalg.norm(
            before[:, components], axis=-1
        )
        assert not worse.any()
    left = result.status == UNCORRECTED
    np.testing.assert_array_equal(result.q[left], q[left])
    assert set(result.status) <= {OK, *MEANING}
    told = np.linalg.norm((calibration.forward(result.q) - commanded)[:, :3, 3], axis=-1)
    np.testing.assert_allclose(result.position, told, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["ur5", "planar-3r"])
def test_poses_are_no_worse_either(name: str, method: Method) -> None:
    calibration = calibrated(name)
    robot = calibration.robot
    q = anywhere(robot, 60)
    poses = robot.mechanism.forward(q)
    result = compensate_poses(calibration, poses, q, method)
    before, after = (
        np.linalg.norm(tool_errors(calibration, x, poses), axis=-1)
        for x in (result.commanded, result.q)
    )
    assert (after <= before * (1 + 1e-6)).all()


@pytest.mark.parametrize("name", ["ur5", "so100"])
def test_a_row_that_is_ok_leaves_no_more_than_the_others(name: str) -> None:
    calibration = calibrated(name)
    q = anywhere(calibration.robot, 1000)
    for method in METHODS:
        result = compensate_joints(calibration, q, method)
        left = tool_errors(calibration, result.q, calibration.robot.mechanism.forward(q))[
            :, correctable(calibration)
        ]
        left = np.linalg.norm(left, axis=-1)
        ok = result.status == OK
        assert ok.mean() > 0.3
        assert left[ok].max() <= max(5 * np.median(left), 1e-9)


def test_rows_that_are_corrected_in_part_are_counted_by_an_evaluation() -> None:
    calibration = calibrated("ur5")
    data = simulate(calibration.robot, Simulation(seed=3, configurations=80, workspace="full"))
    status = compensate_joints(calibration, data.q).status
    nominal, corrected = evaluate([("c", calibration)], data).results
    assert (nominal.marked, corrected.marked) == (0, np.isin(status, DOUBTFUL).sum())


# --- bounded --------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["ur5", "tiago-arm"])
@pytest.mark.parametrize("degrees", [0.01, 0.3, None])
def test_no_joint_changes_by_more_than_it_may(
    name: str, method: Method, degrees: float | None
) -> None:
    calibration = calibrated(name)
    robot = calibration.robot
    bounds = default_bounds(calibration, None if degrees is None else np.deg2rad(degrees))
    q = anywhere(robot, 300)
    result = compensate_joints(calibration, q, method, bounds=bounds)
    most = bounds.largest_change * np.where(robot.prismatic, robot.length, 1.0)
    assert (np.abs(result.q - q) <= most + 1e-12).all()
    if degrees is not None:
        assert (result.status == "limited").mean() > 0.1
        assert (np.abs(result.q - q).max(axis=0) > 0.999 * most).any()


def test_the_bound_follows_the_size_of_the_errors() -> None:
    """50 times the rms of the pose error at the measured configurations."""
    calibration = calibrated("ur5")
    commanded = calibration.robot.mechanism.forward(calibration.q)
    size = np.sqrt((tool_errors(calibration, calibration.q, commanded) ** 2).sum(axis=-1).mean())
    assert default_bounds(calibration).largest_change == pytest.approx(50 * size, rel=1e-6)


@pytest.mark.parametrize("given", [0.0, -1.0, float("nan")])
def test_a_bound_that_is_none_is_refused(given: float) -> None:
    with pytest.raises(UsageError, match="the largest change of a joint"):
        default_bounds(calibrated("ur5"), given)


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "fanuc-m900ib-700", "ur5", "kinova", "xarm7"])
@pytest.mark.parametrize("offset", [0.0, 1e-6, 0.005, 0.02])
def test_joint_targets_at_the_mastering_position_do_not_swing(name: str, offset: float) -> None:
    calibration = calibrated(name)
    robot = calibration.robot
    q = np.clip(np.full((1, robot.n), 0.0), robot.lower, robot.upper)
    q[:, 4] += offset
    commanded = robot.mechanism.forward(q)
    before = np.linalg.norm(tool_errors(calibration, q, commanded), axis=-1)
    for method in METHODS:
        result = compensate_joints(calibration, q, method)
        assert np.abs(result.q - q).max() < np.deg2rad(3.0)
        assert np.linalg.norm(tool_errors(calibration, result.q, commanded), axis=-1) < before


# --- the joint limits -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", REDUNDANT)
def test_a_redundant_arm_stays_inside_by_its_freedom(name: str) -> None:
    """A joint stands at its limit and its correction leads out: the others make up for it."""
    calibration = calibrated(name)
    robot = calibration.robot
    q = anywhere(robot, 80, seed=5)
    free = compensate_joints(calibration, q)
    for j in (0, 2, robot.n - 1):
        at_limit = q.copy()
        at_limit[:, j] = np.where(free.q[:, j] > q[:, j], robot.upper[j], robot.lower[j])
        regular = robot.singularity_distance(at_limit) > 0.15
        result = compensate_joints(calibration, at_limit[regular])
        assert robot.within_limits(result.q).all()
        assert regular.sum() > 10
        assert (result.status == OK).mean() > 0.85  # the last of the others would cost too much
        assert result.position[result.status == OK].max() < 1e-8
        assert np.median(result.position) < 1e-8


@pytest.mark.parametrize("method", METHODS)
def test_without_freedom_a_joint_stops_at_its_limit_and_the_rest_is_corrected(
    method: Method,
) -> None:
    calibration = calibrated("ur5")
    robot = calibration.robot
    q = anywhere(robot, 200, seed=6)
    change = compensate_joints(calibration, q, method).q - q
    q[:, 0] = np.where(change[:, 0] > 0, robot.upper[0], robot.lower[0])
    result = compensate_joints(calibration, q, method)
    assert robot.within_limits(result.q).all()
    commanded = robot.mechanism.forward(q)
    held = result.status == "out-of-limits"
    assert held.mean() > 0.5
    before, after = (
        np.linalg.norm(tool_errors(calibration, x, commanded), axis=-1) for x in (q, result.q)
    )
    assert np.median((after / before)[held]) < 0.8

    def left(step: Array, k: int) -> Array:
        return tool_errors(calibration, (q[k] + step)[None], commanded[k : k + 1])[0]

    if (
        method == "exact"
    ):  # nothing inside comes nearer, but for a little where the others are damped
        for k in np.flatnonzero(held)[:5]:
            box = default_bounds(calibration).box(robot, q[k : k + 1])
            low, high = box[0][0], np.maximum(box[1][0], box[0][0] + 1e-9)
            best = least_squares(
                left, np.clip(0.0, low, high), args=(k,), bounds=(low, high), xtol=1e-14, ftol=1e-14
            )
            assert after[k] <= 1.2 * np.sqrt(2 * best.cost) + 1e-6


def test_a_joint_that_is_commanded_outside_its_limits_is_corrected_as_if_it_had_none() -> None:
    calibration = calibrated("fanuc-m1000ia")
    q = anywhere(calibration.robot, 40)
    far = q + np.array([0, 0, 0, 4 * np.pi, 0, 0])
    near, there = (compensate_joints(calibration, x) for x in (q, far))
    assert (there.status == "out-of-limits").sum() + (there.status == UNCORRECTED).sum() == 40
    regular = (near.status == OK) & (calibration.robot.singularity_distance(q) > 0.1)
    commanded = calibration.robot.mechanism.forward(far)
    assert np.abs(tool_errors(calibration, there.q, commanded)[regular]).max() < 1e-8


# --- fewer than six joints ------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["scara", "so100"])
def test_a_joint_that_is_held_is_on_the_face_of_its_box_to_the_last_digit(name: str) -> None:
    """Where the task is not traded, for n < 6 too: by that `judged` tells what holds a row back."""
    calibration = calibrated(name)
    robot, rng = calibration.robot, np.random.default_rng(5)
    bounds = replace(default_bounds(calibration), largest_change=1e-4)  # far too small: all stop
    model = Linearised.at(calibration, robot.anywhere(500, rng), None, bounds)
    proposal, traded = model.proposed()
    lower, upper = model.box
    near = np.minimum(np.abs(proposal.change - lower), np.abs(proposal.change - upper)) < 1e-12
    on_face = (proposal.change == lower) | (proposal.change == upper)
    assert near[~traded].any()
    assert np.array_equal(on_face[~traded], near[~traded])


@pytest.mark.parametrize(
    ("name", "least"), [("scara", 0.85), ("planar-3r", 0.85), ("gantry", 0.25), ("so100", 0.25)]
)
def test_the_components_that_joints_can_correct_vanish(name: str, least: float) -> None:
    calibration = calibrated(name)
    q = anywhere(calibration.robot, 300)
    result = compensate_joints(calibration, q)
    commanded = calibration.robot.mechanism.forward(q)
    ok = result.status == OK
    assert ok.mean() > least
    assert (
        np.abs(tool_errors(calibration, result.q, commanded)[ok][:, correctable(calibration)]).max()
        < 1e-9
    )
    assert result.orientation[ok].max() > 1e-5  # the rest stays, and is told
    one = compensate_joints(calibration, q, "one-step")
    both = ok & (one.status == OK)
    before, after = (
        tool_errors(calibration, x, commanded)[both][:, correctable(calibration)]
        for x in (q, one.q)
    )
    assert np.linalg.norm(after, axis=-1).max() < 0.1 * np.median(np.linalg.norm(before, axis=-1))


@pytest.mark.parametrize(
    "weights", [(1, 1, 1, 1, 1, 1), (1, 1, 1, 0.1, 0.1, 1), (0.5, 1, 1, 0, 0, 2)]
)
def test_weights_trade_one_component_for_another(weights: tuple[float, ...]) -> None:
    calibration = calibrated("scara")
    q = anywhere(calibration.robot, 20)
    q = q[calibration.robot.singularity_distance(q) > 0.1]
    result = compensate_joints(calibration, q, bounds=default_bounds(calibration, weights=weights))
    commanded = calibration.robot.mechanism.forward(q)

    def left(joints: Array, k: int) -> Array:
        return tool_errors(calibration, joints[None], commanded[k : k + 1])[0] * weights

    assert len(q) > 8
    for k in range(len(q)):
        best = least_squares(left, q[k], args=(k,), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert (left(result.q[k], k) ** 2).sum() <= 2 * best.cost * (1 + 2e-3) + 1e-18


@pytest.mark.parametrize(
    ("name", "weights", "message"),
    [
        ("ur5", (1.0,) * 6, "fewer than six joints"),
        ("scara", (1.0,) * 5, "six numbers"),
        ("scara", (1.0, 1.0, 1.0, -1.0, 0.0, 1.0), "not negative"),
        ("scara", (1.0, float("nan"), 1.0, 0.0, 0.0, 1.0), "six numbers"),
        ("scara", (1.0, 1.0, 0.0, 0.0, 0.0, 1.0), "3 weights are positive, but 4 joints"),
    ],
)
def test_weights_that_do_not_fit_are_refused(
    name: str, weights: tuple[float, ...], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        default_bounds(calibrated(name), weights=weights)


# --- redundancy -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", REDUNDANT)
def test_a_redundant_arm_moves_no_more_than_it_must(name: str) -> None:
    """The change has no part that leaves the tool where it is."""
    calibration = calibrated(name)
    robot = calibration.robot
    q = anywhere(robot, 200)
    q = q[robot.singularity_distance(q) > 0.1]
    result = compensate_joints(calibration, q)
    change = result.q - q
    lower, upper = default_bounds(calibration).box(robot, q)
    free = (result.status == OK) & np.all((change > lower) & (change < upper), axis=-1)
    assert free.sum() > 30
    jacobian = calibration.base_forward_and_jacobian(result.q[free])[1]
    for J, step in zip(jacobian, change[free], strict=True):
        null = np.linalg.svd(J)[2][6:]
        assert np.abs(null @ step).max() < 2e-2 * np.linalg.norm(step) + 1e-9


# --- the step inside a box ------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 4, 5, 6])
def test_a_step_that_is_not_damped_is_the_least_squares_of_the_box(
    n: int, rng: np.random.Generator
) -> None:
    k = min(n, 6)
    A, e = rng.normal(size=(60, k, n)), rng.normal(size=(60, k))
    upper = rng.uniform(0.2, 3.0, size=(60, n))
    change, distance, damping = bounded_step(A, e, -upper, upper)
    inside = np.all(np.abs(change) < upper, axis=-1)
    assert 5 < inside.sum() < 60
    for j in np.flatnonzero(inside & (damping == 0)):
        np.testing.assert_allclose(change[j], np.linalg.solve(A[j], -e[j]), rtol=1e-7, atol=1e-9)
        best = lsq_linear(A[j], -e[j], (-upper[j], upper[j])).x
        np.testing.assert_allclose(change[j], best, atol=1e-5)
    sigma = np.linalg.svd(A, compute_uv=False)
    np.testing.assert_allclose(distance, (1 / sigma**2).sum(axis=-1) ** -0.5, rtol=1e-6)
    assert (np.abs(change) <= upper).all()


def test_a_singular_step_keeps_what_is_regular() -> None:
    """Along the direction without a derivative nothing moves; across it nothing is lost."""
    A = np.diag([1.0, 1.0, 1.0, 0.3, 0.3, 0.0])[None]
    e = np.full((1, 6), 1e-3)
    change, distance, damping = bounded_step(A, e, np.full((1, 6), -1.0), np.full((1, 6), 1.0))
    np.testing.assert_allclose(
        change[0], [-1e-3] * 3 + [-1e-3 / 0.3] * 2 + [0.0], rtol=2e-4, atol=1e-9
    )
    assert distance[0] < 1e-6
    assert damping[0] == pytest.approx(DAMPED_BELOW**2, rel=1e-3)


def test_the_damping_sets_in_without_a_jump() -> None:
    """Through the limit of the distance the step along the singular direction changes smoothly."""
    sigma = np.linspace(0.0, 0.06, 6001)
    A = np.tile(np.eye(6), (len(sigma), 1, 1))
    A[:, 0, 0] = sigma
    ones = np.ones((len(sigma), 6))
    change, _, _ = bounded_step(A, 1e-3 * ones, -9 * ones, 9 * ones)
    along = change[:, 0]
    assert np.abs(along).max() < 1.6e-3 / DAMPED_BELOW
    assert np.abs(np.diff(along)).max() < 4 * 1e-3 / DAMPED_BELOW**2 * 1e-5
    assert along[0] == 0.0


@pytest.mark.parametrize("name", ["ur3", "gantry", "tiago-arm"])
def test_no_row_knows_the_rows_beside_it(name: str) -> None:
    """To the last bit, in batches of any size."""
    calibration = calibrated(name)
    q = anywhere(calibration.robot, 60)
    for method in METHODS:
        together = compensate_joints(calibration, q, method)
        for size in (1, 7):
            parts = [
                compensate_joints(calibration, part, method)
                for part in np.split(q, range(size, 60, size))
            ]
            np.testing.assert_array_equal(np.concatenate([part.q for part in parts]), together.q)
            assert (
                np.concatenate([part.status for part in parts]).tolist() == together.status.tolist()
            )


# --- paths ----------------------------------------------------------------------------------------


def through(name: str, joint: int, degrees: float = 6.0, step: float = 0.003) -> Array:
    """Rows of 0.003 deg through the zero of a joint, the others bent."""
    robot = load_robot(name)
    start = {
        "ur5": [0.3, -1.2, 1.5, -1.9, 0.0, 0.4],
        "fanuc-m1000ia": [0.2, 0.3, -0.2, 0.5, 0.0, 0.3],
        "ur3": [0.3, -1.0, 0.0, -0.7, 1.1, 0.4],
    }[name]
    angles = np.deg2rad(np.arange(-degrees, degrees, step))
    q = np.tile(start, (len(angles), 1))
    q[:, joint] = angles
    assert robot.n == q.shape[1]
    return q


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("name", "joint"), [("ur5", 4), ("fanuc-m1000ia", 4), ("ur3", 2)])
def test_neighbours_of_a_dense_path_are_corrected_alike(
    name: str, joint: int, method: Method
) -> None:
    """Through wrist and elbow: 19.5 deg between two rows that both said near-singular, once."""
    calibration = calibrated(name)
    q = through(name, joint)
    result = compensate_joints(calibration, q, method)
    change = np.abs(np.diff(result.q - q, axis=0)).max(axis=-1)
    assert change.max() < np.deg2rad(0.1)
    said = result.status != OK
    said[[jump.row for jump in CorrectionPath(calibration.robot).jumps(q, result.q)]] = True
    assert change[~said[1:]].max(initial=0.0) <= 20 * np.median(change)


def test_jumps_are_measured_against_the_commanded_step() -> None:
    robot = load_robot("scara")
    q = np.linspace(0, 1, 11)[:, None] * [0.1, 0.1, 0.01, 0.0]
    correction = np.zeros_like(q)
    correction[4:, 1] = 2.6 * LARGEST_RATIO * 0.01
    correction[7:, 2] = 0.9 * LARGEST_RATIO * 0.01 * robot.length  # a slide, less
    path = CorrectionPath(robot)
    assert [(jump.row, jump.joint) for jump in path.jumps(q, q + correction)] == [(4, 1)]
    split = CorrectionPath(robot)
    found = [
        jump.row + k
        for k in (0, 5)
        for jump in split.jumps(q[k : k + 5], (q + correction)[k : k + 5])
    ]
    assert found == [4]
    gap = q + correction
    gap[3:5] = np.nan
    assert [
        jump.row for jump in CorrectionPath(robot).jumps(q, gap)
    ] == []  # over a gap the steps add up


def test_rows_of_joints_that_jump_state_so_and_batches_do_not_show() -> None:
    calibration = calibrated("ur5")
    q = through("ur5", 4, degrees=12.0)
    header = ",".join(calibration.robot.joint_columns)
    text = (
        header + "\n" + "".join(",".join(f"{v:.12g}" for v in row) + "\n" for row in np.rad2deg(q))
    )
    whole, report = compensate_text(calibration, text, "t.csv", StreamOptions(backlash=False))
    status = [line.split(",")[-1] for line in whole.splitlines()[1:]]
    assert {"ok", "near-singular", JUMP} <= set(status)
    parts, _ = compensate_text(calibration, text, "t.csv", StreamOptions(backlash=False, batch=97))
    assert [line.split(",")[-1] for line in parts.splitlines()[1:]] == status
    first = status.index(JUMP)
    assert any(
        line.startswith(f"t.csv:{first + 2}: the correction changes by more than")
        for line in report.remarks
    )
    alone = f"{header}\n{text.splitlines()[first + 1]}\n"
    apart, _ = compensate_text(calibration, alone, "t.csv", StreamOptions(backlash=False))
    assert apart.splitlines()[1].split(",")[:6] == whole.splitlines()[first + 1].split(",")[:6]


def test_bounds_are_what_they_are_given() -> None:
    robot = load_robot("scara")
    q = np.array([robot.upper, robot.lower, (robot.lower + robot.upper) / 2, robot.upper + 0.1])
    lower, upper = Bounds(0.01, (1.0, 1.0)).box(robot, q)
    most = 0.01 * np.where(robot.prismatic, robot.length, 1.0)
    np.testing.assert_allclose(lower, [-most, 0 * most, -most, -most], atol=1e-15)
    np.testing.assert_allclose(upper, [0 * most, most, most, most], atol=1e-15)
