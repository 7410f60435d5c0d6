"""The chances behind flags, against scipy.stats, which the library does
not import for its weight.
"""

import numpy as np
import pytest
from scipy.special import chdtri
from scipy.stats import chi2, hypergeom

from calibtool.identification.robust import at_least

CASES = [(3, 60, 10, 3), (1, 5, 5, 5), (4, 10, 8, 5), (70, 10_000, 900, 100), (6, 9, 5, 6)]


@pytest.mark.parametrize(("take", "count", "inside", "flagged"), CASES)
def test_the_hypergeometric_tail(take: int, count: int, inside: int, flagged: int) -> None:
    assert at_least(take, count, inside, flagged) == pytest.approx(
        hypergeom.sf(take - 1, count, inside, flagged), rel=1e-8
    )


def test_limits_are_quantiles_of_chi_squared() -> None:
    d = np.array([1, 3, 9, 300])
    np.testing.assert_allclose(chdtri(d, 1e-4), chi2.isf(1e-4, d), rtol=1e-12)
    np.testing.assert_allclose(chdtri(d, 0.5), chi2.median(d), rtol=1e-12)
