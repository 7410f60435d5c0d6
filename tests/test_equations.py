"""Normal equations: the products that skip the columns of harmonics, and what a row left out
would leave over.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.errormodel.actual import ErrorScales
from calibtool.identification.equations import normal_equations, row_squares
from calibtool.identification.fitting import Fit
from calibtool.identification.held_out import HeldOut
from calibtool.identification.parameters import Parameters, State
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import observation_matrix, residuals, target_columns, weights
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot


def columns_and_residuals(
    measurements: Measurements, parameters: Parameters, state: State
) -> tuple[np.ndarray, np.ndarray]:
    """Every column written out, weighted: (N, d, p) and (N, d)."""
    context = state.errors.context(measurements.q)
    frames = context.frames
    columns = observation_matrix(state.setup, frames.tool) @ parameters.pose_columns(context)
    if parameters.targets:
        columns = np.concatenate([columns, target_columns(state.setup, frames.tool)], axis=-1)
    weight = weights(measurements)
    return columns * weight[..., None], residuals(measurements, state.setup, frames.tool) * weight


def moved_state(measurements: Measurements, parameters: Parameters) -> State:
    step = np.random.default_rng(0).normal(0, 1e-3, parameters.count)
    return State.nominal(measurements.robot, measurements.setup).moved(parameters, step)


@pytest.mark.parametrize("unregistered", [False, True])
@pytest.mark.parametrize("name", ["fanuc-m1000ia", "scara"])
def test_they_are_the_products_of_the_columns(name: str, unregistered: bool) -> None:
    measurements = simulate(
        load_robot(name), Simulation(configurations=30, unregistered=unregistered, workspace="full")
    )
    parameters = Parameters.of(
        measurements.robot, measurements.setup, twists=1, harmonics=4, gravity=1
    )
    state = moved_state(measurements, parameters)
    row_weight = np.random.default_rng(1).uniform(0.1, 1.0, 30)
    A, r = columns_and_residuals(measurements, parameters, state)
    found = normal_equations(measurements, parameters, state, row_weight)
    information = np.einsum("k,kdi,kdj->ij", row_weight, A, A)
    scale = np.sqrt(np.outer(np.diag(information), np.diag(information))) + 1e-300
    assert np.abs((found.information - information) / scale).max() < 1e-12
    gradient = np.einsum("k,kdi,kd->i", row_weight, A, r)
    assert np.abs(found.gradient - gradient).max() < 1e-12 * np.abs(gradient).max()
    assert found.squares == pytest.approx(row_weight @ (r**2).sum(axis=-1))
    assert found.equations == pytest.approx(row_weight.sum() * r.shape[1])
    assert np.allclose(found.row_squares, row_squares(measurements, state))


def test_rows_weigh_as_they_are_given_and_missing_targets_not_at_all() -> None:
    measurements = simulate(load_robot("ur5"), Simulation(configurations=12, workspace="full"))
    points = measurements.points.copy()
    points[3, 1] = np.nan
    lacking = replace(measurements, points=points)
    parameters = Parameters.of(measurements.robot, measurements.setup, harmonics=2)
    state = State.nominal(measurements.robot, measurements.setup)
    weight = np.ones(12)
    assert normal_equations(lacking, parameters, state, weight).equations == 12 * 9 - 3
    weight[3] = 0.0
    one, other = (normal_equations(m, parameters, state, weight) for m in (lacking, measurements))
    assert np.allclose(one.information, other.information)


def test_a_row_left_out_is_predicted_as_a_fit_of_the_others_would() -> None:
    """The closed form against fits repeated without the row, of the same linear model."""
    small = ErrorScales(length=1e-5, angle=1e-5)  # so that the robot is linear
    measurements = simulate(
        load_robot("ur5"), Simulation(configurations=25, scales=small, workspace="full")
    )
    parameters = Parameters.of(measurements.robot, measurements.setup, harmonics=1)
    start = State.nominal(measurements.robot, measurements.setup)
    prior = np.diag(np.full(parameters.count, 1e-3) ** -2.0)
    A, r = columns_and_residuals(measurements, parameters, start)
    H, g = np.einsum("kdi,kdj->ij", A, A), np.einsum("kdi,kd->i", A, r)
    fitted = r - A @ np.linalg.solve(H + prior, g)
    k = 7
    without = np.linalg.solve(H - A[k].T @ A[k] + prior, g - A[k].T @ r[k])
    expected = ((r[k] - A[k] @ without) ** 2).sum()
    hat = A[k] @ np.linalg.inv(H + prior) @ A[k].T
    assert (np.linalg.solve(np.eye(9) - hat, fitted[k]) ** 2).sum() == pytest.approx(
        expected, rel=1e-6
    )
    state = start.moved(parameters, np.linalg.solve(H + prior, g))
    fit = Fit(
        parameters,
        state,
        np.full(parameters.count, 1e-3),
        H,
        np.zeros(25),
        np.ones(25),
        1.0,
        0.0,
        1,
    )
    assert HeldOut.of(measurements, fit).squares()[k] * 9 == pytest.approx(expected, rel=1e-2)


def test_held_out_rows_without_a_section_are_those_of_the_smaller_model() -> None:
    """Conditioning the larger model on zeros against the smaller model's own equations; repeats
    are held out together."""
    small = ErrorScales(("geometric", "gear"), length=1e-5, angle=1e-5, sizes={"gear": 1e-5})
    robot = load_robot("ur5")
    once = simulate(robot, Simulation(configurations=20, scales=small, workspace="full"))
    at = np.concatenate([once.q, once.q[:5] + 1e-4])
    measurements = simulate(robot, Simulation(at=at, same_robot=once.truth))
    start = State.nominal(robot, measurements.setup)
    sizes = []
    for orders in ({"harmonics": 1}, {}):
        parameters = Parameters.of(robot, measurements.setup, **orders)
        prior = np.diag(np.full(parameters.count, 1e-4) ** -2.0)
        A, r = columns_and_residuals(measurements, parameters, start)
        H, g = np.einsum("kdi,kdj->ij", A, A), np.einsum("kdi,kd->i", A, r)
        state = start.moved(parameters, np.linalg.solve(H + prior, g))
        fit = Fit(
            parameters, state, np.full(parameters.count, 1e-4), H, r[:, 0], np.ones(25), 1.0, 0.0, 1
        )
        dropped = np.arange(parameters.count)[parameters.blocks["harmonics"]]
        sizes.append(HeldOut.of(measurements, fit).squares(dropped))
        if not orders:
            for rows in ([3, 23], [10]):
                rest = np.setdiff1d(np.arange(25), rows)
                H, g = (
                    np.einsum("kdi,kdj->ij", A[rest], A[rest]),
                    np.einsum("kdi,kd->i", A[rest], r[rest]),
                )
                left = r[rows] - A[rows] @ np.linalg.solve(H + prior, g)
                np.testing.assert_allclose(sizes[1][rows] * 9, (left**2).sum(axis=-1), rtol=1e-2)
    np.testing.assert_allclose(sizes[0], sizes[1], rtol=1e-2)
