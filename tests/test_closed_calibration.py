"""Calibration of robots with closed loops: simulated, identified, corrected; rows that do not
close.
"""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify
from calibtool.compensation.solve import compensate_joints, compensate_poses
from calibtool.compensation.status import NOT_CLOSED
from calibtool.compensation.weighted_error import Task
from calibtool.equivalent.joints import equivalent_robot
from calibtool.errormodel.actual import ErrorScales, random_actual
from calibtool.errors import InputError, NoSolutionError
from calibtool.evaluation.compare import evaluate
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, log3, readonly

COUNT = 40


def measured(robot: Robot, seed: int = 1, **options: object) -> Measurements:
    workspace = robot.workspace()
    basis = Simulation(seed=seed, configurations=COUNT, workspace=workspace)
    return simulate(robot, replace(basis, **options))


@cache
def usual(name: str) -> Measurements:
    """The measurements that several tests share."""
    return measured(load_robot(name))


@cache
def identified(name: str) -> Calibration:
    return identify(usual(name))


def fresh(measurements: Measurements) -> Measurements:
    return measured(measurements.robot, same_robot=measurements.truth)


def knowing(measurements: Measurements) -> Calibration:
    """A calibration that is the truth."""
    assert measurements.truth is not None
    nominal = identify(measurements, "nominal")
    truth = measurements.truth.actual.errors
    return replace(nominal, base=replace(nominal.base, model="complete", errors=truth))


def task_errors(robot: Robot, pose: Array, commanded: Array) -> Array:
    """Displacement (m) and rotation (rad) of the task, along the commanded tool: (N, k)."""
    turn = log3(pose[:, :3, :3] @ np.swapaxes(commanded[:, :3, :3], 1, 2))
    error = np.concatenate([pose[:, :3, 3] - commanded[:, :3, 3], turn], axis=-1)
    return Task.of(equivalent_robot(robot)).of_error(error, commanded)


# --- identification ---


def test_a_calibration_removes_nearly_all_of_the_task_error(closed: Robot) -> None:
    measurements = usual(closed.name)
    later = fresh(measurements)
    assert later.truth is not None
    commanded = closed.mechanism.forward(later.q)
    result = compensate_joints(identified(closed.name), later.q)
    before, after = (
        np.linalg.norm(task_errors(closed, later.truth.actual.forward(q), commanded), axis=-1)
        for q in (later.q, result.q)
    )
    assert after.mean() < 0.06 * before.mean()


def test_the_covariance_covers_what_is_left_of_the_poses(closed: Robot) -> None:
    """Predicted poses are off by as much as the posterior says: within a factor of two, rms."""
    from calibtool.calibration.uncertainty import predicted_uncertainty

    measurements = usual(closed.name)
    later = fresh(measurements)
    assert later.truth is not None
    calibration = identified(closed.name)
    off = np.linalg.norm(
        (calibration.forward(later.q) - later.truth.actual.forward(later.q))[:, :3, 3], axis=-1
    )
    said = predicted_uncertainty(calibration, later.q).position
    assert 0.5 < np.sqrt(np.mean(off**2) / np.mean(said**2)) < 2.0


@pytest.mark.parametrize("name", ["delta", "palletizer"])
def test_local_poe_fits_to_the_noise(name: str) -> None:
    measurements = usual(name)
    calibration = identify(measurements, "local-poe")
    assert calibration.base.residual_rms[0] < 0.2e-3
    assert identify(measurements, "nominal").base.residual_rms[0] > 0.5e-3


def test_an_unregistered_set_up_is_registered(closed: Robot) -> None:
    measurements = measured(closed, unregistered=True)
    calibration = identify(measurements)
    assert calibration.base.residual_rms[0] < 0.1e-3


def test_passive_joints_have_no_offsets_twists_or_functions(closed: Robot) -> None:
    errors = identified(closed.name).errors
    for family in ("offsets", "twists", "harmonics", "gravity", "backlash"):
        assert len(errors[family]) == closed.n
    assert len(errors["placements"]) == len(closed.chain.placements)


# --- correction ---


def test_with_a_perfect_model_nothing_stays_in_the_task_components(closed: Robot) -> None:
    """Less than 1e-6 mm, also where no joint can correct the rest (docs/closed-loops.md)."""
    measurements = usual(closed.name)
    calibration = knowing(measurements)
    assert measurements.truth is not None
    result = compensate_joints(calibration, measurements.q)
    pose = measurements.truth.actual.forward(result.q)
    left = task_errors(closed, pose, closed.mechanism.forward(measurements.q))
    full = result.status == "ok"
    assert full.mean() > 0.8
    assert np.abs(left[full]).max() < 1e-9


def test_poses_are_commanded_as_well_as_joints(closed: Robot) -> None:
    measurements = usual(closed.name)
    calibration = knowing(measurements)
    q = measurements.q[:8]
    by_joints = compensate_joints(calibration, q)
    by_poses = compensate_poses(calibration, closed.mechanism.forward(q), q)
    np.testing.assert_allclose(by_poses.q, by_joints.q, atol=1e-7)


def test_a_pose_outside_the_workspace_is_unreachable() -> None:
    robot = load_robot("delta")
    calibration = knowing(measured(robot))
    far = robot.mechanism.forward(robot.workspace("full").home[None])
    far[0, 0, 3] += 3.0
    result = compensate_poses(calibration, far)
    assert result.status.tolist() == ["unreachable"]
    assert np.isnan(result.q).all()


# --- rows that do not close ---


def not_closing(robot: Robot) -> Array:
    """A five-bar with its elbows as far apart as its limits allow."""
    return np.array([[robot.upper[0], robot.lower[1]], robot.workspace("full").home])


def test_a_row_that_does_not_close_stays_and_says_so() -> None:
    robot = load_robot("fivebar")
    calibration, q = knowing(measured(robot)), not_closing(robot)
    for method in ("exact", "one-step"):
        result = compensate_joints(calibration, q, method)
        assert result.status[0] == NOT_CLOSED
        assert result.status[1] in ("ok", "partial")
        np.testing.assert_array_equal(result.q[0], q[0])


def test_a_row_at_which_the_actual_robot_does_not_close_stays_and_says_so() -> None:
    """Rods that are 30 mm shorter than drawn: where the drawing is nearly stretched, they do not
    meet.
    """
    robot = load_robot("fivebar")
    calibration = knowing(measured(robot))
    errors = calibration.base.errors
    shorter = errors["placements"].copy()
    shorter[list(robot.chain.labels).index("loop1.a"), 0] = -0.03
    shorter[list(robot.chain.labels).index("loop1.b"), 0] = -0.03
    short = replace(
        calibration, base=replace(calibration.base, errors=errors.having(placements=shorter))
    )
    outwards = np.linspace(1.5, 2.2, 60)
    q = np.stack([outwards, np.pi - outwards], axis=-1)
    q = q[robot.mechanism.closes(q)]
    lost = ~short.errors.mechanism.closes(q)
    assert 0 < lost.sum() < len(q)
    result = compensate_joints(short, q)
    assert (result.status[lost] == NOT_CLOSED).all()
    np.testing.assert_array_equal(result.q[lost], q[lost])
    assert not np.isnan(result.q).any()


def test_the_command_line_says_which_rows_do_not_close() -> None:
    from calibtool.compensation.stream import compensate_text

    robot = load_robot("fivebar")
    q = np.rad2deg(not_closing(robot))
    text = "j1_deg,j2_deg\n" + "".join(f"{a:.9f},{b:.9f}\n" for a, b in q)
    written, report = compensate_text(knowing(measured(robot)), text, "targets.csv")
    rows = written.splitlines()
    assert rows[1].split(",")[2] == "not-closed"
    assert [float(x) for x in rows[1].split(",")[:2]] == pytest.approx(q[0])
    assert report.remarks == ["targets.csv:2: the closed loops do not close there: as commanded"]


def test_configurations_at_which_a_robot_does_not_close_cannot_be_measured() -> None:
    robot = load_robot("fivebar")
    with pytest.raises(InputError, match="row 1: the loops of the nominal robot do not close"):
        measured(robot, at=not_closing(robot))


@pytest.mark.parametrize(("name", "length"), [("fivebar", 0.5), ("delta", 1.0), ("hexapod", 1.0)])
def test_errors_with_which_hardly_anything_closes_are_said_to_be_too_large(
    name: str, length: float
) -> None:
    with pytest.raises(NoSolutionError, match=f"{name}: with these errors the loops close at only"):
        measured(load_robot(name), scales=ErrorScales(length=length))


def test_sampled_configurations_close_for_the_actual_robot_too() -> None:
    robot = load_robot("hexapod")
    measurements = simulate(robot, Simulation(seed=3, configurations=200, workspace="full"))
    assert measurements.truth is not None
    assert measurements.truth.actual.mechanism.closes(measurements.q).all()
    assert len(measurements) == 200


def test_an_evaluation_has_all_rows_in_numbers() -> None:
    robot = load_robot("hexapod")
    measurements = measured(robot)
    value = evaluate([("complete", identify(measurements))], fresh(measurements)).as_json()
    nominal, complete = value["methods"]
    assert complete["position_mm"]["max"] < 0.1 * nominal["position_mm"]["max"]
    assert complete["reduction_percent"]["position_mean"] > 95


@pytest.mark.parametrize("name", ["fivebar", "hexapod"])
def test_a_correction_at_which_the_actual_robot_does_not_close_counts_as_none(
    name: str, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    """The arm cannot be driven there: no row is missing, and none is without a number."""
    import calibtool.evaluation.compare as module

    later = usual(name)
    assert later.truth is not None
    actual, robot = later.truth.actual, later.robot
    drawn = rng.uniform(robot.lower, robot.upper, (500, robot.n))
    driven = later.q.copy()
    driven[:3] = drawn[~actual.mechanism.closes(drawn)][:3]
    monkeypatch.setattr(
        module,
        "guarded",
        lambda *_, **__: SimpleNamespace(q=driven, status=np.full(len(driven), "ok")),
    )
    found = evaluate([("nominal again", identify(later, "nominal"))], later)
    nominal, result = found.results
    assert result.marked == 3
    assert result.errors.position.shape == nominal.errors.position.shape
    np.testing.assert_array_equal(result.errors.position, nominal.errors.position)
    assert np.isfinite(nominal.errors.position).all()


# --- loads ---


def test_gravity_torques_are_what_the_weights_gain(rng: np.random.Generator) -> None:
    """Virtual work: τ_k is the derivative of the potential energy by the actuator."""
    import pinocchio as pin

    from calibtool.robot.gravity_torque import gravity_model, gravity_torque

    robot = load_robot("delta")
    model = gravity_model(robot)
    data = model.createData()
    q = robot.workspace("full").home[None] + 0.1 * rng.uniform(-1, 1, (3, 3))

    def energy(at: Array) -> Array:
        rows = robot.mechanism.configuration(at)
        return np.array([pin.computePotentialEnergy(model, data, row) for row in rows])

    step = 1e-6
    for k in range(3):
        move = np.zeros(3)
        move[k] = step
        slope = (energy(q + move) - energy(q - move)) / (2 * step)
        np.testing.assert_allclose(gravity_torque(robot, q)[:, k], slope, rtol=1e-6, atol=1e-7)


def test_a_payload_winds_the_actuators_up_by_the_work_it_does() -> None:
    from calibtool.errormodel.family import Rows
    from calibtool.errormodel.operating_conditions import Conditions
    from calibtool.errormodel.payload import moments

    robot = load_robot("delta")
    q = robot.workspace("full").home[None] + np.array([[0.1, -0.1, 0.05]])
    along, across = moments(Rows(robot, q, Conditions(payload_kg=readonly(2.0))))
    step = 1e-6
    for k in range(3):
        move = np.zeros((1, 3))
        move[0, k] = step
        ends = [robot.mechanism.forward(q + s * move)[0, 2, 3] for s in (1, -1)]
        assert along[0, k] == pytest.approx(
            -2.0 * 9.81 * (ends[0] - ends[1]) / (2 * step), rel=1e-6
        )
    assert not across.any()


def test_every_kind_of_error_can_be_drawn_and_identified() -> None:
    from calibtool.errormodel.actual import ErrorScales
    from calibtool.errormodel.families import ERROR_KINDS

    robot = load_robot("prs3")
    measurements = measured(
        robot, scales=ErrorScales(ERROR_KINDS), payload_kg=(0.0, 5.0), temperature_c=(20.0, 30.0)
    )
    assert identify(measurements).base.residual_rms[0] < 0.2e-3
    actual = random_actual(robot, ErrorScales(("thermal",)), np.random.default_rng(0))
    assert actual.mechanism.closes(measurements.q).all()
