"""The built-in robots: they load, they are the machines of their data sheets, and a user's own
files work as well.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest
from poe import poe_frames, random_positions

from calibtool.errors import InputError, UsageError
from calibtool.robot.catalogue import load_robot, robot_names, shipped
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.source import parse_source


def joint_origins(robot: Robot, q: Array) -> Array:
    """Origins of the joint frames in K_0: (N, n, 3)."""
    return poe_frames(robot.chain.placements, robot.chain.twists, q).before[..., :3, 3]


def zero_pose_axes(robot: Robot) -> list[list[float]]:
    """Directions of the joints in K_0 at the zero pose."""
    before = poe_frames(robot.chain.placements, robot.chain.twists, np.zeros((1, robot.n))).before[
        0
    ]
    local = np.where(
        np.array(robot.prismatic)[:, None], robot.chain.twists[:, :3], robot.chain.twists[:, 3:]
    )
    return np.round((before[:, :3, :3] @ local[..., None])[..., 0], 12).tolist()


# --- every robot ---


def test_every_folder_of_robots_is_a_robot_of_that_name() -> None:
    assert robot_names() == sorted(
        path.name for path in shipped("robots").iterdir() if path.is_dir()
    )
    for name in robot_names():
        assert load_robot(name).name == name


def test_the_promised_robots_are_built_in() -> None:
    promised = {
        "fanuc-m1000ia",
        "fanuc-m900ib-700",
        "ur3",
        "ur5",
        "ur10",
        "panda",
        "xarm7",
        "kinova",
        "scara",
        "gantry",
    }
    assert promised | {"planar-3r"} <= set(robot_names())


def test_limits_are_ranges_and_homes_lie_inside_them(robot: Robot) -> None:
    assert (robot.lower < robot.upper).all()
    for name in robot.workspace_names:
        home = robot.workspace(name).home
        assert robot.within_limits(home[None])[0], name


def test_targets_determine_the_pose(robot: Robot) -> None:
    sides = robot.targets[1:3] - robot.targets[0]
    area = np.linalg.norm(np.cross(*sides)) / 2
    assert 1e-3 < area < 1.0  # m²: not in a line, and read as millimetres


def test_full_is_the_last_workspace_and_the_first_is_the_default(robot: Robot) -> None:
    names = robot.workspace_names
    assert names[-1] == "full"
    assert not robot.workspace("full").bounded
    assert robot.workspace().name == names[0] != "full"


def test_a_robot_is_built_again_from_the_texts_of_its_source(
    robot: Robot, rng: np.random.Generator
) -> None:
    again = Robot.from_source(
        parse_source(robot.source.toml_text, robot.source.urdf_text, "a file")
    )
    q = random_positions(robot, rng, 3)
    np.testing.assert_array_equal(again.mechanism.forward(q), robot.mechanism.forward(q))


# --- FANUC: published lengths, axes and reach ---


def test_the_m1000ia_reaches_as_far_as_published(fanuc: Robot, rng: np.random.Generator) -> None:
    # Stretched forward: J2 at 90°, J3 so that the wrist centre is in line with the upper arm.
    stretched = np.array([[0.0, np.pi / 2, np.pi / 2 - np.arctan2(0.3, 1.4), 0.0, 0.0, 0.0]])
    assert fanuc.within_limits(stretched)[0]
    wrist = joint_origins(fanuc, stretched)[0, 4]
    np.testing.assert_allclose(wrist, [0.6 + 1.221 + np.hypot(1.4, 0.3), 0.0, 0.0], atol=1e-9)
    assert wrist[0] == pytest.approx(3.2528, abs=5e-5)
    wrists = joint_origins(fanuc, random_positions(fanuc, rng, 500))[:, 4]
    assert np.hypot(wrists[:, 0], wrists[:, 1]).max() < wrist[0]


def test_the_m1000ia_has_the_axes_and_origins_of_its_table(fanuc: Robot) -> None:
    assert zero_pose_axes(fanuc) == [
        [0, 0, 1],
        [0, 1, 0],
        [0, -1, 0],
        [-1, 0, 0],
        [0, -1, 0],
        [-1, 0, 0],
    ]
    steps = [[0, 0, 0], [0.6, 0, 0], [0, 0, 1.221], [0, 0, 0.3], [1.4, 0, 0], [0.385, 0, 0]]
    np.testing.assert_allclose(
        joint_origins(fanuc, np.zeros((1, 6)))[0], np.cumsum(steps, axis=0), atol=1e-12
    )


def test_the_m900ib_has_the_origins_and_limits_of_its_table() -> None:
    robot = load_robot("fanuc-m900ib-700")
    steps = [[0, 0, 0.94], [0.41, 0, 0], [0, 0, 1.12], [0, 0, 0.25], [1.285, 0, 0], [0.3, 0, 0]]
    np.testing.assert_allclose(
        joint_origins(robot, np.zeros((1, 6)))[0], np.cumsum(steps, axis=0), atol=1e-12
    )
    assert zero_pose_axes(robot) == zero_pose_axes(load_robot("fanuc-m1000ia"))
    np.testing.assert_allclose(
        np.degrees(robot.lower), [-180, -64, -130, -360, -122, -360], atol=1e-6
    )
    np.testing.assert_allclose(np.degrees(robot.upper), [180, 90, 30, 360, 122, 360], atol=1e-6)


def test_the_m1000ia_differs_from_its_sister_in_the_upper_end_of_joint_3_only(fanuc: Robot) -> None:
    sister = load_robot("fanuc-m900ib-700")
    np.testing.assert_array_equal(fanuc.lower, sister.lower)
    assert np.flatnonzero(fanuc.upper != sister.upper).tolist() == [2]
    assert np.degrees(fanuc.upper[2]) == pytest.approx(78)


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "fanuc-m900ib-700"])
def test_the_last_three_axes_of_a_fanuc_meet_in_a_point_and_the_tool_looks_forward(
    name: str, rng: np.random.Generator
) -> None:
    robot = load_robot(name)
    q = random_positions(robot, rng, 1).repeat(20, axis=0)
    q[:, 3:] = random_positions(robot, rng, 20)[:, 3:]
    tool = robot.mechanism.forward(q)
    d6 = np.linalg.norm(robot.chain.placements[5, :3, 3])
    centre = tool[:, :3, 3] - d6 * tool[:, :3, 2]  # tool z points out of the flange
    np.testing.assert_allclose(centre, centre[:1].repeat(20, axis=0), atol=1e-12)


# --- Universal Robots: published Denavit-Hartenberg parameters of the CB series -------------------

# From the frame `base`: d1, a2, a3, d4, d5, d6 in m; twists α = π/2, 0, 0, π/2, −π/2, 0
UNIVERSAL = {
    "ur3": (0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
    "ur5": (0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    "ur10": (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
}


def denavit_hartenberg(
    q: Array, d1: float, a2: float, a3: float, d4: float, d5: float, d6: float
) -> Array:
    pose = np.eye(4)
    rows = [(d1, 0, 1), (0, a2, 0), (0, a3, 0), (d4, 0, 1), (d5, 0, -1), (d6, 0, 0)]
    for theta, (d, a, quarter_turns) in zip(q, rows, strict=True):
        c, s, ca, sa = np.cos(theta), np.sin(theta), 1 - abs(quarter_turns), quarter_turns
        pose = pose @ [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
    return pose


@pytest.mark.parametrize("name", UNIVERSAL)
def test_universal_robots_move_by_their_published_parameters(
    name: str, rng: np.random.Generator
) -> None:
    robot = load_robot(name)
    q = random_positions(robot, rng, 20)
    published = [denavit_hartenberg(row, *UNIVERSAL[name]) for row in q]
    # The URDF writes its right angles with eleven digits.
    np.testing.assert_allclose(robot.mechanism.forward(q), published, atol=5e-11)


# --- the project's own machines, in closed form ---


def test_the_planar_arm_moves_by_the_sums_of_its_angles(rng: np.random.Generator) -> None:
    robot = load_robot("planar-3r")
    q = random_positions(robot, rng, 10)
    angles = np.cumsum(q, axis=1)
    tool = robot.mechanism.forward(q)
    np.testing.assert_allclose(tool[:, 0, 3], np.cos(angles) @ [0.5, 0.4, 0.2], atol=1e-12)
    np.testing.assert_allclose(tool[:, 1, 3], np.sin(angles) @ [0.5, 0.4, 0.2], atol=1e-12)
    np.testing.assert_allclose(tool[:, 2, 3], 0.0, atol=1e-12)
    along = np.stack([np.cos(angles[:, 2]), np.sin(angles[:, 2]), np.zeros(10)], axis=1)
    np.testing.assert_allclose(
        tool[:, :3, 2], along, atol=1e-12
    )  # tool z points along the last link


def test_the_scara_lowers_a_tool_that_points_down(rng: np.random.Generator) -> None:
    robot = load_robot("scara")
    q = random_positions(robot, rng, 10)
    shoulder, elbow = q[:, 0], q[:, 0] + q[:, 1]
    tool = robot.mechanism.forward(q)
    np.testing.assert_allclose(
        tool[:, 0, 3], 0.35 * np.cos(shoulder) + 0.3 * np.cos(elbow), atol=1e-12
    )
    np.testing.assert_allclose(
        tool[:, 1, 3], 0.35 * np.sin(shoulder) + 0.3 * np.sin(elbow), atol=1e-12
    )
    np.testing.assert_allclose(tool[:, 2, 3], 0.3 - q[:, 2], atol=1e-12)
    turn = elbow - q[:, 3]
    np.testing.assert_allclose(
        tool[:, :3, 0], np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1), atol=1e-12
    )
    np.testing.assert_allclose(tool[:, :3, 2], np.tile([0, 0, -1], (10, 1)), atol=1e-12)


def test_the_gantry_carries_its_head_along_the_axes(rng: np.random.Generator) -> None:
    robot = load_robot("gantry")
    q = random_positions(robot, rng, 10)
    x, y, z, c, b = q.T
    pointer = -np.stack(
        [np.sin(b) * np.cos(c), np.sin(b) * np.sin(c), np.cos(b)], axis=1
    )  # from the head to the tool
    head = np.stack([x, y, 2.0 - 0.3 - 0.1 - z], axis=1)
    tool = robot.mechanism.forward(q)
    np.testing.assert_allclose(tool[:, :3, 3], head + 0.2 * pointer, atol=1e-12)
    np.testing.assert_allclose(tool[:, :3, 2], pointer, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "prismatic"),
    [("scara", [False, False, True, False]), ("gantry", [True, True, True, False, False])],
)
def test_slides_are_measured_in_metres_and_written_in_millimetres(
    name: str, prismatic: list[bool]
) -> None:
    robot = load_robot(name)
    assert robot.prismatic == prismatic
    assert robot.joint_units == ["m" if p else "rad" for p in prismatic]
    assert robot.joint_columns == [
        f"j{i + 1}_{'mm' if p else 'deg'}" for i, p in enumerate(prismatic)
    ]


@pytest.mark.parametrize(
    ("name", "length"),
    [
        ("planar-3r", (0.5 + 0.4 + 0.2) / 2),
        ("scara", (0.35 + 0.3 + 0.1 + 0.2) / 2),
        ("gantry", (0.3 + 0.1 + 0.2 + 3 + 2 + 1) / 2),
        ("fanuc-m1000ia", (0.6 + 1.221 + 0.3 + 1.4 + 0.385) / 2),
    ],
)
def test_the_characteristic_length_is_half_of_links_and_strokes(name: str, length: float) -> None:
    assert load_robot(name).length == pytest.approx(length, rel=1e-9)


# --- what is asked of a robot ---


def test_limits_belong_to_the_joint_range(robot: Robot) -> None:
    middle = (robot.lower + robot.upper) / 2
    q = np.array([robot.lower, robot.upper, middle])
    assert robot.within_limits(q).all()
    for j in range(robot.n):
        outside = np.array([robot.lower, robot.upper])
        outside[:, j] += [-1e-6, 1e-6]
        assert not robot.within_limits(outside).any()


def test_joint_positions_of_a_wrong_shape_or_not_finite_are_refused(fanuc: Robot) -> None:
    fanuc.check_positions(np.zeros((2, 6)), "here")
    with pytest.raises(InputError, match=r"^here: .*6 joints"):
        fanuc.check_positions(np.zeros((2, 7)), "here")
    with pytest.raises(InputError, match=r"^here: "):
        fanuc.check_positions(np.zeros(6), "here")
    bad = np.zeros((3, 6))
    bad[1, 4] = np.nan
    with pytest.raises(InputError, match=r"^here: row 2 "):
        fanuc.check_positions(bad, "here")


def test_an_unknown_workspace_is_refused_with_the_known_ones(fanuc: Robot) -> None:
    with pytest.raises(UsageError, match=r"no workspace 'machning'; did you mean machining"):
        fanuc.workspace("machning")


# --- names and paths ---


def test_a_name_in_other_letters_finds_the_one_that_is_meant() -> None:
    with pytest.raises(UsageError, match=r"unknown robot 'UR5'; did you mean ur5\?"):
        load_robot("UR5")


@pytest.mark.parametrize(
    ("name", "near"), [("fanuc-m1000", "fanuc-m1000ia"), ("ur-5", "ur5"), ("skara", "scara")]
)
def test_an_unknown_robot_is_refused_with_the_near_names(name: str, near: str) -> None:
    with pytest.raises(UsageError, match=rf"'{name}'; did you mean .*\b{near}\b"):
        load_robot(name)


def test_without_a_near_name_all_robots_are_named() -> None:
    with pytest.raises(UsageError) as caught:
        load_robot("%%%")
    for name in robot_names():
        assert name in str(caught.value)


@pytest.mark.parametrize("name", ["nowhere/", "nowhere/robot.toml", "nowhere.urdf", "robot.toml"])
def test_a_path_that_is_not_there_is_wrong_usage(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="no such file"):
        load_robot(name)


def test_a_users_own_folder_description_and_bare_urdf_are_the_same_robot(
    fanuc: Robot, rng: np.random.Generator, tmp_path: Path
) -> None:
    own = tmp_path / "own"
    shutil.copytree(shipped("robots") / "fanuc-m1000ia", own)
    q = random_positions(fanuc, rng, 3)
    expected = fanuc.mechanism.forward(q)
    for path in (own, own / "robot.toml", own / "robot.urdf"):
        robot = load_robot(str(path))
        np.testing.assert_array_equal(robot.mechanism.forward(q), expected)
        np.testing.assert_array_equal(robot.lower, fanuc.lower)
        np.testing.assert_array_equal(robot.upper, fanuc.upper)


def test_a_folder_in_the_current_directory_is_found_by_its_name(
    fanuc: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(shipped("robots") / "scara", tmp_path / "mine")
    monkeypatch.chdir(tmp_path)
    assert load_robot("mine").n == 4


def test_a_bare_urdf_has_targets_that_determine_the_pose_and_its_whole_range_as_workspace(
    tmp_path: Path,
) -> None:
    path = tmp_path / "cell 7.urdf"
    shutil.copy(shipped("robots") / "scara" / "robot.urdf", path)
    robot = load_robot(str(path))
    assert robot.workspace_names == ["full"]
    assert np.linalg.matrix_rank(robot.targets[1:] - robot.targets[0]) == 2
