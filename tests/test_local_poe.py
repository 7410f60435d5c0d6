"""The local-POE baseline: what can be recovered is, what cannot is said, and nothing
else is claimed.
"""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from calibtool.calibration import identify
from calibtool.calibration.guard import coverage
from calibtool.errormodel.actual import ActualRobot
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import NoSolutionError
from calibtool.identification.identification import nominal_model
from calibtool.identification.local_poe import identify_local_poe
from calibtool.measurement.measurements import Measurements, Truth
from calibtool.measurement.observation import residuals, weights
from calibtool.measurement.registration import register
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, observe, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array


def actual_robot(robot: Robot, seed: int, size: float = 0.5e-3) -> ActualRobot:
    """Errors of the initial relative poses only: what the model can represent exactly."""
    placements = np.random.default_rng(seed).normal(size=(robot.n + 1, 6)) * size
    return ActualRobot(RobotErrors.of(robot, placements=placements))


def truth_of(
    robot: Robot, seed: int = 0, unregistered: bool = False, size: float = 0.5e-3
) -> Truth:
    rng = np.random.default_rng(seed)
    if not unregistered:
        return Truth(actual_robot(robot, seed, size), Setup(np.eye(4), robot.targets))
    T = np.eye(4)
    T[:3, :3] = Rotation.random(rng=rng).as_matrix()
    T[:3, 3] = rng.uniform(-3, 3, 3)
    targets = robot.targets + rng.uniform(-0.2, 0.2, 3)
    return Truth(
        actual_robot(robot, seed, size), Setup(T, targets, frame_known=False, targets_known=False)
    )


def measured(
    truth: Truth, count: int = 60, noise: float = 0.0, at: Array | None = None
) -> Measurements:
    robot = truth.actual.robot
    workspace = robot.workspace()
    return simulate(
        robot,
        Simulation(
            seed=5, workspace=workspace, configurations=count, noise=noise, same_robot=truth, at=at
        ),
    )


def fresh_configurations(robot: Robot, workspace: str | None = "full") -> Array:
    return sample_configurations(robot, robot.workspace(workspace), 50, np.random.default_rng(99))


def design_configurations(robot: Robot, design: str) -> Array:
    rng = np.random.default_rng(7)
    if design == "workspace":
        return sample_configurations(robot, robot.workspace(), 40, rng)
    return robot.lower + (robot.upper - robot.lower) * rng.random((30, robot.n))


@cache
def sensitivity(name: str, design: str, locked: int | None = None) -> Array:
    """∂(targets in K_0)/∂δζ (N·9, 6n+6) by differences of a product of exponentials
    written out here.
    """
    robot = load_robot(name)
    q = design_configurations(robot, design)
    if locked is not None:
        q[:, locked] = 0.3
    unit = np.zeros((6, 4, 4))
    for c in range(3):
        unit[c, c, 3] = 1.0
    for c, (a, b) in enumerate([(2, 1), (0, 2), (1, 0)]):
        unit[3 + c, a, b], unit[3 + c, b, a] = 1.0, -1.0
    moves = np.array(
        [
            [
                expm(np.einsum("c,cab", twist, unit) * qj[j])
                for j, twist in enumerate(robot.chain.twists)
            ]
            for qj in q
        ]
    )
    targets = np.column_stack([robot.targets, np.ones(len(robot.targets))]).T

    def points(joint: int, component: int, step: float) -> Array:
        T = np.tile(np.eye(4), (len(q), 1, 1))
        for j in range(robot.n + 1):
            T = T @ robot.chain.placements[j]
            if j == joint:
                T = T @ expm(step * unit[component])
            if j < robot.n:
                T = T @ moves[:, j]
        return np.swapaxes((T @ targets)[:, :3], -1, -2).ravel()

    columns = [
        (points(j, c, 1e-5) - points(j, c, -1e-5)) / 2e-5
        for j in range(robot.n + 1)
        for c in range(6)
    ]
    return np.stack(columns, axis=-1)


def expected_rank(robot: Robot) -> int:
    """Six for every frame, less the motions that commute with a joint's own: a turn about and a
    shift along a revolute axis can be moved past it, three shifts and a turn past a prismatic one.
    """
    return 6 * (robot.n + 1) - sum(4 if prismatic else 2 for prismatic in robot.prismatic)


# --- recovery -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "gantry", "panda", "planar-3r", "scara", "ur5"])
def test_injected_placement_errors_are_recovered_without_noise(name: str) -> None:
    robot = load_robot(name)
    truth = truth_of(robot)
    calibration = identify(measured(truth), "local-poe")
    q = fresh_configurations(robot)  # the whole joint range, although the workspace was measured
    assert np.abs(calibration.forward(q) - truth.actual.forward(q)).max() < 1e-9
    assert np.abs(robot.mechanism.forward(q) - truth.actual.forward(q)).max() > 1e-4


def test_large_errors_are_recovered_too(fanuc: Robot) -> None:
    truth = truth_of(fanuc, size=20e-3)
    calibration = identify(measured(truth), "local-poe")
    q = fresh_configurations(fanuc)
    assert np.abs(calibration.forward(q) - truth.actual.forward(q)).max() < 1e-9


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "panda", "scara"])
def test_an_unknown_setup_is_identified_together_with_the_errors(name: str) -> None:
    robot = load_robot(name)
    truth = truth_of(robot, unregistered=True)
    result = identify(measured(truth), "local-poe")
    q = fresh_configurations(robot)
    setup = result.setup
    poses = setup.T_instrument_base @ result.forward(q)
    predicted = np.einsum("kab,mb->kma", poses[:, :3, :3], setup.targets) + poses[:, None, :3, 3]
    assert np.abs(predicted - observe(truth.actual, truth.setup, q)).max() < 1e-9


@pytest.mark.parametrize("known", [True, False])
def test_poses_of_a_sensor_identify_the_robot_as_points_do(fanuc: Robot, known: bool) -> None:
    truth = truth_of(fanuc)
    q, fresh = measured(truth).q, fresh_configurations(fanuc)
    rng = np.random.default_rng(1)
    sensor, origin = Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.2, 0.2, (1, 3))
    T_instrument_base = np.eye(4)
    if not known:
        T_instrument_base[:3, :3], T_instrument_base[:3, 3] = (
            Rotation.random(rng=rng).as_matrix(),
            rng.uniform(-3, 3, 3),
        )
    seen = T_instrument_base @ truth.actual.forward(q)
    points = (seen[:, :3, :3] @ origin[0] + seen[:, :3, 3])[:, None]
    setup = Setup(T_instrument_base, origin, sensor)
    if not known:
        setup = Setup(
            np.eye(4), np.zeros((1, 3)), np.eye(3), frame_known=False, targets_known=False
        )
    measurements = Measurements(fanuc, q, points, seen[:, :3, :3] @ sensor, setup, 0.05e-3, 0.1e-3)
    result = identify(replace(measurements, setup=register(measurements)), "local-poe")
    assert result.base.rank == expected_rank(fanuc)
    assert result.base.residual_rms[0] < 1e-11
    assert result.base.residual_rms[1] is not None
    assert result.base.residual_rms[1] < 1e-11
    found = result.setup
    assert found.R_tool_sensor is not None
    after, real = (
        found.T_instrument_base @ result.forward(fresh),
        T_instrument_base @ truth.actual.forward(fresh),
    )
    assert np.abs(after[:, :3, :3] @ found.R_tool_sensor - real[:, :3, :3] @ sensor).max() < 1e-9
    for T, place in ((after, found.targets[0]), (real, origin[0])):
        T[:, :3, 3] += T[:, :3, :3] @ place
    assert np.abs(after[:, :3, 3] - real[:, :3, 3]).max() < 1e-9


# --- noise ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("unregistered", [False, True])
def test_weighted_residuals_are_chi_square_with_the_equations_less_the_rank(
    fanuc: Robot, unregistered: bool
) -> None:
    measurements = measured(truth_of(fanuc, unregistered=unregistered), noise=0.05e-3)
    base = identify_local_poe(measurements)
    poses = base.errors.forward(measurements.q)
    left = residuals(measurements, base.setup, poses) * weights(measurements)
    freedom = left.size - base.rank
    low, high = chi2.ppf([1e-3, 1 - 1e-3], freedom)
    assert low < (left**2).sum() < high
    assert np.isclose(base.residual_rms[0], 0.05e-3 * np.sqrt((left**2).mean()), rtol=1e-9)


def test_the_fit_is_a_minimum_of_the_weighted_squares(
    fanuc: Robot, fanuc_measurements: Measurements
) -> None:
    base = identify_local_poe(fanuc_measurements)

    def cost(placements: Array) -> float:
        poses = base.errors.having(placements=placements).forward(fanuc_measurements.q)
        return float(
            (
                (residuals(fanuc_measurements, base.setup, poses) * weights(fanuc_measurements))
                ** 2
            ).sum()
        )

    rng = np.random.default_rng(3)
    lowest = cost(base.errors["placements"])
    for _ in range(20):
        step = rng.normal(size=(7, 6)) * 1e-5
        assert cost(base.errors["placements"] + step) > lowest
        assert cost(base.errors["placements"] - step) > lowest


def test_a_smaller_noise_gives_a_smaller_error(fanuc: Robot) -> None:
    truth = truth_of(fanuc)
    q = fresh_configurations(fanuc, None)
    off = [
        float(
            np.abs(
                identify(measured(truth, noise=noise), "local-poe").forward(q)
                - truth.actual.forward(q)
            ).max()
        )
        for noise in (0.1e-3, 0.01e-3)
    ]
    assert 5 < off[0] / off[1] < 20  # linear in the noise, which is the same but for its size


# --- what can be observed -------------------------------------------------------------------------


def test_as_many_parameters_are_found_as_frames_and_axes_leave(robot: Robot) -> None:
    base = identify_local_poe(measured(truth_of(robot)))
    assert base.parameters == 6 * robot.n + 6
    assert base.rank == base.observable_rank == expected_rank(robot)
    assert base.unobservable == ()
    if robot.n == 6:
        assert base.rank == 30  # docs/method.md, local POE


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "gantry", "planar-3r", "scara"])
def test_the_rank_is_that_of_finite_differences(name: str) -> None:
    robot = load_robot(name)
    s = np.linalg.svd(sensitivity(name, "full"), compute_uv=False)
    assert int((s > 1e-6 * s[0]).sum()) == expected_rank(robot)


def test_singular_values_are_those_of_the_weighted_sensitivity(fanuc: Robot) -> None:
    q = design_configurations(fanuc, "workspace")
    base = identify_local_poe(measured(truth_of(fanuc), noise=0.05e-3, at=q))
    expected = np.linalg.svd(sensitivity("fanuc-m1000ia", "workspace") / 0.05e-3, compute_uv=False)
    assert np.allclose(base.singular_values[:30], expected[:30], rtol=1e-6)


@pytest.mark.parametrize("locked", [0, 2, 5])
def test_a_joint_that_never_moves_leaves_directions_that_are_named(
    fanuc: Robot, locked: int
) -> None:
    truth = truth_of(fanuc)
    q = measured(truth).q.copy()
    q[:, locked] = 0.3
    measurements = measured(truth, at=q, noise=0.05e-3)
    result = identify(measurements, "local-poe")
    base = result.base
    # A locked revolute joint joins two frames into one: of their 12 parameters less
    # two, six are left.
    assert (base.rank, base.observable_rank) == (26, 30)
    assert len(base.unobservable) == 4
    assert np.isfinite(base.errors["placements"]).all()
    assert np.isfinite(result.forward(fresh_configurations(fanuc))).all()
    assert base.residual_rms[0] < 0.05e-3
    # Where the joint stands as it stood, the fit is as good as any.
    there = fresh_configurations(fanuc, None)
    there[:, locked] = 0.3
    assert np.abs(result.forward(there) - truth.actual.forward(there)).max() < 0.5e-3


@pytest.mark.parametrize("locked", [0, 2, 5])
def test_named_directions_are_those_that_a_better_design_would_see(
    fanuc: Robot, locked: int
) -> None:
    q = measured(truth_of(fanuc)).q.copy()
    q[:, locked] = 0.3
    base = identify_local_poe(measured(truth_of(fanuc), at=q, noise=0.05e-3))
    # All directions that this design misses and the whole joint range shows, without the
    # exact redundancies.
    seen = np.linalg.svd(sensitivity("fanuc-m1000ia", "full"))[2][:30]
    here = np.linalg.svd(sensitivity("fanuc-m1000ia", "workspace", locked))[2][:26]
    missing = np.linalg.svd(seen - seen @ here.T @ here)[2][:4]
    reach = np.linalg.norm(
        missing, axis=0
    )  # largest value of each parameter in a unit vector of these directions
    names = [f"ζ{j + 1}.{c}" for j in range(7) for c in ("x", "y", "z", "rx", "ry", "rz")]
    assert base.unobservable
    for text in base.unobservable:
        terms = re.findall(r"([+-]\d\.\d\d)·(\S+)", text)
        assert len(terms) == 3
        for coefficient, name in terms:
            assert abs(float(coefficient)) <= reach[names.index(name)] + 0.006, (
                f"{text}: {name} is no part of it"
            )


def test_the_step_has_no_component_that_the_data_cannot_see(fanuc: Robot) -> None:
    # Errors so small that one linear step solves the problem.
    q = measured(truth_of(fanuc)).q
    base = identify_local_poe(measured(truth_of(fanuc, size=1e-6), at=q))
    step = base.errors["placements"].ravel()
    redundant = np.linalg.svd(sensitivity("fanuc-m1000ia", "full"))[2][30:]
    assert np.linalg.norm(redundant @ step) < 1e-4 * np.linalg.norm(step)
    truth = truth_of(fanuc, size=1e-6).actual.errors["placements"].ravel()
    assert np.linalg.norm(redundant @ truth) > 0.1 * np.linalg.norm(truth)
    assert np.linalg.norm(step) < np.linalg.norm(truth)


# --- no solution ----------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 3, 4])
def test_too_few_configurations_are_refused_with_a_number_that_is_enough(
    fanuc: Robot, count: int
) -> None:
    # Three targets on a rigid tool show six things of a configuration, however many
    # coordinates are read.
    truth = truth_of(fanuc)
    with pytest.raises(NoSolutionError, match=f"{count} configurations give") as error:
        identify_local_poe(measured(truth, count))
    named = re.search(r"measure at least (\d+)", str(error.value))
    assert named is not None
    assert identify_local_poe(measured(truth, int(named[1]))).rank == 30


def test_points_of_another_robot_do_not_converge(fanuc: Robot) -> None:
    measurements = measured(truth_of(fanuc), 20)
    shuffled = replace(
        measurements, points=measurements.points[np.random.default_rng(0).permutation(20)]
    )
    with pytest.raises(NoSolutionError, match=r"no convergence in \d+ iterations"):
        identify_local_poe(shuffled)


# --- nominal --------------------------------------------------------------------------------------


def test_the_nominal_model_is_the_drawing(fanuc_measurements: Measurements) -> None:
    model = nominal_model(fanuc_measurements)
    assert model.parameters == 0
    assert not model.errors["placements"].any()
    poses = fanuc_measurements.robot.mechanism.forward(fanuc_measurements.q)
    targets = fanuc_measurements.robot.targets
    expected = np.einsum("kab,mb->kma", poses[:, :3, :3], targets) + poses[:, None, :3, 3]
    assert np.isclose(
        model.residual_rms[0],
        np.sqrt(((fanuc_measurements.points - expected) ** 2).mean()),
        rtol=1e-12,
    )


@pytest.mark.parametrize("jitter", [1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("unregistered", [False, True])
def test_joints_that_only_jitter_settle_with_less_shown(jitter: float, unregistered: bool) -> None:
    """Directions that the noise hides are not estimated, and rows like those measured are
    inside."""
    robot = load_robot("ur10")
    home, rng = np.array([0.3, -1.2, 1.4, -0.8, 1.0, 0.4]), np.random.default_rng(0)
    q, again = (home + jitter * rng.normal(size=(100, 6)) for _ in range(2))
    calibration = identify(
        simulate(robot, Simulation(at=q, unregistered=unregistered)), "local-poe"
    )
    base = calibration.base
    assert base.rank < base.observable_rank
    assert base.unobservable
    assert np.abs(base.errors["placements"]).max() < 15e-3
    assert base.residual_rms[0] < 0.06e-3
    assert not coverage(calibration, again).outside.any()
    moved = home + np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert coverage(calibration, moved[None]).outside.all()


@pytest.mark.parametrize(
    ("name", "seed", "moving"),
    [
        ("ur5", 1, 3),  # these two came to their end in neither 30 nor 100 steps
        ("ur5", 10, 2),
        ("ur5", 0, 1),
        ("fanuc-m1000ia", 2, 2),
        ("scara", 3, 2),
    ],
)
@pytest.mark.parametrize("unregistered", [False, True])
def test_it_settles_where_some_joints_move_and_the_others_jitter(
    name: str, seed: int, moving: int, unregistered: bool
) -> None:
    """Whatever the formula cannot describe of the joints that move; rows like those measured are
    inside.
    """
    robot, rng = load_robot(name), np.random.default_rng([seed, moving])
    q = np.tile(robot.anywhere(1, rng), (198, 1))
    joints = rng.choice(robot.n, moving, replace=False)
    q[:, joints] = robot.anywhere(198, rng)[:, joints]
    q, again = (
        np.clip(q + 1e-3 * rng.normal(size=q.shape), robot.lower, robot.upper) for _ in range(2)
    )
    data = simulate(robot, Simulation(at=q, seed=seed, unregistered=unregistered))
    calibration = identify(data, "local-poe")
    nominal = nominal_model(data).residual_rms[0]
    assert calibration.base.residual_rms[0] <= nominal
    assert coverage(calibration, again).outside.mean() < 0.02


def test_repeats_that_jitter_are_not_unlike_each_other() -> None:
    """33 configurations, six times each."""
    robot, rng = load_robot("ur5"), np.random.default_rng(4)
    q = np.repeat(robot.anywhere(33, rng), 6, axis=0)
    q, again = (
        np.clip(q + 1e-3 * rng.normal(size=q.shape), robot.lower, robot.upper) for _ in range(2)
    )
    for model in ("local-poe", "complete"):
        calibration = identify(simulate(robot, Simulation(at=q, unregistered=True)), model)
        assert not coverage(calibration, q).outside.any()
        assert not coverage(calibration, again).outside.any()
