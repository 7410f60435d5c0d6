"""The calibrated URDF, loaded by Pinocchio, has the calibrated geometry, and says
what it leaves out.
"""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import ROBOTS
from exported import anywhere, calibrated
from scipy.optimize import least_squares

from calibtool.calibration import Calibration
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.export.as_urdf import calibration_as_urdf
from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, log3
from calibtool.robot.source import parse_source


def geometric(name: str, twists: str) -> Calibration:
    """Random placement errors and offsets, and twist errors that only displace the axes, of
    any kind, or none.
    """
    calibration = calibrated(name, "local-poe", False)
    chain, rng = calibration.robot.chain, np.random.default_rng(5)
    n = calibration.robot.n
    errors = np.zeros((n, 6))
    if twists == "axes":
        for j, twist in enumerate(
            chain.twists
        ):  # Ad(exp6(step)) turns and shifts an axis, and no more
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
    tool = model.getFrameId(text.split("(tool)   link ")[1].split()[0], pin.FrameType.BODY)
    names = [*list(calibration.robot.chain.model.names)[1:], *kinematics.locked_joints]
    for row in q:
        for name, value in zip(names, [*row, *kinematics.locked_joints.values()], strict=True):
            joint = model.joints[model.getJointId(name)]
            values[joint.idx_q : joint.idx_q + joint.nq] = (
                [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
            )
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


def fresh(calibration: Calibration, count: int = 300) -> Array:
    """Configurations of the default workspace that no fit has seen."""
    robot = calibration.robot
    return sample_configurations(robot, robot.workspace(), count, np.random.default_rng(77))


def distances(a: Array, b: Array) -> Array:
    """Of the tool points, m, and of the orientations, rad: (2, N)."""
    turn = log3(a[:, :3, :3] @ np.swapaxes(b[:, :3, :3], 1, 2))
    return np.linalg.norm([a[:, :3, 3] - b[:, :3, 3], turn], axis=-1)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_urdf_is_nearer_to_the_calibrated_robot_than_the_drawing(
    name: str, tmp_path: Path
) -> None:
    calibration = geometric(name, "any")
    q = fresh(calibration)
    wanted = calibration.forward(q)
    urdf = distances(
        tool_poses(calibration_as_urdf(calibration)[0], calibration, q, tmp_path), wanted
    )
    drawing = distances(calibration.robot.mechanism.forward(q), wanted)
    assert (urdf.mean(axis=1) < 0.8 * drawing.mean(axis=1)).all()


def best_of_any_urdf(calibration: Calibration, q: Array) -> float:
    """Mean weighted pose error after scipy has moved every origin as it likes, for the poses
    at q themselves.
    """
    robot, wanted = calibration.robot, calibration.forward(q)

    def errors(x: Array) -> Array:
        poses = RobotErrors.of(robot, placements=x.reshape(-1, 6)).forward(q)
        turn = log3(poses[:, :3, :3] @ np.swapaxes(wanted[:, :3, :3], 1, 2))
        return np.concatenate([(poses[:, :3, 3] - wanted[:, :3, 3]) / robot.length, turn], axis=1)

    found = least_squares(
        lambda x: errors(x).ravel(), np.zeros(6 * (robot.n + 1)), xtol=1e-8, ftol=1e-8
    )
    return float(np.linalg.norm(errors(found.x), axis=1).mean())


@pytest.mark.parametrize("name", ["planar-3r", "gantry", "ur5"])
def test_hardly_any_urdf_is_nearer_to_the_calibrated_robot(name: str, tmp_path: Path) -> None:
    """On configurations that the export has not seen, but the other one was made for."""
    calibration = geometric(name, "any")
    q = fresh(calibration, 100)
    poses = tool_poses(calibration_as_urdf(calibration)[0], calibration, q, tmp_path)
    position, orientation = distances(poses, calibration.forward(q))
    found = np.hypot(position / calibration.robot.length, orientation).mean()
    assert found < 1.1 * best_of_any_urdf(calibration, q)


@pytest.mark.parametrize("seed", range(3))
def test_origins_stay_where_they_would_only_be_fitted_to_noise(seed: int, tmp_path: Path) -> None:
    """Ripple of a joint so fine that no origin takes anything of it up: the drawing is as
    near as any URDF.
    """
    calibration = geometric("ur5", "none")
    n = calibration.robot.n
    ripple = np.zeros((n, 800))
    ripple[:, 600:] = np.random.default_rng(seed).normal(size=(n, 200)) * 1e-4
    base = replace(calibration.base, errors=RobotErrors.of(calibration.robot, harmonics=ripple))
    calibration = replace(calibration, base=base)
    text, missing = calibration_as_urdf(calibration)
    q = fresh(calibration)
    poses = tool_poses(text, calibration, q, tmp_path)
    assert np.abs(poses - calibration.robot.mechanism.forward(q)).max() < 1e-12
    assert missing[0].startswith("harmonics of the joint motions: up to ")


@pytest.mark.parametrize("name", ["planar-3r", "panda"])
def test_what_a_urdf_cannot_hold_is_listed(name: str, tmp_path: Path) -> None:
    calibration = geometric(name, "any")
    text, missing = calibration_as_urdf(calibration)
    left = tool_poses(text, calibration, calibration.q, tmp_path)
    mean, most = (
        f(distances(left, calibration.forward(calibration.q)) * 1e3, axis=1)
        for f in (np.mean, np.max)
    )
    assert missing[-1] == (
        f"all together: {mean[0]:.4f} mm, {mean[1]:.4f} mrad in the mean, up to {most[0]:.4f} mm, "
        f"{most[1]:.4f} mrad"
    )
    assert [line.split(":")[0] for line in missing[:-1]] == ["twist errors"]
    assert all(line in text for line in missing)


def test_every_part_is_listed_with_its_size(tmp_path: Path) -> None:
    calibration = calibrated("panda", "everything", True)
    text, missing = calibration_as_urdf(calibration)
    parts = [
        "twist errors",
        "harmonics of the joint motions",
        "wind-up under gravity",
        "functions of pairs of joints",
        "network",
        "all together",
    ]
    assert [line.split(" (")[0].split(":")[0] for line in missing] == parts
    left = tool_poses(text, calibration, calibration.q, tmp_path)
    largest = distances(left, calibration.forward(calibration.q)).max(axis=1)
    assert missing[-1].endswith(f"up to {largest[0] * 1e3:.4f} mm, {largest[1] * 1e3:.4f} mrad")


@pytest.mark.parametrize("name", ROBOTS)
def test_names_limits_and_bodies_stay(name: str) -> None:
    calibration = geometric(name, "any")
    before = ET.fromstring(calibration.robot.source.urdf_text.encode())
    after = ET.fromstring(calibration_as_urdf(calibration)[0].encode())

    def kept(root: ET.Element) -> list[tuple[str | None, str | None, dict[str, str]]]:
        found = []
        for joint in root.findall("joint"):
            limit = joint.find("limit")
            found.append(
                (joint.get("name"), joint.get("type"), {} if limit is None else dict(limit.attrib))
            )
        return found

    assert kept(after)[: len(kept(before))] == kept(before)
    assert len(kept(after)) <= len(kept(before)) + 1
    for tag in ("mesh", "mass", "axis"):
        assert [part.attrib for part in after.iter(tag)] == [
            part.attrib for part in before.iter(tag)
        ]


def robot_of(text: str, calibration: Calibration, **kinematics: str) -> Robot:
    """What calibtool makes of an exported file, described as the calibration's robot is."""
    source = calibration.robot.source
    known = source.description.kinematics.model_copy(update=kinematics)
    description = source.description.model_copy(update={"kinematics": known})
    return Robot.from_source(replace(source, urdf_text=text, description=description))


def with_errors(calibration: Calibration, robot: Robot, seed: int) -> Calibration:
    """A calibration of another robot of the same joints, with random
    placement errors and offsets.
    """
    rng, n = np.random.default_rng(seed), robot.n
    errors = RobotErrors.of(
        robot, placements=rng.normal(size=(n + 1, 6)) * 1e-3, offsets=rng.normal(size=n) * 1e-3
    )
    return replace(calibration, robot=robot, base=replace(calibration.base, errors=errors))


@pytest.mark.parametrize("name", ROBOTS)
def test_an_exported_file_is_calibrated_and_exported_again(name: str, tmp_path: Path) -> None:
    first = geometric(name, "none")
    for seed in range(2):
        text, missing = calibration_as_urdf(first)
        tool = text.split("(tool)   link ")[1].split()[0]
        robot = robot_of(text, first, tool_frame=tool)
        q = anywhere(first, 10)
        assert np.abs(robot.mechanism.forward(q) - first.forward(q)).max() < 1e-9
        assert missing == []
        assert np.abs(tool_poses(text, first, q, tmp_path) - first.forward(q)).max() < 1e-9
        first = with_errors(first, robot, seed)
    assert text.count("Calibrated geometry") == 1


def tool_on_the_last_moving_link() -> tuple[Calibration, str]:
    """planar-3r with a tool frame that has no fixed joint of its own, and its name."""
    calibration = geometric("planar-3r", "axes")
    source = calibration.robot.source
    last = ET.fromstring(source.urdf_text.encode()).find(
        f"joint[@name='{calibration.robot.chain.model.names[3]}']/child"
    )
    assert last is not None
    tool = last.get("link", "")
    toml = source.toml_text.replace('tool_frame = "tool0"', f'tool_frame = "{tool}"')
    described = parse_source(toml, "", "robot.toml").description
    moved = Robot.from_source(replace(source, toml_text=toml, description=described))
    errors = RobotErrors.of(moved, **calibration.base.errors.values)
    return replace(calibration, robot=moved, base=replace(calibration.base, errors=errors)), tool


def test_a_tool_that_is_the_last_moving_link_becomes_a_link_of_its_own(tmp_path: Path) -> None:
    calibration, tool = tool_on_the_last_moving_link()
    text, missing = calibration_as_urdf(calibration)
    q = anywhere(calibration, 10)
    expected = calibration.base.errors.forward(q)
    assert np.abs(tool_poses(text, calibration, q, tmp_path) - expected).max() < 1e-9
    assert missing == []
    assert f'<link name="{tool}_calibrated"' in text


def test_a_second_link_for_the_same_tool_gets_another_name(tmp_path: Path) -> None:
    """Who keeps the description keeps its tool frame: the first export's own link is in
    the file already.
    """
    calibration, tool = tool_on_the_last_moving_link()
    robot = robot_of(calibration_as_urdf(calibration)[0], calibration)
    again = with_errors(calibration, robot, 1)
    text, _ = calibration_as_urdf(again)
    assert (
        text.count(f'<link name="{tool}_calibrated"')
        == text.count(f'<link name="{tool}_calibrated_2"')
        == 1
    )
    q = anywhere(again, 10)
    assert np.abs(tool_poses(text, again, q, tmp_path) - again.forward(q)).max() < 1e-9


def test_a_calibration_without_errors_is_the_robot_s_own_urdf(tmp_path: Path) -> None:
    """Nothing to correct at the tool: no link is added, and every pose is the nominal one."""
    calibration = geometric("ur10", "none")
    nothing = replace(
        calibration, base=replace(calibration.base, errors=RobotErrors.of(calibration.robot))
    )
    text, _ = calibration_as_urdf(nothing)
    assert text.count("<link") == calibration.robot.source.urdf_text.count("<link")
    q = np.random.default_rng(0).uniform(-1, 1, (5, 6))
    np.testing.assert_allclose(
        tool_poses(text, nothing, q, tmp_path), calibration.robot.mechanism.forward(q), atol=1e-12
    )
