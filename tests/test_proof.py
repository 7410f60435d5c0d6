"""Proof on the arm: measured against commanded points, and rows that do not belong together."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify
from calibtool.calibration.fit import BaseOptions
from calibtool.compensation.backlash_path import BacklashPath
from calibtool.compensation.solve import compensate_joints, compensate_poses
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.operating_conditions import Conditions, directions
from calibtool.errors import InputError, UsageError
from calibtool.evaluation.acceptance import broken_limits, parse_limit
from calibtool.evaluation.compare import Evaluation, evaluate
from calibtool.evaluation.plots import Subject
from calibtool.evaluation.report.verdict import headline, remarks, verdicts
from calibtool.evaluation.wording import words
from calibtool.identification.complete import CompleteOptions
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array, readonly

CYCLES = 4


@cache
def made(
    name: str = "ur5", unregistered: bool = True, kinds: tuple[str, ...] = ("geometric",)
) -> tuple[Calibration, Measurements, Array]:
    """A calibration, its measurements, and commanded joints: twelve fresh, five in cycles."""
    robot = load_robot(name)
    simulation = Simulation(
        seed=3,
        configurations=40,
        scales=ErrorScales(kinds=kinds),
        unregistered=unregistered,
    )
    data = simulate(robot, simulation)
    fresh = simulate(robot, replace(simulation, configurations=17, same_robot=data.truth)).q
    options = BaseOptions(complete=CompleteOptions(orders={"harmonics": 0, "gravity": 0}))
    return identify(data, options), data, np.vstack([fresh[:12], np.tile(fresh[12:], (CYCLES, 1))])


def driven(
    q: Array, corrected: Array, data: Measurements, seed: int = 8, noise: float = 0.05e-3
) -> Measurements:
    """What a tracker sees where the arm is driven to corrected joints for the commands q."""
    robot = data.robot
    seen = simulate(robot, Simulation(seed=seed, at=corrected, same_robot=data.truth, noise=noise))
    return replace(
        seen, truth=None, setup=data.setup, commanded=readonly(robot.mechanism.forward(q))
    )


def plain(q: Array, data: Measurements, seed: int = 9) -> Measurements:
    """The commands themselves, measured."""
    seen = simulate(data.robot, Simulation(seed=seed, at=q, same_robot=data.truth))
    return replace(seen, truth=None, setup=data.setup)


def proved(
    name: str = "ur5",
    unregistered: bool = True,
    corrected: Array | None = None,
    before: bool = True,
) -> tuple[Evaluation, Measurements, Measurements]:
    calibration, data, q = made(name, unregistered)
    corrected = compensate_joints(calibration, q).q if corrected is None else corrected
    after, earlier = driven(q, corrected, data), plain(q, data)
    found = evaluate([("c", calibration)], after, before=earlier if before else None)
    return found, after, earlier


def by_hand(measurements: Measurements, calibration: Calibration, commanded: Array) -> Array:
    """Distances of measured from commanded targets, RMS over the targets: (N,) m."""
    setup = measurements.setup if measurements.setup.known else calibration.setup
    pose = setup.T_instrument_base @ commanded
    targets = np.einsum("kab,mb->kma", pose[:, :3, :3], setup.targets) + pose[:, None, :3, 3]
    result: Array = np.sqrt(((measurements.points - targets) ** 2).sum(axis=-1).mean(axis=-1))
    return result


@pytest.mark.parametrize("unregistered", [False, True])
@pytest.mark.parametrize("name", ["ur5", "panda", "scara"])
def test_errors_are_measured_minus_commanded_points(name: str, unregistered: bool) -> None:
    calibration, _, q = made(name, unregistered)
    found, after, before = proved(name, unregistered)
    assert found.kind == "measured"
    assert [errors.name for errors in found.methods] == ["nominal", "c"]
    commanded = after.robot.mechanism.forward(q)
    for errors, measured in zip(found.methods, (before, after), strict=True):
        np.testing.assert_allclose(
            errors.position_size, by_hand(measured, calibration, commanded), atol=1e-12
        )
    lowered = 0.7 if name == "scara" else 0.35  # four joints leave the tilts
    assert found.methods[1].position_size.mean() < lowered * found.methods[0].position_size.mean()


def test_ap_and_rp_are_those_of_the_standard() -> None:
    calibration, _, q = made()
    found, after, before = proved()
    test = found.as_json()["iso9283"]
    assert isinstance(test, dict)
    assert test["repeats"] == [CYCLES] * 5
    commanded = after.robot.mechanism.forward(q)
    T_base_instrument = np.linalg.inv(calibration.setup.T_instrument_base)
    for k in range(5):
        rows = 12 + k + 5 * np.arange(CYCLES)
        centre = calibration.setup.targets.mean(axis=0)
        asked = commanded[rows[0], :3, :3] @ centre + commanded[rows[0], :3, 3]
        for method, measured in enumerate((before, after)):
            attained = (
                measured.points[rows].mean(axis=1) @ T_base_instrument[:3, :3].T
                + T_base_instrument[:3, 3]
            )
            length = np.linalg.norm(attained - attained.mean(axis=0), axis=-1)
            ap = np.linalg.norm(attained.mean(axis=0) - asked)
            rp = length.mean() + 3 * length.std(ddof=1)
            assert test["methods"][method]["ap_mm"][k] == pytest.approx(1e3 * ap, rel=1e-9)
            key = ("rp_before_mm", "rp_mm")[method]
            assert test[key][k] == pytest.approx(1e3 * rp, rel=1e-9)


def test_before_is_expected_where_it_was_not_measured() -> None:
    calibration, _, q = made()
    found, after, _ = proved(before=False)
    value = json.loads(json.dumps(found.as_json(), allow_nan=False))
    assert (value["kind"], value["before"]) == ("measured", "expected")
    assert "rp_before_mm" not in value["iso9283"]
    modelled = replace(after, points=np.zeros_like(after.points))
    setup = calibration.setup
    pose = setup.T_instrument_base @ calibration.forward(q)
    targets = np.einsum("kab,mb->kma", pose[:, :3, :3], setup.targets) + pose[:, None, :3, 3]
    modelled = replace(after, points=targets)
    expected = by_hand(modelled, calibration, after.robot.mechanism.forward(q))
    np.testing.assert_allclose(found.methods[0].position_size, expected, atol=1e-9)


def test_what_is_expected_is_what_the_model_leaves_at_the_driven_joints() -> None:
    calibration, _, q = made()
    corrected = compensate_joints(calibration, q).q + 1e-4
    found, _, _ = proved(corrected=corrected)
    left = (calibration.forward(corrected) - calibration.robot.mechanism.forward(q))[:, :3, 3]
    assert found.proof is not None
    turn = calibration.forward(corrected)[:, :3, :3] @ calibration.robot.mechanism.forward(q)[
        :, :3, :3
    ].swapaxes(1, 2)
    expected = found.proof.expected
    assert expected.orientation_size is not None
    np.testing.assert_allclose(
        expected.orientation_size, Rotation.from_matrix(turn).magnitude(), atol=1e-9
    )
    assert expected.position_size.max() < 2 * np.linalg.norm(left, axis=-1).max() + 0.2e-3


def test_a_6d_sensor_and_a_single_target_are_compared_by_what_they_see() -> None:
    calibration, data, q = made(unregistered=False)
    corrected = compensate_joints(calibration, q).q
    assert data.truth is not None
    commanded = data.robot.mechanism.forward(q)
    poses = data.truth.actual.forward(corrected)
    sensor = replace(
        driven(q, corrected, data),
        points=readonly(poses[:, None, :3, 3]),
        rotations=readonly(poses[:, :3, :3]),
        setup=Setup(np.eye(4), np.zeros((1, 3)), np.eye(3)),
    )
    found = evaluate([("c", calibration)], sensor)
    after = found.methods[1]
    np.testing.assert_allclose(after.position[:, 0], (poses - commanded)[:, :3, 3], atol=1e-12)
    turn = poses[:, :3, :3] @ commanded[:, :3, :3].swapaxes(1, 2)
    assert after.orientation_size is not None
    np.testing.assert_allclose(
        after.orientation_size, Rotation.from_matrix(turn).magnitude(), atol=1e-9
    )
    before = found.methods[0].orientation_size
    assert before is not None
    assert after.orientation_size.mean() < 0.5 * before.mean()
    one = replace(
        driven(q, corrected, data),
        points=readonly(poses[:, None, :3, 3]),
        setup=Setup(np.eye(4), np.zeros((1, 3))),
    )
    found = evaluate([("c", calibration)], one)
    assert [errors.orientation for errors in found.methods] == [None, None]
    np.testing.assert_allclose(found.methods[1].position, after.position, atol=1e-12)


def test_a_moved_tracker_is_registered_again_when_asked() -> None:
    calibration, data, q = made()
    corrected = compensate_joints(calibration, q).q
    after, before = driven(q, corrected, data), plain(q, data)
    turn = Rotation.from_rotvec([0.4, 0.2, -1.0]).as_matrix()
    moved = replace(after, points=readonly(after.points @ turn.T + [1.0, -0.5, 2.0]))
    lost = evaluate([("c", calibration)], moved, before=before)
    assert lost.methods[1].position_size.min() > 0.1
    found = evaluate([("c", calibration)], moved, before=before, refit_setup=True)
    assert found.methods[1].position_size.mean() < 0.2e-3


# --- which driven joints are accepted ------------------------------------------------------------


def with_backlash(q: Array, corrected: Array) -> Array:
    return corrected + BacklashPath(np.full(q.shape[1], 0.1e-3)).taken_up(corrected)


BELIEVED = {
    "as written": lambda q, c: c,
    "with four decimals": lambda q, c: np.deg2rad(np.round(np.rad2deg(c), 4)),
    "backlash taken up": with_backlash,
    "a little off": lambda q, c: c + 5e-5 * np.sin(40 * q),
}


@pytest.mark.parametrize("how", list(BELIEVED))
@pytest.mark.parametrize("name", ["ur5", "scara"])
def test_driven_joints_that_differ_plausibly_are_taken(name: str, how: str) -> None:
    calibration, _, q = made(name)
    corrected = BELIEVED[how](q, compensate_joints(calibration, q).q)
    found, _, _ = proved(name, corrected=corrected)
    assert found.methods[1].position_size.mean() < 0.7 * found.methods[0].position_size.mean()


def test_one_step_corrections_and_another_elbow_are_taken() -> None:
    calibration, data, q = made()
    assert proved(corrected=compensate_joints(calibration, q, "one-step").q)[0].kind == "measured"
    calibration, data, q = made("panda")
    corrected = compensate_joints(calibration, q).q
    _, jacobian = calibration.forward_and_jacobian(corrected)
    free = np.linalg.svd(jacobian)[2][:, -1]
    target = calibration.robot.mechanism.forward(q)
    elbow = compensate_poses(calibration, target, corrected + 0.05 * free).q
    assert np.abs(elbow - corrected).max() > 0.01
    after = driven(q, elbow, data)
    assert evaluate([("c", calibration)], after).kind == "measured"


REFUSED = {
    "not corrected at all": lambda q, c: q,
    "rows shifted": lambda q, c: np.roll(c, 1, axis=0),
    "two rows exchanged": lambda q, c: c[[1, 0, *range(2, len(c))]],
    "corrected twice": lambda q, c: 2 * c - q,
    "corrected the wrong way": lambda q, c: 2 * q - c,
    "one joint in other units": lambda q, c: np.where(np.arange(c.shape[1]) == 1, np.rad2deg(c), c),
}


@pytest.mark.parametrize("how", list(REFUSED))
@pytest.mark.parametrize("name", ["ur5", "scara"])
def test_driven_joints_of_another_correction_are_refused(name: str, how: str) -> None:
    calibration, data, q = made(name)
    corrected = REFUSED[how](q, compensate_joints(calibration, q).q)
    after = replace(plain(q, data), q=corrected, commanded=data.robot.mechanism.forward(q))
    with pytest.raises(
        InputError, match="rows were driven to other joints than 'c' asks for"
    ) as caught:
        evaluate([("c", calibration)], after)
    assert "\n" not in str(caught.value)
    if how == "two rows exchanged":
        assert "2 of 32" in str(caught.value)
        assert "(row 1, 2)" in str(caught.value)


def test_the_other_frame_is_another_correction() -> None:
    calibration, data, q = made()
    after = driven(q, compensate_joints(calibration.in_frame("fitted"), q).q, data)
    with pytest.raises(InputError, match="are calibration, frame and commanded rows those"):
        evaluate([("c", calibration)], after)
    assert evaluate([("c", calibration.in_frame("fitted"))], after).kind == "measured"


def test_before_and_after_need_the_same_commands() -> None:
    calibration, data, q = made()
    after = driven(q, compensate_joints(calibration, q).q, data)
    named = [("c", calibration)]
    with pytest.raises(InputError, match="31 rows before the correction, 32 after it"):
        evaluate(named, after, before=plain(q[1:], data))
    with pytest.raises(InputError, match="row 1 was commanded"):
        evaluate(named, after, before=plain(np.roll(q, 1, axis=0), data))
    unseen = plain(q, data)
    points = unseen.points.copy()
    points[4, 1] = np.nan
    with pytest.raises(InputError, match="row 5 lacks a target"):
        evaluate(named, after, before=replace(unseen, points=readonly(points)))
    with pytest.raises(UsageError, match="import them with --commanded"):
        evaluate(named, plain(q, data), before=plain(q, data))
    for several in ([], [*named, *named]):
        with pytest.raises(UsageError, match="give its calibration alone"):
            evaluate(several, after)


def test_rows_after_the_correction_that_lack_a_target_are_left_out_of_both() -> None:
    calibration, data, q = made()
    after, before = driven(q, compensate_joints(calibration, q).q, data), plain(q, data)
    points = after.points.copy()
    points[4, 1] = np.nan
    found = evaluate([("c", calibration)], replace(after, points=readonly(points)), before=before)
    whole = evaluate([("c", calibration)], after, before=before)
    rest = np.delete(np.arange(len(q)), 4)
    for errors, every in zip(found.methods, whole.methods, strict=True):
        np.testing.assert_allclose(errors.position, every.position[rest], atol=1e-12)


# --- limits and words -----------------------------------------------------------------------------


@pytest.mark.parametrize("quantity", ["ap", "rp"])
@pytest.mark.parametrize("unit", ["mm", "mrad"])
def test_limits_on_ap_and_rp_are_those_of_the_table(quantity: str, unit: str) -> None:
    found, _, _ = proved()
    test = found.as_json()["iso9283"]
    assert isinstance(test, dict)
    values = test[f"rp_{unit}"] if quantity == "rp" else test["methods"][1][f"ap_{unit}"]
    for statistic, value in (("max", max(values)), ("mean", float(np.mean(values)))):
        for factor, broken in ((1.001, 0), (0.999, 1)):
            limit = parse_limit(f"{quantity}_{statistic}_{unit}={factor * value}")
            assert len(broken_limits(found.methods[1:], [limit], found.pose_tests[1:])) == broken


def test_limits_on_ap_without_repeats_cannot_be_judged() -> None:
    calibration, data, q = made()
    after = driven(q[:12], compensate_joints(calibration, q[:12]).q, data)
    found = evaluate([("c", calibration)], after)
    limits = [parse_limit("ap_max_mm=100"), parse_limit("position_max_mm=100")]
    (line,) = broken_limits(found.methods[1:], limits, found.pose_tests[1:])
    assert (
        line
        == "c: ap max: no configuration was measured at least three times, so the limit cannot be "
        "judged"
    )
    with pytest.raises(UsageError, match="ap_S_mm"):
        parse_limit("ap_max_deg=1")


def said(evaluation: Evaluation, calibration: Calibration, data: Measurements) -> str:
    """Headline, remarks and column names of the report."""
    subject = Subject([("c", calibration)], data, evaluation)
    found = words(evaluation.kind, evaluation.before)
    return " ".join(
        [headline(subject, verdicts(subject)).text, *remarks(subject), found.before, found.after]
    )


def test_only_what_was_measured_is_called_after() -> None:
    calibration, data, q = made()
    measured, after, _ = proved()
    alone, _, _ = proved(before=False)
    predicted = evaluate([("c", calibration)], plain(q, data))
    fresh = simulate(data.robot, Simulation(seed=8, at=q, same_robot=data.truth))
    simulated = evaluate([("c", calibration)], fresh)
    assert "after, measured" in said(measured, calibration, after)
    assert "before, measured" in said(measured, calibration, after)
    assert "expected before correction" in said(alone, calibration, after)
    assert "before, measured" not in said(alone, calibration, after)
    text = said(predicted, calibration, plain(q, data))
    assert "expected after correction" in text
    assert "after, measured" not in text
    assert "brings" not in text
    text = said(simulated, calibration, fresh)
    assert "after, simulated" in text
    assert "in simulation" in text


def test_directions_are_those_of_the_driven_joints() -> None:
    """Where backlash was taken up along the driven motion the model expects next to nothing."""
    calibration, data, q = made(kinds=("geometric", "backlash"))
    if not calibration.errors["backlash"].any():
        pytest.skip("no backlash was found")
    corrected = compensate_joints(calibration, q).q
    taken_up = corrected + BacklashPath(calibration.errors["backlash"]).taken_up(corrected)
    after = replace(
        driven(q, taken_up, data), conditions=Conditions(readonly(directions(taken_up)))
    )
    found = evaluate([("c", calibration)], after)
    assert found.proof is not None
    assert found.proof.expected.position_size[1:].max() < 1e-7
