"""Structured Text computes what `one_step` computes: run as Python, and parsed by blark where that is installed."""

import os
import re

import numpy as np
import pytest
from exported import CASES, REGULAR, anywhere, calibrated
from structured_text import FunctionBlock

from calibtool.compensation.solve import one_step
from calibtool.errors import UsageError
from calibtool.export.rendering import SINGLE_ACCURACY, SINGLE_DISTANCE, Precision
from calibtool.export.structured_text import calibration_as_structured_text
from calibtool.robot.damped import MIN_SINGULARITY_DISTANCE
from calibtool.robot.se3 import Array


def corrected(text: str, q: Array) -> tuple[Array, Array]:
    """Corrected positions (N, n) and status (N,), from one instance after another call of it."""
    block = FunctionBlock(text)
    answers = [block(row) for row in q]
    return np.array([answer[0] for answer in answers]), np.array([answer[1] for answer in answers])


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_function_block_corrects_as_one_step_does(case: tuple[str, str, bool]) -> None:
    calibration = calibrated(*case)
    q = anywhere(calibration, 10)
    expected, distance = one_step(calibration, q)
    found, status = corrected(calibration_as_structured_text(calibration, "arm"), q)
    assert np.abs(found - expected)[distance >= REGULAR].max() < 1e-12
    assert np.abs(found - expected).max() < 1e-9
    damped = 0 if calibration.base.model == "nominal" else distance < MIN_SINGULARITY_DISTANCE
    assert np.array_equal(status, np.broadcast_to(damped, status.shape))


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "panda"])
def test_a_function_block_of_reals_keeps_what_its_header_says(name: str) -> None:
    calibration = calibrated(name, "everything", True)
    q = anywhere(calibration, 10).astype(np.float32)
    expected, distance = one_step(calibration, q.astype(float))
    text = calibration_as_structured_text(calibration, "arm", "single")
    found, _ = corrected(text, q)
    assert np.abs(found - expected)[distance >= SINGLE_DISTANCE].max() < SINGLE_ACCURACY
    assert " OF LREAL" not in text


def test_a_singular_configuration_is_damped_and_says_so() -> None:
    calibration = calibrated("planar-3r", "local-poe", True)
    rng = np.random.default_rng(0)
    q = np.column_stack([rng.random((5, 1)), np.zeros((5, 2))])  # stretched
    expected, distance = one_step(calibration, q)
    found, status = corrected(calibration_as_structured_text(calibration), q)
    assert (distance < MIN_SINGULARITY_DISTANCE).all()
    assert np.abs(found - expected).max() < 1e-9
    assert (status == 1).all()


@pytest.mark.parametrize("base", ["nominal", "local-poe"])
def test_positions_that_make_no_sense_come_back_as_they_are(base: str) -> None:
    q = np.array([[0.1, bad, 0.3] for bad in (np.nan, np.inf, -np.inf, 1e200, -2e6)])
    found, status = corrected(calibration_as_structured_text(calibrated("planar-3r", base, True)), q)
    assert (status == 2).all()
    assert np.array_equal(found, q, equal_nan=True)


@pytest.mark.parametrize(("precision", "size"), [("double", 8), ("single", 4)])
def test_the_memory_of_the_header_is_that_of_the_variables(precision: Precision, size: int) -> None:
    text = calibration_as_structured_text(calibrated("scara", "everything", True), "arm", precision)
    size_of = {int: 2, float: size, np.float32: size}
    expected = 0
    for value in FunctionBlock(text).variables.values():
        expected += sum(map(size_of.__getitem__, map(type, value.values() if isinstance(value, dict) else [value])))
    match = re.search(r"memory +(\d+) bytes", text)
    assert match
    assert int(match[1]) == expected


def parsed(text: str) -> None:
    """Read by blark, which takes a millisecond per character: initial values are shortened."""
    parse = pytest.importorskip("blark.parse", reason="blark, which parses Structured Text, is not installed")
    result = parse.parse_source_code(re.sub(r":= \[[^]]*\]", ":= [0.5, -1.0e-3]", text))
    assert result.exception is None
    assert result.tree is not None


def test_an_independent_parser_reads_a_block_without_kinematics() -> None:
    parsed(calibration_as_structured_text(calibrated("planar-3r", "nominal", True), "arm"))


@pytest.mark.skipif("CALIBTOOL_SLOW_TESTS" not in os.environ, reason="takes half a minute; set CALIBTOOL_SLOW_TESTS=1")
def test_an_independent_parser_reads_a_whole_block() -> None:
    parsed(calibration_as_structured_text(calibrated("planar-3r", "everything", True), "arm"))


@pytest.mark.parametrize("name", ["", "3r", "my-arm", "a__b", "arm_", "größe", "If", "REAL", "a b"])
def test_a_name_that_no_function_block_can_have_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match="name of a function block"):
        calibration_as_structured_text(calibrated("fanuc-m1000ia", "nominal", False), name)


def test_lines_are_plain_and_short() -> None:
    text = calibration_as_structured_text(calibrated("scara", "everything", True), "arm")
    assert text.isascii()
    assert max(map(len, text.splitlines())) <= 125
