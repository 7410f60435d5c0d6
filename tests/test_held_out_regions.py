"""Deviations of new rows: regions of the joints that are held out say how wide they are."""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.identification.complete import CompleteOptions, identify_complete
from calibtool.identification.equations import linearised_rows
from calibtool.identification.identification import Identification
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import readonly

GEOMETRY = CompleteOptions(orders={"harmonics": 0, "gravity": 0}, compared=False)


def held(found: Identification, rows: Measurements) -> float:
    """Part of the coordinates of rows whose residual lies within 1.96 predicted deviations."""
    assert found.posterior is not None
    columns, off = linearised_rows(rows, found.posterior.parameters, found.state)
    variance = ((columns @ found.posterior.covariance) * columns).sum(axis=-1)
    variance += found.posterior.residual_factors[0] ** 2
    return float((np.abs(off) < 1.96 * np.sqrt(variance)).mean())


def rows_of(name: str, seed: int, count: int = 400) -> Measurements:
    return simulate(load_robot(name), Simulation(seed=seed, configurations=count))


def bent(rows: Measurements, size: float) -> Measurements:
    """The rows with an error that turns with two joints at once, which no family describes, m."""
    off = size * np.sin(3.0 * rows.q[:, 1] * rows.q[:, 2] + rows.q[:, 0] ** 2)
    return replace(rows, points=readonly(rows.points + off[:, None, None]))


@pytest.mark.parametrize("name", ["ur5", "fanuc-m1000ia"])
@pytest.mark.parametrize("size", [0.0, 0.3e-3, 2e-3])
def test_intervals_hold_the_rows_of_a_region_that_was_not_measured(name: str, size: float) -> None:
    """A region is the tenth of the rows that is nearest to one of them, the rest is fitted. Where
    the model describes everything, the intervals are no wider than they have to be."""
    inside = []
    for seed in range(4):
        every = bent(rows_of(name, seed, 200), size)
        distance = ((every.q - every.q[7]) ** 2).sum(axis=-1)
        order = np.argsort(distance)
        found = identify_complete(every.rows(np.sort(order[20:])), GEOMETRY)
        inside.append(held(found, every.rows(np.sort(order[:20]))))
    assert np.mean(inside) >= 0.9
    if size == 0.0:
        assert np.mean(inside) <= 0.98


def test_the_factor_is_no_less_than_the_residuals_of_the_fit() -> None:
    """The prediction of a region is no better than that of the rows that were fitted."""
    rows = bent(rows_of("ur5", 4, 100), 1e-3)
    posterior = identify_complete(rows, GEOMETRY).posterior
    assert posterior is not None
    assert posterior.residual_factors[0] >= posterior.noise_factor


def test_the_order_of_the_rows_does_not_matter_much() -> None:
    rows = bent(rows_of("ur5", 2, 150), 1e-3)
    shuffled = rows.rows(np.random.default_rng(0).permutation(len(rows)))
    found = [identify_complete(each, GEOMETRY).posterior for each in (rows, shuffled)]
    factors = [posterior.residual_factors[0] for posterior in found if posterior is not None]
    assert factors[1] == pytest.approx(factors[0], rel=0.2)


@pytest.mark.parametrize("rows", [[3], [5, 60], [1, 2, 50, 99]])
def test_rows_that_do_not_fit_do_not_widen_the_others(rows: list[int]) -> None:
    clean = rows_of("ur5", 1, 100)
    points = clean.points.copy()
    points[rows] += 0.1
    gross = replace(clean, points=readonly(points))
    factors = [
        posterior.residual_factors[0]
        for posterior in (identify_complete(each, GEOMETRY).posterior for each in (clean, gross))
        if posterior is not None
    ]
    assert factors[1] == pytest.approx(factors[0], rel=0.1)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("count", [4, 7, 13])
def test_few_rows_and_joints_that_stand_still_give_finite_deviations(count: int) -> None:
    rows = rows_of("ur5", 0, count)
    q = rows.q.copy()
    q[:, 5] = 0.3
    repeated = rows.rows(np.repeat(np.arange(3), count))
    for each in (rows, replace(rows, q=readonly(q)), repeated):
        posterior = identify_complete(each, CompleteOptions(compared=False)).posterior
        assert posterior is not None
        assert np.isfinite(posterior.residual_factors).all()
        assert (posterior.residual_factors > 0).all()
