"""The complete model: recovery of injected errors, its own uncertainty, evidence, and bad data."""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.calibration import identify
from calibtool.calibration.fit import BaseOptions
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import BY_ID
from calibtool.errormodel.tolerances import Tolerances
from calibtool.errors import NoSolutionError
from calibtool.identification.complete import CompleteOptions, identify_complete
from calibtool.identification.report import parameter_rows
from calibtool.identification.robust import row_weights
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, observe, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import log3, readonly, transform_points

PHYSICAL = ("geometric", "gear", "gravity", "thermal")


def measured(
    robot: Robot, count: int = 50, seed: int = 0, **options: object
) -> tuple[Measurements, Measurements]:
    """Measurements over the whole joint range, and fresh ones of the same robot."""
    first = simulate(
        robot, Simulation(seed=seed, configurations=count, workspace="full", **options)
    )
    return first, simulate(
        robot, Simulation(seed=seed, configurations=300, same_robot=first.truth, workspace="full")
    )


def position_errors(calibration_forward: object, fresh: Measurements) -> np.ndarray:
    assert fresh.truth is not None
    actual = fresh.truth.actual.forward(fresh.q)
    return np.linalg.norm((calibration_forward(fresh.q) - actual)[:, :3, 3], axis=-1)


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "ur5", "panda", "scara", "gantry"])
def test_fresh_configurations_of_the_whole_range_are_predicted(name: str) -> None:
    measurements, fresh = measured(load_robot(name))
    nominal = position_errors(measurements.robot.mechanism.forward, fresh)
    left = position_errors(identify(measurements, "complete").forward, fresh)
    assert left.max() < 0.05 * nominal.max()


def test_evidence_finds_the_joint_motion_functions_that_are_there(fanuc: Robot) -> None:
    for kinds, harmonics, gravity in ((("geometric",), 0, []), (PHYSICAL, 2, [[1, 2]])):
        posterior = identify_complete(measured(fanuc, scales=ErrorScales(kinds))[0]).posterior
        assert posterior is not None
        assert posterior.parameters.orders.get("harmonics", 0) == harmonics
        wound_up = [
            part.elements.tolist()
            for part in posterior.parameters.parts
            if part.family.id == "gravity"
        ]
        assert wound_up == gravity


@pytest.mark.parametrize("kinds", [("geometric",), ("geometric", "gear")])
def test_fine_structure_of_the_joint_motions_is_found(fanuc: Robot, kinds: tuple[str, ...]) -> None:
    """Twenty waves per turn, as of a gear's teeth, also beside a gear's large first orders."""
    first, fresh = measured(fanuc, 200, scales=ErrorScales(kinds))
    assert first.truth is not None

    def with_waves(measurements: Measurements) -> np.ndarray:
        assert measurements.truth is not None
        truth = measurements.truth
        return observe(
            truth.actual, truth.setup, measurements.q + 0.2e-3 * np.sin(20 * measurements.q)
        )

    noise = np.random.default_rng(3).normal(0, 0.05e-3, first.points.shape)
    wavy = replace(first, points=with_waves(first) + noise)
    expected = with_waves(fresh)
    left = []
    for options in (CompleteOptions(orders={"harmonics": 3}), CompleteOptions()):
        calibration = identify(wavy, BaseOptions("complete", options))
        predicted = transform_points(calibration.forward(fresh.q), calibration.setup.targets)
        left.append(np.linalg.norm(predicted - expected, axis=-1).mean())
    assert left[1] < 0.3 * left[0]
    assert calibration.base.errors["harmonics"].shape[1] >= 40


def test_joints_that_repeat_badly_are_not_taken_for_fine_structure(fanuc: Robot) -> None:
    kinds = ErrorScales((*PHYSICAL, "backlash"))
    for seed in range(3):
        posterior = identify_complete(measured(fanuc, 50, seed, scales=kinds)[0]).posterior
        assert posterior is not None
        assert posterior.parameters.orders.get("harmonics", 0) <= 3


def test_identified_functions_are_those_injected_within_their_covariance(fanuc: Robot) -> None:
    measurements, _ = measured(fanuc, 80, scales=ErrorScales(PHYSICAL))
    base = identify_complete(measurements, CompleteOptions(orders={"harmonics": 2, "gravity": 1}))
    assert measurements.truth is not None
    assert base.posterior is not None
    parameters = base.posterior.parameters
    gear = measurements.truth.actual.errors["harmonics"][~np.array(fanuc.prismatic)].ravel()
    block = parameters.blocks["harmonics"]
    deviation = (base.errors["harmonics"].ravel() - gear) / base.posterior.std[block]
    assert np.sqrt(np.mean(deviation**2)) < 1.6
    assert np.abs(deviation).max() < 4.5


def test_most_fresh_errors_are_inside_their_intervals(fanuc: Robot) -> None:
    inside = []
    for seed in range(20):
        measurements, fresh = measured(fanuc, 40, seed)
        calibration = identify(measurements, "complete")
        assert fresh.truth is not None
        actual, predicted = fresh.truth.actual.forward(fresh.q), calibration.forward(fresh.q)
        turn = log3(actual[:, :3, :3] @ np.swapaxes(predicted[:, :3, :3], -1, -2))
        error = np.concatenate([(actual - predicted)[:, :3, 3], turn], axis=-1)
        covariance = predicted_uncertainty(calibration, fresh.q).covariance
        std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        inside.append(np.mean(np.abs(error) < 1.96 * std))
    assert 0.90 <= np.mean(inside) <= 0.98


def test_the_estimated_noise_is_the_real_one_whatever_is_stated(fanuc: Robot) -> None:
    measurements, fresh = measured(fanuc, noise=0.5e-3)
    lied = replace(measurements, noise_position=0.05e-3)
    posterior = identify_complete(lied).posterior
    assert posterior is not None
    assert 8.0 < posterior.noise_factor < 12.0
    nominal = position_errors(fanuc.mechanism.forward, fresh)
    assert position_errors(identify(lied, "complete").forward, fresh).mean() < 0.1 * nominal.mean()


@pytest.mark.parametrize("loss_function", ["huber", "cauchy"])
def test_gross_errors_are_flagged_and_weigh_less(fanuc: Robot, loss_function: str) -> None:
    measurements, fresh = measured(fanuc, 60)
    bad = np.arange(0, 60, 10)
    points = measurements.points.copy()
    points[bad] += 5e-3
    spoiled = replace(measurements, points=readonly(points))
    options = CompleteOptions(loss_function=loss_function)
    robust = identify(spoiled, BaseOptions("complete", options))
    assert robust.base.flagged is not None
    assert set(bad) <= set(robust.base.flagged.rows)
    squared = CompleteOptions(loss_function="squared")
    plain = identify(spoiled, BaseOptions("complete", squared))
    better = position_errors(robust.forward, fresh).mean()
    assert better < 0.6 * position_errors(plain.forward, fresh).mean()
    dropped = identify(spoiled, BaseOptions("complete", replace(options, drop_flagged=True)))
    assert dropped.base.flagged is not None
    assert dropped.base.flagged.dropped
    assert position_errors(dropped.forward, fresh).mean() < better * 1.5


@pytest.mark.parametrize(("row", "gross"), [(17, 0.1), (140, 5.0), (99, 0.03)])
def test_one_gross_row_moves_nothing_and_is_listed(fanuc: Robot, row: int, gross: float) -> None:
    measurements, fresh = measured(fanuc, 200)
    points = measurements.points.copy()
    points[row] += [gross, 0.0, 0.0]
    clean, spoiled = (
        identify(m, "complete")
        for m in (measurements, replace(measurements, points=readonly(points)))
    )
    apart = np.linalg.norm((clean.forward(fresh.q) - spoiled.forward(fresh.q))[:, :3, 3], axis=-1)
    assert apart.max() < 0.1 * position_errors(clean.forward, fresh).max() + 2e-6
    assert spoiled.base.flagged is not None
    assert spoiled.base.flagged.rows.tolist() == [row]
    assert not spoiled.base.flagged.dropped


def test_bending_and_wobble_are_found_where_they_are(fanuc: Robot) -> None:
    """What is found predicts fresh poses better than the same without it, and is not found on an
    arm that is stiff."""
    for kind in ("bending", "wobble"):
        scales = ErrorScales(("geometric", kind), sizes={kind: 0.3e-3})
        measurements, fresh = measured(fanuc, 80, scales=scales)
        found = identify(measurements, "complete")
        assert found.base.posterior is not None
        assert kind in found.base.posterior.parameters.orders
        options = CompleteOptions(orders={"bending": 0, "wobble": 0})
        stiff = identify(measurements, BaseOptions("complete", options))
        left, without = (position_errors(c.forward, fresh).mean() for c in (found, stiff))
        assert left < 0.5 * without
    plain = identify_complete(measured(fanuc, 80)[0]).posterior
    assert plain is not None
    assert not {"bending", "wobble"} & set(plain.parameters.orders)


def test_fine_structure_is_not_taken_from_a_handful_of_rows(fanuc: Robot) -> None:
    for seed in range(5):
        posterior = identify_complete(measured(fanuc, 15, seed)[0]).posterior
        assert posterior is not None
        assert posterior.parameters.orders.get("harmonics", 0) <= 3


def test_bad_rows_of_one_region_are_called_a_region(fanuc: Robot) -> None:
    measurements, _ = measured(fanuc, 150)
    region = np.flatnonzero(measurements.q[:, 2] > np.deg2rad(50))
    points = measurements.points.copy()
    points[region] += 4e-3
    options = CompleteOptions(loss_function="cauchy")
    flagged = identify_complete(replace(measurements, points=readonly(points)), options).flagged
    assert flagged is not None
    assert flagged.cluster is not None
    assert "joint 3" in flagged.cluster


def test_clean_rows_are_hardly_ever_flagged(fanuc: Robot) -> None:
    counts = []
    for seed in range(10):
        flagged = identify_complete(measured(fanuc, 40, seed)[0]).flagged
        assert flagged is not None
        counts.append(len(flagged.rows))
    assert sum(counts) <= 2


def test_a_joint_that_never_moves_is_named_and_the_rest_is_usable(fanuc: Robot) -> None:
    q = measured(fanuc, 40)[0].q.copy()
    q[:, 3] = 0.3
    measurements = simulate(fanuc, Simulation(at=q))
    calibration = identify(measurements, "complete")
    assert position_errors(calibration.forward, measurements).max() < 0.5e-3
    assert any(row.at_prior for row in parameter_rows(calibration.base))


@pytest.mark.parametrize("harmonics", [0, 2])
def test_what_measurements_could_determine_is_that_of_the_design(
    robot: Robot, harmonics: int
) -> None:
    """Six of every joint and of the base (δζ, δξ and δq overlap), sine and cosine of every order
    of turning joints.
    """
    turning = robot.n - sum(robot.prismatic)
    expected = 6 * (robot.n + 1) + 2 * harmonics * turning
    options = CompleteOptions(
        orders=dict.fromkeys(BY_ID, 0)
        | {"harmonics": harmonics, "twists": 1, "placements": 1, "offsets": 1}
    )
    for count in (8, 60):
        base = identify_complete(measured(robot, count)[0], options)
        assert base.observable_rank == expected
        assert base.rank <= expected


def test_rows_that_lack_a_target_count_with_the_others(fanuc: Robot) -> None:
    measurements, fresh = measured(fanuc, 50)
    points = measurements.points.copy()
    points[::5, 1] = np.nan
    calibration = identify(replace(measurements, points=readonly(points)), "complete")
    nominal = position_errors(fanuc.mechanism.forward, fresh)
    assert position_errors(calibration.forward, fresh).max() < 0.05 * nominal.max()


def test_a_handful_of_configurations_still_gives_something(fanuc: Robot) -> None:
    measurements, fresh = measured(fanuc, 4)
    left = position_errors(identify(measurements, "complete").forward, fresh)
    assert left.mean() < 0.8 * position_errors(fanuc.mechanism.forward, fresh).mean()


def test_unregistered_measurements_are_predicted_in_their_frame(fanuc: Robot) -> None:
    measurements, _ = measured(fanuc, 60, unregistered=True)
    base = identify_complete(measurements)
    assert base.residual_rms[0] < 0.06e-3


def test_too_few_iterations_are_no_answer(fanuc: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calibtool.identification.fitting._MAX_ITERATIONS", 1)
    with pytest.raises(NoSolutionError, match="no convergence in 1 iterations"):
        identify_complete(measured(fanuc)[0])


def test_a_joint_may_have_tolerances_of_its_own(fanuc: Robot) -> None:
    tolerances = Tolerances(joints=((2, 5e-3, 7e-3),))
    measurements = measured(fanuc)[0]
    options = CompleteOptions(tolerances=tolerances, estimate_priors=False)
    rows = {
        row.name: row.tolerance for row in parameter_rows(identify_complete(measurements, options))
    }
    assert [rows[f"ζ{j}.x"] for j in (2, 3, 4)] == pytest.approx([1.0, 5.0, 1.0])
    assert [rows[f"ζ{j}.rx"] for j in (2, 3, 4)] == pytest.approx([1.0, 7.0, 1.0])


def test_squared_residuals_weigh_every_row_alike() -> None:
    sizes = np.array([1.0, 4.0, 900.0])
    assert row_weights(sizes, np.array([9, 9, 9]), "squared").tolist() == [1.0, 1.0, 1.0]
    for name in ("huber", "cauchy"):
        assert (np.diff(row_weights(sizes, np.array([9, 9, 9]), name)) <= 0).all()
