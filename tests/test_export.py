"""Exported corrections compute what `one_step` computes: a reader of the JSON file alone, and the
compiled C code.

After a wanted change of the templates: CALIBTOOL_UPDATE_GOLDEN=1 pytest tests/test_export.py,
and read the diff.
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
from typing import Any

import numpy as np
import pytest
from exported import (
    CASES,
    STATUS,
    TURNING_CASES,
    anywhere,
    calibrated,
    turning,
    turning_by,
    undisturbed,
    weighted_sizes,
)
from hypothesis import given
from hypothesis import strategies as st
from json_reader import correct_from_json
from structured_text import FunctionBlock

from calibtool.calibration import Calibration
from calibtool.compensation.one_step import default_bounds, one_step
from calibtool.equivalent.joints import EquivalentRobot
from calibtool.equivalent.network import Network
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import UsageError
from calibtool.export.as_json import calibration_as_json
from calibtool.export.c_code import calibration_as_c
from calibtool.export.rendering import SINGLE_ACCURACY, SINGLE_LARGEST, Precision
from calibtool.export.structured_text import calibration_as_structured_text
from calibtool.robot.coupling import JointValues
from calibtool.robot.se3 import Array

GCC = shutil.which("gcc")
FLAGS = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-pedantic",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Werror",
    "-O1",
]
SINGLE_CASES = [case for case in CASES if case[1] == "everything" or case[0] in ("scara", "gantry")]
CORRECTING = [case for case in CASES if case[1:] != ("nominal", False)]
GOLDEN = Path(__file__).parent / "golden"

# --- JSON -----------------------------------------------------------------------------------------


def joints_from_json(c: dict, q: Array) -> Array:
    """Corrected joints with whose joint values q and the answer are, as `joint_values` says."""
    if c["joint_values"] == "serial":
        return correct_from_json(c, q)[0]
    serial = c["joint_coupling"] @ q
    change = correct_from_json(c, serial)[0] - serial
    return q + np.linalg.solve(c["joint_coupling"], change)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_reader_of_the_json_alone_corrects_as_one_step_does(case: tuple[str, str, bool]) -> None:
    calibration = calibrated(*case)
    q = anywhere(calibration, 30)
    contents = json.loads(calibration_as_json(calibration))
    expected = one_step(calibration, q)
    found = [correct_from_json(contents, row) for row in q]
    difference = np.abs(np.array([row for row, _ in found]) - expected.q)
    plain = undisturbed(calibration, q)
    assert plain.sum() > 10
    assert difference[plain].max() < 1e-11
    assert difference.max() < 1e-8
    assert [status for _, status in found] == expected.status.tolist()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200, -1e7])
def test_a_reader_of_the_json_leaves_nonsense_as_it_is(bad: float) -> None:
    contents = json.loads(calibration_as_json(calibrated("planar-3r", "local-poe", True)))
    q = np.array([0.1, bad, 0.3])
    found, status = correct_from_json(contents, q)
    assert np.array_equal(found, q, equal_nan=True)
    assert status == "not-finite"


def test_json_holds_every_number_exactly_and_is_deterministic() -> None:
    calibration = calibrated("scara", "local-poe", True)
    text = calibration_as_json(calibration)
    contents = json.loads(text)
    assert calibration.network is not None
    assert np.array_equal(contents["network"]["hidden_weights"], calibration.network.hidden_weights)
    assert np.array_equal(
        contents["base_model"]["placement_errors_m_rad"], calibration.base.errors["placements"]
    )
    assert np.array_equal(contents["nominal_placements_m"], calibration.robot.chain.placements)
    assert np.array_equal(
        [j["upper_rad_or_m"] for j in contents["joints"]], calibration.robot.upper
    )
    assert [j["kind"] for j in contents["joints"]].count("prismatic") == 1
    assert (contents["schema"], contents["schema_version"]) == ("calibtool/compensator", 4)
    assert text.endswith("}\n")
    assert text == calibration_as_json(calibration)


# --- C --------------------------------------------------------------------------------------------


LOOP = """
#include "arm.h"
void many(int count, const {real} *q, {real} *q_m, int *codes)
{{
    for (int k = 0; k < count; k++)
        codes[k] = arm_correct(q + k * ARM_N, q_m + k * ARM_N);
}}
"""


def built(
    calibration: Calibration,
    folder: Path,
    precision: Precision = "double",
    joint_values: JointValues = "serial",
) -> ctypes.CDLL:
    """A calibration's C code as a library, compiled with warnings as errors."""
    header, source = calibration_as_c(calibration, "arm", precision, joint_values)
    (folder / "arm.h").write_text(header, encoding="ascii")
    (folder / "arm.c").write_text(source, encoding="ascii")
    (folder / "loop.c").write_text(LOOP.format(real="double" if precision == "double" else "float"))
    library = folder / "arm.so"
    sources = [folder / "arm.c", folder / "loop.c"]
    subprocess.run(
        [str(GCC), *FLAGS, "-shared", "-fPIC", "-o", library, *sources, "-lm"], check=True
    )
    return ctypes.CDLL(str(library))


@pytest.fixture
def compiled(tmp_path: Path) -> Callable[..., ctypes.CDLL]:
    """Compile a calibration's C code; skips where there is no gcc."""
    if GCC is None:
        pytest.skip("gcc is not installed, so the generated C code cannot be compiled")

    def build(
        calibration: Calibration,
        precision: Precision = "double",
        joint_values: JointValues = "serial",
    ) -> ctypes.CDLL:
        return built(calibration, tmp_path, precision, joint_values)

    return build


def run(library: ctypes.CDLL, q: Array) -> tuple[Array, Array]:
    """Corrected positions (N, n), in the precision of q, and return codes (N,)."""
    q = np.ascontiguousarray(q)
    corrected, codes = np.empty_like(q), np.empty(len(q), dtype=np.intc)
    library.many(len(q), *(ctypes.c_void_p(array.ctypes.data) for array in (q, corrected, codes)))
    return corrected, codes


def names(codes: Array) -> list[str]:
    return [STATUS[code] for code in codes]


@pytest.mark.parametrize("case", CORRECTING, ids=str)
def test_compiled_c_corrects_as_one_step_does(
    case: tuple[str, str, bool], compiled: Callable
) -> None:
    calibration = calibrated(*case)
    q = anywhere(calibration, 10_000)
    expected = one_step(calibration, q)
    found, codes = run(compiled(calibration), q)
    plain = undisturbed(calibration, q)
    assert plain.mean() > 0.5
    difference = np.abs(found - expected.q)
    assert difference[plain].max() < 1e-12
    assert difference.max() < 1e-8
    assert names(codes) == expected.status.tolist()


@pytest.mark.parametrize("case", TURNING_CASES, ids=str)
def test_compiled_c_is_for_the_payload_and_temperature_asked_for_and_holds_turns_of_frames(
    case: tuple[str, str, bool], compiled: Callable
) -> None:
    calibration, loaded = calibrated(*case), turning(*case)
    q = anywhere(loaded, 1000)
    expected = one_step(loaded, q).q
    found, _ = run(compiled(loaded), q)
    calm = undisturbed(loaded, q)
    assert np.abs(found - expected)[calm].max() < 1e-12
    assert np.abs(one_step(calibration, q).q - expected)[calm].max() > 1e-5


@pytest.mark.parametrize("family", ["bending", "wobble", "payload", "pairs"])
def test_each_turn_of_frames_alone_is_exported(family: str, compiled: Callable) -> None:
    calibration, alone = calibrated("fanuc-m1000ia", "local-poe", False), turning_by(family)
    q = anywhere(alone, 1000)
    expected = one_step(alone, q).q
    calm = undisturbed(alone, q)
    assert np.abs(run(compiled(alone), q)[0] - expected)[calm].max() < 1e-12
    assert np.abs(one_step(calibration, q).q - expected)[calm].max() > 1e-5
    contents = json.loads(calibration_as_json(alone))
    for k in np.flatnonzero(calm)[:5]:
        np.testing.assert_allclose(correct_from_json(contents, q[k])[0], expected[k], atol=1e-9)


@pytest.mark.skipif(GCC is None, reason="no gcc")
@pytest.mark.parametrize("case", TURNING_CASES, ids=str)
def test_the_header_states_no_less_than_the_stack_that_gcc_counts(
    case: tuple[str, str, bool], tmp_path: Path
) -> None:
    header, source = calibration_as_c(turning(*case), "arm")
    (tmp_path / "arm.h").write_text(header)
    (tmp_path / "arm.c").write_text(source)
    subprocess.run(
        [str(GCC), "-std=c99", "-O2", "-fstack-usage", "-c", "arm.c"], cwd=tmp_path, check=True
    )
    lines = [line.split("\t") for line in (tmp_path / "arm.su").read_text().splitlines()]
    used = {place.split(":")[-1]: int(size) for place, size, _ in lines}
    deepest = sum(used.get(name, 0) for name in ("arm_correct", "pose_error", "exp6_change"))
    stated = re.search(r"stack +about (\d+) bytes", header)
    assert stated
    assert 3000 < deepest <= int(stated[1]) < 1.3 * deepest


def test_compiled_c_corrects_nothing_where_nothing_was_identified(compiled: Callable) -> None:
    calibration = calibrated("fanuc-m1000ia", "nominal", False)
    q = anywhere(calibration, 100)
    found, codes = run(compiled(calibration), q)
    assert np.array_equal(found, q)
    assert not codes.any()


@pytest.mark.parametrize("case", CORRECTING, ids=str)
def test_compiled_c_makes_no_row_worse(case: tuple[str, str, bool], compiled: Callable) -> None:
    """Judged by the calibrated model itself.

    A joint moves by no more than the bound, rows left alone say so.
    """
    calibration = calibrated(*case)
    q = anywhere(calibration, 10_000)
    found, codes = run(compiled(calibration), q)
    before, after = (weighted_sizes(calibration, x, q) for x in (q, found))
    assert (after <= before).all()
    assert np.array_equal(
        found[codes == STATUS.index("uncorrected")], q[codes == STATUS.index("uncorrected")]
    )
    assert after[codes == 0].max() <= 5 * np.median(after)
    bounds = default_bounds(calibration)
    assert (np.abs(found - q) <= bounds.of_joints(calibration.robot) + 1e-15).all()


@pytest.mark.parametrize("case", SINGLE_CASES, ids=str)
def test_compiled_c_in_single_precision_keeps_what_its_header_says(
    case: tuple[str, str, bool], compiled: Callable
) -> None:
    calibration = calibrated(*case)
    q = anywhere(calibration, 10_000).astype(np.float32)
    expected = one_step(calibration, q.astype(float))
    found, codes = run(compiled(calibration, "single"), q)
    plain = undisturbed(calibration, q.astype(float))
    assert plain.mean() > 0.5
    apart = np.abs(found - expected.q)[plain].max(axis=-1)
    assert np.quantile(apart, 0.999) < SINGLE_ACCURACY
    assert apart.max() < SINGLE_LARGEST
    assert (np.array(names(codes)) == expected.status).mean() > 0.999
    before, after = (
        weighted_sizes(calibration, x.astype(float), q.astype(float)) for x in (q, found)
    )
    assert (after <= before + SINGLE_ACCURACY).all()
    header, source = calibration_as_c(calibration, "arm", "single")
    assert "1e-06 rad or m of double precision" in header
    assert not re.search(r"\bdouble\b", source)


def test_compiled_c_stays_finite_at_exact_singularities(compiled: Callable) -> None:
    calibration = calibrated("fanuc-m1000ia", "local-poe", False)
    straight = replace(
        calibration, base=replace(calibration.base, errors=RobotErrors.of(calibration.robot))
    )
    corrected, codes = run(
        compiled(straight), np.zeros((1, 6))
    )  # wrist axes 4 and 6 coincide, nothing to correct
    assert np.abs(corrected).max() < 1e-12
    assert codes[0] == 1


def test_q_may_be_its_own_correction(compiled: Callable) -> None:
    calibration = calibrated("scara", "everything", True)
    library, q = compiled(calibration), anywhere(calibration, 100)
    expected, codes = run(library, q)
    again = np.empty_like(codes)
    library.many(len(q), *(ctypes.c_void_p(array.ctypes.data) for array in (q, q, again)))
    assert np.array_equal(q, expected)
    assert np.array_equal(again, codes)


NONSENSE = [
    ("fanuc-m1000ia", "nominal", True),
    ("fanuc-m1000ia", "nominal", False),
    ("scara", "everything", True),
]


@pytest.fixture(
    scope="module", params=[(*case, p) for case in NONSENSE for p in ("double", "single")], ids=str
)
def library(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Calibration, str, Any]:
    """Code of each kind and precision, compiled once for many examples."""
    if GCC is None:
        pytest.skip("gcc is not installed, so the generated C code cannot be compiled")
    *case, precision = request.param
    calibration = calibrated(*case)
    return calibration, precision, built(calibration, tmp_path_factory.mktemp("c"), precision)


@given(st.data())
def test_whatever_comes_in_no_large_number_comes_out(
    library: tuple[Calibration, str, Any], data: st.DataObject
) -> None:
    """Not a number, infinite or beyond 1e6: the same bits come back.

    Anything else moves by the bound at most.
    """
    calibration, precision, code = library
    n, kind = calibration.robot.n, np.float64 if precision == "double" else np.float32
    extremes = st.sampled_from(
        [np.nan, np.inf, -np.inf, 1e6, -1e6, 1.001e6, 1e38, -1e38, 0.0, -0.0, 1e-40, np.pi]
    )
    values = st.one_of(extremes, st.floats(width=32), st.floats(-7, 7))
    with np.errstate(over="ignore"):
        q = np.array([data.draw(st.lists(values, min_size=n, max_size=n))]).astype(kind)
    found, codes = run(code, q)
    if not (np.abs(q) <= 1e6).all():
        assert codes[0] == STATUS.index("not-finite")
        assert found.tobytes() == q.tobytes()
        return
    assert codes[0] != STATUS.index("not-finite")
    most = default_bounds(calibration).of_joints(calibration.robot)
    step = np.abs(found.astype(float) - q)
    assert (step <= most + np.spacing(np.abs(q)) + 1e-7 * most).all()
    if codes[0] == STATUS.index("uncorrected"):
        assert found.tobytes() == q.tobytes()


@pytest.mark.parametrize("flag", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
@pytest.mark.parametrize("case", NONSENSE, ids=str)
def test_arithmetic_without_infinities_stops_compilation(
    flag: str, case: tuple[str, str, bool], compiled: Callable, tmp_path: Path
) -> None:
    compiled(calibrated(*case))  # writes the files, and compiles without the flag
    command = [str(GCC), "-std=c99", flag, "-c", "-o", "arm.o", "arm.c"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode != 0
    assert "compile it without -ffast-math" in result.stderr
    assert not (tmp_path / "arm.o").exists()


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
    """A made-up calibration of numbers that no processor rounds: not trained, no rotation in its
    placements' errors.
    """
    calibration = calibrated("planar-3r", "local-poe", False)
    chain = calibration.robot.chain
    shifts = np.array([[1.0, 0, 0], [0, 2.0, 0], [0, 0, -1.0], [0, 0, 3.0]]) / 1024
    network = Network(
        input_centre=np.array([0.0, 1.0, 0.25]),
        input_scale=np.array([1.0, 0.5, 2.0]),
        hidden_weights=np.array([[1.0, -0.5, 0.25], [0.0, 2.0, -1.0]]),
        hidden_bias=np.array([0.5, -0.125]),
        output_weights=np.array(
            [[1.0, -1.0], [0.5, 0.25], [0.0, 1.0], [2.0, 0.0], [-0.5, 0.5], [1.0, 1.0]]
        ),
        output_bias=np.array([0.0, 0.5, -0.5, 0.25, 0.0, 1.0]),
        output_scale=np.full(6, 1 / 1024),
    )
    robot = replace(
        calibration.robot, chain=replace(chain, placements=chain.placements.round(12) + 0.0)
    )
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
        ["nm", "-g", "--defined-only", tmp_path / "arm.o"],
        check=True,
        capture_output=True,
        text=True,
    )
    assert {line.split()[-1] for line in listed.stdout.splitlines()} == {
        "arm_correct",
        "arm_network",
    }


# --- coupled joint values -------------------------------------------------------------------------


def test_json_holds_the_coupling_and_states_what_it_is() -> None:
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


def controller_case(base: str, count: int) -> tuple[Calibration, Array, Array, np.ndarray]:
    """A FANUC's calibration, the controller's joint values, their correction, rows to compare."""
    calibration = calibrated("fanuc-m1000ia", base, True)
    q = anywhere(calibration, count)
    shown, corrected = q.copy(), one_step(calibration, q).q.copy()
    for values in (shown, corrected):
        values[:, 2] -= values[:, 1]
    return calibration, shown, corrected, undisturbed(calibration, q)


@pytest.mark.parametrize("base", ["nominal", "everything"])
def test_exports_take_and_give_a_controller_s_joint_values(base: str, compiled: Callable) -> None:
    calibration, shown, expected, regular = controller_case(base, 40)
    assert regular.mean() > 0.5
    found, codes = run(compiled(calibration, "double", "controller"), shown)
    assert np.abs(found - expected)[regular].max() < 1e-12
    assert names(codes) == one_step(calibration, anywhere(calibration, 40)).status.tolist()
    block = FunctionBlock(
        calibration_as_structured_text(calibration, "arm", joint_values="controller")
    )
    found = np.array([block(row)[0] for row in shown[regular]])
    assert np.abs(found - expected[regular]).max() < 1e-12
    contents = json.loads(calibration_as_json(calibration, "controller"))
    found = np.array([joints_from_json(contents, row) for row in shown[regular]])
    assert np.abs(found - expected[regular]).max() < 1e-11


def test_a_controller_s_positions_that_are_not_finite_come_back_as_they_are(
    compiled: Callable,
) -> None:
    q = np.array([[0.1, bad, 0.3, 0.1, 0.2, 0.3] for bad in (np.nan, np.inf, -np.inf)])
    found, codes = run(
        compiled(calibrated("fanuc-m1000ia", "everything", True), "double", "controller"), q
    )
    np.testing.assert_array_equal(found, q)
    assert (codes == 2).all()


@pytest.mark.parametrize("values", ["serial", "controller"])
def test_exported_code_states_whose_joint_values_it_takes(values: JointValues) -> None:
    calibration = calibrated("fanuc-m1000ia", "nominal", True)
    header, _ = calibration_as_c(calibration, "arm", joint_values=values)
    text = calibration_as_structured_text(calibration, "arm", joint_values=values)
    word = "serial chain" if values == "serial" else "controller"
    for written in (header, text):
        assert re.search(rf"joint values of the {word}:\s+q3 = J3 \+ J2", written)
    assert json.loads(calibration_as_json(calibration, values))["joint_values"] == values
    assert all(len(line) <= 125 for line in text.splitlines())
