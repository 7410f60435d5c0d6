"""Rigid motions obey the laws of their group; the exponential is that of the 4 × 4 matrix."""

from collections.abc import Callable

import numpy as np
import pytest
from cases import examples
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm

from calibtool.errors import InputError
from calibtool.robot.se3 import (
    Array,
    adjoint,
    check_poses,
    exp6,
    inverse,
    log3,
    log6,
    readonly,
    skew,
    transform_points,
    translation,
)

laws = examples(40)

vectors = arrays(float, 3, elements=st.floats(-2, 2))


@st.composite
def twists(draw: st.DrawFn, longest_turn: float = np.pi - 1e-6) -> Array:
    """Twists with a turn of 1e-12 … `longest_turn` rad, or of none, and any slide up
    to 2 m per axis.
    """
    axis = draw(vectors)
    norm = np.linalg.norm(axis)
    size = draw(st.sampled_from([0.0, 1e-12, 1e-8, 1e-4, 1e-2, 1.0])) * draw(
        st.floats(0.1, longest_turn)
    )
    turn = axis / norm * min(size, longest_turn) if norm > 1e-3 else np.zeros(3)
    return np.concatenate([draw(vectors), turn])


poses = twists().map(exp6)


def matrix_exponential(twist: Array) -> Array:
    """The pose from scipy's matrix exponential, which leaves rounding errors in a
    last row of zeros.
    """
    pose: Array = expm(hat(twist))
    np.testing.assert_allclose(pose[3], [0, 0, 0, 1], atol=1e-13)
    pose[3] = [0, 0, 0, 1]
    return pose


def hat(twist: Array) -> Array:
    """The element of se(3) as a matrix, written out: [[ω]×, v; 0, 0]."""
    vx, vy, vz, wx, wy, wz = twist
    return np.array([[0, -wz, wy, vx], [wz, 0, -wx, vy], [-wy, wx, 0, vz], [0, 0, 0, 0]])


@laws
@given(twists(longest_turn=6.0))
def test_exp6_is_the_exponential_of_the_matrix(x: Array) -> None:
    np.testing.assert_allclose(exp6(x), matrix_exponential(x), atol=1e-12)


@laws
@given(twists())
def test_log6_undoes_exp6(x: Array) -> None:
    np.testing.assert_allclose(log6(exp6(x)), x, atol=1e-12)


@laws
@given(twists(longest_turn=6.0))
def test_exp6_undoes_log6_with_a_turn_of_at_most_half_a_circle(x: Array) -> None:
    pose = matrix_exponential(x)
    twist = log6(pose)
    np.testing.assert_allclose(matrix_exponential(twist), pose, atol=1e-12)
    assert np.linalg.norm(twist[3:]) <= np.pi + 1e-12


@pytest.mark.parametrize("scale", [1e-15, 1e-12, 1e-9, 1e-6, 1e-3])
def test_a_small_twist_keeps_its_relative_precision(scale: float, rng: np.random.Generator) -> None:
    x = rng.normal(size=(50, 6)) * scale
    assert np.abs(log6(exp6(x)) - x).max() < 1e-12 * scale


def test_half_a_turn_has_a_logarithm() -> None:
    for axis in np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.0, -0.8]]]):
        pose = np.eye(4)
        pose[:3, :3] = 2 * np.outer(axis, axis) - np.eye(3)  # rotation by π about a unit axis
        pose[:3, 3] = [0.3, -1.2, 2.0]
        np.testing.assert_allclose(matrix_exponential(log6(pose)), pose, atol=1e-12)
        assert np.linalg.norm(log3(pose[:3, :3])) == pytest.approx(np.pi, abs=1e-12)


@laws
@given(twists())
def test_log3_is_the_rotation_part_of_log6(x: Array) -> None:
    np.testing.assert_allclose(log3(matrix_exponential(x)[:3, :3]), x[3:], atol=1e-12)


@laws
@given(poses, poses)
def test_adjoint_of_a_product_is_the_product_of_adjoints(A: Array, B: Array) -> None:
    np.testing.assert_allclose(adjoint(A @ B), adjoint(A) @ adjoint(B), atol=1e-12)


@laws
@given(poses)
def test_adjoint_of_the_inverse_is_the_inverse_of_the_adjoint(T: Array) -> None:
    np.testing.assert_allclose(adjoint(inverse(T)) @ adjoint(T), np.eye(6), atol=1e-12)


@laws
@given(poses, twists())
def test_conjugation_moves_a_twist_by_the_adjoint(T: Array, x: Array) -> None:
    np.testing.assert_allclose(T @ exp6(x) @ inverse(T), exp6(adjoint(T) @ x), atol=1e-11)


@laws
@given(poses)
def test_inverse_is_two_sided(T: Array) -> None:
    np.testing.assert_allclose(inverse(T) @ T, np.eye(4), atol=1e-13)
    np.testing.assert_allclose(T @ inverse(T), np.eye(4), atol=1e-13)
    assert inverse(T)[3].tolist() == [0, 0, 0, 1]


@laws
@given(vectors, vectors)
def test_skew_times_a_vector_is_the_cross_product(a: Array, b: Array) -> None:
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-14)


@laws
@given(vectors, vectors)
def test_translations_add(a: Array, b: Array) -> None:
    np.testing.assert_allclose(translation(a) @ translation(b), translation(a + b), atol=1e-15)
    np.testing.assert_array_equal(translation(a)[:3, :3], np.eye(3))


@pytest.mark.parametrize(
    ("function", "item"),
    [
        (exp6, (6,)),
        (log6, (4, 4)),
        (log3, (3, 3)),
        (inverse, (4, 4)),
        (adjoint, (4, 4)),
        (skew, (3,)),
        (translation, (3,)),
    ],
)
@pytest.mark.parametrize("leading", [(), (0,), (1,), (4,), (2, 3)])
def test_a_batch_is_its_elements(
    function: Callable[[Array], Array],
    item: tuple[int, ...],
    leading: tuple[int, ...],
    rng: np.random.Generator,
) -> None:
    count = int(np.prod(leading))
    if len(item) == 1:
        batch = rng.normal(size=(*leading, *item))
    else:
        matrices = [
            matrix_exponential(rng.normal(size=6))[: item[0], : item[1]] for _ in range(count)
        ]
        batch = np.reshape(matrices, (*leading, *item))
    result = function(batch)
    single = [function(x) for x in batch.reshape(-1, *item)]
    assert result.shape[: len(leading)] == leading
    assert result.ndim == len(leading) + (1 if function in (log6, log3) else 2)
    for got, want in zip(result.reshape(count, *result.shape[len(leading) :]), single, strict=True):
        np.testing.assert_allclose(got, want, atol=1e-15)


@pytest.mark.parametrize("leading", [(), (3,), (2, 5)])
@pytest.mark.parametrize("m", [1, 4])
def test_transform_points_is_the_homogeneous_product(
    leading: tuple[int, ...], m: int, rng: np.random.Generator
) -> None:
    pose, points = exp6(rng.normal(size=(*leading, 6))), rng.normal(size=(m, 3))
    moved = transform_points(pose, points)
    assert moved.shape == (*leading, m, 3)
    for index in np.ndindex(*leading, m):
        homogeneous = pose[index[:-1]] @ [*points[index[-1]], 1.0]
        np.testing.assert_allclose(moved[index], homogeneous[:3], atol=1e-14)


def test_readonly_is_a_copy_that_refuses_writing() -> None:
    source = np.zeros((2, 3))
    kept = readonly(source)
    source[0, 0] = 1.0
    assert kept[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        kept[0, 0] = 2.0


def test_readonly_makes_floats_of_integers() -> None:
    assert readonly([[1, 2]]).dtype == np.float64


@pytest.mark.parametrize("shape", [(2, 3), (-1, 3), (2, -1), (-1, -1)])
def test_readonly_accepts_the_shape_that_was_asked_for(shape: tuple[int, ...]) -> None:
    assert readonly(np.ones((2, 3)), shape).shape == (2, 3)


@pytest.mark.parametrize("shape", [(3, 2), (-1, 2), (6,), (2, 3, 1), ()])
def test_readonly_refuses_another_shape(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="expected shape"):
        readonly(np.ones((2, 3)), shape)


@laws
@given(poses)
def test_every_rigid_motion_written_with_six_digits_is_one(pose: Array) -> None:
    check_poses(np.round(pose[None], 6), "poses")


@pytest.mark.parametrize(
    "wrong",
    [
        np.eye(3)[None],
        np.eye(4),
        np.full((1, 4, 4), np.nan),
        np.diag([1.0, 1.0, -1.0, 1.0])[None],
        np.diag([1.001, 1.0, 1.0, 1.0])[None],
        np.eye(4)[None] + np.eye(4)[:, [3, 0, 1, 2]][None],
        2.0 * np.eye(4)[None],
        translation(np.array([[np.inf, 0.0, 0.0]])),
    ],
)
def test_what_is_no_rigid_motion_is_refused(wrong: Array) -> None:
    with pytest.raises(InputError, match=r"^these: "):
        check_poses(wrong, "these")
