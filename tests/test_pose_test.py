"""AP and RP against the definitions worked out with numpy, and the poses found in the
data themselves.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.calibration import Calibration
from calibtool.evaluation.compare import evaluate
from calibtool.evaluation.metrics import MethodErrors
from calibtool.evaluation.pose_test import pose_test, repeated_poses
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.registration import rigid_fit
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.constraints import Constraints
from calibtool.planning.iso9283_poses import plan_test
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import log3, readonly, transform_points

CYCLES = 12


@pytest.fixture(scope="module")
def cycles(fanuc: Robot, fanuc_measurements: Measurements) -> Measurements:
    """The cube in cycles on the robot of `fanuc_measurements`, P5 to P1."""
    cube = plan_test(fanuc, fanuc.workspace(), Constraints(), fanuc.targets)
    q = np.tile(cube.q[::-1], (CYCLES, 1))
    return simulate(fanuc, Simulation(seed=3, at=q, same_robot=fanuc_measurements.truth))


def definition(attained: np.ndarray, commanded: np.ndarray) -> tuple[float, float]:
    """AP and RP of attained positions (r, 3), as the standard writes them."""
    x, y, z = attained.T
    xb, yb, zb = x.mean(), y.mean(), z.mean()
    xc, yc, zc = commanded
    ap = np.sqrt((xb - xc) ** 2 + (yb - yc) ** 2 + (zb - zc) ** 2)
    length = np.sqrt((x - xb) ** 2 + (y - yb) ** 2 + (z - zb) ** 2)
    spread = np.sqrt(((length - length.mean()) ** 2).sum() / (len(length) - 1))
    return float(ap), float(length.mean() + 3 * spread)


@pytest.mark.parametrize("truth", [True, False])
def test_the_definitions(
    cycles: Measurements, fanuc: Robot, fanuc_local_poe: Calibration, truth: bool
) -> None:
    """Simulated and real files alike: from the measured points, never
    from a drive without noise.
    """
    measurements = cycles if truth else replace(cycles, truth=None)
    test = evaluate([("poe", fanuc_local_poe)], measurements).as_json()["iso9283"]
    assert isinstance(test, dict)
    assert test["poses"] == ["P1", "P2", "P3", "P4", "P5"]
    assert test["first_configurations"] == [5, 4, 3, 2, 1]
    assert test["repeats"] == [CYCLES] * 5
    for k in range(5):
        rows = np.arange(4 - k, 5 * CYCLES, 5)
        centre = fanuc.targets.mean(axis=0, keepdims=True)
        attained = cycles.points[rows].mean(axis=1)
        for method, forward in enumerate((fanuc.mechanism.forward, fanuc_local_poe.forward)):
            pose = forward(cycles.q[rows[:1]])[0]
            ap, rp = definition(attained, transform_points(pose, centre)[0])
            assert test["methods"][method]["ap_mm"][k] == pytest.approx(ap * 1e3, rel=1e-9)
            assert test["rp_mm"][k] == pytest.approx(rp * 1e3, rel=1e-9)
            expected = np.tile(transform_points(pose, fanuc.targets), (CYCLES, 1, 1))
            turns = log3(rigid_fit(expected, cycles.points[rows])[:, :3, :3])
            ap_turn, rp_turn = definition(turns, np.zeros(3))
            assert test["methods"][method]["ap_mrad"][k] == pytest.approx(ap_turn * 1e3, rel=1e-9)
            assert test["rp_mrad"][k] == pytest.approx(rp_turn * 1e3, rel=1e-2)


def test_noise_alone_repeats_as_chance_says(cycles: Measurements) -> None:
    """Three targets with 0.05 mm noise: mean distance σ √(8/π), standard deviation σ √(3 −
    8/π), σ = 0.05/√3 mm.
    """
    test = evaluate([], cycles).pose_test
    assert test is not None
    sigma = 0.05e-3 / np.sqrt(3) * np.sqrt(1 - 1 / CYCLES)
    expected = sigma * (np.sqrt(8 / np.pi) + 3 * np.sqrt(3 - 8 / np.pi))
    assert test.repeatability.mean() == pytest.approx(expected, rel=0.15)


def test_measurements_without_repeats_have_no_such_part(fanuc_measurements: Measurements) -> None:
    assert "iso9283" not in evaluate([], fanuc_measurements).as_json()


def test_groups_among_other_rows() -> None:
    rng = np.random.default_rng(0)
    q = rng.normal(size=(20, 3))
    q[[4, 9, 15]] = q[4]
    q[[2, 7]] = q[2]  # two are no group
    poses = repeated_poses(q, rng.normal(size=(20, 3)))
    assert [pose.name for pose in poses] == ["configuration 5"]
    assert poses[0].rows.tolist() == [4, 9, 15]


@pytest.mark.parametrize(
    ("first", "names"), [(0, "P1 P2 P3 P4 P5"), (4, "P1 P2 P3 P4 P5"), (2, None)]
)
def test_the_cube_is_recognised_by_its_centre(first: int, names: str | None) -> None:
    places = np.array([[1, 1, 1], [1, -1, 1], [-1, -1, -1], [-1, 1, -1]], dtype=float)
    places = np.insert(places, first, 0.0, axis=0)
    order = np.tile(np.arange(5), 3)
    poses = repeated_poses(places[order] + 2.0, places[order])
    assert " ".join(pose.name for pose in poses) == (
        names or " ".join(f"configuration {k}" for k in range(1, 6))
    )
    if first == 4:
        assert poses[0].rows.tolist() == [4, 9, 14]


def test_position_alone() -> None:
    errors = MethodErrors("nominal", np.random.default_rng(0).normal(size=(9, 1, 3)), None)
    test = pose_test([errors], repeated_poses(np.zeros((9, 2)), np.zeros((9, 3))))
    assert test.repeatability_turn is None
    assert test.as_json()["rp_mrad"] is None
    assert test.accuracy[0, 0] == pytest.approx(np.linalg.norm(errors.position[:, 0].mean(axis=0)))


def test_targets_that_were_not_seen_leave_their_rows_out(cycles: Measurements) -> None:
    points = cycles.points.copy()
    points[:5, 1] = np.nan
    lacking = replace(cycles, points=readonly(points), truth=None)
    test, rest = (
        evaluate([], m).pose_test
        for m in (lacking, replace(cycles, truth=None).rows(np.arange(5, len(cycles))))
    )
    assert test is not None
    assert rest is not None
    assert np.array_equal(test.repeatability, rest.repeatability)
