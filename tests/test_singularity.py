"""The distance from singularity by its formula, and rows that do not depend on the others."""

import numpy as np
import pytest

from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.robot.catalogue import load_robot
from calibtool.robot.gravity_torque import gravity_torque
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, log3, log6
from calibtool.robot.singularity import (
    GRAM_REGULARISATION,
    inverse_trace,
    singularity_distance,
)


def drawn(robot: Robot, count: int, rng: np.random.Generator) -> Array:
    return robot.lower + (robot.upper - robot.lower) * rng.random((count, robot.n))


def drawn_errors(robot: Robot, rng: np.random.Generator) -> RobotErrors:
    """Errors that make screws of turning joints and let slides turn a little."""
    shapes = {"placements": (robot.n + 1, 6), "twists": (robot.n, 6), "offsets": robot.n}
    return RobotErrors.of(
        robot, **{name: rng.normal(size=shape) * 1e-3 for name, shape in shapes.items()}
    )


@pytest.mark.parametrize("size", [1, 3, 6])
def test_elimination_finds_the_trace_of_the_inverse(size: int, rng: np.random.Generator) -> None:
    A = rng.normal(size=(40, size, size))
    gram = A @ np.swapaxes(A, -1, -2) + np.eye(size)
    trace = inverse_trace(np.moveaxis(gram, 0, -1))
    np.testing.assert_allclose(trace, np.trace(np.linalg.inv(gram), axis1=1, axis2=2), rtol=1e-12)


@pytest.mark.parametrize("c", [6, 7])
def test_distances_are_the_formula_near_singularities_and_far(
    c: int, rng: np.random.Generator
) -> None:
    J = rng.normal(size=(300, 6, c))
    J[:, :, 0] *= np.geomspace(1e-9, 10.0, 300)[:, None]
    if c == 7:
        J[:, :, 1] *= np.geomspace(1e-9, 10.0, 300)[:, None]
    untouched = J.copy()
    distance = singularity_distance(J, 2.0)
    scaled = J / np.array([2, 2, 2, 1, 1, 1])[:, None]
    sigma = np.linalg.svd(scaled, compute_uv=False)
    regular = 1.0 / (sigma**2 + GRAM_REGULARISATION)
    np.testing.assert_allclose(distance, np.sum(regular, axis=-1) ** -0.5, rtol=1e-6, atol=2e-8)
    assert (distance < 0.02).sum() > 20
    assert (distance > 0.05).sum() > 20
    np.testing.assert_array_equal(J, untouched)


def test_a_row_does_not_depend_on_the_rows_beside_it(rng: np.random.Generator) -> None:
    robot = load_robot("ur5")
    found, q = drawn_errors(robot, rng).mechanism, drawn(robot, 2500, rng)
    error = rng.normal(size=(len(q), 6)) * 1e-3

    def everything(rows: slice) -> list[Array]:
        poses, jacobians = found.forward_and_jacobian(q[rows])
        return [
            poses,
            jacobians,
            gravity_torque(robot, q[rows]),
            singularity_distance(jacobians, robot.length),
            exp6(error[rows]),
            log6(poses),
            log3(poses[:, :3, :3]),
        ]

    whole = everything(slice(None))
    for k in (0, 1, 1023, 1024, 2499):
        for all_rows, alone in zip(whole, everything(slice(k, k + 1)), strict=True):
            np.testing.assert_array_equal(all_rows[k], alone[0])
