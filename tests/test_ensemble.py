"""Bayesian networks: nothing where there is nothing to learn, something where there is; the verdict
of cross-validation.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify, train
from calibtool.calibration.guard import coverage
from calibtool.calibration.learning_curve import learning_curve
from calibtool.calibration.transfer import refit
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.compensation.targets import guarded
from calibtool.equivalent.bayesian import train_bayesian
from calibtool.equivalent.loss import task_loss
from calibtool.equivalent.network import Network
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ActualRobot
from calibtool.errors import InputError, NoSolutionError, UsageError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import exp6, inverse, log3, transform_points

BAYES = TrainingOptions(regularisation="bayes", restarts=2)


@pytest.fixture(scope="module")
def paper(fanuc_measurements: Measurements) -> Calibration:
    """An ensemble on the nominal robot, which leaves it much to learn."""
    return train(fanuc_measurements, "nominal", BAYES)


def test_noise_alone_has_no_effective_weights() -> None:
    rng = np.random.default_rng(0)
    q, G = rng.uniform(-1, 1, (80, 6)), rng.normal(size=(80, 9, 6))
    noise = rng.normal(size=(80, 9))
    run = train_bayesian(Network.initial(q, np.ones(6), 6, rng), task_loss(q, G, noise))
    assert run.effective < 8.0  # of 84
    assert np.sqrt(np.mean(run.network(q) ** 2)) < 0.2


def test_a_smooth_function_and_its_noise_are_distinguished() -> None:
    rng = np.random.default_rng(1)
    q, G = rng.uniform(-1, 1, (150, 6)), rng.normal(size=(150, 9, 6))
    teacher = Network.initial(q, np.full(6, 50.0), 4, rng)
    y = (G @ teacher(q)[..., None])[..., 0] + 2.0 * rng.normal(size=(150, 9))
    run = train_bayesian(Network.initial(q, np.full(6, 50.0), 6, rng), task_loss(q, G, y))
    assert run.noise_factor == pytest.approx(2.0, rel=0.15)
    fresh = rng.uniform(-0.9, 0.9, (500, 6))
    assert np.sqrt(np.mean((run.network(fresh) - teacher(fresh)) ** 2)) < 0.1 * np.std(
        teacher(fresh)
    )


def test_the_mean_of_networks_is_one_network(rng: np.random.Generator) -> None:
    q = rng.uniform(-1, 1, (20, 6))
    members = [Network.initial(q, np.full(6, 1e-3), 5, rng) for _ in range(4)]
    np.testing.assert_allclose(
        Network.averaged(members)(q), np.mean([member(q) for member in members], axis=0), atol=1e-18
    )


def test_networks_are_kept_where_they_help_and_left_out_where_not(
    paper: Calibration, fanuc_measurements: Measurements
) -> None:
    assert paper.validation is not None
    assert paper.validation.gain > 90.0
    assert len(paper.networks) == 2
    complete = train(fanuc_measurements, "complete", BAYES)
    assert complete.validation is not None
    assert not complete.validation.helps
    assert complete.networks == ()
    base = identify(fanuc_measurements, "complete")
    np.testing.assert_array_equal(
        complete.forward(fanuc_measurements.q), base.forward(fanuc_measurements.q)
    )


def test_the_same_seed_gives_the_same_ensemble(
    fanuc_measurements: Measurements, paper: Calibration
) -> None:
    again = train(fanuc_measurements, "nominal", BAYES)
    assert again.network is not None
    assert paper.network is not None
    np.testing.assert_array_equal(again.network.weights, paper.network.weights)
    assert again.validation == paper.validation


def test_the_training_itself_is_inside_and_the_far_side_of_the_range_outside(
    paper: Calibration, fanuc: Robot, fanuc_measurements: Measurements
) -> None:
    assert not coverage(paper, fanuc_measurements.q).outside.any()
    far = fanuc_measurements.q + np.array([2.5, 0, 0, 0, 0, 0])
    assert coverage(paper, far).outside.all()
    alone = replace(paper, networks=())
    kept = guarded(paper, far, None, "exact", "mark")
    assert set(kept.status) <= {"outside", "near-singular", "out-of-limits"}
    np.testing.assert_array_equal(
        guarded(paper, far, None, "exact", "base").q, guarded(alone, far, None, "exact", "mark").q
    )
    assert np.isnan(guarded(paper, far, None, "exact", "refuse").q).all()


def test_uncertainty_grows_away_from_the_training(fanuc_measurements: Measurements) -> None:
    calibration = identify(fanuc_measurements, "complete")
    near = predicted_uncertainty(calibration, fanuc_measurements.q).position
    far = predicted_uncertainty(
        calibration, fanuc_measurements.q + np.array([2.5, 0, 0, 0, 0, 0])
    ).position
    assert far.min() > near.max()


def test_more_configurations_are_predicted_to_be_better(fanuc_measurements: Measurements) -> None:
    curve = learning_curve(
        fanuc_measurements, lambda rows, _: identify(rows, "complete"), 4, np.random.default_rng(0)
    )
    assert curve.error[-1] < curve.error[0]
    assert curve.predicted(1000) <= curve.predicted(100)
    assert curve.error[-1] > 0.045e-3  # the noise of the held-out rows is in it


def test_without_two_sizes_that_can_be_fitted_there_is_no_learning_curve(
    fanuc_measurements: Measurements,
) -> None:
    def fit(rows: Measurements, rng: np.random.Generator) -> Calibration:
        if len(rows) < 90:
            raise NoSolutionError("too few")
        return identify(rows, "local-poe")

    with pytest.raises(NoSolutionError, match="100 configurations are too few"):
        learning_curve(fanuc_measurements, fit, 10, np.random.default_rng(0))


def test_members_that_disagree_add_their_scatter_to_the_uncertainty(
    fanuc_measurements: Measurements, paper: Calibration
) -> None:
    """The covariance of the mean of the members' poses, each computed by itself; about their mean,
    to first order.
    """
    q, alone = paper.q[:6], identify(fanuc_measurements, "complete")
    ensemble = replace(alone, networks=paper.networks)
    added = (
        predicted_uncertainty(ensemble, q).covariance - predicted_uncertainty(alone, q).covariance
    )
    mean = ensemble.forward(q)
    poses = np.stack([replace(alone, networks=(network,)).forward(q) for network in paper.networks])
    turns = log3(poses[..., :3, :3] @ np.swapaxes(mean[:, :3, :3], -1, -2))
    apart = np.concatenate([poses[..., :3, 3] - mean[:, :3, 3], turns], axis=-1)
    members = np.stack([np.cov(apart[:, k], rowvar=False) for k in range(len(q))])
    expected = members / len(paper.networks)
    np.testing.assert_allclose(added, expected, atol=0.01 * np.abs(expected).max())


def test_uncertainty_needs_a_posterior(fanuc_local_poe: Calibration) -> None:
    with pytest.raises(InputError, match="'local-poe' base has no posterior"):
        predicted_uncertainty(fanuc_local_poe, fanuc_local_poe.q)


def test_a_calibration_moves_to_a_tool_with_one_target_and_to_another_instrument(
    fanuc: Robot,
) -> None:
    """Of a known set-up a shift of the only target is found; of an unknown one, the
    set-up itself is.
    """
    first = simulate(fanuc, Simulation(configurations=60, workspace="full"))
    old = identify(first, "complete")
    again = replace(
        simulate(
            fanuc, Simulation(seed=3, configurations=12, same_robot=first.truth, workspace="full")
        ),
        truth=None,
    )
    setup, shift = again.setup, np.array([0.02, -0.01, 0.03])
    one = replace(
        again, points=again.points[:, :1], setup=replace(setup, targets=setup.targets[:1] - shift)
    )
    moved, verdict = refit(old, one, ("tool",))
    assert verdict.still_helps
    between = inverse(old.forward(one.q)) @ moved.forward(one.q)
    np.testing.assert_allclose(between[:, :3, 3], shift[None].repeat(12, 0), atol=1e-4)

    elsewhere = setup.T_instrument_base @ exp6(np.array([1.0, 2.0, -0.5, 0.3, 0.2, 0.1]))
    points = transform_points(
        elsewhere @ inverse(setup.T_instrument_base), again.points.reshape(-1, 3)
    )
    unknown = replace(
        again, points=points.reshape(again.points.shape), setup=replace(setup, frame_known=False)
    )
    placed, verdict = refit(old, unknown, ("base",))
    assert verdict.still_helps
    np.testing.assert_allclose(placed.base.setup.T_instrument_base, elsewhere, atol=1e-3)
    assert not placed.base.setup.frame_known


def test_a_calibration_moves_to_another_cell(fanuc: Robot) -> None:
    """The same arm on another foot with another tool: a few rows bring the old calibration back."""
    first = simulate(fanuc, Simulation(configurations=60, workspace="full"))
    old = identify(first, "complete")
    assert first.truth is not None
    actual = first.truth.actual
    shifts = actual.errors["placements"].copy()
    shifts[0] += [0.004, -0.003, 0.002, 0.003, 0.002, -0.004]
    shifts[-1] += [0.002, 0.001, -0.003, 0.004, -0.002, 0.003]
    moved: ActualRobot = replace(actual, errors=actual.errors.having(placements=shifts))
    truth = replace(first.truth, actual=moved)
    few = simulate(fanuc, Simulation(seed=3, configurations=8, same_robot=truth, workspace="full"))
    fresh = simulate(
        fanuc, Simulation(seed=4, configurations=100, same_robot=truth, workspace="full")
    )
    refitted, verdict = refit(old, few, ("base", "tool"))
    assert verdict.still_helps

    def mean_error(calibration: Calibration) -> float:
        return float(
            np.linalg.norm(
                (calibration.forward(fresh.q) - moved.forward(fresh.q))[:, :3, 3], axis=-1
            ).mean()
        )

    assert mean_error(refitted) < 0.05 * mean_error(old)
    other = simulate(fanuc, Simulation(seed=77, configurations=8, workspace="full"))
    assert not refit(old, other, ("base", "tool"))[1].still_helps
    with pytest.raises(UsageError, match="base, tool"):
        refit(old, few, ("elbow",))
