"""Drawn configurations: inside the limits, the box and the cone, away from singularities, the same
for the same seed.
"""

import numpy as np
import pytest
from arms import ROBOTS
from scipy.spatial.transform import Rotation

from calibtool.errors import NoSolutionError
from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.singularity import MIN_SINGULARITY_DISTANCE
from calibtool.robot.workspace import Workspace

UR5_HOME = np.deg2rad([0.0, -80.0, 100.0, -110.0, -90.0, 0.0])


def cell(robot: Robot, home: Array, box: float, cone_deg: float) -> Workspace:
    cone = float(np.deg2rad(cone_deg))
    return Workspace("cell", home, box=np.full(3, box), cone=cone, roll=cone)


def drawn(robot: Robot, workspace: str | None, count: int = 60, seed: int = 0) -> Array:
    return sample_configurations(
        robot, robot.workspace(workspace), count, np.random.default_rng(seed)
    )


def distance_by_singular_values(robot: Robot, q: Array) -> Array:
    """(Σ 1/σ²)^(−1/2) of the actuated Jacobian at the tool point, from differences
    of the tool pose.
    """
    jacobian = np.empty((len(q), 6, robot.n))
    step = 1e-6
    for j in range(robot.n):
        e = step * np.eye(robot.n)[j]
        ahead, behind = robot.mechanism.forward(q + e), robot.mechanism.forward(q - e)
        jacobian[:, :3, j] = (ahead[:, :3, 3] - behind[:, :3, 3]) / (2 * step) / robot.length
        turn = Rotation.from_matrix(ahead[:, :3, :3] @ np.swapaxes(behind[:, :3, :3], -1, -2))
        jacobian[:, 3:, j] = turn.as_rotvec() / (2 * step)
    sigma = np.linalg.svd(jacobian, compute_uv=False)
    return (1.0 / sigma**2).sum(axis=-1) ** -0.5


@pytest.mark.parametrize("workspace", [None, "full"])
def test_configurations_are_inside_the_joint_limits(robot: Robot, workspace: str | None) -> None:
    q = drawn(robot, workspace)
    assert q.shape == (60, robot.n)
    assert (q >= robot.lower - 1e-9).all()
    assert (q <= robot.upper + 1e-9).all()


@pytest.mark.parametrize("workspace", [None, "full"])
def test_configurations_keep_their_distance_from_singularities(
    robot: Robot, workspace: str | None
) -> None:
    assert distance_by_singular_values(
        robot, drawn(robot, workspace)
    ).min() >= MIN_SINGULARITY_DISTANCE * (1 - 1e-6)


def test_tool_positions_are_inside_the_box_and_fill_it(robot: Robot) -> None:
    workspace = robot.workspace()
    assert workspace.bounded
    centre = robot.mechanism.forward(workspace.home[None])[0, :3, 3]
    offset = robot.mechanism.forward(drawn(robot, None))[:, :3, 3] - centre
    half = workspace.box / 2
    assert (np.abs(offset) <= half + 1e-7).all()
    reachable = half > 0
    if robot.name == "planar-3r":
        reachable[2] = False
    spread = offset.max(axis=0) - offset.min(axis=0)
    assert (spread[reachable] > half[reachable]).all()  # more than a half of every edge


@pytest.mark.parametrize(
    "name",
    [name for name in ROBOTS if load_robot(name).n >= 6 and load_robot(name).workspace().bounded],
)
def test_tools_are_inside_the_cone_and_turned_within_the_roll(name: str) -> None:
    # With n < 6 the nearest reachable orientation is taken, which the cone does not bound.
    robot = load_robot(name)
    workspace = robot.workspace()
    assert workspace.bounded
    home = robot.mechanism.forward(workspace.home[None])[0, :3, :3]
    relative = home.T @ robot.mechanism.forward(drawn(robot, None))[:, :3, :3]
    tilt = np.rad2deg(np.arccos(np.clip(relative[:, 2, 2], -1, 1)))
    cone, roll = np.rad2deg([workspace.cone, workspace.roll])
    assert tilt.max() <= cone + 1e-5
    assert tilt.max() > 0.8 * cone
    _, _, z, w = Rotation.from_matrix(relative).as_quat().T
    turn = np.rad2deg(2 * np.arctan(z / w))  # the twist about the tool's own axis
    assert np.abs(turn).max() <= roll + 1e-5
    assert np.abs(turn).max() > 0.8 * roll


def test_tilts_are_uniform_over_the_cap_of_the_cone(fanuc: Robot) -> None:
    # Uniform over a cap: 1 − cos(tilt) is uniform, so half of the tilts are below the
    # median of the cap.
    workspace = cell(fanuc, fanuc.workspace().home, box=0.2, cone_deg=20)
    q = sample_configurations(fanuc, workspace, 400, np.random.default_rng(0))
    home = fanuc.mechanism.forward(workspace.home[None])[0, :3, :3]
    height = 1.0 - (home.T @ fanuc.mechanism.forward(q)[:, :3, :3])[:, 2, 2]
    below = (height < 0.5 * (1.0 - np.cos(np.deg2rad(20)))).mean()
    assert abs(below - 0.5) < 4 * 0.5 / np.sqrt(400)


def test_the_same_seed_draws_the_same_configurations_and_another_seed_others() -> None:
    for name in ("ur5", "scara"):
        robot = load_robot(name)
        for workspace in (None, "full"):
            assert np.array_equal(drawn(robot, workspace, 10, 7), drawn(robot, workspace, 10, 7))
            assert not np.isin(drawn(robot, workspace, 10, 7), drawn(robot, workspace, 10, 8)).any()


def test_a_workspace_out_of_reach_has_no_configurations() -> None:
    ur5 = load_robot("ur5")
    far = cell(ur5, UR5_HOME, box=50.0, cone_deg=30)
    with pytest.raises(
        NoSolutionError, match=r"ur5: only .* poses of the workspace can be reached"
    ):
        sample_configurations(ur5, far, 10, np.random.default_rng(0))


def test_a_workspace_at_a_singularity_has_no_configurations() -> None:
    ur5 = load_robot("ur5")
    wrist = cell(ur5, UR5_HOME * [1, 1, 1, 1, 0, 1], box=0.0, cone_deg=0)
    with pytest.raises(NoSolutionError, match="ur5: only 0 of"):
        sample_configurations(ur5, wrist, 10, np.random.default_rng(0))
