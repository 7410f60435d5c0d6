"""The one helper through which every derivative of the project is checked."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def finite_differences(function: Callable[[Array], Array], x: Array, step: float = 1e-5) -> Array:
    """Central differences of order four of `function` at x (k,), last axis = x:
    output shape (…, k).
    """
    columns = []
    for i in range(len(x)):
        e = np.zeros_like(x)
        e[i] = step
        columns.append(
            (8 * (function(x + e) - function(x - e)) - (function(x + 2 * e) - function(x - 2 * e)))
            / (12 * step)
        )
    return np.stack(columns, axis=-1)


def assert_derivative(
    function: Callable[[Array], Array],
    derivative: Array,
    x: Array,
    tolerance: float = 1e-8,
    step: float = 1e-5,
) -> None:
    """`derivative` (…, k) is that of `function` at x (k,), within `tolerance` of the
    largest element.
    """
    expected = finite_differences(function, x, step)
    assert derivative.shape == expected.shape
    scale = max(1.0, float(np.abs(expected).max()))
    worst = float(np.abs(derivative - expected).max())
    assert worst <= tolerance * scale, f"off by {worst:.2e} at scale {scale:.2e}"
