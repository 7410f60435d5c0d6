"""Geometries for others: they read back as the robot that they were made from."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import ROBOTS
from exported import anywhere, calibrated
from test_export_urdf import distances, geometric, tool_poses

from calibtool.calibration import Calibration
from calibtool.controller import read_controller_model
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import InputError
from calibtool.export.as_dh import calibration_as_dh
from calibtool.export.as_offsets import calibration_as_offsets
from calibtool.export.as_ur_yaml import calibration_as_ur_yaml
from calibtool.export.as_urdf import calibration_as_urdf
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.z_axes import placements_between_z

UR = ["ur3", "ur5", "ur10"]


def having(calibration: Calibration, **values: Array) -> Calibration:
    """The calibration with these errors alone."""
    errors = RobotErrors.of(calibration.robot, **values)
    return replace(calibration, base=replace(calibration.base, errors=errors), networks=())


def read(text: str, folder: Path, name: str) -> Robot:
    (folder / name).write_text(text)
    return load_robot(str(folder / name))


@pytest.mark.parametrize("twists", ["none", "axes"])
@pytest.mark.parametrize("name", ROBOTS)
def test_a_table_of_dh_parameters_reads_back_as_the_calibrated_robot(
    name: str, twists: str, tmp_path: Path
) -> None:
    calibration = geometric(name, twists)
    q = anywhere(calibration, 20)
    expected = calibration.base.errors.mechanism.forward(q)
    for convention in ("standard", "modified"):
        text, missing = calibration_as_dh(calibration, convention)
        robot = read(text, tmp_path, "table.csv")
        assert missing == []
        np.testing.assert_allclose(robot.mechanism.forward(q), expected, atol=1e-9)
        np.testing.assert_allclose(robot.lower, calibration.robot.lower, atol=1e-12)
        assert robot.length < 2 * calibration.robot.length  # no common normal far away
        np.testing.assert_allclose(robot.upper, calibration.robot.upper, atol=1e-12)


@pytest.mark.parametrize("name", ["ur5", "scara", "panda"])
def test_the_drawing_itself_is_a_table_too(name: str, tmp_path: Path) -> None:
    """Parallel axes and axes that meet: no common normal of its own."""
    calibration = having(calibrated(name, "local-poe", False))
    q = anywhere(calibration, 20)
    text, _ = calibration_as_dh(calibration, "standard")
    poses = read(text, tmp_path, "table.csv").mechanism.forward(q)
    np.testing.assert_allclose(poses, calibration.robot.mechanism.forward(q), atol=1e-12)
    numbers = [float(cell) for cell in re.findall(r"-?\d+\.\d+(?:e-?\d+)?", text)]
    assert max(abs(number) for number in numbers) < 2000  # no common normal far away


def test_a_table_of_dh_parameters_is_a_controller_s_model() -> None:
    calibration = geometric("ur5", "none")
    small = having(calibration, placements=calibration.base.errors["placements"] * 0.1)
    text, _ = calibration_as_dh(small, "modified")
    model = read_controller_model(text, "table.csv", small.robot)
    q = anywhere(small, 20)
    np.testing.assert_allclose(model.mechanism.forward(q), small.forward(q), atol=1e-9)


def test_frames_on_the_axes_are_the_same_chain() -> None:
    for name in ("gantry", "so100", "kinova"):
        robot = load_robot(name)
        placements = placements_between_z(robot.chain.placements, robot.chain.twists)
        q = np.random.default_rng(1).uniform(robot.lower, robot.upper)
        pose = placements[0]
        for value, slides, placement in zip(q, robot.prismatic, placements[1:], strict=True):
            motion = np.eye(4)
            if slides:
                motion[2, 3] = value
            else:
                motion[:2, :2] = [[np.cos(value), -np.sin(value)], [np.sin(value), np.cos(value)]]
            pose = pose @ motion @ placement
        np.testing.assert_allclose(robot.mechanism.forward(q[None])[0], pose, atol=1e-12)


@pytest.mark.parametrize("name", UR)
def test_the_yaml_of_a_ur_arm_has_the_poses_of_a_factory_calibrated_one(
    name: str, tmp_path: Path
) -> None:
    """Errors in its six frames and joint offsets, none of the tool."""
    calibration = geometric(name, "none")
    placements = calibration.base.errors["placements"].copy()
    placements[-1] = 0.0
    offsets = calibration.base.errors["offsets"]
    factory = having(calibration, placements=placements, offsets=offsets)
    text, missing = calibration_as_ur_yaml(factory)
    q = anywhere(factory, 50)
    robot = read(text, tmp_path, "my_calibration.yaml")
    assert missing == []
    np.testing.assert_allclose(robot.mechanism.forward(q), factory.forward(q), atol=1e-9)


def test_what_the_yaml_does_not_hold_is_its_distance_from_the_calibration(tmp_path: Path) -> None:
    calibration = geometric("ur5", "none")  # with an error of the tool frame
    text, missing = calibration_as_ur_yaml(calibration)
    poses = read(text, tmp_path, "my_calibration.yaml").mechanism.forward(calibration.q)
    found = distances(poses, calibration.forward(calibration.q)) * 1e3
    mean, most = found.mean(axis=1), found.max(axis=1)
    assert missing[-1] == (
        f"all together: {mean[0]:.4f} mm, {mean[1]:.4f} mrad in the mean, "
        f"up to {most[0]:.4f} mm, {most[1]:.4f} mrad"
    )
    assert all(f"# not held: {line}\n" in text for line in missing)
    nominal = distances(
        calibration.robot.mechanism.forward(calibration.q), calibration.forward(calibration.q)
    )
    assert mean[0] < 1e3 * nominal[0].mean()


def test_the_yaml_is_for_six_joints_and_a_tool_on_the_flange() -> None:
    with pytest.raises(InputError, match="for an arm with six revolute joints"):
        calibration_as_ur_yaml(calibrated("panda", "nominal", True))
    with pytest.raises(InputError, match="ends at the flange, and the tool frame 'j2s6s200"):
        calibration_as_ur_yaml(geometric("kinova", "none"))


@pytest.mark.parametrize("values", ["serial", "controller"])
@pytest.mark.parametrize("name", ["fanuc-m1000ia", "gantry", "panda"])
def test_offsets_are_found_again_and_read_back(name: str, values: str) -> None:
    calibration = calibrated(name, "local-poe", False)
    offsets = np.random.default_rng(2).normal(size=calibration.robot.n) * 1e-3
    only = having(calibration, offsets=offsets)
    text, missing = calibration_as_offsets(only, values)
    assert missing == []
    rows = [line.split(",") for line in text.splitlines() if line[0].isdigit()]
    factor = np.where(only.robot.prismatic, 1e-3, np.pi / 180)
    shown = np.array([float(row[1]) for row in rows]) * factor
    serial = only.robot.to_serial(shown) if values == "controller" else shown
    np.testing.assert_allclose(serial, offsets, atol=1e-9)
    assert all(float(row[1]) == -float(row[2]) for row in rows)
    q = anywhere(only, 20)
    model = read_controller_model(text, "offsets.csv", only.robot)
    np.testing.assert_allclose(model.mechanism.forward(q), only.forward(q), atol=1e-9)


def test_offsets_take_up_what_they_can_and_say_the_rest() -> None:
    calibration = geometric("ur5", "none")
    text, missing = calibration_as_offsets(calibration, "serial")
    lost = float(re.search(r"all together: ([\d.]+) mm", missing[-1])[1])
    nominal = calibration.robot.mechanism.forward(calibration.q)
    before = 1e3 * distances(nominal, calibration.forward(calibration.q))[0].mean()
    assert 0 < lost < before
    assert all(f"# not held: {line}\n" in text for line in missing)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("\n2,", "\n3,", "joints 1, 3, 3"),
        (",deg,", ",mm,", "in mm, "),
        (",serial", ",motor", "values 'motor'; expected serial or controller"),
        ("\n1,", "\n1,x", "column 'offset' holds 'x"),
    ],
)
def test_offsets_of_another_robot_are_refused(old: str, new: str, word: str) -> None:
    calibration = having(calibrated("planar-3r", "local-poe", False), offsets=np.full(3, 1e-3))
    text, _ = calibration_as_offsets(calibration, "serial")
    assert old in text
    with pytest.raises(InputError) as caught:
        read_controller_model(text.replace(old, new), "offsets.csv", calibration.robot)
    assert word in str(caught.value)


def test_the_urdf_for_ros_2_has_no_comment_and_the_same_poses(tmp_path: Path) -> None:
    calibration = geometric("ur5", "any")
    plain, missing = calibration_as_urdf(calibration)
    text, again = calibration_as_urdf(calibration, comments=False)
    assert again == missing
    assert "<!--" not in text
    assert missing[0] in text
    q = anywhere(calibration, 5)
    expected = tool_poses(plain, calibration, q, tmp_path)
    tool = re.search(r'<calibtool tool="([^"]+)"', text)[1]
    same = text.replace("<calibtool ", f"<!-- (tool)   link {tool}\n --><calibtool ")
    np.testing.assert_array_equal(tool_poses(same, calibration, q, tmp_path), expected)
