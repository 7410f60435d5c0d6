"""Inverses of information matrices: exact for what is regular, refused for what is not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibtool.calibration import identify
from calibtool.errors import NoSolutionError
from calibtool.identification.evidence import inverse
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot


@given(st.integers(0, 10**6), st.integers(1, 12))
def test_the_inverse_of_a_regular_matrix_is_one_whatever_its_units(seed: int, p: int) -> None:
    rng = np.random.default_rng(seed)
    units = 10.0 ** rng.uniform(-8, 8, p)
    rows = rng.normal(size=(3 * p, p)) / units
    matrix = rows.T @ rows + np.diag(units**-2.0)
    found = inverse(matrix)
    assert np.array_equal(found, found.T)
    np.testing.assert_allclose(
        units[:, None] ** -1.0 * (found @ matrix) * units, np.eye(p), atol=1e-9
    )


def regular() -> np.ndarray:
    return np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 1.0], [0.0, 1.0, 2.0]])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 0.0, -2.0])
@pytest.mark.parametrize("place", [(0, 0), (1, 1), (2, 2)])
def test_a_diagonal_that_no_information_has_is_refused(bad: float, place: tuple[int, int]) -> None:
    matrix = regular()
    matrix[place] = bad
    with pytest.raises(NoSolutionError, match="state a larger noise"):
        inverse(matrix)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 3.0, 2.0 + 1e-9])
def test_an_indefinite_matrix_is_refused(bad: float) -> None:
    matrix = np.array([[2.0, bad], [bad, 2.0]])
    with pytest.raises(NoSolutionError, match="singular to rounding"):
        inverse(matrix)


@pytest.mark.parametrize("noise", [1e-8, 2e-9])
def test_a_noise_that_rounding_drowns_is_an_error_and_no_number(noise: float) -> None:
    """A planar arm does not show the height of its base: the prior of 1 m stands beside
    a noise of 10 nm.
    """
    measurements = simulate(
        load_robot("planar-3r"),
        Simulation(noise=noise, unregistered=True, configurations=40, workspace="full"),
    )
    with pytest.raises(NoSolutionError, match="state a larger noise"):
        identify(measurements, "complete")
