"""The robot.yaml of example-parallel-robots: its loops, the joints that it replaces, refusals."""

from pathlib import Path

import numpy as np
import pytest

from calibtool.errors import InputError
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

LIMITS = '<limit lower="-1.5" upper="1.5" effort="1" velocity="1"/>'


def joint(name: str, parent: str, child: str, x: float = 0, z: float = 0, rpy: str = "") -> str:
    """A hinge about y, or a fixed joint with the angles of its frame; and its child."""
    kind = "fixed" if rpy else "revolute"
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{x} 0 {z}" rpy="{rpy or "0 0 0"}"/>'
        f'<axis xyz="0 1 0"/>{LIMITS}</joint>'
    )


END = joint("fix_b", "rocker", "end_b", 0, 0.2, "0.4 0.5 0.6")
URDF = (
    '<robot name="loop"><link name="base"/>'
    + joint("mot", "base", "crank")
    + joint("knee", "crank", "tcp", 0, 0.2)
    + joint("free", "base", "rocker", 0.3)
    + joint("fix_a", "tcp", "end_a", 0.3, 0, "0.4 0.5 0.6")
    + END
    + "</robot>"
)
YAML = "closed_loop: [['fix_a', 'end_b']]\ntype: ['3d']\nname_mot: ['mot']\n"
Q = np.linspace(-1, 1, 9)[:, None]


def written(folder: Path, text: str = YAML, urdf: str = URDF) -> Robot:
    (folder / "robot.yaml").write_text(text)
    (folder / "robot.urdf").write_text(urdf)
    return load_robot(str(folder))


@pytest.mark.parametrize("extra", [False, True])
def test_a_parallelogram_only_shifts_its_coupler(extra: bool, tmp_path: Path) -> None:
    """Cut at a ball joint, or welded behind a joint that turns about y: its frames are turned."""
    if not extra:
        robot = written(tmp_path)
    else:
        pin = joint("turn", "rocker", "pin", 0, 0.2)
        turning = URDF.replace(END, pin + joint("fix_b", "pin", "end_b", 0, 0, "0.4 0.5 0.6"))
        robot = written(tmp_path, YAML.replace("3d", "6d"), turning)
    poses = robot.mechanism.forward(Q)
    np.testing.assert_allclose(poses[:, :3, :3], np.tile(np.eye(3), (9, 1, 1)), atol=1e-11)
    np.testing.assert_allclose(poses[:, 0, 3], 0.2 * np.sin(Q[:, 0]), atol=1e-12)


def test_rounded_numbers_of_an_overconstrained_loop_close_all_the_same(tmp_path: Path) -> None:
    """Links 0.2 µm beside each other's plane: all six equations of a weld cannot hold, and need
    not.
    """
    end = joint("fix_b", "pin", "end_b", 0, 0, "0.4 0.5 0.6").replace("0 0 0", "0 2e-7 0", 1)
    urdf = URDF.replace(END, joint("turn", "rocker", "pin", 0, 0.2) + end)
    assert urdf.count("2e-7") == 1
    robot = written(tmp_path, YAML.replace("3d", "6d"), urdf)
    assert robot.chain.mobility == robot.n == 1
    poses = robot.mechanism.forward(Q)
    np.testing.assert_allclose(poses[:, :3, :3], np.tile(np.eye(3), (9, 1, 1)), atol=1e-5)
    np.testing.assert_allclose(poses[:, 0, 3], 0.2 * np.sin(Q[:, 0]), atol=1e-6)


def test_the_file_alone_and_its_folder_are_the_same(tmp_path: Path) -> None:
    folder = written(tmp_path)
    alone = load_robot(str(tmp_path / "robot.yaml"))
    np.testing.assert_array_equal(folder.mechanism.forward(Q), alone.mechanism.forward(Q))


def test_joints_are_replaced_by_revolute_ones_and_closed_somewhere(tmp_path: Path) -> None:
    """A ball and a universal joint on the rocker's side instead of hinges: the same mechanism,
    also where its legs do not meet at 0.
    """
    text = YAML.replace("3d", "6d") + (
        "joint_name: ['free', 'turn']\njoint_type: ['UJOINT_XY', 'SPHERICAL']\n"
    )
    pin = joint("turn", "rocker", "pin", 0, 0.25)
    urdf = URDF.replace(END, pin + joint("fix_b", "pin", "end_b", 0, 0, "0.1 -0.2 0.3"))
    robot = written(tmp_path, text, urdf)
    assert robot.source.description.kinematics.closed_at
    q = Q[np.isfinite(robot.mechanism.forward(Q)[:, 0, 0])]
    assert len(q) > 4
    poses = robot.mechanism.forward(q)
    knee = np.stack([0.2 * np.sin(q[:, 0]), 0 * q[:, 0], 0.2 * np.cos(q[:, 0])], axis=1)
    np.testing.assert_allclose(poses[:, :3, 3], knee, atol=1e-12)
    end = poses[:, :3, 3] + 0.3 * poses[:, :3, 0]
    np.testing.assert_allclose(np.linalg.norm(end - [0.3, 0, 0], axis=1), 0.25, atol=1e-11)


@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        ("'fix_a'", "'fix_c'", "closed_loop: 'fix_c' is no frame of robot.urdf"),
        ("'3d'", "'4d'", "type '4d'; expected 3d or 6d"),
        ("['3d']", "['3d', '6d']", "type has 2 entries; expected 1"),
        ("name_mot: ['mot']", "", "name_mot: Field required"),
        ("['mot']", "['motor']", "name_mot: 'motor' is no joint of robot.urdf; did you mean mot"),
        ("['mot']", "['mot', 'elbow']", "name_mot: 'elbow' is no joint of robot.urdf"),
        ("'end_b'", "'end_a'", "loop 'loop1': 'end_a' and 'end_a' are on the same link"),
        ("'fix_a'", "'rocker'", "loop 'loop1': 'rocker' and 'end_b' are on the same link"),
        ("['mot']", "[['mot']]", r"name_mot\.0"),
        ("['mot']", "['mot'", "not valid YAML"),
        ("\n", "\njoint_name: ['free']\njoint_type: ['BALL']\n", "joint_type 'BALL'; expected"),
        ("\n", "\njoint_name: ['fre']\njoint_type: ['FIXED']\n", "'fre' is no joint"),
        ("\n", "\njoint_name: ['free']\n", "joint_type has 0 entries; expected 1"),
        ("'3d'", "'6d'", "over-constrained|does not close"),
    ],
)
def test_what_does_not_fit_the_urdf_is_refused(
    old: str, new: str, finding: str, tmp_path: Path
) -> None:
    assert old in YAML
    with pytest.raises(InputError, match=finding) as caught:
        written(tmp_path, YAML.replace(old, new, 1))
    assert "\n" not in str(caught.value)


def test_without_its_urdf_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(YAML)
    with pytest.raises(InputError, match=r"robot\.urdf: No such file"):
        load_robot(str(tmp_path))
