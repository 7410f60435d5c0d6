"""What is known before a plan: rows against finite differences of observations, updates against the
estimator itself.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify
from calibtool.calibration.fit import BaseOptions
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.errormodel.tolerances import Tolerances
from calibtool.errors import InputError
from calibtool.identification.complete import CompleteOptions
from calibtool.identification.equations import normal_equations
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.information import HARMONICS, Knowledge
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import skew

NOISE = 0.05e-3


@pytest.mark.parametrize("unregistered", [False, True])
@pytest.mark.parametrize("name", ["fanuc-m1000ia", "scara", "planar-3r"])
def test_rows_carry_the_information_of_the_normal_equations(name: str, unregistered: bool) -> None:
    """Condensed, scaled rows against the H that an identification would use."""
    robot = load_robot(name)
    knowledge = Knowledge.of_tolerances(robot, NOISE, unregistered)
    measurements = simulate(
        robot, Simulation(configurations=12, unregistered=unregistered, workspace="full")
    )
    setup = replace(measurements.setup, T_instrument_base=np.eye(4), targets=robot.targets)
    measurements = replace(measurements, setup=setup)
    rows = knowledge.rows(measurements.q).reshape(-1, knowledge.parameters.count)
    H = normal_equations(
        measurements, knowledge.parameters, knowledge.state, np.ones(12)
    ).information
    expected = H * np.outer(knowledge.prior_std, knowledge.prior_std)
    assert np.abs(rows.T @ rows - expected).max() < 1e-9 * np.abs(expected).max()


def test_known_targets_need_six_rows_and_free_ones_all(fanuc: Robot) -> None:
    q = np.zeros((2, 6)) + 0.3
    assert Knowledge.of_tolerances(fanuc, NOISE).rows(q).shape[1] == 6
    assert Knowledge.of_tolerances(fanuc, NOISE, unregistered=True).rows(q).shape[1] == 9


def complete(measurements: Measurements) -> Calibration:
    options = CompleteOptions(
        orders={"harmonics": HARMONICS, "gravity": 1, "twists": 1}, estimate_priors=False
    )
    return identify(measurements, BaseOptions("complete", options))


def posterior_deviation(calibration: Calibration, q: np.ndarray) -> np.ndarray:
    """Standard deviation of the targets from the covariance of the calibrated poses."""
    covariance = predicted_uncertainty(calibration, q).covariance
    arms = calibration.robot.targets @ np.swapaxes(calibration.forward(q)[:, :3, :3], 1, 2)
    moves = np.concatenate([np.broadcast_to(np.eye(3), (*arms.shape, 3)), -skew(arms)], axis=-1)
    return np.sqrt(
        np.einsum("kmai,kij,kmaj->k", moves, covariance, moves) / len(calibration.robot.targets)
    )


def test_with_an_unknown_set_up_targets_can_be_predicted_all_the_same(fanuc: Robot) -> None:
    q = simulate(fanuc, Simulation(configurations=40, workspace="full")).q
    known, unknown = (
        Knowledge.of_tolerances(fanuc, NOISE, unregistered) for unregistered in (False, True)
    )
    sure, less_sure = (k.after(k.rows(q)).target_deviation(q) for k in (known, unknown))
    assert (sure < less_sure * 1.001).all()
    assert less_sure.max() < 0.2e-3


def test_what_is_predicted_is_what_the_estimator_states_afterwards(fanuc: Robot) -> None:
    """Planned covariance against the posterior of an identification from such measurements, its
    noise factor aside.
    """
    measurements = simulate(fanuc, Simulation(configurations=25, workspace="full"))
    calibration = complete(measurements)
    posterior = calibration.base.posterior
    assert posterior is not None
    knowledge = Knowledge.of_tolerances(fanuc, NOISE * posterior.noise_factor)
    asked = posterior.parameters  # with the wind-up of every joint, of which a plan expects less
    knowledge = replace(
        knowledge,
        parameters=asked,
        prior_std=asked.prior_std(),
        covariance=np.eye(asked.count),
    )
    after = knowledge.after(knowledge.rows(measurements.q))
    assert after.effective == pytest.approx(posterior.effective, rel=0.02)
    found = after.target_deviation(measurements.q)
    assert found == pytest.approx(posterior_deviation(calibration, measurements.q), rel=0.05)


def test_a_calibration_is_where_the_next_measurements_start(fanuc: Robot) -> None:
    """Its posterior, and the same after more rows as by adding their information to the inverse."""
    measurements = simulate(fanuc, Simulation(configurations=20, workspace="full"))
    calibration = complete(measurements)
    posterior = calibration.base.posterior
    assert posterior is not None
    knowledge = Knowledge.of_identification(fanuc, calibration.base, NOISE, 1e-4)
    deviation = posterior_deviation(calibration, measurements.q)
    assert knowledge.target_deviation(measurements.q) == pytest.approx(deviation, rel=1e-9)
    rows = knowledge.rows(measurements.q[:3])
    A = rows.reshape(-1, knowledge.parameters.count)
    expected = np.linalg.inv(np.linalg.inv(knowledge.covariance) + A.T @ A)
    assert np.allclose(knowledge.after(rows).covariance, expected, atol=1e-8)


def test_many_harmonics_of_a_calibration_stay_as_they_are(fanuc: Robot) -> None:
    measurements = simulate(fanuc, Simulation(configurations=40, workspace="full"))
    options = CompleteOptions(orders={"harmonics": 4, "gravity": 1, "twists": 1})
    base = identify(measurements, BaseOptions("complete", options)).base
    knowledge = Knowledge.of_identification(fanuc, base, NOISE, 1e-4)
    assert knowledge.parameters.orders["harmonics"] == HARMONICS
    assert base.posterior is not None
    names = base.posterior.parameters.names
    for name in ("ζ3.x", "cos2q4", "gravity2"):
        i, j = knowledge.parameters.names.index(name), names.index(name)
        assert np.sqrt(knowledge.covariance[i, i]) * knowledge.prior_std[i] == pytest.approx(
            np.sqrt(base.posterior.covariance[j, j])
        )


def test_a_model_without_posterior_is_no_start(fanuc: Robot, fanuc_local_poe: Calibration) -> None:
    with pytest.raises(InputError, match=r"local-poe.*no posterior.*complete"):
        Knowledge.of_identification(fanuc, fanuc_local_poe.base, NOISE, 1e-4)


def test_without_measurements_the_tolerances_are_all_that_is_known(fanuc: Robot) -> None:
    knowledge = Knowledge.of_tolerances(fanuc, NOISE)
    assert knowledge.effective == 0.0
    assert np.array_equal(
        knowledge.prior_std, knowledge.parameters.prior_std(Tolerances.of_robot(fanuc))
    )
