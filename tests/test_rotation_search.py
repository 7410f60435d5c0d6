"""The rotation search: its minima are minima, and none lower is found by looking everywhere."""

import numpy as np
from scipy.spatial.transform import Rotation

from calibtool.measurement.rotation_search import RotationForm, nearest_rotation, rotation_grid


def test_the_grid_leaves_no_rotation_far_away() -> None:
    grid = rotation_grid()
    assert np.abs(np.linalg.det(grid) - 1).max() < 1e-12
    some = Rotation.random(500, rng=np.random.default_rng(1)).as_matrix()
    traces = np.einsum("kab,gab->kg", some, grid)
    nearest = np.arccos((traces.max(axis=-1) - 1) / 2)
    assert np.rad2deg(nearest.max()) < 63


def test_no_rotation_anywhere_is_lower() -> None:
    everywhere = Rotation.random(20_000, rng=np.random.default_rng(2)).as_matrix()
    for seed in range(10):
        rng = np.random.default_rng(seed)
        form = RotationForm.of(rng.normal(size=(12, 9)), rng.normal(size=12))
        found = form.minimum(np.concatenate([form.relaxed(), rotation_grid()]))
        values = [float(form.value(C)) for C in found]
        assert values == sorted(values)
        assert values[0] <= form.value(everywhere).min()
        for turn in np.concatenate([np.eye(3), -np.eye(3)]) * 1e-4:
            assert form.value(Rotation.from_rotvec(turn).as_matrix() @ found[0]) > values[0]


def test_the_value_is_half_the_sum_of_squares_but_for_a_constant() -> None:
    rng = np.random.default_rng(3)
    E, e = rng.normal(size=(12, 9)), rng.normal(size=12)
    C = Rotation.random(4, rng=rng).as_matrix()
    direct = [0.5 * np.sum((E @ c.ravel() - e) ** 2) for c in C]
    assert np.allclose(RotationForm.of(E, e).value(C), np.array(direct) - 0.5 * e @ e)


def test_exact_equations_give_their_rotation() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        truth = Rotation.random(rng=rng).as_matrix()
        E = rng.normal(size=(7, 9))  # fewer than nine: only the constraint makes it one rotation
        form = RotationForm.of(E, E @ truth.ravel())
        assert np.abs(form.minimum(rotation_grid())[0] - truth).max() < 1e-8


def test_the_nearest_rotation_of_a_stretched_one() -> None:
    truth = Rotation.random(6, rng=np.random.default_rng(4)).as_matrix()
    assert np.abs(nearest_rotation(truth @ np.diag([2.0, 1.0, 0.5])) - truth).max() < 1e-12
