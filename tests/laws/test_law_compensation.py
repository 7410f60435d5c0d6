"""Laws of the correction: it undoes the errors of the model, row by row, here and in exported code."""

import ctypes
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import examples
from hypothesis import example, given
from hypothesis import strategies as st
from plain import Array, adjoint, exponential, logarithm, poses_along
from strategies import (
    DrawnChain,
    calibrated,
    carried,
    configurations,
    drawn_chains,
    robots,
    seeds,
)

from calibtool.calibration import Calibration
from calibtool.compensation.solve import NEAR_SINGULAR, OK, compensate_joints, compensate_poses, one_step
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.export.as_json import calibration_as_json
from calibtool.export.c_code import calibration_as_c
from calibtool.robot.catalogue import load_robot
from calibtool.robot.damped import MIN_SINGULARITY_DISTANCE, at_point
from calibtool.robot.model import Robot


def compared(robot: Robot, a: Array, b: Array) -> Array:
    """Largest difference of pose elements, positions over the characteristic length: (N,)."""
    off = np.abs(a - b)
    off[:, :3, 3] /= max(robot.length, 1.0)
    return off.max(axis=(1, 2))


@examples(12)
@given(robots(), seeds)
def test_compensated_joints_take_the_calibrated_robot_to_the_nominal_pose(robot: Robot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    calibration = calibrated(robot, rng)
    q = configurations(robot, 20, rng)
    result = compensate_joints(calibration, q)
    good = result.status == OK
    reached, aim = calibration.forward(result.q[good]), robot.mechanism.forward(q[good])
    if robot.n >= 6:
        assert compared(robot, reached, aim).max(initial=0.0) < 1e-9
    else:
        assert_nearest(calibration, result.q[good], aim)


def assert_nearest(calibration: Calibration, q: Array, aim: Array) -> None:
    """No motion of the joints lowers the weighted pose error: its slope along every joint is zero."""
    pose, jacobian = calibration.forward_and_jacobian(q)
    columns = at_point(jacobian[:, :, : calibration.robot.n], pose[:, :3, 3])
    columns[:, :3] /= calibration.robot.length
    for k in range(len(q)):
        turn = logarithm(aim[k] @ np.linalg.inv(pose[k]))[3:]
        error = np.concatenate([(aim[k] - pose[k])[:3, 3] / calibration.robot.length, turn])
        # J leaves out the slope of the joint motions and of the network, a thousandth of it.
        assert np.abs(columns[k].T @ error).max() < 2e-2 * np.linalg.norm(error) * np.linalg.norm(columns[k]) + 1e-9


@examples(8)
@given(robots(), seeds, st.sampled_from(["exact", "one-step"]))
def test_a_calibration_without_errors_corrects_nothing(robot: Robot, seed: int, method: str) -> None:
    rng = np.random.default_rng(seed)
    made = calibrated(robot, rng, with_network=False)
    base = replace(made.base, errors=RobotErrors.of(robot))
    q = configurations(robot, 20, rng)
    result = compensate_joints(replace(made, base=base), q, method)  # type: ignore[arg-type]
    assert np.abs(result.q - q).max() < 1e-9
    assert np.isin(result.status, (OK, NEAR_SINGULAR)).all()


@examples(6)
@given(robots(), seeds, st.sampled_from(["exact", "one-step"]))
def test_rows_are_corrected_by_themselves(robot: Robot, seed: int, method: str) -> None:
    """Alone, in another order or twice: a row of joints, or of a pose with its seed, has one answer."""
    rng = np.random.default_rng(seed)
    calibration = calibrated(robot, rng)
    q = configurations(robot, 12, rng)
    order = rng.integers(0, 12, 20)
    together = compensate_joints(calibration, q, method)  # type: ignore[arg-type]
    shuffled = compensate_joints(calibration, q[order], method)  # type: ignore[arg-type]
    assert np.array_equal(shuffled.status, together.status[order])
    sure = together.status[order] == OK
    np.testing.assert_allclose(shuffled.q[sure], together.q[order][sure], atol=1e-9)


@examples(6)
@given(robots(), seeds)
def test_a_commanded_pose_is_corrected_as_its_joints_are(robot: Robot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    calibration = calibrated(robot, rng)
    q = configurations(robot, 10, rng)
    q = q[robot.singularity_distance(q) > 2 * MIN_SINGULARITY_DISTANCE]
    by_joints = compensate_joints(calibration, q)
    by_pose = compensate_poses(calibration, robot.mechanism.forward(q), q)
    assert np.array_equal(by_pose.status, by_joints.status)
    np.testing.assert_allclose(by_pose.q, by_joints.q, atol=1e-6)


# --- exported code ---------------------------------------------------------------------------------------------------


def correct_as_the_formula_says(c: dict, q: Array) -> Array:
    """`formula` of the JSON file in numpy, with joint motions and torques; nothing of calibtool."""
    n, base = len(c["joints"]), c["base_model"]
    M, xi = np.array(c["nominal_placements_m"]), np.array(c["nominal_twists_per_rad_or_m"])
    N = np.zeros(c["equivalent_robot"]["p"])
    if (net := c["network"]) is not None:
        s = (q - net["input_centre_rad_or_m"]) / net["input_scale_rad_or_m"]
        hidden = np.tanh(np.array(net["hidden_weights"]) @ s + net["hidden_bias"])
        N = (np.array(net["output_weights"]) @ hidden + net["output_bias"]) * net["output_scale_rad_or_m"]
    if base["name"] == "nominal":
        return q - N[:n]
    *F, T_nominal = poses_along(M, xi, q)
    motion = np.zeros(n)
    for j in range(n):
        for k, factor in enumerate(base["harmonics_rad"][j]):
            motion[j] += factor * (np.cos if k % 2 else np.sin)((k // 2 + 1) * q[j])
        column, torque = adjoint(F[j]) @ xi[j], 0.0
        for i in range(j, n):
            centre = (F[i] @ [*base["centres_of_mass_m"][i], 1.0])[:3]
            velocity = column[:3] + np.cross(column[3:], centre)
            torque -= base["link_masses_kg"][i] * (base["gravity_m_per_s2"] @ velocity)
        motion[j] -= base["compliance_rad_per_nm"][j] * torque
    xi = xi + base["twist_errors_per_rad_or_m"]
    *F, T_base = poses_along(np.array(base["placements_m"]), xi, q + base["offset_errors_rad_or_m"] + motion)
    columns = [adjoint(F[j]) @ xi[j] for j in range(n)]
    columns += [adjoint(T_base)[:, k] for k in c["equivalent_robot"]["virtual_joint_columns"]]
    J = np.stack(columns, axis=1)
    T_calibrated = exponential(J @ N) @ T_base
    e = logarithm(T_calibrated @ np.linalg.inv(T_nominal))
    weigh = np.eye(6)
    weigh[:3, 3:] = -adjoint(T_calibrated)[:3, 3:] @ T_calibrated[:3, :3].T
    weigh[:3] /= c["characteristic_length_m"]
    e, J = weigh @ e, weigh @ J
    G = J @ J.T + c["gram_regularisation"] * np.eye(6)
    damping = max(0.0, c["min_singularity_distance"] - 1 / np.sqrt(np.trace(np.linalg.inv(G))))
    return q - (J.T @ np.linalg.solve(G + damping**2 * np.eye(6), e))[:n]


@examples(12)
@given(robots(), seeds, st.booleans(), st.booleans())
def test_the_formulas_of_the_json_file_are_the_one_step_correction(
    robot: Robot, seed: int, with_network: bool, with_motion: bool
) -> None:
    rng = np.random.default_rng(seed)
    calibration = calibrated(robot, rng, with_network=with_network, with_motion=with_motion)
    q = configurations(robot, 5, rng)
    expected, distance = one_step(calibration, q)
    contents = json.loads(calibration_as_json(calibration))
    for k in np.flatnonzero(distance > 1e-4):
        found = correct_as_the_formula_says(contents, q[k])
        np.testing.assert_allclose(found, expected[k], atol=1e-13 / min(distance[k], 0.1) ** 2)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_compiled_c_is_the_one_step_correction(tmp_path: Path) -> None:
    """Drawn calibrations in one library, compiled once."""
    made: list[Calibration] = []

    @examples(12)
    @given(carried | drawn_chains().map(DrawnChain.robot), seeds, st.booleans(), st.booleans())
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
        expected, distance = one_step(calibration, q)
        found = np.empty_like(q)
        correct = getattr(library, f"arm{i}_correct")
        for row, result in zip(q, found, strict=True):
            code = correct(row.ctypes.data_as(pointer), result.ctypes.data_as(pointer))
            assert code in (0, 1)
        off = np.abs(found - expected).max(axis=-1)
        assert (off < 1e-13 / np.clip(distance, 1e-4, 0.1) ** 2).all(), calibration.robot.source.urdf_text
        assert (off[distance > 2 * MIN_SINGULARITY_DISTANCE] < 1e-12).all(), calibration.robot.source.urdf_text
