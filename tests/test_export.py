"""Exported corrections compute what `one_step` computes: a reader of the JSON file alone, and the compiled C code.

After a wanted change of the templates: CALIBTOOL_UPDATE_GOLDEN=1 pytest tests/test_export.py, and read the diff.
"""

import ctypes
import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exported import CASES, REGULAR, anywhere, calibrated
from scipy.linalg import expm
from scipy.spatial.transform import RigidTransform

from calibtool.calibration import Calibration
from calibtool.compensation.solve import one_step
from calibtool.equivalent.joints import EquivalentRobot
from calibtool.equivalent.network import Network
from calibtool.errormodel.conditions import Conditions
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import UsageError
from calibtool.export.as_json import calibration_as_json
from calibtool.export.c_code import calibration_as_c
from calibtool.export.rendering import SINGLE_ACCURACY, SINGLE_DISTANCE, Precision
from calibtool.export.structured_text import calibration_as_structured_text
from calibtool.robot.damped import MIN_SINGULARITY_DISTANCE
from calibtool.robot.se3 import Array

GCC = shutil.which("gcc")
FLAGS = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Wdouble-promotion", "-Werror", "-O1"]
SINGLE_CASES = [case for case in CASES if case[1] == "everything" or case[0] in ("scara", "gantry")]
GOLDEN = Path(__file__).parent / "golden"

# --- JSON -----------------------------------------------------------------------------------------------------------


def correct_from_json(c: dict, q: Array) -> Array:
    """What a stranger makes of the file: `formula` in numpy and scipy, without calibtool."""
    n, base = len(c["joints"]), c["base_model"]

    def hat(w: Array) -> Array:
        return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])

    def exp6(twist: Array) -> Array:
        return expm(np.block([[hat(twist[3:]), twist[:3, None]], [np.zeros((1, 4))]]))

    def log6(T: Array) -> Array:
        whole = np.vstack([T[:3], [0.0, 0.0, 0.0, 1.0]])  # inv leaves rounding in the last row
        w_v = RigidTransform.from_matrix(whole).as_exp_coords()
        return np.array([*w_v[3:], *w_v[:3]])

    def adjoint(T: Array) -> Array:
        return np.block([[T[:3, :3], hat(T[:3, 3]) @ T[:3, :3]], [np.zeros((3, 3)), T[:3, :3]]])

    def frames(M: Array, xi: Array, q: Array) -> tuple[list[Array], list[Array]]:
        T, frames, columns = np.eye(4), [], []
        for j in range(n):
            T = T @ M[j] @ exp6(xi[j] * q[j])
            frames.append(T)
            columns.append(adjoint(T) @ xi[j])
        return frames, columns

    def chain(M: Array, xi: Array, q: Array) -> tuple[Array, list[Array]]:
        joints, columns = frames(M, xi, q)
        return joints[-1] @ M[n], columns

    N = np.zeros(c["equivalent_robot"]["p"])
    if (net := c["network"]) is not None:
        s = (q - net["input_centre_rad_or_m"]) / net["input_scale_rad_or_m"]
        hidden = np.tanh(np.array(net["hidden_weights"]) @ s + net["hidden_bias"])
        N = (np.array(net["output_weights"]) @ hidden + net["output_bias"]) * net["output_scale_rad_or_m"]
    if base["name"] == "nominal":
        return q - N[:n]
    nominal_twists = np.array(c["nominal_twists_per_rad_or_m"])
    T_nominal, _ = chain(np.array(c["nominal_placements_m"]), nominal_twists, q)
    twists = nominal_twists + base["twist_errors_per_rad_or_m"]
    moved = q + base["offset_errors_rad_or_m"]
    for j, row in enumerate(base["harmonics_rad"]):
        moved[j] += sum(a * np.sin((h // 2 + 1) * q[j]) for h, a in enumerate(row) if h % 2 == 0)
        moved[j] += sum(b * np.cos((h // 2 + 1) * q[j]) for h, b in enumerate(row) if h % 2 == 1)
    T_nominal_joints, nominal_columns = frames(np.array(c["nominal_placements_m"]), nominal_twists, q)
    for j in range(n):
        for i in range(j, n):
            centre = (T_nominal_joints[i] @ [*base["centres_of_mass_m"][i], 1])[:3]
            velocity = nominal_columns[j][:3] + np.cross(nominal_columns[j][3:], centre)
            torque = -base["link_masses_kg"][i] * np.dot(base["gravity_m_per_s2"], velocity)
            moved[j] -= base["compliance_rad_per_nm"][j] * torque
    T_base, columns = chain(np.array(base["placements_m"]), twists, moved)
    columns += [adjoint(T_base)[:, k] for k in c["equivalent_robot"]["virtual_joint_columns"]]
    J = np.stack(columns, axis=1)
    T_calibrated = exp6(J @ N) @ T_base
    e = log6(T_calibrated @ np.linalg.inv(T_nominal))

    t, length = T_calibrated[:3, 3], c["characteristic_length_m"]
    weigh = np.block([[np.eye(3) / length, -hat(t) / length], [np.zeros((3, 3)), np.eye(3)]])
    e, J = weigh @ e, weigh @ J
    G = J @ J.T + c["gram_regularisation"] * np.eye(6)
    distance = 1 / np.sqrt(np.trace(np.linalg.inv(G)))
    damping = max(0.0, c["min_singularity_distance"] - distance)
    rho = J.T @ np.linalg.solve(G + damping**2 * np.eye(6), e)
    return q - rho[:n]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_reader_of_the_json_alone_corrects_as_one_step_does(case: tuple[str, str, bool]) -> None:
    calibration = calibrated(*case)
    q = anywhere(calibration, 20)
    contents = json.loads(calibration_as_json(calibration))
    expected, _ = one_step(calibration, q)
    found = np.array([correct_from_json(contents, row) for row in q])
    assert np.abs(found - expected).max() < 1e-11


def test_json_holds_every_number_exactly_and_is_deterministic() -> None:
    calibration = calibrated("scara", "local-poe", True)
    text = calibration_as_json(calibration)
    contents = json.loads(text)
    assert calibration.network is not None
    assert np.array_equal(contents["network"]["hidden_weights"], calibration.network.hidden_weights)
    assert np.array_equal(contents["base_model"]["placement_errors_m_rad"], calibration.base.errors["placements"])
    assert np.array_equal(contents["nominal_placements_m"], calibration.robot.chain.placements)
    assert np.array_equal([j["upper_rad_or_m"] for j in contents["joints"]], calibration.robot.upper)
    assert [j["kind"] for j in contents["joints"]].count("prismatic") == 1
    assert (contents["schema"], contents["schema_version"]) == ("calibtool/compensator", 1)
    assert text.endswith("}\n")
    assert text == calibration_as_json(calibration)


# --- C --------------------------------------------------------------------------------------------------------------


LOOP = """
#include "arm.h"
void many(int count, const {real} *q, {real} *q_m, int *codes)
{{
    for (int k = 0; k < count; k++)
        codes[k] = arm_correct(q + k * ARM_N, q_m + k * ARM_N);
}}
"""


@pytest.fixture
def compiled(tmp_path: Path) -> Callable[..., ctypes.CDLL]:
    """Compile a calibration's C code, warnings are errors; skips where there is no gcc."""
    if GCC is None:
        pytest.skip("gcc is not installed, so the generated C code cannot be compiled")

    def build(calibration: Calibration, precision: Precision = "double") -> ctypes.CDLL:
        header, source = calibration_as_c(calibration, "arm", precision)
        (tmp_path / "arm.h").write_text(header, encoding="ascii")
        (tmp_path / "arm.c").write_text(source, encoding="ascii")
        (tmp_path / "loop.c").write_text(LOOP.format(real="double" if precision == "double" else "float"))
        library = tmp_path / "arm.so"
        sources = [tmp_path / "arm.c", tmp_path / "loop.c"]
        subprocess.run([GCC, *FLAGS, "-shared", "-fPIC", "-o", library, *sources, "-lm"], check=True)
        return ctypes.CDLL(str(library))

    return build


def run(library: ctypes.CDLL, q: Array) -> tuple[Array, Array]:
    """Corrected positions (N, n), in the precision of q, and return codes (N,)."""
    q = np.ascontiguousarray(q)
    corrected, codes = np.empty_like(q), np.empty(len(q), dtype=np.intc)
    library.many(len(q), *(ctypes.c_void_p(array.ctypes.data) for array in (q, corrected, codes)))
    return corrected, codes


@pytest.mark.parametrize("case", CASES, ids=str)
def test_compiled_c_corrects_as_one_step_does(case: tuple[str, str, bool], compiled: Callable) -> None:
    calibration = calibrated(*case)
    q = anywhere(calibration, 10_000)
    expected, distance = one_step(calibration, q)
    found, codes = run(compiled(calibration), q)
    regular = distance >= REGULAR
    assert regular.mean() > 0.5
    assert np.abs(found - expected)[regular].max() < 1e-12
    assert np.abs(found - expected).max() < 1e-9
    damped = 0 if calibration.base.model == "nominal" else distance < MIN_SINGULARITY_DISTANCE
    assert np.array_equal(codes, np.broadcast_to(damped, codes.shape))


@pytest.mark.parametrize("case", [case for case in CASES if case[1] == "everything"], ids=str)
def test_compiled_c_is_for_the_payload_and_temperature_asked_for(
    case: tuple[str, str, bool], compiled: Callable
) -> None:
    calibration = calibrated(*case)
    robot, rng = calibration.robot, np.random.default_rng(3)
    loads, growth = rng.uniform(1, 5, (robot.n, 2)) * 1e-6, rng.uniform(5, 25, robot.n + 1) * 1e-6
    errors = calibration.base.errors.having(payload=loads, temperature=growth)
    conditions = Conditions(payload_kg=np.array(8.0), temperature_c=np.array(45.0))
    loaded = replace(calibration, base=replace(calibration.base, errors=errors)).at(conditions)
    q = anywhere(calibration, 1000)
    expected, distance = one_step(loaded, q)
    found, _ = run(compiled(loaded), q)
    assert np.abs(found - expected)[distance >= REGULAR].max() < 1e-12
    assert np.abs(one_step(calibration, q)[0] - expected)[distance >= REGULAR].max() > 1e-5


@pytest.mark.parametrize(
    "case", [case for case in CASES if case[1] == "everything" or case[0] in ("scara", "gantry")], ids=str
)
def test_compiled_c_in_single_precision_keeps_what_its_header_says(
    case: tuple[str, str, bool], compiled: Callable
) -> None:
    calibration = calibrated(*case)
    q = anywhere(calibration, 10_000).astype(np.float32)
    expected, distance = one_step(calibration, q.astype(float))
    found, codes = run(compiled(calibration, "single"), q)
    regular = (distance >= SINGLE_DISTANCE) | (calibration.base.model == "nominal")
    assert regular.mean() > 0.5
    assert np.abs(found - expected)[regular].max() < SINGLE_ACCURACY
    assert np.isfinite(found).all()
    assert not codes[regular].any()
    header, source = calibration_as_c(calibration, "arm", "single")
    assert "1e-06 rad or m of double precision" in header
    assert not re.search(r"\bdouble\b", source)


def test_compiled_c_stays_finite_at_exact_singularities(compiled: Callable) -> None:
    calibration = calibrated("fanuc-m1000ia", "local-poe", False)
    straight = replace(calibration, base=replace(calibration.base, errors=RobotErrors.of(calibration.robot)))
    corrected, codes = run(compiled(straight), np.zeros((1, 6)))  # wrist axes 4 and 6 coincide, nothing to correct
    assert np.abs(corrected).max() < 1e-12
    assert codes[0] == 1


@pytest.mark.parametrize("base", ["nominal", "local-poe"])
def test_compiled_c_returns_positions_that_are_not_finite_as_they_are(base: str, compiled: Callable) -> None:
    q = np.array([[0.1, 0.2, bad, 0.4, 0.5, 0.6] for bad in (np.nan, np.inf, -np.inf)])
    corrected, codes = run(compiled(calibrated("fanuc-m1000ia", base, True)), q)
    assert (codes == 2).all()
    assert np.array_equal(corrected, q, equal_nan=True)


def test_compiled_c_returns_positions_that_overflow_as_they_are(compiled: Callable) -> None:
    q = np.array([[0.1, 0.2, 1e200, 0.4, 0.5, 0.6]])
    corrected, codes = run(compiled(calibrated("fanuc-m1000ia", "local-poe", True)), q)
    assert codes[0] == 2
    assert np.array_equal(corrected, q)


@pytest.mark.parametrize("network", [True, False])
def test_compiled_c_network_is_the_network(network: bool, compiled: Callable) -> None:
    calibration = calibrated("fanuc-m1000ia", "nominal", network)
    pointer = ctypes.POINTER(ctypes.c_double)
    q, rho = np.linspace(-1, 1, 6), np.full(6, np.nan)
    compiled(calibration).arm_network(q.ctypes.data_as(pointer), rho.ctypes.data_as(pointer))
    expected = calibration.network(q[None])[0] if calibration.network is not None else np.zeros(6)
    assert np.abs(rho - expected).max() < 1e-15


def test_generated_code_is_the_golden_file() -> None:
    header, source = calibration_as_c(round_numbers(), "planar_3r")
    block = calibration_as_structured_text(round_numbers(), "planar_3r")
    for suffix, text in (("h", header), ("c", source), ("st", block)):
        path = GOLDEN / f"planar_3r.{suffix}"
        if os.environ.get("CALIBTOOL_UPDATE_GOLDEN") == "1":
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="ascii")
        assert text == path.read_text(encoding="ascii")


def round_numbers() -> Calibration:
    """A made-up calibration of numbers that no processor rounds: not trained, no rotation in its placements' errors."""
    calibration = calibrated("planar-3r", "local-poe", False)
    chain = calibration.robot.chain
    shifts = np.array([[1.0, 0, 0], [0, 2.0, 0], [0, 0, -1.0], [0, 0, 3.0]]) / 1024
    network = Network(
        input_centre=np.array([0.0, 1.0, 0.25]),
        input_scale=np.array([1.0, 0.5, 2.0]),
        hidden_weights=np.array([[1.0, -0.5, 0.25], [0.0, 2.0, -1.0]]),
        hidden_bias=np.array([0.5, -0.125]),
        output_weights=np.array([[1.0, -1.0], [0.5, 0.25], [0.0, 1.0], [2.0, 0.0], [-0.5, 0.5], [1.0, 1.0]]),
        output_bias=np.array([0.0, 0.5, -0.5, 0.25, 0.0, 1.0]),
        output_scale=np.full(6, 1 / 1024),
    )
    robot = replace(calibration.robot, chain=replace(chain, placements=chain.placements.round(12) + 0.0))
    return replace(
        calibration,
        robot=robot,
        base=replace(
            calibration.base,
            errors=RobotErrors.of(
                robot,
                placements=np.hstack([shifts, np.zeros((4, 3))]),
                twists=np.array([[0, 0, 1.0, 0, 0, 0], [0] * 6, [0, 0, 0, 0, 2.0, 0]]) / 1024,
                offsets=np.array([0.0, 0.5, -1.0]) / 1024,
            ),
        ),
        equivalent=EquivalentRobot(3, ("x", "ry", "rz")),
        networks=(network,),
    )


@pytest.mark.parametrize("prefix", ["", "3r", "my-arm", "a b", "größe", "x;", "arm\n"])
def test_a_prefix_that_is_no_c_identifier_is_refused(prefix: str) -> None:
    with pytest.raises(UsageError, match="names of C functions"):
        calibration_as_c(calibrated("fanuc-m1000ia", "nominal", False), prefix)


def test_all_symbols_of_c_code_begin_with_the_prefix(compiled: Callable, tmp_path: Path) -> None:
    compiled(calibrated("scara", "local-poe", True))
    assert GCC is not None
    subprocess.run([GCC, *FLAGS, "-c", "-o", tmp_path / "arm.o", tmp_path / "arm.c"], check=True)
    listed = subprocess.run(
        ["nm", "-g", "--defined-only", tmp_path / "arm.o"], check=True, capture_output=True, text=True
    )
    assert {line.split()[-1] for line in listed.stdout.splitlines()} == {"arm_correct", "arm_network"}


# --- coupled joint values --------------------------------------------------------------------------------------------


def test_json_holds_the_coupling_and_says_what_it_is() -> None:
    value = json.loads(calibration_as_json(calibrated("fanuc-m1000ia", "nominal", True)))
    q = np.array(value["joint_coupling"]) @ [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    np.testing.assert_allclose(q, [0.1, 0.2, 0.5, 0.4, 0.5, 0.6])  # serial q3 = J3 + J2
    assert "controller" in value["formula"]["joint_coupling"]
    plain = json.loads(calibration_as_json(calibrated("scara", "local-poe", True)))
    np.testing.assert_array_equal(plain["joint_coupling"], np.eye(4))


def test_compiled_c_converts_coupled_joint_values(compiled: Callable) -> None:
    calibration = calibrated("fanuc-m1000ia", "nominal", True)
    library, pointer = compiled(calibration), ctypes.POINTER(ctypes.c_double)
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    library.arm_to_serial(q.ctypes.data_as(pointer), q.ctypes.data_as(pointer))  # in place
    np.testing.assert_allclose(q, [0.1, 0.2, 0.5, 0.4, 0.5, 0.6], atol=1e-15)
    back = np.empty(6)
    library.arm_to_controller(q.ctypes.data_as(pointer), back.ctypes.data_as(pointer))
    np.testing.assert_allclose(back, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], atol=1e-15)


def test_c_of_a_robot_without_coupling_has_no_conversion() -> None:
    assert "to_serial" not in "".join(calibration_as_c(calibrated("scara", "local-poe", True)))
