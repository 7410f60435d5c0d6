"""Structured Text computes what `one_step` computes: run as Python, and parsed by blark where
that is installed.
"""

import os
import re
from collections.abc import Callable

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
from structured_text import FunctionBlock

from calibtool.calibration import Calibration
from calibtool.compensation.one_step import default_bounds, one_step
from calibtool.errors import UsageError
from calibtool.export.rendering import (
    LARGEST_POSITION,
    SINGLE_ACCURACY,
    SINGLE_LARGEST,
    Precision,
)
from calibtool.export.structured_text import RESERVED, calibration_as_structured_text
from calibtool.robot.se3 import Array

CORRECTING = [case for case in CASES if case[1:] != ("nominal", False)]


def corrected(text: str, q: Array) -> tuple[Array, Array]:
    """Corrected positions (N, n) and status (N,), from one instance after another call of it."""
    block = FunctionBlock(text)
    answers = [block(row) for row in q]
    return np.array([answer[0] for answer in answers]), np.array([answer[1] for answer in answers])


def names(codes: Array) -> list[str]:
    return [STATUS[code] for code in codes]


@pytest.mark.parametrize("case", CORRECTING, ids=str)
def test_a_function_block_corrects_as_one_step_does(case: tuple[str, str, bool]) -> None:
    calibration = calibrated(*case)
    q = anywhere(calibration, 40)
    expected = one_step(calibration, q)
    found, status = corrected(calibration_as_structured_text(calibration, "arm"), q)
    plain = undisturbed(calibration, q)
    assert plain.sum() > 10
    difference = np.abs(found - expected.q)
    assert difference[plain].max() < 1e-12
    assert difference.max() < 1e-8
    assert names(status) == expected.status.tolist()
    before, after = (weighted_sizes(calibration, x, q) for x in (q, found))
    assert (after <= before).all()


@pytest.mark.parametrize("case", TURNING_CASES, ids=str)
def test_a_function_block_holds_turns_of_frames_payload_and_temperature(
    case: tuple[str, str, bool],
) -> None:
    calibration, loaded = calibrated(*case), turning(*case)
    q = anywhere(loaded, 30)
    expected = one_step(loaded, q)
    text = calibration_as_structured_text(loaded, "arm")
    found, status = corrected(text, q)
    calm = undisturbed(loaded, q)
    assert np.abs(found - expected.q)[calm].max() < 1e-12
    assert names(status) == expected.status.tolist()
    assert np.abs(one_step(calibration, q).q - expected.q)[calm].max() > 1e-5
    assert "8 kg at the tool, links at 45 C" in text
    assert max(map(len, text.splitlines())) <= 125


@pytest.mark.parametrize("family", ["bending", "wobble", "payload", "pairs"])
def test_a_function_block_holds_each_turn_of_frames_alone(family: str) -> None:
    alone = turning_by(family)
    q = anywhere(alone, 20)
    expected = one_step(alone, q).q
    found, _ = corrected(calibration_as_structured_text(alone), q)
    calm = undisturbed(alone, q)
    assert calm.sum() > 5
    assert np.abs(found - expected)[calm].max() < 1e-12


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "scara"])
def test_a_function_block_of_reals_holds_turns_of_frames(name: str) -> None:
    loaded = turning(name, "everything", True)
    q = anywhere(loaded, 20).astype(np.float32)
    expected = one_step(loaded, q.astype(float))
    found, status = corrected(calibration_as_structured_text(loaded, "arm", "single"), q)
    apart = np.abs(found - expected.q)[undisturbed(loaded, q.astype(float))].max(axis=-1)
    assert np.quantile(apart, 0.999) < SINGLE_ACCURACY
    assert names(status) == expected.status.tolist()


def test_a_function_block_corrects_nothing_where_nothing_was_identified() -> None:
    calibration = calibrated("fanuc-m1000ia", "nominal", False)
    q = anywhere(calibration, 10)
    found, status = corrected(calibration_as_structured_text(calibration), q)
    assert np.array_equal(found, q)
    assert not status.any()


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "panda", "scara"])
def test_a_function_block_of_reals_keeps_what_its_header_says(name: str) -> None:
    calibration = calibrated(name, "everything", True)
    q = anywhere(calibration, 20).astype(np.float32)
    expected = one_step(calibration, q.astype(float))
    text = calibration_as_structured_text(calibration, "arm", "single")
    found, status = corrected(text, q)
    plain = undisturbed(calibration, q.astype(float))
    apart = np.abs(found - expected.q)[plain].max(axis=-1)
    assert np.quantile(apart, 0.999) < SINGLE_ACCURACY
    assert apart.max() < SINGLE_LARGEST
    assert names(status) == expected.status.tolist()
    assert " OF LREAL" not in text


def test_a_singular_configuration_is_damped_and_is_marked() -> None:
    calibration = calibrated("planar-3r", "local-poe", True)
    rng = np.random.default_rng(0)
    q = np.column_stack([rng.random((5, 1)), np.zeros((5, 2))])  # stretched
    expected = one_step(calibration, q)
    found, status = corrected(calibration_as_structured_text(calibration), q)
    assert np.abs(found - expected.q).max() < 1e-9
    assert names(status) == expected.status.tolist()
    assert (status != 0).all()


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("base", ["nominal", "local-poe", "everything"])
def test_positions_that_make_no_sense_come_back_as_they_are(
    base: str, precision: Precision
) -> None:
    q = np.array([[0.1, bad, 0.3] for bad in (np.nan, np.inf, -np.inf, 1e37, -2e6, 1.001e6)])
    q = np.concatenate([q, q[:, [1, 0, 2]], q[:, [0, 2, 1]]])
    found, status = corrected(
        calibration_as_structured_text(calibrated("planar-3r", base, True), "arm", precision), q
    )
    assert (status == STATUS.index("not-finite")).all()
    expected = q if precision == "double" else q.astype(np.float32)
    assert np.array_equal(found, expected, equal_nan=True)


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize(
    "case", [("planar-3r", "nominal"), ("scara", "everything"), ("fanuc-m1000ia", "local-poe")]
)
def test_positions_far_outside_the_limits_move_by_the_bound_at_most(
    case: tuple[str, str], precision: Precision
) -> None:
    calibration = calibrated(*case, True)
    rng, n = np.random.default_rng(3), calibration.robot.n
    q = 10.0 ** rng.uniform(-40, np.log10(LARGEST_POSITION), (30, n)) * rng.choice([-1, 1], (30, n))
    found, status = corrected(calibration_as_structured_text(calibration, "arm", precision), q)
    given = q if precision == "double" else q.astype(np.float32)
    most = default_bounds(calibration).of_joints(calibration.robot)
    assert (np.abs(found - given) <= most * (1 + 1e-6) + np.spacing(np.abs(given))).all()
    assert STATUS.index("not-finite") not in status


def test_no_variable_has_the_name_of_a_standard_word() -> None:
    made = [calibrated(*case) for case in CORRECTING] + [turning(*case) for case in TURNING_CASES]
    for calibration in made:
        block = FunctionBlock(calibration_as_structured_text(calibration))
        assert not set(block.variables) & set(RESERVED.split())


@pytest.mark.parametrize(("precision", "size"), [("double", 8), ("single", 4)])
@pytest.mark.parametrize("made", [calibrated, turning])
def test_the_memory_of_the_header_is_that_of_the_variables(
    made: Callable[..., Calibration], precision: Precision, size: int
) -> None:
    text = calibration_as_structured_text(made("scara", "everything", True), "arm", precision)
    size_of = {int: 2, float: size, np.float32: size}
    expected = 0
    for value in FunctionBlock(text).variables.values():
        expected += sum(
            map(
                size_of.__getitem__,
                map(type, value.values() if isinstance(value, dict) else [value]),
            )
        )
    match = re.search(r"memory +(\d+) bytes", text)
    assert match
    assert int(match[1]) == expected


def parsed(text: str) -> None:
    """Read by blark, which takes a millisecond per character: initial values are shortened."""
    parse = pytest.importorskip(
        "blark.parse", reason="blark, which parses Structured Text, is not installed"
    )
    result = parse.parse_source_code(re.sub(r":= \[[^]]*\]", ":= [0.5, -1.0e-3]", text))
    assert result.exception is None
    assert result.tree is not None


def test_an_independent_parser_reads_a_block_without_kinematics() -> None:
    parsed(calibration_as_structured_text(calibrated("planar-3r", "nominal", True), "arm"))


@pytest.mark.skipif(
    "CALIBTOOL_SLOW_TESTS" not in os.environ,
    reason="takes half a minute; set CALIBTOOL_SLOW_TESTS=1",
)
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
