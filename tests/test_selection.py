"""Optimal selection: updates against determinants and traces written out, exhaustive
search on small cases.
"""

from itertools import combinations

import numpy as np
import pytest

from calibtool.planning.selection import _Design, improve, select


def objective(
    rows: np.ndarray, prior: np.ndarray, chosen: tuple[int, ...], reference: np.ndarray | None
) -> float:
    """ln det of the covariance, or the mean variance over the reference rows."""
    A = rows[list(chosen)].reshape(-1, rows.shape[-1])
    covariance = np.linalg.inv(np.linalg.inv(prior) + A.T @ A)
    if reference is None:
        return float(np.linalg.slogdet(covariance)[1])
    flat = reference.reshape(-1, rows.shape[-1])
    return float(np.einsum("ki,ij,kj->", flat, covariance, flat) / len(flat))


def problem(seed: int, candidates: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(7, 7)) + 3 * np.eye(7)
    rows = rng.normal(size=(candidates, 2, 7)) * rng.uniform(0.3, 3.0, (candidates, 1, 1))
    return rows, root @ root.T, rng.normal(size=(20, 2, 7))


@pytest.mark.parametrize("criterion", ["d", "i"])
def test_it_finds_nearly_the_best_subset_of_all(criterion: str) -> None:
    ranks = []
    for seed in range(6):
        rows, prior, reference = problem(seed)
        judged = reference if criterion == "i" else None
        chosen = select(rows, prior, 4, criterion, reference)
        assert len(set(chosen.tolist())) == 4
        found = objective(rows, prior, tuple(chosen), judged)
        every = sorted(
            objective(rows, prior, subset, judged) for subset in combinations(range(len(rows)), 4)
        )
        ranks.append(int(np.searchsorted(every, found - 1e-9)))
    assert max(ranks) <= 5  # of 495
    assert np.median(ranks) == 0


@pytest.mark.parametrize("criterion", ["d", "i"])
def test_gains_are_what_adding_gains(criterion: str) -> None:
    """After additions and removals, against the objective written out."""
    rows, prior, reference = problem(3)
    flat = reference.reshape(-1, 7)
    moments = flat.T @ flat / len(flat) if criterion == "i" else None
    design = _Design(rows, np.linalg.inv(prior), moments)
    for index, sign in ((2, 1), (5, 1), (7, 1), (5, -1), (9, 1), (2, -1)):
        design.move(index, sign)
    judged = reference if criterion == "i" else None
    before = objective(rows, prior, (7, 9), judged)
    expected = [before - objective(rows, prior, (7, 9, k), judged) for k in range(len(rows))]
    assert design.gains() == pytest.approx(np.array(expected), rel=1e-8)


def test_precise_instruments_do_not_spoil_it() -> None:
    """Information 1e12 times that of the prior: removals stay exact."""
    rows, prior, reference = problem(5)
    rows = rows * 1e6
    chosen = select(rows, prior, 6, "i", reference)
    found = objective(rows, prior, tuple(chosen), reference)
    every = [
        objective(rows, prior, subset, reference) for subset in combinations(range(len(rows)), 6)
    ]
    assert found <= np.quantile(every, 0.02) * (1 + 1e-3)


def test_improving_never_makes_it_worse() -> None:
    for seed in range(5):
        rows, prior, _ = problem(seed)
        chosen = improve(rows, prior, 4)
        assert (
            objective(rows, prior, tuple(chosen), None)
            <= objective(rows, prior, (0, 1, 2, 3), None) + 1e-9
        )


def test_all_candidates_can_be_chosen() -> None:
    rows, prior, _ = problem(0, candidates=5)
    assert sorted(select(rows, prior, 5)) == [0, 1, 2, 3, 4]
