"""The five poses of ISO 9283: their places in the cube, reachable on one branch, in cycles."""

import csv
import io

import numpy as np
import pytest

from calibtool.errors import NoSolutionError
from calibtool.planning.constraints import Constraints
from calibtool.planning.iso9283_poses import POSES, five_poses, plan_test
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

FREE = Constraints()


def test_places_on_the_inclined_plane() -> None:
    centre = np.eye(4)
    centre[:3, 3] = [1.0, 2.0, 3.0]
    points = five_poses(centre, 0.5)[:, :3, 3]
    assert np.allclose(points[0], [1, 2, 3])
    diagonal = 0.5 * np.sqrt(3)
    # A tenth of the diagonal from its ends is 0.4 of it from the centre.
    assert np.allclose(np.linalg.norm(points[1:] - points[0], axis=-1), 0.4 * diagonal)
    assert np.allclose(points[1] + points[3], 2 * points[0])
    assert np.allclose(points[2] + points[4], 2 * points[0])
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    normal /= np.linalg.norm(normal)
    assert np.allclose((points - points[0]) @ normal, 0)
    assert np.allclose(np.sort(np.abs(normal)), [0, np.sqrt(0.5), np.sqrt(0.5)])  # 45° to two faces


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "ur5", "panda", "scara", "gantry", "kinova"])
def test_the_largest_cube_can_be_driven(name: str) -> None:
    robot = load_robot(name)
    space = robot.workspace()
    assert space.bounded
    cube = plan_test(robot, space, FREE, robot.targets)
    assert 0.05 < cube.edge <= space.box.min() + 1e-12
    assert np.allclose(robot.mechanism.forward(cube.q), cube.pose, atol=1e-6)
    assert robot.within_limits(cube.q).all()
    home = robot.mechanism.forward(space.home[None])[0]
    assert np.allclose(cube.pose[:, :3, :3], home[:3, :3])
    assert np.allclose(cube.pose[0], home)


def test_poses_are_on_the_branch_of_the_home(fanuc: Robot) -> None:
    """A straight way from the centre to every pose never comes near a singularity."""
    cube = plan_test(fanuc, fanuc.workspace(), FREE, fanuc.targets, edge=0.8)
    assert cube.edge == 0.8
    for q in cube.q[1:]:
        way = cube.q[0] + np.linspace(0, 1, 50)[:, None] * (q - cube.q[0])
        assert fanuc.singularity_distance(way).min() > 0.02


def test_cycles_run_from_the_fifth_pose_to_the_first(fanuc: Robot) -> None:
    cube = plan_test(fanuc, fanuc.workspace(), FREE, fanuc.targets, edge=0.5)
    rows = list(csv.DictReader(io.StringIO(cube.table(3))))
    assert [row["pose"] for row in rows] == [*reversed(POSES)] * 3
    assert [row["cycle"] for row in rows] == ["1"] * 5 + ["2"] * 5 + ["3"] * 5
    q = np.deg2rad([[float(row[c]) for c in fanuc.joint_columns] for row in rows])
    assert np.allclose(q[:5][::-1], cube.q, atol=1e-12)
    assert np.array_equal(q[:5], q[10:])


def test_the_joint_range_holds_the_largest_cube_of_the_reach(fanuc: Robot) -> None:
    cube = plan_test(fanuc, "full", FREE, fanuc.targets)
    assert cube.edge > 1.0
    with pytest.raises(NoSolutionError):
        plan_test(fanuc, "full", FREE, fanuc.targets, edge=1.05 * cube.edge)


def test_constraints_make_it_smaller(fanuc: Robot) -> None:
    space = fanuc.workspace()
    free = plan_test(fanuc, space, FREE, fanuc.targets)
    corner = free.pose[3, :3, 3]
    shelf = Constraints(keep_out=((*(corner - 0.1), *(corner + 0.1)),))
    bound = plan_test(fanuc, space, shelf, fanuc.targets)
    assert 0 < bound.edge < free.edge
    with pytest.raises(
        NoSolutionError, match="P4 of a 1000 mm cube fails --keep-out; give a smaller --cube-mm"
    ):
        plan_test(fanuc, space, shelf, fanuc.targets, edge=free.edge)


def test_an_arm_that_cannot_take_them_is_refused() -> None:
    robot = load_robot("planar-3r")
    with pytest.raises(NoSolutionError, match=r"planar-3r: P2 .* fails the reach"):
        plan_test(robot, robot.workspace(), FREE, robot.targets)
