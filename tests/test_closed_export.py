"""Exports of calibrations with closed loops: read, compiled and run without calibtool."""

import ctypes
import json
import re
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from closed_json_reader import calibrated_pose, corrected, nominal_pose
from structured_text import FunctionBlock

from calibtool.calibration import Calibration, identify, train
from calibtool.compensation.exact import exact
from calibtool.compensation.weighted_error import Task
from calibtool.equivalent.training import TrainingOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import InputError, NoSolutionError
from calibtool.export.as_dh import calibration_as_dh
from calibtool.export.as_json import calibration_as_json
from calibtool.export.as_kuka_machine import calibration_as_kuka_machine
from calibtool.export.as_offsets import calibration_as_offsets
from calibtool.export.as_ur_yaml import calibration_as_ur_yaml
from calibtool.export.as_urdf import calibration_as_urdf
from calibtool.export.c_code import calibration_as_c
from calibtool.export.closed_loop_network import Taught
from calibtool.export.structured_text import calibration_as_structured_text
from calibtool.export.taught_region import TaughtRegion
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, pose_difference
from calibtool.robot.singularity import MIN_SINGULARITY_DISTANCE
from calibtool.robot.source import parse_source

NAMES = ["delta", "prs3"]


@pytest.fixture(autouse=True)
def _taught_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The network of one calibration is the same in every test."""
    monkeypatch.setattr(Taught, "of", _taught)


_taught = cache(Taught.of)


@cache
def calibration_of(name: str) -> Calibration:
    robot = load_robot(name)
    workspace = robot.workspace()
    return identify(simulate(robot, Simulation(seed=2, configurations=40, workspace=workspace)))


def rows(calibration: Calibration, count: int = 12) -> Array:
    robot = calibration.robot
    q = sample_configurations(robot, robot.workspace(), 3 * count, np.random.default_rng(9))
    middle = (robot.lower + robot.upper) / 2
    return (middle + 0.8 * (q - middle))[:count]


def left(calibration: Calibration, q: Array, driven: Array) -> Array:
    """Distances (m) of the calibrated tool points at driven joints from the nominal ones."""
    nominal = calibration.robot.mechanism.forward(q)
    return np.linalg.norm((calibration.forward(driven) - nominal)[:, :3, 3], axis=-1)


# --- C and Structured Text ---


def test_the_c_code_corrects_as_near_as_its_header_says(tmp_path: Path) -> None:
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("gcc is not installed, so the generated C code cannot be compiled")
    calibration = calibration_of("delta")
    taught = Taught.of(calibration)
    header, source = calibration_as_c(calibration, "delta", header_name="my-delta.h")
    (tmp_path / "my-delta.h").write_text(header)
    (tmp_path / "delta.c").write_text(source)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O2", "-shared", "-fPIC"]
    library = tmp_path / "delta.so"
    subprocess.run([gcc, *flags, str(tmp_path / "delta.c"), "-o", str(library), "-lm"], check=True)
    correct = ctypes.CDLL(str(library)).delta_correct
    correct.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
    q = rows(calibration)
    driven, states = q.copy(), []
    for row in driven:
        states.append(correct(row.ctypes.data, row.ctypes.data))
    assert set(states) == {0}
    after = left(calibration, q, driven)
    assert f"after this one {taught.after[0]:.3g} mm, {taught.after[1]:.3g} mrad" in header
    assert after.max() <= 1.5e-3 * taught.after[0]
    assert after.max() < 0.05 * left(calibration, q, q).max()
    for wrong, state in ((np.full(3, np.nan), 2), (calibration.robot.upper + 0.1, 1)):
        answer = np.zeros(3)
        assert correct(wrong.ctypes.data, answer.ctypes.data) == state
        np.testing.assert_array_equal(answer, wrong)


@pytest.mark.parametrize("name", NAMES)
def test_structured_text_computes_the_network(name: str) -> None:
    calibration = calibration_of(name)
    block = FunctionBlock(calibration_as_structured_text(calibration, "robot"))
    network, q = Taught.of(calibration).network, rows(calibration)
    for row, change in zip(q, network(q), strict=True):
        answer, status = block(row)
        assert status == 0
        np.testing.assert_allclose(answer, row + change, rtol=0, atol=1e-12)
    answer, status = block(calibration.robot.upper + 1.0)
    assert status == 1
    np.testing.assert_array_equal(answer, calibration.robot.upper + 1.0)


@pytest.mark.parametrize("name", NAMES)
def test_what_a_taught_network_leaves_is_small_beside_what_it_corrects(name: str) -> None:
    taught = Taught.of(calibration_of(name))
    for before, after, exactly in zip(taught.before, taught.after, taught.exact, strict=True):
        assert after <= 0.1 * max(before, 1e-6)
        assert exactly <= after + 1e-9


def test_near_singularities_and_where_loops_do_not_close_joints_stay_as_commanded() -> None:
    """Anywhere in the range of the training: rows that are corrected close and come nearer to where
    they should be, and the code decides as `TaughtRegion` does."""
    robot = load_robot("fivebar")
    measured = simulate(
        robot,
        Simulation(
            seed=0,
            configurations=40,
            workspace=robot.workspace(),
            scales=ErrorScales(ERROR_KINDS),
        ),
    )
    calibration = train(measured, "nominal", TrainingOptions(seed=0))
    taught = Taught.of(calibration)
    region, task = taught.region, Task.of(calibration.equivalent)
    q = np.random.default_rng(5).uniform(region.lower, region.upper, (3000, robot.n))
    held, closes = region.holds(q), robot.mechanism.closes(q)
    near = robot.singularity_distance(q) < 0.5 * MIN_SINGULARITY_DISTANCE
    assert not (held & near).any()
    assert held[closes].mean() > 0.9
    rows = q[held]
    commanded, sizes = robot.mechanism.forward(rows), []
    for driven in (rows, rows + taught.network(rows)):
        error = pose_difference(calibration.forward(driven), commanded, robot.length)
        sizes.append(np.linalg.norm(task.of_error(error, commanded), axis=-1))
    assert (sizes[1] < sizes[0]).all()
    block = FunctionBlock(calibration_as_structured_text(calibration, "robot"))
    for row, inside in zip(q[:60], held[:60], strict=True):
        answer, status = block(row)
        assert status == (0 if inside else 1)
        assert inside or np.array_equal(answer, row)


@pytest.mark.parametrize("radius", [0.5, 0.9])
def test_a_smaller_region_leaves_out_what_it_has_to(radius: float) -> None:
    rng = np.random.default_rng(0)
    q = rng.normal(size=(500, 2))
    region = TaughtRegion(q.min(axis=0), q.max(axis=0), np.zeros(2), np.eye(2) / 4.0)
    outside = q[np.linalg.norm(q, axis=-1) > 4.0 * radius]
    smaller = region.without(outside)
    assert not smaller.holds(outside).any()
    assert smaller.holds(q[np.linalg.norm(q, axis=-1) < 3.8 * radius]).all()
    with pytest.raises(NoSolutionError, match="smaller"):
        TaughtRegion(region.lower, region.upper).without(q[:1])


def test_a_network_that_cannot_learn_the_corrections_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The calibration is another object than that of `_taught_once`, so it is taught again."""
    import calibtool.export.closed_loop_network as module

    monkeypatch.setattr(module, "HIDDEN", 1)
    with pytest.raises(NoSolutionError, match=r"delta: a network of 1 nodes leaves .* use json"):
        calibration_as_c(replace(calibration_of("delta")), "delta")


# --- JSON ---


@pytest.mark.parametrize("name", NAMES)
def test_a_stranger_reads_the_json_file_and_corrects_as_calibtool_does(name: str) -> None:
    calibration = calibration_of(name)
    contents = json.loads(calibration_as_json(calibration))
    q = rows(calibration, 1)
    expected = exact(calibration, q).q
    for row, nominal, pose, answer in zip(
        q,
        calibration.robot.mechanism.forward(q),
        calibration.forward(q),
        expected,
        strict=True,
    ):
        np.testing.assert_allclose(nominal_pose(contents, row), nominal, atol=1e-10)
        np.testing.assert_allclose(calibrated_pose(contents, row), pose, atol=1e-10)
        np.testing.assert_allclose(corrected(contents, row), answer, atol=1e-8)


def test_joint_functions_and_a_network_are_in_the_json_file() -> None:
    robot = load_robot("delta")
    measurements = simulate(robot, Simulation(seed=2, configurations=40, workspace="full"))
    options = TrainingOptions(restarts=1)
    calibration = train(measurements, calibration_of("delta"), options)
    rng = np.random.default_rng(0)
    errors = calibration.base.errors.having(
        harmonics=1e-3 * rng.normal(size=(3, 4)), gravity=np.full(3, 1e-4)
    )
    calibration = replace(calibration, base=replace(calibration.base, errors=errors))
    network = train(measurements, "nominal", options).networks
    calibration = replace(calibration, networks=network)
    contents = json.loads(calibration_as_json(calibration))
    assert contents["network"] is not None
    for row in rows(calibration, 1):
        expected = calibration.forward(row[None])[0]
        np.testing.assert_allclose(calibrated_pose(contents, row), expected, atol=1e-9)


# --- URDF ---


@pytest.mark.parametrize("name", [*NAMES, "fivebar"])
def test_the_calibrated_urdf_with_the_loops_is_as_near_as_it_says(name: str) -> None:
    calibration = calibration_of(name)
    text, missing = calibration_as_urdf(calibration)
    source = calibration.robot.source
    robot = Robot.from_source(parse_source(source.toml_text, text, "calibrated"))
    q = calibration.q
    apart = np.linalg.norm(
        (robot.mechanism.forward(q) - calibration.forward(q))[:, :3, 3], axis=-1
    ).max()
    nominal = left(calibration, q, q).max()
    assert apart < 0.1 * nominal
    stated = re.findall(r"up to ([\d.]+) mm", missing[-1]) if missing else ["0"]
    assert 1e3 * apart == pytest.approx(float(stated[-1]), abs=2e-4)  # as its comment says


def test_a_frame_of_a_loop_without_a_fixed_joint_is_refused() -> None:
    calibration = calibration_of("delta")
    robot = calibration.robot
    fixed = '"rod12_end_fix" type="fixed"'
    urdf = robot.source.urdf_text.replace(fixed, fixed.replace('"fixed"', '"floating"'))
    other = replace(robot, source=replace(robot.source, urdf_text=urdf))
    with pytest.raises(InputError, match="frame 'rod12_end' of a loop has no fixed joint"):
        calibration_as_urdf(replace(calibration, robot=other))


# --- Geometries ---


@pytest.mark.parametrize("name", ["fivebar", "prs3", "palletizer"])
def test_joint_offsets_of_closed_loops_are_recovered(name: str) -> None:
    """A calibration whose only errors are offsets of the motors: they are what is written."""
    found = identify(simulate(load_robot(name), Simulation(configurations=20)), "nominal")
    robot, rng = found.robot, np.random.default_rng(4)
    offsets = rng.normal(size=robot.n) * 1e-3
    having = RobotErrors.of(robot, offsets=offsets)
    text, missing = calibration_as_offsets(
        replace(found, base=replace(found.base, errors=having)), "serial"
    )
    table = [line.split(",") for line in text.splitlines() if line[0].isdigit()]
    unit = np.where(robot.prismatic, 1e-3, np.pi / 180)
    np.testing.assert_allclose([float(row[1]) for row in table] * unit, offsets, atol=1e-7)
    assert missing == []
    assert len(table) == robot.n


@pytest.mark.parametrize("name", ["fivebar", "hexapod", "palletizer"])
def test_formats_of_serial_arms_refuse_closed_loops(name: str) -> None:
    """A table of a chain through the actuated joints alone would be another robot."""
    nominal = identify(simulate(load_robot(name), Simulation(configurations=20)), "nominal")
    for written in (
        lambda: calibration_as_dh(nominal, "standard"),
        lambda: calibration_as_dh(nominal, "modified"),
        lambda: calibration_as_ur_yaml(nominal),
        lambda: calibration_as_kuka_machine(nominal),
    ):
        with pytest.raises(InputError, match=f"{name}: .* closed loops; export it as urdf"):
            written()
