"""Descriptions by numbers: tables of DH parameters, the YAML of a UR arm, a chain in robot.toml."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array

# a, alpha, d, theta of an arm with an offset wrist: m and deg
ROWS = [
    (0.0, 90, 0.13, 10),
    (-0.6, 0, 0.02, 0),
    (-0.55, 5, 0, 0),
    (0, 90, 0.16, 0),
    (0, -90, 0.115, 0),
    (0.01, 0, 0.09, -20),
]
Q = np.random.default_rng(5).uniform(-3, 3, (10, 6))
TARGETS = "[targets]\npoints_mm = [[100, 0, 0], [0, 100, 0], [0, 0, 100]]\n"


def moved(axis: str, angle: float = 0.0, *, along: float = 0.0) -> Array:
    """A turn about an axis and a shift along it."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    pose["xyz".index(axis), 3] = along
    return pose


def forward(rows: list[tuple[float, ...]], q: Array, modified: bool) -> Array:
    """Products of the four motions of the textbooks, one after the other."""
    pose = np.eye(4)
    for (a, alpha, d, theta), angle in zip(rows, q, strict=True):
        across = moved("x", np.deg2rad(alpha)) @ moved("x", along=a)
        own = moved("z", np.deg2rad(theta) + angle) @ moved("z", along=d)
        pose = pose @ (across @ own if modified else own @ across)
    return pose


@pytest.fixture
def read(tmp_path: Path) -> Callable[[str, str], Robot]:
    def reading(text: str, name: str) -> Robot:
        (tmp_path / name).write_text(text)
        return load_robot(str(tmp_path / name))

    return reading


def csv(convention: str, separator: str = ",") -> str:
    header = ["joint", "a_mm", "alpha_deg", "d_mm", "theta_deg", "convention"]
    rows = [
        [str(k), f"{a * 1e3:g}", f"{alpha:g}", f"{d * 1e3:g}", f"{theta:g}", convention]
        for k, (a, alpha, d, theta) in enumerate(ROWS, start=1)
    ]
    return "\n".join(separator.join(row) for row in [header, *rows]) + "\n"


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("form", ["csv", "semicolons", "toml"])
def test_a_table_of_dh_parameters_is_a_robot(
    convention: str, form: str, read: Callable[[str, str], Robot]
) -> None:
    if form == "toml":
        rows = ",\n".join(
            f"{{ a_m = {a}, alpha_deg = {alpha}, d_m = {d}, theta_deg = {theta} }}"
            for a, alpha, d, theta in ROWS
        )
        text = f'name = "mine"\ntitle = "Mine"\n[kinematics]\ndh_convention = "{convention}"\n'
        robot = read(f"{text}dh = [\n{rows},\n]\n{TARGETS}", "robot.toml")
        assert robot.source.description.assumed is None
    else:
        robot = read(csv(convention, ";" if form == "semicolons" else ","), "table.csv")
        assert "a bare table of DH parameters" in str(robot.source.description.assumed)
    expected = [forward(ROWS, q, convention == "modified") for q in Q]
    np.testing.assert_allclose(robot.mechanism.forward(Q), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        (",convention", "", "DH parameters do not say their convention; add a column"),
        ("standard", "paul", "convention 'paul'; expected standard or modified"),
        ("\n3,", "\n4,", "table.csv:4: joint '4'; expected 3"),
        ("-550", "1_0", "table.csv:4: column 'a_mm' holds '1_0'; expected a number"),
        ("-550", "nan", "column 'a_mm' holds 'nan'"),
        ("-550,", "", "table.csv:4: 5 cells, but the header has 6"),
        ("theta_deg", "a_mm", "a text file of another kind; a robot is a robot.toml, a URDF"),
    ],
)
def test_a_table_that_is_none_is_refused(
    old: str, new: str, word: str, read: Callable[[str, str], Robot]
) -> None:
    text = csv("standard")
    if old == ",convention":
        text = text.replace(",standard", "")
    with pytest.raises(InputError) as caught:
        read(text.replace(old, new), "table.csv")
    assert word in str(caught.value)


def test_the_yaml_of_a_ur_arm_is_that_arm(read: Callable[[str, str], Robot]) -> None:
    frames = [
        ("shoulder", 0, 0, 0.1274, 0, 0, 1e-05),
        ("upper_arm", -5e-05, 0, 0, 1.5712, 0, -3e-05),
        ("forearm", -0.6125, 0, 0, 0.0018, 0, 4e-05),
        ("wrist_1", -0.5719, 0.0002, 0.164, 0.0012, 0, -0.0001),
        ("wrist_2", 5e-05, -0.1157, 2e-05, 1.5709, 0, -3e-05),
        ("wrist_3", 1e-05, 0.0922, 3e-05, 1.5708, 3.1416, 3.1416),
    ]
    keys = ("x", "y", "z", "roll", "pitch", "yaw")
    text = "kinematics:\n" + "".join(
        f"  {name}:\n" + "".join(f"    {key}: {v}\n" for key, v in zip(keys, values, strict=True))
        for name, *values in frames
    )
    robot = read(text, "my_calibration.yaml")
    for q, pose in zip(Q, robot.mechanism.forward(Q), strict=True):
        expected = np.eye(4)
        for (_, x, y, z, *angles), angle in zip(frames, q, strict=True):
            step = np.eye(4)
            step[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
            step[:3, 3] = x, y, z
            expected = expected @ step @ moved("z", angle)
        np.testing.assert_allclose(pose, expected, atol=1e-12)
    with pytest.raises(InputError, match="kinematics has no frame wrist_3"):
        read(text.replace("wrist_3", "wrist_4"), "my_calibration.yaml")


CHAIN = f"""\
name = "mine"
title = "Mine"
[kinematics]
chain = [
  {{ xyz_mm = [0, 0, 300], axis = [0, 0, 1] }},
  {{ xyz_mm = [100, 0, 0], rpy_deg = [0, 90, 0], axis = [0, 1, 0] }},
  {{ xyz_mm = [0, 0, 10], type = "fixed" }},
  {{ xyz_mm = [0, 0, 40], axis = [1, 0, 0], type = "prismatic" }},
  {{ xyz_mm = [0, 0, 50], rpy_deg = [10, 0, 30], type = "fixed" }},
]
[limits]
j1_deg = [-100, 100]
j3_mm = [0, 200]
{TARGETS}"""


def test_a_chain_of_numbers_is_a_robot(read: Callable[[str, str], Robot]) -> None:
    robot = read(CHAIN, "robot.toml")
    assert (robot.n, robot.prismatic) == (3, [False, False, True])
    np.testing.assert_allclose(robot.upper, [np.deg2rad(100), np.pi, 0.2])
    q = np.array([0.3, -0.7, 0.12])
    tool = moved("z", along=0.05)
    tool[:3, :3] = Rotation.from_euler("xyz", [10, 0, 30], degrees=True).as_matrix()
    expected = moved("z", q[0], along=0.3)
    for step in (
        *(moved("x", along=0.1), moved("y", np.pi / 2), moved("y", q[1])),
        *(moved("z", along=0.05), moved("x", along=q[2]), tool),
    ):
        expected = expected @ step
    np.testing.assert_allclose(robot.mechanism.forward(q[None])[0], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("xyz_mm = [100, 0, 0]", "xyz_cm = [10, 0, 0]", "unknown key 'kinematics.chain.1.xyz_cm'"),
        ("axis = [0, 0, 1]", "axis = [0, 0, 0]", "has no axis"),
        ('type = "prismatic"', 'type = "planar"', "kinematics.chain.3.type"),
        ("chain = [", 'urdf = "robot.urdf"\nchain = [', "give exactly one of"),
        ("j3_mm = [0, 200]", "", "slide 'joint_3' has no limits"),
        ("j3_mm = [0, 200]", "j4_mm = [0, 200]", "'j4_mm' names joint 4"),
        ("[kinematics]", '[kinematics]\ndh_convention = "standard"', "belong together"),
    ],
)
def test_numbers_that_are_no_chain_are_refused(
    old: str, new: str, word: str, read: Callable[[str, str], Robot]
) -> None:
    assert old in CHAIN
    with pytest.raises(InputError) as caught:
        read(CHAIN.replace(old, new, 1), "robot.toml")
    assert word in str(caught.value)
    assert "robot.toml" in str(caught.value)
