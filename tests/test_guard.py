"""The guard's distances: those to the nearest training configuration, for any number of them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify
from calibtool.calibration.guard import coverage
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array, readonly


@cache
def calibration() -> Calibration:
    return identify(simulate(load_robot("ur5"), Simulation(configurations=40)), "local-poe")


def trained_at(q: Array) -> Calibration:
    return replace(calibration(), q=readonly(q))


def by_all_pairs(known: Array, points: Array) -> Array:
    """Distances over the largest spacing, from every pair."""
    scale = np.maximum(np.ptp(known, axis=0) / 2, 1e-3)
    known, points = known / scale, points / scale
    within = np.linalg.norm(known[:, None] - known[None], axis=-1)
    np.fill_diagonal(within, np.inf)
    spacing = max(within.min(axis=1).max(), np.linalg.norm(1e-3 / scale))
    found: Array = np.linalg.norm(points[:, None] - known[None], axis=-1).min(axis=1) / spacing
    return found


@pytest.mark.parametrize("kind", ["even", "clustered", "repeated", "on a line", "a path", "two"])
def test_distances_are_those_of_all_pairs(kind: str) -> None:
    rng = np.random.default_rng(1)
    known = rng.uniform(-2, 2, (400, 6))
    if kind == "clustered":
        known[:-5] *= 1e-3
    if kind == "repeated":
        known = np.repeat(known[:20], 20, axis=0)
    if kind == "on a line":
        known[:, 1:] = 0.5
    if kind == "a path":
        known = np.cumsum(0.01 * known, axis=0)
    if kind == "two":
        known = known[:2]
    points = np.concatenate([rng.uniform(-3, 3, (50, 6)), known[:5], known[:5] + 1e-9])
    found = coverage(trained_at(known), points).distance
    np.testing.assert_allclose(found, by_all_pairs(known, points), rtol=1e-12, atol=1e-12)


def test_a_hundred_thousand_rows_are_few_comparisons(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exact distances are asked for at a few hundred of them, whatever time that takes here."""
    from scipy.spatial import cKDTree

    asked = []

    class Counting(cKDTree):
        def query(self, x: Array, k: int = 1, eps: float = 0.0) -> tuple[Array, Array]:
            if eps == 0.0:
                asked.append(len(x))
            return super().query(x, k=k, eps=eps)

    monkeypatch.setattr("scipy.spatial.cKDTree", Counting)
    rng = np.random.default_rng(2)
    q = rng.uniform(-2, 2, (100_000, 6))
    inside = coverage(trained_at(q), q[:2]).distance
    assert inside.tolist() == [0.0, 0.0]
    assert sum(asked) < 2000


def test_rows_without_positions_have_no_distance() -> None:
    q = np.array([[np.nan] * 6, calibration().q[0]])
    assert np.isnan(coverage(calibration(), q).distance).tolist() == [True, False]
