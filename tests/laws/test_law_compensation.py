"""Laws of the correction: it undoes the errors of the model, row by row,
here and in exported code.
"""

import ctypes
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import examples
from exported import STATUS, undisturbed, weighted_sizes
from hypothesis import example, given
from hypothesis import strategies as st
from json_reader import correct_from_json
from plain import Array, logarithm
from strategies import (
    DrawnChain,
    built_in,
    calibrated,
    configurations,
    drawn_chains,
    robots,
    seeds,
)

from calibtool.calibration import Calibration
from calibtool.compensation.one_step import one_step
from calibtool.compensation.solve import compensate_joints, compensate_poses
from calibtool.compensation.status import NEAR_SINGULAR, OK, UNCORRECTED
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.export.as_json import calibration_as_json
from calibtool.export.c_code import calibration_as_c
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.singularity import MIN_SINGULARITY_DISTANCE


def compared(robot: Robot, a: Array, b: Array) -> Array:
    """Largest difference of pose elements, positions over the characteristic length: (N,)."""
    off = np.abs(a - b)
    off[:, :3, 3] /= max(robot.length, 1.0)
    return off.max(axis=(1, 2))


@examples(12)
@given(robots(), seeds)
def test_compensated_joints_take_the_calibrated_robot_to_the_nominal_pose(
    robot: Robot, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    calibration = calibrated(robot, rng)
    q = configurations(robot, 20, rng)
    result = compensate_joints(calibration, q)
    good = result.status == OK
    reached, aim = calibration.forward(result.q[good]), robot.mechanism.forward(q[good])
    if robot.n >= 6:
        assert compared(robot, reached, aim).max(initial=0.0) < 1e-9
    else:
        assert np.abs(task_errors(calibration, reached, aim)).max(initial=0.0) < 2e-9


@examples(12)
@given(robots(), seeds, st.sampled_from(["exact", "one-step"]), st.sampled_from([1e-3, 1e-2]))
def test_no_correction_is_worse_than_none(
    robot: Robot, seed: int, method: str, size: float
) -> None:
    """By the whole weighted pose error, and by the components that the joints can correct."""
    rng = np.random.default_rng(seed)
    calibration = calibrated(robot, rng, size=size)
    q = configurations(robot, 20, rng)
    result = compensate_joints(calibration, q, method)
    assert robot.within_limits(result.q).all()
    left = result.status == UNCORRECTED
    np.testing.assert_array_equal(result.q[left], q[left])
    aim = robot.mechanism.forward(q)
    for errors in (whole_errors, task_errors):
        before, after = (
            np.linalg.norm(errors(calibration, calibration.forward(joints), aim), axis=-1)
            for joints in (q, result.q)
        )
        assert (after <= before * (1 + 1e-9) + 1e-15).all()


def whole_errors(calibration: Calibration, pose: Array, aim: Array) -> Array:
    """Displacement over the characteristic length and turn, along the axes of the
    commanded tool: (N, 6).
    """
    rows = []
    for a, b in zip(pose, aim, strict=True):
        turn = logarithm(a @ np.linalg.inv(b))[3:]
        rows.append(
            [*(b[:3, :3].T @ (a - b)[:3, 3] / calibration.robot.length), *(b[:3, :3].T @ turn)]
        )
    return np.array(rows).reshape(-1, 6)


def task_errors(calibration: Calibration, pose: Array, aim: Array) -> Array:
    """Those of `whole_errors` that are no virtual joints: (N, min(n, 6))."""
    virtual = calibration.equivalent.virtual_joints
    kept = [i for i, name in enumerate(("x", "y", "z", "rx", "ry", "rz")) if name not in virtual]
    return whole_errors(calibration, pose, aim)[:, kept]


@examples(8)
@given(robots(), seeds, st.sampled_from(["exact", "one-step"]))
def test_a_calibration_without_errors_corrects_nothing(
    robot: Robot, seed: int, method: str
) -> None:
    rng = np.random.default_rng(seed)
    made = calibrated(robot, rng, with_network=False)
    base = replace(made.base, errors=RobotErrors.of(robot))
    q = configurations(robot, 20, rng)
    result = compensate_joints(replace(made, base=base), q, method)
    assert np.abs(result.q - q).max() < 1e-9
    assert np.isin(result.status, (OK, NEAR_SINGULAR)).all()


@examples(6)
@given(robots(), seeds, st.sampled_from(["exact", "one-step"]))
def test_rows_are_corrected_by_themselves(robot: Robot, seed: int, method: str) -> None:
    """Alone, in another order or twice: a row of joints, or of a pose with its
    seed, has one answer.
    """
    rng = np.random.default_rng(seed)
    calibration = calibrated(robot, rng)
    q = configurations(robot, 12, rng)
    order = rng.integers(0, 12, 20)
    together = compensate_joints(calibration, q, method)
    shuffled = compensate_joints(calibration, q[order], method)
    assert np.array_equal(shuffled.status, together.status[order])
    sure = together.status[order] == OK
    np.testing.assert_allclose(shuffled.q[sure], together.q[order][sure], atol=1e-9)


@examples(6)
@given(robots(), seeds)
def test_a_commanded_pose_is_corrected_as_its_joints_are(robot: Robot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    calibration = calibrated(robot, rng)
    q = configurations(robot, 10, rng)
    q = q[robot.singularity_distance(q) > 3 * MIN_SINGULARITY_DISTANCE]
    by_joints = compensate_joints(calibration, q)
    by_pose = compensate_poses(calibration, robot.mechanism.forward(q), q)
    assert np.array_equal(by_pose.status, by_joints.status)
    np.testing.assert_allclose(by_pose.q, by_joints.q, atol=1e-6)


# --- exported code --------------------------------------------------------------------------------


@examples(12)
@given(robots(), seeds, st.booleans(), st.booleans())
def test_the_formulas_of_the_json_file_are_the_one_step_correction(
    robot: Robot, seed: int, with_network: bool, with_motion: bool
) -> None:
    rng = np.random.default_rng(seed)
    calibration = calibrated(robot, rng, with_network=with_network, with_motion=with_motion)
    q = configurations(robot, 5, rng)
    expected, plain = one_step(calibration, q), undisturbed(calibration, q)
    contents = json.loads(calibration_as_json(calibration))
    for k in range(len(q)):
        found, status = correct_from_json(contents, q[k])
        np.testing.assert_allclose(found, expected.q[k], atol=1e-11 if plain[k] else 1e-7)
        assert status == expected.status[k]


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_compiled_c_is_the_one_step_correction(tmp_path: Path) -> None:
    """Drawn calibrations in one library, compiled once."""
    made: list[Calibration] = []

    @examples(12)
    @given(built_in | drawn_chains().map(DrawnChain.robot), seeds, st.booleans(), st.booleans())
    @example(load_robot("scara"), 0, True, True)  # slides that turn a little
    @example(load_robot("gantry"), 0, True, True)
    def draw(robot: Robot, seed: int, with_network: bool, with_motion: bool) -> None:
        rng = np.random.default_rng(seed)
        made.append(calibrated(robot, rng, with_network=with_network, with_motion=with_motion))

    draw()
    sources = []
    for i, calibration in enumerate(made):
        header, source = calibration_as_c(calibration, f"arm{i}")
        (tmp_path / f"arm{i}.h").write_text(header, encoding="ascii")
        sources.append(tmp_path / f"arm{i}.c")
        sources[-1].write_text(source, encoding="ascii")
    whole = tmp_path / "arms.so"
    command = [
        "gcc",
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-O0",
        "-shared",
        "-fPIC",
        "-o",
        whole,
        *sources,
        "-lm",
    ]
    subprocess.run(command, check=True)
    library, pointer = ctypes.CDLL(str(whole)), ctypes.POINTER(ctypes.c_double)
    for i, calibration in enumerate(made):
        q = configurations(calibration.robot, 200, np.random.default_rng(i))
        expected, plain = one_step(calibration, q), undisturbed(calibration, q)
        found, names = np.empty_like(q), []
        correct = getattr(library, f"arm{i}_correct")
        for row, result in zip(q, found, strict=True):
            code = correct(row.ctypes.data_as(pointer), result.ctypes.data_as(pointer))
            names.append(STATUS[code])
        off = np.abs(found - expected.q).max(axis=-1)
        assert (off < np.where(plain, 1e-12, 1e-7)).all(), calibration.robot.source.urdf_text
        assert names == expected.status.tolist(), calibration.robot.source.urdf_text
        before, after = (weighted_sizes(calibration, x, q) for x in (q, found))
        assert (after <= before + 1e-15).all(), calibration.robot.source.urdf_text
