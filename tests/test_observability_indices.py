"""Observability indices: against singular values worked out another way,
and what they say of sets.
"""

import numpy as np
import pytest

from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.measurement.sampling import sample_configurations
from calibtool.planning.information import Knowledge
from calibtool.planning.observability_indices import observability_indices
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import transform_points

NOISE = 0.05e-3


@pytest.fixture(scope="module")
def fanuc_configurations(fanuc: Robot) -> np.ndarray:
    return sample_configurations(fanuc, "full", 300, np.random.default_rng(0))


def test_they_are_those_of_the_geometry_by_finite_differences(
    fanuc: Robot, fanuc_configurations: np.ndarray
) -> None:
    """Target points of robots with one placement error each: 30 of 42 directions are seen, their
    singular values.
    """
    q, step = fanuc_configurations[:20], 1e-6

    def points(errors: np.ndarray) -> np.ndarray:
        return transform_points(
            RobotErrors.of(fanuc, placements=errors.reshape(7, 6)).frames(q).tool, fanuc.targets
        ).ravel()

    # Tolerances are 1 mm and 1 mrad for every element.
    columns = [
        (points(step * e) - points(-step * e)) / (2 * step) * 1e-3 / NOISE for e in np.eye(42)
    ]
    sigma = np.linalg.svd(np.stack(columns, axis=-1), compute_uv=False)
    assert sigma[30] < 1e-6 * sigma[0]
    sigma = sigma[:30]
    found = observability_indices(Knowledge.of_tolerances(fanuc, NOISE), q, fanuc_configurations)
    expected = {
        "O1": np.prod(sigma) ** (1 / 30) / np.sqrt(20),
        "O2": sigma[-1] / sigma[0],
        "O3": sigma[-1],
        "O4": sigma[-1] ** 2 / sigma[0],
        "O5": 1 / np.sum(1 / sigma),
    }
    assert found == pytest.approx(expected, rel=1e-4)


def test_more_configurations_are_never_worse(
    fanuc: Robot, fanuc_configurations: np.ndarray
) -> None:
    knowledge = Knowledge.of_tolerances(fanuc, NOISE)
    few, more = (
        observability_indices(knowledge, fanuc_configurations[:k], fanuc_configurations)
        for k in (10, 40)
    )
    assert more["O3"] > few["O3"]
    assert more["O5"] > few["O5"]


def test_too_few_configurations_observe_nothing(
    fanuc: Robot, fanuc_configurations: np.ndarray
) -> None:
    found = observability_indices(
        Knowledge.of_tolerances(fanuc, NOISE), fanuc_configurations[:3], fanuc_configurations
    )
    assert set(found.values()) == {0.0}


def test_a_quieter_instrument_scales_them(fanuc: Robot, fanuc_configurations: np.ndarray) -> None:
    q = fanuc_configurations[:12]
    loud, quiet = (
        observability_indices(Knowledge.of_tolerances(fanuc, noise), q, fanuc_configurations)
        for noise in (NOISE, NOISE / 2)
    )
    assert quiet["O3"] == pytest.approx(2 * loud["O3"])
    assert quiet["O2"] == pytest.approx(loud["O2"])
