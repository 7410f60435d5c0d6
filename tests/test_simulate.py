"""Simulated measurements are those of the actual robot, plus noise of the stated size, and
nothing is given away.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.errors import InputError
from calibtool.measurement.measurements import Measurements, Truth
from calibtool.measurement.registration import register
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, observe, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.source import parse_source

EVERYTHING = ErrorScales(kinds=ERROR_KINDS)


def simulated(robot: Robot, **options: object) -> Measurements:
    return simulate(
        robot,
        replace(Simulation(seed=3, configurations=40), **options),
    )


def true_points(measurements: Measurements) -> Array:
    """Where the targets really are, configuration by configuration and target by target."""
    truth = measurements.truth
    assert truth is not None
    poses = truth.setup.T_instrument_base @ truth.actual.forward(measurements.q)
    return np.array([[(T @ [*target, 1.0])[:3] for target in truth.setup.targets] for T in poses])


@pytest.mark.parametrize("unregistered", [False, True])
@pytest.mark.parametrize("name", ["fanuc-m1000ia", "scara", "panda"])
def test_without_noise_the_points_are_those_of_the_actual_robot(
    name: str, unregistered: bool
) -> None:
    measurements = simulated(
        load_robot(name), scales=EVERYTHING, noise=0.0, unregistered=unregistered
    )
    assert np.abs(measurements.points - true_points(measurements)).max() < 1e-12


@pytest.mark.parametrize("noise", [0.05e-3, 0.3e-3])
def test_noise_has_the_stated_size_on_every_axis(fanuc: Robot, noise: float) -> None:
    measurements = simulated(fanuc, configurations=200, noise=noise)
    scaled = (measurements.points - true_points(measurements)) / noise
    assert measurements.noise_position == noise
    for axis in range(3):
        values = scaled[:, :, axis].ravel()
        low, high = chi2.ppf([1e-4, 1 - 1e-4], len(values))
        assert low < (values**2).sum() < high
        assert abs(values.mean()) < 4 / np.sqrt(len(values))


def test_noise_of_different_coordinates_is_independent(fanuc: Robot) -> None:
    measurements = simulated(fanuc, configurations=400)
    scaled = ((measurements.points - true_points(measurements)) / 0.05e-3).reshape(400, 9)
    correlation = np.corrcoef(scaled.T) - np.eye(9)
    assert np.abs(correlation).max() < 4 / np.sqrt(400)


def test_the_same_robot_is_measured_again_at_other_configurations(fanuc: Robot) -> None:
    first = simulated(fanuc, scales=EVERYTHING)
    assert first.truth is not None
    again = simulated(fanuc, same_robot=first.truth, scales=EVERYTHING)
    assert again.truth is not None
    for q in (first.q, again.q):
        assert np.array_equal(again.truth.actual.forward(q), first.truth.actual.forward(q))
    assert not np.isin(again.q, first.q).any()
    noise = first.points - true_points(first), again.points - true_points(again)
    assert not np.isin(noise[0], noise[1]).any()


def test_another_seed_makes_another_robot_other_configurations_and_other_noise(
    fanuc: Robot,
) -> None:
    a, b = simulated(fanuc, seed=1), simulated(fanuc, seed=2)
    assert a.truth is not None
    assert b.truth is not None
    assert not np.isclose(
        a.truth.actual.errors["placements"], b.truth.actual.errors["placements"], rtol=1e-6
    ).any()
    assert not np.isin(a.q, b.q).any()


def test_the_same_seed_makes_the_same_measurements(fanuc: Robot) -> None:
    for unregistered in (False, True):
        a = simulated(fanuc, scales=EVERYTHING, unregistered=unregistered)
        b = simulated(fanuc, scales=EVERYTHING, unregistered=unregistered)
        assert np.array_equal(a.q, b.q)
        assert np.array_equal(a.points, b.points)


def test_size_of_the_noise_and_number_of_configurations_leave_the_robot_as_it_was(
    fanuc: Robot,
) -> None:
    a, b = simulated(fanuc, noise=0.0), simulated(fanuc, noise=1e-3, configurations=5)
    assert a.truth is not None
    assert b.truth is not None
    assert np.array_equal(a.truth.actual.forward(a.q), b.truth.actual.forward(a.q))


def test_a_registered_simulation_knows_the_paper_s_setup(fanuc: Robot) -> None:
    measurements = simulated(fanuc)
    assert measurements.setup.known
    assert np.array_equal(measurements.setup.T_instrument_base, np.eye(4))
    assert np.array_equal(measurements.setup.targets, fanuc.targets)


def test_an_unregistered_simulation_hides_frame_and_targets(fanuc: Robot) -> None:
    measurements = simulated(fanuc, unregistered=True)
    truth, setup = measurements.truth, measurements.setup
    assert truth is not None
    assert not setup.frame_known
    assert not setup.targets_known
    assert np.linalg.norm(truth.setup.T_instrument_base[:3, 3]) > 0.1
    assert np.abs(truth.setup.targets - fanuc.targets).max() > 0.01
    assert np.abs(setup.T_instrument_base - truth.setup.T_instrument_base).max() > 1e-6
    assert np.abs(setup.targets - truth.setup.targets).max() > 1e-6
    # What is told follows from the readings alone: it comes out again without the truth and without
    # the first estimate.
    blank = Setup(np.eye(4), np.zeros((3, 3)), frame_known=False, targets_known=False)
    estimated = register(replace(measurements, truth=None, setup=blank))
    assert np.abs(estimated.T_instrument_base - setup.T_instrument_base).max() < 1e-9
    assert np.abs(estimated.targets - setup.targets).max() < 1e-9


def test_targets_keep_their_triangle_when_they_are_moved(fanuc: Robot) -> None:
    truth = simulated(fanuc, unregistered=True).truth
    assert truth is not None

    def sides(targets: Array) -> Array:
        return np.linalg.norm(targets - np.roll(targets, 1, axis=0), axis=-1)

    assert np.allclose(sides(truth.setup.targets), sides(fanuc.targets), atol=1e-12)


def test_the_setup_of_an_unregistered_robot_stays_when_it_is_measured_again(fanuc: Robot) -> None:
    first = simulated(fanuc, unregistered=True, noise=0.0)
    assert first.truth is not None
    again = simulated(fanuc, same_robot=first.truth, noise=0.0)
    assert not again.setup.known
    assert (
        np.abs(again.points - observe(first.truth.actual, first.truth.setup, again.q)).max() < 1e-12
    )


def test_configurations_can_be_given(fanuc: Robot) -> None:
    q = np.linspace(-0.2, 0.2, 18).reshape(3, 6)
    measurements = simulated(fanuc, at=q)
    assert np.array_equal(measurements.q, q)
    assert measurements.points.shape == (3, 3, 3)


@pytest.mark.parametrize(
    ("q", "message"),
    [
        (np.zeros((3, 5)), "shape"),
        (np.full((2, 6), np.nan), "not finite"),
        (np.zeros((0, 6)), "none to measure"),
    ],
)
def test_given_configurations_must_fit_the_robot(fanuc: Robot, q: Array, message: str) -> None:
    with pytest.raises(InputError, match=message):
        simulated(fanuc, at=q)


def test_targets_on_a_line_are_refused() -> None:
    source = load_robot("scara").source
    start = source.toml_text.index("points_mm")
    end = source.toml_text.index("\n", start)
    line = "points_mm = [[0.0, 0.0, 50.0], [10.0, 0.0, 50.0], [100.0, 0.0, 50.0]]"
    text = source.toml_text[:start] + line + source.toml_text[end:]
    robot = Robot.from_source(parse_source(text, source.urdf_text, "scara"))
    with pytest.raises(InputError, match="collinear"):
        simulated(robot)


def test_an_actual_robot_without_errors_is_the_nominal_one() -> None:
    for name in ("ur5", "gantry"):
        robot = load_robot(name)
        measurements = simulated(robot, scales=ErrorScales(kinds=()), noise=0.0)
        poses = robot.mechanism.forward(measurements.q)
        expected = np.einsum("kab,mb->kma", poses[:, :3, :3], robot.targets) + poses[:, None, :3, 3]
        assert np.abs(measurements.points - expected).max() < 1e-12
        assert isinstance(measurements.truth, Truth)
