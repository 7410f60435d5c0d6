"""The calibrated URDF, loaded by Pinocchio, has the calibrated geometry, and says what it leaves out."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from exported import anywhere, calibrated

from calibtool.calibration import Calibration
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.export.as_urdf import calibration_as_urdf
from calibtool.robot.se3 import Array

ROBOTS = ["fanuc-m1000ia", "scara", "gantry", "panda", "ur10", "planar-3r"]


def geometric(name: str, twists: str) -> Calibration:
    """Random placement errors and offsets, and twist errors that only displace the axes, of any kind, or none."""
    calibration = calibrated(name, "local-poe", False)
    chain, rng = calibration.robot.chain, np.random.default_rng(5)
    n = calibration.robot.n
    errors = np.zeros((n, 6))
    if twists == "axes":
        for j, twist in enumerate(chain.twists):  # Ad(exp6(step)) turns and shifts an axis, and no more
            step = rng.normal(size=6) * 2e-3
            moved = pin.exp6(pin.Motion(step)).act(pin.Motion(twist)).vector
            if twist[3:].any():
                errors[j] = moved - twist
            else:
                errors[j, :3] = moved[:3] - twist[:3]
    elif twists == "any":
        errors = rng.normal(size=(n, 6)) * 1e-3
    placements, offsets = rng.normal(size=(n + 1, 6)) * 2e-3, rng.normal(size=n) * 2e-3
    drawn = RobotErrors.of(calibration.robot, placements=placements, twists=errors, offsets=offsets)
    return replace(calibration, base=replace(calibration.base, errors=drawn))


def tool_poses(text: str, calibration: Calibration, q: Array, folder: Path) -> Array:
    """T_base_tool of a URDF text, straight from Pinocchio: no code of calibtool in between."""
    path = folder / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    kinematics = calibration.robot.source.description.kinematics
    model = pin.buildModelFromUrdf(str(path))
    values = pin.neutral(model)
    data, poses = model.createData(), []
    base = model.getFrameId(kinematics.base_frame) if kinematics.base_frame else 0
    tool = model.getFrameId(text.split("(tool)   link ")[1].split()[0])
    for row in q:
        for name, value in zip(list(calibration.robot.chain.model.names)[1:], row, strict=True):
            joint = model.joints[model.getJointId(name)]
            values[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        pin.framesForwardKinematics(model, data, values)
        poses.append((data.oMf[base].inverse() * data.oMf[tool]).homogeneous)
    return np.array(poses)


@pytest.mark.parametrize("twists", ["none", "axes"])
@pytest.mark.parametrize("name", ROBOTS)
def test_the_urdf_has_the_calibrated_geometry(name: str, twists: str, tmp_path: Path) -> None:
    calibration = geometric(name, twists)
    text, missing = calibration_as_urdf(calibration)
    q = anywhere(calibration, 20)
    expected = calibration.base.errors.mechanism.forward(q)
    assert np.abs(tool_poses(text, calibration, q, tmp_path) - expected).max() < 1e-9
    assert missing == []
    assert "The whole calibration is held." in text


@pytest.mark.parametrize("name", ROBOTS)
def test_what_a_joint_cannot_do_is_right_at_home_and_listed(name: str, tmp_path: Path) -> None:
    calibration = geometric(name, "any")
    robot = calibration.robot
    text, missing = calibration_as_urdf(calibration)
    home = robot.home(robot.workspace(None)[1])[None]
    expected = calibration.base.errors.mechanism.forward(home)
    assert np.abs(tool_poses(text, calibration, home, tmp_path) - expected).max() < 1e-9
    left = tool_poses(text, calibration, calibration.q, tmp_path)
    difference = calibration.base.errors.mechanism.forward(calibration.q)[:, :3, 3] - left[:, :3, 3]
    largest = np.linalg.norm(difference, axis=-1).max()
    assert len(missing) == 1
    assert missing[0].startswith("twist errors")
    assert f"up to {largest * 1e3:.4f} mm" in missing[0]
    assert missing[0] in text


def test_every_part_is_listed_with_its_size(tmp_path: Path) -> None:
    calibration = calibrated("panda", "everything", True)
    text, missing = calibration_as_urdf(calibration)
    parts = ["twist errors", "harmonics of the joint motions", "wind-up under gravity", "network", "all together"]
    assert [line.split(" (")[0].split(":")[0] for line in missing] == parts
    largest = np.linalg.norm(
        calibration.forward(calibration.q)[:, :3, 3] - tool_poses(text, calibration, calibration.q, tmp_path)[:, :3, 3],
        axis=-1,
    ).max()
    assert f"{largest * 1e3:.4f} mm" in missing[-1]


@pytest.mark.parametrize("name", ROBOTS)
def test_names_limits_and_bodies_stay(name: str) -> None:
    calibration = geometric(name, "any")
    before = ET.fromstring(calibration.robot.source.urdf_text.encode())
    after = ET.fromstring(calibration_as_urdf(calibration)[0].encode())

    def kept(root: ET.Element) -> list[tuple[str | None, str | None, dict[str, str]]]:
        found = []
        for joint in root.findall("joint"):
            limit = joint.find("limit")
            found.append((joint.get("name"), joint.get("type"), {} if limit is None else dict(limit.attrib)))
        return found

    assert kept(after)[: len(kept(before))] == kept(before)
    assert len(kept(after)) <= len(kept(before)) + 1
    for tag in ("mesh", "mass", "axis"):
        assert [part.attrib for part in after.iter(tag)] == [part.attrib for part in before.iter(tag)]


def test_a_tool_that_is_the_last_moving_link_becomes_a_link_of_its_own(tmp_path: Path) -> None:
    calibration = geometric("planar-3r", "axes")
    robot = calibration.robot
    last = ET.fromstring(robot.source.urdf_text.encode()).find(f"joint[@name='{robot.chain.model.names[3]}']/child")
    assert last is not None
    toml = robot.source.toml_text.replace('tool_frame = "tool0"', f'tool_frame = "{last.get("link")}"')
    moved = type(robot).from_source(replace(robot.source, toml_text=toml, description=_described(toml)))
    errors = RobotErrors.of(moved, **calibration.base.errors.values)
    changed = replace(calibration, robot=moved, base=replace(calibration.base, errors=errors))
    text, missing = calibration_as_urdf(changed)
    q = anywhere(changed, 10)
    expected = changed.base.errors.mechanism.forward(q)
    assert np.abs(tool_poses(text, changed, q, tmp_path) - expected).max() < 1e-9
    assert missing == []
    assert f'<link name="{last.get("link")}_calibrated"' in text


def _described(toml: str):
    from calibtool.robot.description import parse_source

    return parse_source(toml, "", "robot.toml").description


def test_bodies_stay_in_place_when_an_axis_moves() -> None:
    """With displaced axes alone the arm looks the same at q = 0, and moves otherwise."""
    calibration = geometric("panda", "axes")
    axes = RobotErrors.of(calibration.robot, twists=calibration.base.errors["twists"])
    text, _ = calibration_as_urdf(replace(calibration, base=replace(calibration.base, errors=axes)))

    def centre_of_mass(urdf: str, q: float) -> Array:
        model = pin.buildModelFromXML(urdf)
        return pin.centerOfMass(model, model.createData(), np.full(model.nq, q))

    nominal = calibration.robot.source.urdf_text
    assert np.abs(centre_of_mass(text, 0.0) - centre_of_mass(nominal, 0.0)).max() < 1e-9
    assert np.abs(centre_of_mass(text, 0.5) - centre_of_mass(nominal, 0.5)).max() > 1e-6


def test_a_calibration_without_errors_is_the_robot_s_own_urdf(tmp_path: Path) -> None:
    """Nothing to correct at the tool: no link is added, and every pose is the nominal one."""
    calibration = geometric("ur10", "none")
    nothing = replace(calibration, base=replace(calibration.base, errors=RobotErrors.of(calibration.robot)))
    text, _ = calibration_as_urdf(nothing)
    assert text.count("<link") == calibration.robot.source.urdf_text.count("<link")
    q = np.random.default_rng(0).uniform(-1, 1, (5, 6))
    np.testing.assert_allclose(
        tool_poses(text, nothing, q, tmp_path), calibration.robot.mechanism.forward(q), atol=1e-12
    )
