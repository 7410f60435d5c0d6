"""Built-in arms of numbers: each against the reach or the table that its maker publishes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_catalogue import denavit_hartenberg

from calibtool.evaluation.robot_check import check_robot
from calibtool.robot.catalogue import load_robot, robot_names
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

# Published reach in mm, and the point whose distance from axis 1 it is: the origin of a joint
# (from 1), or 0 for the flange.
REACH = {
    "abb-irb120": (580, 5),
    "abb-irb1200": (901, 5),
    "abb-irb2600": (1653, 5),
    "abb-irb4600": (2552, 5),
    "abb-irb6700": (2601, 5),
    "denso-vs060": (605, 5),
    "doosan-m1013": (1300, 0),
    "fanuc-lrmate200id": (717, 5),
    "fanuc-m20ia": (1811, 5),
    "fanuc-r2000ic-165f": (2655, 5),
    "franka-fr3": (855, 0),
    "kinova-gen3": (902, 0),
    "kuka-iiwa14": (820, 7),
    "kuka-kr210-r2700": (2701, 5),
    "kuka-kr6-r900": (901.5, 5),
    "nachi-mz07": (723, 5),
    "staubli-tx2-60l": (920, 0),
    "yaskawa-gp25": (1730, 5),
}
TOLERANCE = 3.0  # mm: makers round, and some measure to the middle of the flange's face
# d1, a2, a3, d4, d5, d6 in m as Universal Robots publishes them
UNIVERSAL = {
    "ur3e": (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    "ur5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "ur16e": (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
    "ur20": (0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543),
    "ur30": (0.2363, -0.637, -0.5037, 0.201, 0.1593, 0.1543),
}
ARMS = sorted([*REACH, *UNIVERSAL, "techman-tm12"])


def distance(robot: Robot, q: Array, of: int) -> Array:
    """From axis 1, which is vertical in all of them, mm."""
    frames = robot.mechanism.frames(q)
    points = frames.tool if of == 0 else frames.after[:, of - 1]
    return 1e3 * np.hypot(points[:, 0, 3], points[:, 1, 3])


def farthest(robot: Robot, of: int) -> float:
    """The largest distance within the joint limits: random search, ever nearer to the best."""
    rng = np.random.default_rng(0)
    best = robot.lower + (robot.upper - robot.lower) * rng.random((3000, robot.n))
    for size in 0.5 * 0.8 ** np.arange(45):
        best = best[np.argsort(-distance(robot, best, of))[:15]]
        near = best[:, None] + size * rng.normal(size=(15, 20, robot.n))
        near = np.clip(near, robot.lower, robot.upper).reshape(-1, robot.n)
        best = np.concatenate([best, near])
    return float(distance(robot, best, of).max())


def test_these_are_the_arms_of_numbers() -> None:
    of_numbers = []
    for name in robot_names():
        kinematics = load_robot(name).source.description.kinematics
        if kinematics.chain is not None or kinematics.dh is not None:
            of_numbers.append(name)
    assert of_numbers == ARMS


@pytest.mark.parametrize("name", REACH)
def test_the_arm_reaches_as_far_as_published(name: str) -> None:
    published, of = REACH[name]
    assert farthest(load_robot(name), of) == pytest.approx(published, abs=TOLERANCE)


def test_the_tm12_reaches_as_far_as_published() -> None:
    """1300 mm in the plane of its links, beside which its wrist stands by 156.3 mm."""
    found = farthest(load_robot("techman-tm12"), 5)
    assert np.hypot(1300.0, 156.3) == pytest.approx(found, abs=TOLERANCE)


# Joint values (deg) and flange poses (mm; deg about z, y, x) that a pendant of an MZ07F shows,
# as nachi-mz07f.md of the public RobotKinematics states them. It is the MZ07 on a base 10 mm
# higher, with a flange 5 mm farther out.
PENDANT = [
    [21.4862, 64.4801, -41.7744, -180.007, 22.7216, -158.513],
    [18.6965, 68.6763, -39.6996, -158.418, 38.2621, -180.401],
    [4.98917, 73.5581, -44.4732, -189.95, 35.3251, -153.57],
    [-17.8857, 69.2501, -38.4703, -14.4347, -45.5303, -25.5808],
    [-25.4971, 70.7751, -42.0408, 44.0796, -38.9396, -79.9948],
]
SHOWN = [
    [339.525, 133.617, 278.473, 0.000535733, 0.0236197, 179.986],
    [339.486, 133.658, 311.388, 1.99842, 10.7741, -169.478],
    [339.5, 21.8373, 319.019, -13.2406, 3.7502, 172.732],
    [339.474, -124.15, 319.966, 19.152, 17.1551, 179.99],
    [339.49, -124.109, 319.939, 14.2266, -16.2692, -159.49],
]


def test_the_mz07_is_where_a_pendant_says() -> None:
    shown = np.array(SHOWN)
    poses = load_robot("nachi-mz07").mechanism.forward(np.deg2rad(PENDANT))
    flange = poses[:, :3, 3] + np.array([0, 0, 0.01]) + 0.005 * poses[:, :3, 2]
    np.testing.assert_allclose(1e3 * flange, shown[:, :3], atol=0.1)
    turns = Rotation.from_euler("ZYX", shown[:, 3:], degrees=True).as_matrix()
    np.testing.assert_allclose(poses[:, :3, :3], turns, atol=np.deg2rad(0.02))


@pytest.mark.parametrize("name", UNIVERSAL)
def test_the_arms_of_universal_robots_have_their_published_tables(name: str) -> None:
    q = np.random.default_rng(1).uniform(-3, 3, (20, 6))
    expected = [denavit_hartenberg(row, *UNIVERSAL[name]) for row in q]
    np.testing.assert_allclose(load_robot(name).mechanism.forward(q), expected, atol=1e-12)


@pytest.mark.parametrize("name", ARMS)
def test_its_description_can_be_worked_with(name: str) -> None:
    robot = load_robot(name)
    found = check_robot(robot, name)
    assert all("masses" in warning for warning in found.warnings)
    assert all(each.singularity_distance > 0.1 for each in found.workspaces)
    assert all(design.rank == design.possible for _, design in found.designs)
    assert robot.coupled == name.startswith("fanuc")
    assert robot.source.description.notes[0].startswith("Kinematics")
    home = robot.mechanism.forward(robot.workspace().home[None])[0]
    assert home[2, 2] < -0.3  # its tool looks down
