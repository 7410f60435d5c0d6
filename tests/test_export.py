"""Exported corrections compute what `one_step` computes: a reader of the JSON file alone, and the compiled C code.

After a wanted change of the C templates: CALIBTOOL_UPDATE_GOLDEN=1 pytest tests/test_export.py, and read the diff.
"""

import ctypes
import json
import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm, logm

from calibtool.calibration import Calibration, identify, train
from calibtool.compensation.solve import one_step
from calibtool.equivalent.joints import EquivalentRobot
from calibtool.equivalent.network import Network, initial_network
from calibtool.equivalent.training import TrainingOptions
from calibtool.errors import UsageError
from calibtool.export.as_json import calibration_as_json
from calibtool.export.c_code import calibration_as_c
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.geometry import GeometricErrors
from calibtool.robot.mechanism import MIN_SINGULARITY_DISTANCE
from calibtool.robot.se3 import Array

GCC = shutil.which("gcc")
FLAGS = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Werror", "-O2"]
GOLDEN = Path(__file__).parent / "golden"

# robot, base model, with a network
CASES = [
    ("fanuc-m1000ia", "nominal", True),
    ("fanuc-m1000ia", "nominal", False),
    ("fanuc-m1000ia", "local-poe", True),
    ("fanuc-m1000ia", "local-poe", False),
    ("fanuc-m1000ia", "all geometric errors", True),
    ("scara", "local-poe", True),
    ("gantry", "local-poe", True),
    ("panda", "local-poe", True),
    ("panda", "nominal", True),
]


@cache
def calibrated(name: str, base: str, network: bool) -> Calibration:
    """A calibration from 60 simulated configurations; the network is a small random one where none was worth keeping."""
    robot = load_robot(name)
    measurements = simulate(robot, Simulation(workspace=robot.workspace(None)[1], configurations=60))
    model = "nominal" if base == "nominal" else "local-poe"
    if not network:
        return identify(measurements, model)
    calibration = train(measurements, model, TrainingOptions(restarts=2))
    rng = np.random.default_rng(1)
    if calibration.network is None:
        scale = np.full(calibration.equivalent.p, 1e-3)
        calibration = replace(calibration, networks=(initial_network(measurements.q, scale, 5, rng),))
    if base == "all geometric errors":
        errors = [rng.normal(size=shape) * 1e-3 for shape in ((robot.n + 1, 6), (robot.n, 6), (robot.n,))]
        calibration = replace(calibration, base=replace(calibration.base, geometry=GeometricErrors(*errors)))
    return calibration


def anywhere(calibration: Calibration, count: int) -> Array:
    """Random configurations of the whole joint range."""
    robot = calibration.robot
    return robot.lower + (robot.upper - robot.lower) * np.random.default_rng(2).random((count, robot.n))


# --- JSON -----------------------------------------------------------------------------------------------------------


def correct_from_json(c: dict, q: Array) -> Array:
    """What a stranger makes of the file: `formula` in numpy and scipy.linalg, without calibtool."""
    n, base = len(c["joints"]), c["base_model"]

    def hat(w: Array) -> Array:
        return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])

    def exp6(twist: Array) -> Array:
        return expm(np.block([[hat(twist[3:]), twist[:3, None]], [np.zeros((1, 4))]]))

    def log6(T: Array) -> Array:
        X = logm(T).real
        return np.array([*X[:3, 3], X[2, 1], X[0, 2], X[1, 0]])

    def adjoint(T: Array) -> Array:
        return np.block([[T[:3, :3], hat(T[:3, 3]) @ T[:3, :3]], [np.zeros((3, 3)), T[:3, :3]]])

    def chain(M: Array, xi: Array, q: Array) -> tuple[Array, list[Array]]:
        T, columns = np.eye(4), []
        for j in range(n):
            T = T @ M[j] @ exp6(xi[j] * q[j])
            columns.append(adjoint(T) @ xi[j])
        return T @ M[n], columns

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
    T_base, columns = chain(np.array(base["placements_m"]), twists, q + base["offset_errors_rad_or_m"])
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
    q = anywhere(calibration, 50)
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
    assert np.array_equal(contents["base_model"]["placement_errors_m_rad"], calibration.base.geometry.placements)
    assert np.array_equal(contents["nominal_placements_m"], calibration.robot.chain.placements)
    assert np.array_equal([j["upper_rad_or_m"] for j in contents["joints"]], calibration.robot.upper)
    assert [j["kind"] for j in contents["joints"]].count("prismatic") == 1
    assert (contents["schema"], contents["schema_version"]) == ("calibtool/compensator", 1)
    assert text.endswith("}\n")
    assert text == calibration_as_json(calibration)


# --- C --------------------------------------------------------------------------------------------------------------


@pytest.fixture
def compiled(tmp_path: Path) -> Callable[[Calibration], ctypes.CDLL]:
    """Compile a calibration's C code, warnings are errors; skips where there is no gcc."""
    if GCC is None:
        pytest.skip("gcc is not installed, so the generated C code cannot be compiled")

    def build(calibration: Calibration) -> ctypes.CDLL:
        header, source = calibration_as_c(calibration, "arm")
        (tmp_path / "arm.h").write_text(header, encoding="ascii")
        (tmp_path / "arm.c").write_text(source, encoding="ascii")
        library = tmp_path / "arm.so"
        subprocess.run([GCC, *FLAGS, "-shared", "-fPIC", "-o", library, tmp_path / "arm.c", "-lm"], check=True)
        return ctypes.CDLL(str(library))

    return build


def run(library: ctypes.CDLL, q: Array) -> tuple[Array, Array]:
    """Corrected positions (N, n) and return codes (N,)."""
    pointer = ctypes.POINTER(ctypes.c_double)
    corrected, codes = np.empty_like(q), np.empty(len(q), dtype=int)
    for k, row in enumerate(np.ascontiguousarray(q)):
        codes[k] = library.arm_correct(row.ctypes.data_as(pointer), corrected[k].ctypes.data_as(pointer))
    return corrected, codes


@pytest.mark.parametrize("case", CASES, ids=str)
def test_compiled_c_corrects_as_one_step_does(case: tuple[str, str, bool], compiled: Callable) -> None:
    calibration = calibrated(*case)
    q = anywhere(calibration, 3000)
    expected, distance = one_step(calibration, q)
    found, codes = run(compiled(calibration), q)
    regular = np.flatnonzero(distance >= 2 * MIN_SINGULARITY_DISTANCE)[:1000]
    assert len(regular) == 1000
    assert np.abs(found - expected)[regular].max() < 1e-12
    assert np.abs(found - expected).max() < 1e-9
    damped = 0 if calibration.base.model == "nominal" else distance < MIN_SINGULARITY_DISTANCE
    assert np.array_equal(codes, np.broadcast_to(damped, codes.shape))


def test_compiled_c_stays_finite_at_exact_singularities(compiled: Callable) -> None:
    calibration = calibrated("fanuc-m1000ia", "local-poe", False)
    straight = replace(calibration, base=replace(calibration.base, geometry=GeometricErrors.none(6)))
    corrected, codes = run(compiled(straight), np.zeros((1, 6)))  # wrist axes 4 and 6 coincide, nothing to correct
    assert np.abs(corrected).max() < 1e-12
    assert codes[0] == 1


@pytest.mark.parametrize("base", ["nominal", "local-poe"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_compiled_c_returns_positions_that_are_not_finite_as_they_are(
    base: str, bad: float, compiled: Callable
) -> None:
    q = np.array([[0.1, 0.2, bad, 0.4, 0.5, 0.6]])
    corrected, codes = run(compiled(calibrated("fanuc-m1000ia", base, True)), q)
    assert codes[0] == 2
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


def test_c_code_is_the_golden_file() -> None:
    for suffix, text in zip(("h", "c"), calibration_as_c(round_numbers(), "planar_3r"), strict=True):
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
    return replace(
        calibration,
        robot=replace(calibration.robot, chain=replace(chain, placements=chain.placements.round(12) + 0.0)),
        base=replace(
            calibration.base,
            geometry=GeometricErrors(
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
