"""Methods side by side: a perfect calibration leaves nothing, nothing is fitted where it is
judged, and the JSON.
"""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify, train
from calibtool.calibration.guard import coverage
from calibtool.compensation.targets import OutsidePolicy
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.errors import InputError, NoSolutionError
from calibtool.evaluation.compare import evaluate
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import register
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot

STATISTICS = {"mean", "std", "rms", "p95", "max"}


@cache
def simulated(name: str = "ur5", unregistered: bool = False) -> tuple[Measurements, Measurements]:
    """A simulation, and the same robot at fresh configurations."""
    robot = load_robot(name)
    workspace = robot.workspace()
    first = simulate(
        robot, Simulation(seed=1, workspace=workspace, configurations=60, unregistered=unregistered)
    )
    fresh = simulate(
        robot, Simulation(seed=1, workspace=workspace, configurations=25, same_robot=first.truth)
    )
    return first, fresh


def perfect(measurements: Measurements) -> Calibration:
    """A calibration that holds the truth itself."""
    truth = measurements.truth
    assert truth is not None
    calibration = identify(measurements, "nominal")
    base = replace(
        calibration.base, model="local-poe", errors=truth.actual.errors, setup=truth.setup
    )
    return replace(calibration, base=base)


# --- compensated ----------------------------------------------------------------------------------


@pytest.mark.parametrize("unregistered", [False, True])
@pytest.mark.parametrize("name", ["fanuc-m1000ia", "panda", "ur5"])
def test_a_calibration_that_holds_the_truth_leaves_nothing(name: str, unregistered: bool) -> None:
    first, fresh = simulated(name, unregistered)
    evaluation = evaluate([("perfect", perfect(first))], fresh)
    nominal, best = evaluation.methods
    assert evaluation.kind == "compensated"
    assert [r.marked for r in evaluation.results] == [0, 0]
    assert best.position_size.max() < 1e-9
    assert best.orientation_size is not None
    assert best.orientation_size.max() < 2e-9
    assert nominal.position_size.mean() > 1e-4
    entry = evaluation.as_json()["methods"][1]
    assert min(entry["reduction_percent"].values()) > 99.99


def test_the_nominal_robot_errs_by_its_tool_pose() -> None:
    _, fresh = simulated()
    truth = fresh.truth
    assert truth is not None
    nominal = evaluate([], fresh).methods[0]
    actual, commanded = truth.actual.forward(fresh.q), fresh.robot.mechanism.forward(fresh.q)
    assert np.allclose(nominal.position[:, 0], actual[:, :3, 3] - commanded[:, :3, 3], atol=1e-12)
    turn = Rotation.from_matrix(
        actual[:, :3, :3] @ np.swapaxes(commanded[:, :3, :3], -1, -2)
    ).as_rotvec()
    assert nominal.orientation is not None
    assert np.allclose(nominal.orientation, turn, atol=1e-12)


def test_the_noise_of_the_judged_measurements_does_not_matter_where_the_truth_is_known() -> None:
    first, fresh = simulated()
    calibration = identify(first, "local-poe")
    noisy = replace(fresh, points=fresh.points + 1e-3)
    a, b = (evaluate([("c", calibration)], m).methods[1].position for m in (fresh, noisy))
    assert np.array_equal(a, b)


@pytest.mark.parametrize("unregistered", [False, True])
def test_local_poe_lowers_the_error_of_fresh_configurations(unregistered: bool) -> None:
    first, fresh = simulated("ur5", unregistered)
    nominal, calibrated = evaluate([("c", identify(first, "local-poe"))], fresh).methods
    assert calibrated.position_size.mean() < 0.3 * nominal.position_size.mean()


def test_one_step_is_a_little_worse_than_exact() -> None:
    first, fresh = simulated()
    calibration = perfect(first)
    exact, stepped = (
        evaluate([("c", calibration)], fresh, method=m).methods[1] for m in ("exact", "one-step")
    )
    nominal = evaluate([], fresh).methods[0]
    assert (
        exact.position_size.max() < stepped.position_size.max() < 0.05 * nominal.position_size.max()
    )


ALL_SIX = (0, 1, 2, 3, 4, 5)


def nearest_by_scipy(
    fresh: Measurements, row: int, components: tuple[int, ...] = ALL_SIX
) -> np.ndarray:
    """The pose of the actual robot nearest to the commanded one: (4, 4), by an
    independent minimiser.

    components: of the displacement and the turn along the axes of the commanded tool.
    """
    truth, robot = fresh.truth, fresh.robot
    assert truth is not None
    commanded = robot.mechanism.forward(fresh.q[row : row + 1])[0]

    def left(q: np.ndarray) -> np.ndarray:
        pose = truth.actual.forward(q[None])[0]
        turn = Rotation.from_matrix(pose[:3, :3] @ commanded[:3, :3].T).as_rotvec()
        axes = commanded[:3, :3].T
        return np.concatenate([axes @ (pose - commanded)[:3, 3] / robot.length, axes @ turn])[
            list(components)
        ]

    best = least_squares(left, fresh.q[row], xtol=1e-15, ftol=1e-15, gtol=1e-15, jac="3-point").x
    pose: np.ndarray = truth.actual.forward(best[None])[0]
    return pose


def test_what_no_joint_can_correct_is_reported_apart() -> None:
    first, fresh = simulated("scara")
    evaluation = evaluate([("perfect", perfect(first))], fresh)
    beyond = evaluation.uncorrectable
    assert beyond is not None
    assert len(beyond.position) == 25
    commanded = fresh.robot.mechanism.forward(fresh.q)
    for row in (0, 7, 24):
        nearest = nearest_by_scipy(
            fresh, row, (0, 1, 2, 5)
        )  # a SCARA corrects x, y, z and the turn about z
        assert np.allclose(beyond.position[row, 0], (nearest - commanded[row])[:3, 3], atol=1e-9)
    best = evaluation.results[1].correctable
    assert best.position_size.max() < 1e-8
    assert best.orientation_size is not None
    assert best.orientation_size.max() < 1e-8
    assert evaluation.methods[1].orientation_size is not None
    assert (
        evaluation.methods[1].orientation_size.mean() > 1e-4
    )  # the whole error keeps what no joint can correct


def test_poses_that_a_shorter_arm_cannot_reach() -> None:
    robot = load_robot("fanuc-m1000ia")
    elbow = np.arctan2(1.4, 0.3) - 0.03  # nearly stretched
    q = np.array([[0.3, 0.4, elbow, 1.0, 0.9, 0.2], [0.3, 0.4, 0.1, 1.0, 0.9, 0.2]])
    first, _ = simulated("fanuc-m1000ia")
    truth = first.truth
    assert truth is not None
    lengths = np.zeros((7, 6))
    lengths[[2, 4], [2, 0]] = -2e-3  # upper arm and forearm are 2 mm shorter each
    shorter = replace(truth.actual, errors=truth.actual.errors.having(placements=lengths))
    fresh = simulate(robot, Simulation(seed=1, at=q, same_robot=replace(truth, actual=shorter)))
    given = replace(first, truth=replace(truth, actual=shorter))
    evaluation = evaluate([("perfect", perfect(given))], fresh)
    beyond = evaluation.uncorrectable
    assert beyond is not None
    assert len(beyond.position) == 1
    nearest = nearest_by_scipy(fresh, 0)
    commanded = robot.mechanism.forward(q[:1])[0]
    assert np.linalg.norm((nearest - commanded)[:3, 3]) > 1e-4
    assert np.allclose(beyond.position[0, 0], (nearest - commanded)[:3, 3], atol=1e-6)
    assert [r.marked for r in evaluation.results] == [0, 1]
    # Near the stretched arm the correction is damped: the corrected joints come near
    # the nearest pose.
    assert (
        evaluation.results[1].correctable.position_size.max()
        < 0.02 * evaluation.results[0].correctable.position_size.max()
    )
    entry = evaluation.as_json()["methods"][1]
    assert entry["reduction_percent"]["position_max"] > 98
    assert entry["position_mm"]["max"] > 0.1


def test_doubtful_rows_are_counted() -> None:
    first, _ = simulated()
    q = np.deg2rad([[0.0, -80.0, 100.0, -110.0, -90.0, 0.0], [0.0, -80.0, 100.0, -110.0, 0.1, 0.0]])
    again = simulate(first.robot, Simulation(seed=1, at=q, same_robot=first.truth))
    assert [r.marked for r in evaluate([("c", identify(first, "local-poe"))], again).results] == [
        0,
        1,
    ]


# --- predicted ------------------------------------------------------------------------------------


@pytest.mark.parametrize("unregistered", [False, True])
def test_without_the_truth_measured_and_predicted_targets_are_compared(unregistered: bool) -> None:
    first, fresh = simulated("ur5", unregistered)
    calibration = identify(first, "local-poe")
    evaluation = evaluate([("c", calibration)], replace(fresh, truth=None))
    assert evaluation.kind == "predicted"
    setup = calibration.setup
    poses = setup.T_instrument_base @ calibration.forward(fresh.q)
    predicted = np.einsum("kab,mb->kma", poses[:, :3, :3], setup.targets) + poses[:, None, :3, 3]
    left = (fresh.points - predicted) @ setup.T_instrument_base[
        :3, :3
    ]  # along the axes of the base
    assert np.allclose(evaluation.methods[1].position, left, atol=1e-12)
    assert evaluation.methods[1].orientation is not None


def test_predicted_errors_of_the_truth_are_its_noise() -> None:
    first, fresh = simulated("ur5", True)
    method = evaluate([("perfect", perfect(first))], replace(fresh, truth=None)).methods[1]
    assert abs(np.sqrt((method.position**2).mean()) / 0.05e-3 - 1) < 4 / np.sqrt(
        2 * method.position.size
    )


def test_the_nominal_robot_is_registered_on_the_training_rows_and_not_on_the_judged_ones() -> None:
    first, fresh = simulated("ur5", True)
    calibration = identify(first, "local-poe")
    nominal = evaluate([("c", calibration)], replace(fresh, truth=None)).methods[0]
    setup = register(replace(first, truth=None))
    poses = setup.T_instrument_base @ fresh.robot.mechanism.forward(fresh.q)
    predicted = np.einsum("kab,mb->kma", poses[:, :3, :3], setup.targets) + poses[:, None, :3, 3]
    lengths = np.sqrt(((fresh.points - predicted) ** 2).sum(axis=-1).mean(axis=-1))
    assert np.allclose(nominal.position_size, lengths, atol=1e-9)


def test_what_is_judged_does_not_depend_on_the_other_judged_rows() -> None:
    first, fresh = simulated("ur5", True)
    calibration = identify(first, "local-poe")
    whole, half = (
        evaluate([("c", calibration)], replace(fresh, truth=None).rows(np.arange(count)))
        for count in (25, 10)
    )
    for a, b in zip(whole.methods, half.methods, strict=True):
        assert np.allclose(a.position[:10], b.position, atol=1e-12)


def test_a_moved_instrument_is_registered_again_when_asked() -> None:
    first, fresh = simulated("ur5", True)
    calibration = perfect(first)
    turn = Rotation.from_rotvec([0.5, -0.3, 1.2]).as_matrix()
    moved = replace(fresh, truth=None, points=fresh.points @ turn.T + [1.0, -2.0, 0.5])
    blind, refitted = (
        evaluate([("c", calibration)], moved, refit_setup=r).methods for r in (False, True)
    )
    assert blind[1].position_size.min() > 0.1
    assert refitted[1].position_size.mean() < 0.15e-3  # noise of 0.05 mm per coordinate
    assert refitted[1].position_size.mean() < refitted[0].position_size.mean()


def test_one_target_has_no_orientation() -> None:
    first, fresh = simulated("ur5", True)
    setup = Setup(np.eye(4), np.zeros((1, 3)), frame_known=False, targets_known=False)
    one = [replace(m, points=m.points[:, :1], truth=None, setup=setup) for m in (first, fresh)]
    one = [replace(m, setup=register(m)) for m in one]
    evaluation = evaluate([("c", identify(one[0], "local-poe"))], one[1])
    assert [m.orientation for m in evaluation.methods] == [None, None]
    nominal, calibrated = evaluation.methods
    assert calibrated.position_size.mean() < nominal.position_size.mean()


def test_a_6d_sensor_is_compared_by_its_position_and_turn() -> None:
    first, _ = simulated()
    truth = first.truth
    assert truth is not None
    poses = truth.actual.forward(first.q)
    pose_measured = Measurements(
        first.robot, first.q, poses[:, None, :3, 3], poses[:, :3, :3], Setup(np.eye(4), np.zeros((1,
            3)), np.eye(3)),
        1e-5, 1e-5,
    )  # fmt: skip
    nominal, best = evaluate([("perfect", perfect(first))], pose_measured).methods
    assert best.position_size.max() < 1e-9
    commanded = first.robot.mechanism.forward(first.q)
    assert nominal.position.shape == (60, 1, 3)
    assert np.allclose(nominal.position[:, 0], (poses - commanded)[:, :3, 3], atol=1e-12)
    turn = Rotation.from_matrix(
        poses[:, :3, :3] @ np.swapaxes(commanded[:, :3, :3], -1, -2)
    ).magnitude()
    assert nominal.orientation_size is not None
    assert np.allclose(nominal.orientation_size, turn, atol=1e-12)


# --- contract -------------------------------------------------------------------------------------


def test_the_json_has_the_keys_of_the_contract() -> None:
    first, fresh = simulated()
    evaluation = evaluate(
        [("local", identify(first, "local-poe")), ("perfect", perfect(first))], fresh
    )
    found = json.loads(json.dumps(evaluation.as_json(), allow_nan=False))
    assert set(found) == {"schema", "schema_version", "robot", "configurations", "kind", "methods"}
    assert (found["schema"], found["schema_version"]) == ("calibtool/evaluation", 1)
    assert (found["robot"], found["configurations"], found["kind"]) == ("ur5", 25, "compensated")
    assert [entry["name"] for entry in found["methods"]] == ["nominal", "local", "perfect"]
    reductions = {f"{q}_{s}" for q in ("position", "orientation") for s in ("mean", "max", "std")}
    for entry in found["methods"]:
        assert set(entry) == {"name", "position_mm", "orientation_mrad", "reduction_percent"}
        assert set(entry["position_mm"]) == set(entry["orientation_mrad"]) == STATISTICS
        assert set(entry["reduction_percent"]) == reductions
    assert set(found["methods"][0]["reduction_percent"].values()) == {0.0}


def test_the_json_has_the_same_keys_where_orientation_is_not_seen() -> None:
    first, fresh = simulated()
    setup = Setup(np.eye(4), first.robot.targets[:1])
    one = [replace(m, points=m.points[:, :1], truth=None, setup=setup) for m in (first, fresh)]
    evaluation = evaluate([("c", identify(one[0], "local-poe"))], one[1])
    for entry in json.loads(json.dumps(evaluation.as_json(), allow_nan=False))["methods"]:
        assert entry["orientation_mrad"] is None
        assert {
            f"{q}_{s}" for q in ("position", "orientation") for s in ("mean", "max", "std")
        } == set(entry["reduction_percent"])


def test_nominal_comes_first_and_stands_alone_without_calibrations() -> None:
    _, fresh = simulated()
    assert [m.name for m in evaluate([], fresh).methods] == ["nominal"]


def test_a_calibration_for_another_robot_is_refused() -> None:
    _, fresh = simulated()
    other = identify(simulated("fanuc-m1000ia")[0], "local-poe")
    with pytest.raises(
        InputError,
        match="calibration 'other' is for 'fanuc-m1000ia', but the measurements for 'ur5'",
    ):
        evaluate([("other", other)], fresh)


def test_rows_unlike_the_training_are_predicted_by_the_base_on_request() -> None:
    """Where a network never was it is left out, and only there; or the
    whole judgement is refused.
    """
    first, fresh = simulated("planar-3r")
    trained = train(
        first, "local-poe", TrainingOptions(regularisation="early-stopping", restarts=1, hidden=2)
    )
    assert trained.networks
    everywhere = simulate(
        first.robot, Simulation(seed=1, configurations=15, same_robot=first.truth, workspace="full")
    ).q
    both = Simulation(at=np.concatenate([fresh.q, everywhere]), same_robot=first.truth)
    real = replace(simulate(first.robot, both), truth=None)
    unlike = coverage(trained, real.q).outside
    assert 0 < unlike.sum() < len(unlike)

    def errors(calibration: Calibration, outside: OutsidePolicy) -> np.ndarray:
        return evaluate([("a", calibration)], real, outside=outside).methods[1].position

    alone, marked, base = (
        errors(replace(trained, networks=()), "mark"),
        errors(trained, "mark"),
        errors(trained, "base"),
    )
    np.testing.assert_array_equal(base[unlike], alone[unlike])
    np.testing.assert_array_equal(base[~unlike], marked[~unlike])
    with pytest.raises(NoSolutionError, match=f"a: {unlike.sum()} configurations are outside"):
        errors(trained, "refuse")


@pytest.mark.parametrize("name", ["planar-3r", "so100", "scara"])
def test_who_knows_all_errors_leaves_nothing_that_joints_could_remove(name: str) -> None:
    """Bent joints and tilted axes take the tool where fewer than six joints cannot bring it back:
    that is no error of the calibration."""
    scales = ErrorScales(("geometric", "bending", "wobble"))
    rows = simulate(load_robot(name), Simulation(2, 60, scales=scales))
    assert rows.truth is not None
    nominal = identify(rows, "nominal")
    known = replace(nominal.base, model="complete", errors=rows.truth.actual.errors)
    evaluation = evaluate([("known", replace(nominal, base=known))], rows)
    drawn, after = (result.correctable.position_size for result in evaluation.results)
    assert drawn.mean() > 0.2e-3
    assert after.max() < 1e-3 * drawn.mean()
