"""Training: repeatable, never worse than no network, the best of its restarts, and about the
error that users see.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify, train
from calibtool.equivalent.network import Network
from calibtool.equivalent.training import (
    TrainingOptions,
    TrainingReport,
    split_rows,
    train_networks,
)
from calibtool.errormodel.actual import ErrorScales
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

Array = np.ndarray


def learnable(seed: int = 0, K: int = 60, noise: float = 0.05) -> tuple[Array, Array, Array]:
    """q, G, y of joint motion errors that a smooth function makes."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1, 1, (K, 6))
    G = rng.normal(size=(K, 9, 6)) * 1e3
    teacher = Network.initial(q, np.full(6, 1e-3), 4, rng)
    return q, G, (G @ teacher(q)[..., None])[..., 0] + noise * rng.normal(size=(K, 9))


Trained = tuple[tuple[Array, Array, Array], Network | None, TrainingReport]


def trained(data: int = 0, **changes: object) -> Trained:
    """Data, network and report of a training on learnable data."""
    options = replace(TrainingOptions(), **changes)
    q, G, y = learnable(data)
    rng = np.random.default_rng(options.seed)
    networks, report = train_networks(q, G, y, options, rng)
    return (q, G, y), networks[0] if networks else None, report


def mean_square(q: Array, G: Array, y: Array, network: Network | None) -> float:
    """Mean squared weighted residual, configuration by configuration."""
    left = [
        y[k] - (0.0 if network is None else G[k] @ network(q[k : k + 1])[0]) for k in range(len(q))
    ]
    return float(np.mean([v @ v for v in left]))


@pytest.mark.parametrize("count", [1, 7, 50, 100])
@pytest.mark.parametrize("validation", [0.0, 0.3, 0.5])
def test_training_and_validation_rows_are_a_partition(count: int, validation: float) -> None:
    training, held = split_rows(count, validation, np.random.default_rng(0))
    assert sorted([*training, *held]) == list(range(count))
    assert abs(len(held) - validation * count) <= 0.5
    assert (np.diff(training) > 0).all()
    assert (np.diff(held) > 0).all()


@pytest.mark.parametrize("optimiser", ["lm", "gd"])
@pytest.mark.parametrize("loss", ["task", "joint"])
def test_a_network_learns_what_a_smooth_function_has_made(loss: str, optimiser: str) -> None:
    (q, G, y), network, report = trained(loss=loss, optimiser=optimiser, restarts=1)
    assert network is not None
    held = report.validation_rows
    assert mean_square(q[held], G[held], y[held], network) < 0.2 * mean_square(
        q[held], G[held], y[held], None
    )


def test_the_reported_losses_are_those_of_the_rows_they_are_stated_to_be_of() -> None:
    (q, G, y), network, report = trained()
    assert network is not None
    for rows, reported in (
        (report.validation_rows, report.history.validation),
        (report.training_rows, report.history.training),
    ):
        # All but what no joint motion can explain, the same with and without a network.
        gained = mean_square(q[rows], G[rows], y[rows], None) - mean_square(
            q[rows], G[rows], y[rows], network
        )
        floor = np.mean(
            [y[k] @ y[k] - y[k] @ G[k] @ np.linalg.lstsq(G[k], y[k], rcond=None)[0] for k in rows]
        )
        without = mean_square(q[rows], G[rows], y[rows], None) - floor
        assert np.isclose(without - reported[report.history.chosen], gained, rtol=1e-9)
    held = report.validation_rows
    floor = np.mean(
        [y[k] @ y[k] - y[k] @ G[k] @ np.linalg.lstsq(G[k], y[k], rcond=None)[0] for k in held]
    )
    assert np.isclose(
        report.loss_without, mean_square(q[held], G[held], y[held], None) - floor, rtol=1e-9
    )


def test_the_best_restart_is_kept() -> None:
    places = set()
    for seed in range(4):
        (q, G, y), network, report = trained(restarts=4, seed=seed)
        assert network is not None
        losses = report.restart_losses
        assert len(set(losses.tolist())) == 4
        assert report.history.validation[report.history.chosen] == losses.min()
        held = report.validation_rows
        gained = mean_square(q[held], G[held], y[held], None) - mean_square(
            q[held], G[held], y[held], network
        )
        assert np.isclose(
            report.loss_without - losses.min(), gained, rtol=1e-9
        )  # the network itself, not its report
        places.add(int(losses.argmin()))
    assert places != {0}


def test_more_restarts_never_validate_worse() -> None:
    losses = [trained(restarts=restarts)[2].restart_losses.min() for restarts in (1, 3, 6)]
    assert losses[0] >= losses[1] >= losses[2]


def test_early_stopping_keeps_the_iteration_of_the_lowest_validation_loss() -> None:
    for seed in range(4):
        history = trained(data=seed)[2].history
        assert history.validation[history.chosen] == history.validation.min()


def test_without_validation_rows_all_rows_train() -> None:
    _, network, report = trained(validation=0.0, restarts=2)
    assert network is not None
    assert len(report.validation_rows) == 0
    assert len(report.training_rows) == 60
    assert np.isclose(report.restart_losses.min(), report.history.training.min(), rtol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_never_makes_the_validation_worse(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, G = rng.uniform(-1, 1, (40, 6)), rng.normal(size=(40, 9, 6)) * 1e3
    y = rng.normal(size=(40, 9))
    options = TrainingOptions(restarts=2, seed=seed)
    networks, report = train_networks(q, G, y, options, rng)
    network = networks[0] if networks else None
    held = report.validation_rows
    with_network, without = (mean_square(q[held], G[held], y[held], n) for n in (network, None))
    assert with_network <= without
    assert (network is None) == (report.restart_losses.min() >= report.loss_without)


def test_nothing_to_learn_leaves_no_network() -> None:
    q, G, _ = learnable()
    y = np.zeros((60, 9))
    rng = np.random.default_rng(0)
    networks, report = train_networks(q, G, y, TrainingOptions(restarts=2), rng)
    assert networks == ()
    assert report.loss_without == 0.0


def test_a_perfect_robot_is_not_made_worse_than_its_noise(fanuc: Robot) -> None:
    simulation = Simulation(seed=2, scales=ErrorScales(kinds=()))
    measurements = simulate(fanuc, simulation)
    calibration = train(measurements, "nominal", TrainingOptions(restarts=2))
    q = measurements.q
    moved = calibration.forward(q)[:, :3, 3] - fanuc.mechanism.forward(q)[:, :3, 3]
    assert np.linalg.norm(moved, axis=-1).mean() < 0.05e-3  # the noise of one coordinate


@pytest.mark.parametrize(
    "options", [{"restarts": 3}, {"restarts": 1, "optimiser": "gd", "hidden": 2}]
)
def test_the_same_seed_trains_the_same_network_bit_for_bit(options: dict[str, object]) -> None:
    (_, first, report), (_, again, repeated) = trained(**options), trained(**options)
    assert first is not None
    assert again is not None
    assert np.array_equal(first.weights, again.weights)
    assert np.array_equal(report.history.validation, repeated.history.validation)
    assert np.array_equal(report.training_rows, repeated.training_rows)


def test_another_seed_splits_and_starts_otherwise() -> None:
    (_, first, report), (_, other, otherwise) = (
        trained(restarts=1, seed=0),
        trained(restarts=1, seed=1),
    )
    assert first is not None
    assert other is not None
    assert not np.array_equal(report.training_rows, otherwise.training_rows)
    assert not np.isin(first.weights, other.weights).any()


def test_the_number_of_hidden_nodes_is_that_asked_for() -> None:
    for hidden, expected in ((3, 3), (None, 6)):  # √36 = 6
        _, network, report = trained(hidden=hidden, restarts=1)
        assert network is not None
        assert network.hidden == report.hidden == expected


def test_the_loss_of_a_calibration_is_the_weighted_error_of_its_predicted_targets(
    fanuc_measurements: Measurements, fanuc_network: Calibration
) -> None:
    """From measurements to loss without any of the matrices: targets by the calibrated poses, over
    the stated noise.
    """
    report = fanuc_network.training
    assert report is not None
    held = report.validation_rows
    robot, q = fanuc_measurements.robot, fanuc_measurements.q[held]

    def error(poses: Array) -> float:
        points = np.einsum("kab,mb->kma", poses[:, :3, :3], robot.targets) + poses[:, None, :3, 3]
        left = (fanuc_measurements.points[held] - points) / fanuc_measurements.noise_position
        return float((left**2).sum() / len(held))

    gained = error(robot.mechanism.forward(q)) - error(fanuc_network.forward(q))
    reported = report.loss_without - report.history.validation[report.history.chosen]
    assert np.isclose(reported, gained, rtol=0.01)  # the loss is linear in δρ, of some mrad


def test_a_network_on_the_nominal_robot_lowers_its_error_on_fresh_configurations(
    fanuc: Robot,
) -> None:
    measurements = simulate(fanuc, Simulation(seed=1))
    truth = measurements.truth
    assert truth is not None
    fresh = simulate(fanuc, Simulation(seed=1, same_robot=truth))
    real = truth.actual.forward(fresh.q)[:, :3, 3]

    def error(poses: Array) -> float:
        return float(np.linalg.norm(poses[:, :3, 3] - real, axis=-1).mean())

    before = error(fanuc.mechanism.forward(fresh.q))
    for loss in ("task", "joint"):
        calibration = train(measurements, "nominal", TrainingOptions(loss=loss))
        assert error(calibration.forward(fresh.q)) < 0.25 * before


def test_a_network_on_local_poe_learns_what_local_poe_cannot_represent() -> None:
    ur5 = load_robot("ur5")
    scales = ErrorScales(kinds=("gear",), sizes={"gear": 5e-3})
    measurements = simulate(ur5, Simulation(seed=3, scales=scales))
    truth = measurements.truth
    assert truth is not None
    fresh = simulate(ur5, Simulation(seed=3, same_robot=truth))
    real = truth.actual.forward(fresh.q)[:, :3, 3]
    base = identify(measurements, "local-poe")
    both = train(measurements, base, TrainingOptions(regularisation="early-stopping"))
    errors = [
        np.linalg.norm(c.forward(fresh.q)[:, :3, 3] - real, axis=-1).mean() for c in (base, both)
    ]
    assert errors[1] < 0.7 * errors[0]


def test_the_paper_stops_early_and_everything_else_is_regularised() -> None:
    robot = load_robot("planar-3r")
    measurements = simulate(robot, Simulation(configurations=16))
    for base, expected in (
        ("nominal", "early-stopping"),
        (identify(measurements, "local-poe"), "bayes"),
    ):
        training = train(measurements, base).training
        assert training is not None
        assert training.regularisation == expected
