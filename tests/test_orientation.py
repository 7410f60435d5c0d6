"""Orientations as numbers: against scipy's rotations, there and back, nearest answers."""

from itertools import permutations, product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.robot.orientation import (
    numbers_in,
    orientation_numbers,
    rotation_matrices,
    wrong_length,
)
from calibtool.robot.se3 import Array

RNG = np.random.default_rng(0)
ANGLES = RNG.uniform(-4.0, 4.0, (50, 3))
AXES = ["".join(p) for p in product("xyz", repeat=3) if p[0] != p[1] != p[2]]


@pytest.mark.parametrize("axes", AXES)
def test_euler_angles_are_those_of_scipy(axes: str) -> None:
    turning = Rotation.from_euler(axes.upper(), ANGLES).as_matrix()
    fixed = Rotation.from_euler(axes, ANGLES).as_matrix()
    assert np.abs(rotation_matrices(ANGLES, f"intrinsic-{axes}") - turning).max() < 1e-14
    for name in ("extrinsic", "fixed"):
        assert np.abs(rotation_matrices(ANGLES, f"{name}-{axes}") - fixed).max() < 1e-14


def test_quaternions_and_rotation_vectors_are_those_of_scipy() -> None:
    q = RNG.normal(size=(50, 4))
    expected = Rotation.from_quat(q, scalar_first=True).as_matrix()
    assert np.abs(rotation_matrices(q, "quaternion-wxyz") - expected).max() < 1e-14
    last = q[:, [1, 2, 3, 0]]
    assert np.abs(rotation_matrices(last, "quaternion-xyzw") - expected).max() < 1e-14
    expected = Rotation.from_rotvec(ANGLES).as_matrix()
    assert np.abs(rotation_matrices(ANGLES, "rotation-vector") - expected).max() < 1e-14


def test_every_convention_says_how_many_numbers_it_has_and_others_none() -> None:
    known = [f"{kind}-{axes}" for kind in ("intrinsic", "extrinsic", "fixed") for axes in AXES]
    assert {numbers_in(name) for name in [*known, "rotation-vector"]} == {3}
    assert {numbers_in(f"quaternion-{order}") for order in ("wxyz", "xyzw")} == {4}
    wrong = ["", "xyz", "intrinsic-xxy", "intrinsic-xyy", "intrinsic-xy", "quaternion", "XYZ"]
    others = [f"quaternion-{''.join(p)}" for p in permutations("wxyz")]
    others = [name for name in others if name not in ("quaternion-wxyz", "quaternion-xyzw")]
    assert not any(numbers_in(name) for name in [*wrong, *others])


@pytest.mark.parametrize(
    "convention", ["rotation-vector", "extrinsic-xyz", "intrinsic-zyx", "quaternion-wxyz"]
)
def test_numbers_of_a_matrix_nearest_to_given_ones(convention: str) -> None:
    near: Array = ANGLES
    if convention.startswith("quaternion"):
        near = RNG.normal(size=(50, 4))
        near = near / np.linalg.norm(near, axis=1, keepdims=True)
    R = rotation_matrices(near, convention)
    assert np.abs(orientation_numbers(R, convention, near + 1e-4) - near).max() < 1e-9
    far = rotation_matrices(orientation_numbers(R, convention, np.ones_like(near)), convention)
    assert np.abs(far - R).max() < 1e-12


def test_the_first_quaternion_of_a_wrong_length_is_named() -> None:
    q = np.eye(4)
    assert wrong_length(q) is None
    q[2] *= 1.01
    q[3, 0] = np.nan
    found = wrong_length(q)
    assert found is not None
    assert found[0] == 2
    assert abs(found[1] - 1.01) < 1e-12
