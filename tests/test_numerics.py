"""Bounds at the edges of floating point and of good sense: singularities, sizes, turns, targets,
noise, few rows.

docs/numerics.md lists them, by benchmarks/numerics.py. Every figure here is checked within a factor
of about two of what was measured.
"""

from dataclasses import replace

import numpy as np
import pytest
from drawn import DrawnChain, DrawnJoint
from poe import expm_chain
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify, train
from calibtool.compensation.solve import compensate_joints, compensate_poses
from calibtool.compensation.status import NEAR_SINGULAR, OK, UNREACHABLE
from calibtool.compensation.step import DAMPED_BELOW
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import InputError, NoSolutionError
from calibtool.evaluation.compare import evaluate
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.setup import check_targets
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, readonly, transform_points
from calibtool.robot.singularity import (
    MIN_SINGULARITY_DISTANCE,
    at_point,
    singularity_distance,
)

# --- singularities --------------------------------------------------------------------------------

DISTANCES = np.concatenate([-(10.0 ** -np.arange(1, 9)), [0.0], 10.0 ** -np.arange(8, 0, -1)])
SINGULAR = [
    ("fanuc-m1000ia", 4),
    ("ur5", 4),
    ("scara", 1),
    ("planar-3r", 1),
]  # joint that is singular at zero
_KEPT: dict[str, Calibration] = {}


def calibrated(name: str) -> Calibration:
    if name not in _KEPT:
        robot = load_robot(name)
        data = simulate(robot, Simulation(seed=1, configurations=40))
        _KEPT[name] = identify(data, "complete")
    return _KEPT[name]


def towards_singularity(robot: Robot, joint: int) -> Array:
    q = np.tile(robot.workspace().home, (len(DISTANCES), 1))
    q[:, joint] = DISTANCES
    return q


@pytest.mark.parametrize(("name", "joint"), SINGULAR)
@pytest.mark.parametrize("method", ["exact", "one-step"])
def test_corrections_are_bounded_and_reported_near_singularities(
    name: str, joint: int, method: str
) -> None:
    calibration = calibrated(name)
    robot = calibration.robot
    q = towards_singularity(robot, joint)
    result = compensate_joints(calibration, q, method)
    assert np.isfinite(result.q).all()
    assert np.abs(result.q - q).max() < 0.1
    near = robot.singularity_distance(q) < MIN_SINGULARITY_DISTANCE / 2
    assert near.any()
    assert not (result.status[near] == OK).any()
    before = errors(calibration, q, q)
    assert (errors(calibration, result.q, q) <= before).all()  # no correction is worse than none
    told = np.hypot(result.position / robot.length, result.orientation)
    np.testing.assert_allclose(told, errors(calibration, result.q, q), atol=1e-12)
    if method == "exact" and robot.n >= 6:
        assert result.position[result.status == OK].max(initial=0.0) < 1e-9


@pytest.mark.parametrize(("name", "joint"), SINGULAR[:2])
def test_exact_leaves_no_more_than_one_step_near_singularities(name: str, joint: int) -> None:
    """Of the sum that the damping makes least: both are damped alike, exact finds what one
    step is aiming at.
    """
    calibration = calibrated(name)
    robot = calibration.robot
    q = towards_singularity(robot, joint)
    pose, jacobian = calibration.forward_and_jacobian(q)
    columns = at_point(jacobian, pose[:, :3, 3])
    damping = np.maximum(0.0, DAMPED_BELOW - singularity_distance(columns, robot.length))
    cost = {}
    for method in ("exact", "one-step"):
        result = compensate_joints(calibration, q, method)
        length = np.linalg.norm(result.q - q, axis=-1)
        cost[method] = errors(calibration, result.q, q) ** 2 + (damping * length) ** 2 / 4
    assert (cost["exact"] <= cost["one-step"] * 1.05 + 1e-24).all()
    assert (np.sqrt(cost["exact"][damping == 0]) < 1e-9).all()


def errors(calibration: Calibration, corrected: Array, q: Array) -> Array:
    """Weighted pose errors of the calibrated robot at corrected joints, against the
    nominal one at q: (N,).
    """
    pose, aim = calibration.forward(corrected), calibration.robot.mechanism.forward(q)
    turn = Rotation.from_matrix(pose[:, :3, :3] @ np.swapaxes(aim[:, :3, :3], -1, -2)).magnitude()
    return np.hypot(
        np.linalg.norm((pose - aim)[:, :3, 3], axis=-1) / calibration.robot.length, turn
    )


def test_poses_at_a_singularity_have_a_verdict() -> None:
    calibration = calibrated("fanuc-m1000ia")
    q = towards_singularity(calibration.robot, 4)
    result = compensate_poses(calibration, calibration.robot.mechanism.forward(q), q)
    assert np.isin(result.status, (OK, NEAR_SINGULAR, UNREACHABLE)).all()
    assert np.isfinite(result.q[result.status != UNREACHABLE]).all()


# --- sizes ----------------------------------------------------------------------------------------

STRAIGHT = (0.0, 0.0, 0.0)


def joint(
    kind: str, xyz: tuple[float, float, float], axis: tuple[float, float, float]
) -> DrawnJoint:
    return DrawnJoint(kind, xyz, STRAIGHT, axis, 0.0)


WRIST = [
    joint("revolute", (0, 0, 0.1), (1, 0, 0)),
    joint("revolute", (0.4, 0, 0), (0, 1, 0)),
    joint("revolute", (0.1, 0, 0), (1, 0, 0)),
]
ARM = [
    joint("revolute", (0, 0, 0.3), (0, 0, 1)),
    joint("revolute", (0.1, 0, 0), (0, 1, 0)),
    joint("revolute", (0, 0, 0.4), (0, 1, 0)),
]
SLIDES = [
    joint("prismatic", STRAIGHT, axis)
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
]
TOOL = joint("fixed", (0.1, 0, 0.05), (0, 0, 1))
TARGETS = ((100.0, 0.0, 20.0), (-50.0, 86.6, 20.0), (-50.0, -86.6, 20.0))


@pytest.mark.parametrize("scale", [0.005, 1.0, 50.0])
@pytest.mark.parametrize("first", [ARM, SLIDES], ids=["arm", "gantry"])
@pytest.mark.parametrize("tolerances", ["own", "default"])
def test_a_micro_manipulator_and_a_crane_are_calibrated_as_well(
    first: list[DrawnJoint], scale: float, tolerances: str
) -> None:
    """Links of about 1 m times 0.005 and 50, slides of 1 m likewise; errors and
    noise grow with them.
    """
    tolerance = 1.0 if tolerances == "default" else scale
    robot = DrawnChain(tuple(first + WRIST), TOOL, TARGETS).robot(
        scale=scale, tolerance_mm=tolerance
    )
    data = simulate(
        robot,
        Simulation(
            seed=1,
            configurations=50,
            scales=ErrorScales(length=0.5e-3 * scale),
            noise=0.05e-3 * scale,
            workspace="full",
        ),
    )
    fresh = simulate(
        robot,
        Simulation(seed=2, configurations=60, noise=0.0, same_robot=data.truth, workspace="full"),
    )
    calibration = identify(data, "complete")
    # At a joint limit or a singularity a part of the error stays.
    full = compensate_joints(calibration, fresh.q).status == OK
    assert full.mean() > 0.8
    compared = evaluate([("complete", calibration)], fresh.rows(np.flatnonzero(full))).methods[1]
    assert compared.position_size.max() / scale < 0.08e-3
    turns = compared.orientation_size
    assert turns is not None
    assert turns.max() < 0.5e-3


def test_the_stated_noise_of_a_fine_instrument_is_its_own() -> None:
    robot = load_robot("ur5")
    data = simulate(robot, Simulation(configurations=5, noise=2e-8, workspace="full"))
    assert data.noise_position == 2e-8
    assert (
        simulate(robot, Simulation(configurations=5, noise=0.0, workspace="full")).noise_position
        == 1e-6
    )


def test_robots_that_differ_by_five_micrometres_are_not_the_same() -> None:
    chain = DrawnChain(tuple(ARM + WRIST), TOOL, TARGETS)
    data = simulate(chain.robot(), Simulation(configurations=10, workspace="full"))
    other = replace(data, robot=chain.robot(scale=1 + 1e-5))
    with pytest.raises(InputError, match="kinematics differ"):
        evaluate([("other", identify(other, "nominal"))], data)


# --- many turns -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("turned", "bound"), [(1e3, 1e-12), (1e4, 1e-11), (1e5, 1e-10), (1e6, 1e-9)]
)
def test_joint_values_of_many_turns_lose_digits_only(turned: float, bound: float) -> None:
    """Metres and elements of rotations, on an arm of 3 m whose last three joints
    have turned so far.
    """
    calibration = calibrated("fanuc-m1000ia")
    robot = calibration.robot
    q = calibration.q[:10]
    far = q + np.array([0, 0, 0, 1, 1, 1]) * round(turned / (2 * np.pi)) * 2 * np.pi
    np.testing.assert_allclose(robot.mechanism.forward(far), robot.mechanism.forward(q), atol=bound)
    # With the same turns of every joint error the calibration says the same: only δξ
    # grows with the turns.
    steady = calibration.base.errors.without("twists")
    plain = replace(calibration, base=replace(calibration.base, errors=steady), networks=())
    np.testing.assert_allclose(plain.forward(far), plain.forward(q), atol=bound)
    near, there = compensate_joints(plain, q), compensate_joints(plain, far)
    np.testing.assert_allclose(there.q - far, near.q - q, atol=10 * bound)
    # A screw of many turns: scipy's matrix exponential, Pinocchio's helical joints.
    errors, chain = calibration.base.errors, robot.chain
    placements = chain.placements @ exp6(errors["placements"])
    expected = expm_chain(placements, chain.twists + errors["twists"], far + errors["offsets"])
    found = calibration.base_mechanism.forward(far)  # a pitch takes the tool metres away
    np.testing.assert_allclose(found, expected, rtol=1e3 * bound, atol=1e3 * bound)


# --- targets almost on one line -------------------------------------------------------------------


def seen_with(data: Measurements, targets: Array) -> Measurements:
    assert data.truth is not None
    points = transform_points(data.truth.actual.forward(data.q), targets)
    points = points + 0.05e-3 * np.random.default_rng(3).normal(size=points.shape)
    setup = replace(data.setup, targets=readonly(targets))
    return replace(data, setup=setup, points=readonly(points), truth=None)


@pytest.mark.parametrize("width", 10.0 ** -np.arange(1, 10))
def test_targets_almost_on_a_line_are_refused_or_serve(
    width: float, fanuc_measurements: Measurements
) -> None:
    """Three targets on 0.2 m, the middle one `width` times 0.2 m off the line."""
    targets = np.array([[-0.1, 0, 0.05], [0.1, 0, 0.05], [0, 0.2 * width, 0.05]])
    if width < 0.8e-3:
        with pytest.raises(InputError, match="collinear"):
            check_targets(targets, "targets")
    elif width > 1.2e-3:
        check_targets(targets, "targets")
    # The tolerances of the complete model take over what targets do not show: made by hand,
    # such data serve too.
    data = fanuc_measurements.rows(np.arange(40))
    found = identify(seen_with(data, targets), "complete")
    assert data.truth is not None
    off = (data.truth.actual.forward(data.q) - found.forward(data.q))[:, :3, 3]
    assert np.linalg.norm(off, axis=-1).max() < 0.2e-3


# --- noise ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 1e-15, 1e-9, 1e-3, 1.0, 1e3, 1e6])
def test_no_noise_and_huge_noise_give_the_truth_and_the_drawing(noise: float, fanuc: Robot) -> None:
    workspace = fanuc.workspace()
    data = simulate(fanuc, Simulation(seed=1, workspace=workspace, configurations=40, noise=noise))
    found = identify(data, "complete")
    assert data.truth is not None
    true, nominal = data.truth.actual.forward(data.q), fanuc.mechanism.forward(data.q)
    left, before = (
        np.linalg.norm((true - pose)[:, :3, 3], axis=-1).max()
        for pose in (found.forward(data.q), nominal)
    )
    assert left < {0.0: 1e-9, 1e-15: 1e-9, 1e-9: 1e-8}.get(noise, 1.3 * before)


@pytest.mark.parametrize("stated", [0.0, -1.0, 1e-200, 1e200, np.inf, np.nan])
def test_stated_noise_that_cannot_be_a_weight_is_refused(
    stated: float, fanuc_measurements: Measurements
) -> None:
    with pytest.raises(InputError, match="stated noise"):
        replace(fanuc_measurements, noise_position=stated)


def test_stated_noise_far_from_the_real_one_is_put_right(fanuc_measurements: Measurements) -> None:
    """Weights matter by their ratios: the noise is estimated."""
    wrong = replace(fanuc_measurements, noise_position=1e-12)
    right, found = identify(fanuc_measurements, "complete"), identify(wrong, "complete")
    q = fanuc_measurements.q
    np.testing.assert_allclose(found.forward(q), right.forward(q), atol=0.05e-3)


# --- one configuration, and the same one again ----------------------------------------------------


@pytest.mark.parametrize(
    "rows", [[0], [0] * 30, [0] * 15 + [1] * 15], ids=["one", "the same", "two"]
)
@pytest.mark.parametrize("base", ["nominal", "local-poe", "complete"])
def test_few_configurations_are_fitted_or_refused(
    rows: list[int], base: str, fanuc_measurements: Measurements
) -> None:
    data = fanuc_measurements.rows(np.array(rows))
    if base == "local-poe" and len(rows) == 1:
        with pytest.raises(NoSolutionError, match="measure at least 5"):
            identify(data, base)
        return
    found = identify(data, base)
    poses = found.forward(data.q)
    left = data.points - transform_points(poses, data.setup.targets)
    nominal = data.points - transform_points(
        data.robot.mechanism.forward(data.q), data.setup.targets
    )
    assert np.abs(left).max() <= np.abs(nominal).max()
    assert np.isfinite(compensate_joints(found, fanuc_measurements.q[:5]).q).all()


@pytest.mark.parametrize("base", ["nominal", "complete"])
@pytest.mark.parametrize("regularisation", ["bayes", "early-stopping"])
def test_a_network_is_trained_on_one_configuration_or_not_used(
    base: str, regularisation: str, fanuc_measurements: Measurements
) -> None:
    options = TrainingOptions(restarts=2, regularisation=regularisation)
    repeated = fanuc_measurements.rows(
        np.zeros(20, dtype=int)
    )  # the very same reading: fitted to the last digit
    assert np.isfinite(train(repeated, base, options).forward(fanuc_measurements.q)).all()
    if regularisation == "bayes":  # nothing can be left out to judge a network
        one = train(fanuc_measurements.rows(np.zeros(1, dtype=int)), base, options)
        assert one.networks == ()
        assert "neural network: not used" in one.summary()


def test_without_errors_nothing_is_left_to_correct_at_any_size() -> None:
    for scale in (0.005, 50.0):
        robot = DrawnChain(tuple(SLIDES + WRIST), TOOL, TARGETS).robot(scale=scale)
        data = simulate(
            robot,
            Simulation(
                configurations=20, scales=ErrorScales(kinds=()), noise=0.0, workspace="full"
            ),
        )
        found = identify(data, "complete")
        assert np.abs(found.base.errors["placements"]).max() < 1e-9
        still = replace(found, base=replace(found.base, errors=RobotErrors.of(robot)))
        np.testing.assert_allclose(compensate_joints(still, data.q).q, data.q, atol=1e-9)
