"""One row in, one row out: the answers are those of compensate, whatever comes between."""

import json
import struct

import numpy as np
import pytest
from exported import anywhere, calibrated

from calibtool.calibration import Calibration
from calibtool.compensation.row_by_row import NOT_FINITE, STATUSES, Live
from calibtool.compensation.solve import compensate_joints
from calibtool.compensation.stream import StreamOptions, compensate_text
from calibtool.robot.se3 import Array

CASES = [("fanuc-m1000ia", "controller"), ("fanuc-m1000ia", "serial"), ("scara", "serial")]


def answered(live: Live, value: object) -> dict[str, object]:
    text = live.object_answer(json.dumps(value).encode())
    assert text.endswith(b"\n")
    return json.loads(text)


def targets(calibration: Calibration, count: int = 10) -> Array:
    robot = calibration.robot
    q = anywhere(calibration, count)
    return np.clip(q, robot.lower + 0.1, robot.upper - 0.1)


@pytest.mark.parametrize(("name", "values"), CASES)
@pytest.mark.parametrize("method", ["one-step", "exact"])
def test_rows_are_answered_as_by_compensate(name: str, values: str, method: str) -> None:
    calibration = calibrated(name, "everything", True)
    robot = calibration.robot
    live = Live(calibration, values, method)
    serial = targets(calibration)
    expected = compensate_joints(calibration, serial, method).q
    shown = robot.serial_as(values, serial)
    found = np.array([live.corrected(q)[0] for q in shown])
    np.testing.assert_allclose(robot.serial_from(values, found), expected, atol=1e-12)


def test_objects_have_the_names_units_and_statuses_of_tables() -> None:
    calibration = calibrated("scara", "everything", True)
    serial = targets(calibration)
    columns = ["j1_deg", "j2_rad", "j3_mm", "j4_deg"]
    factors = np.array([np.pi / 180, 1.0, 1e-3, np.pi / 180])
    table = ",".join(columns) + "\n"
    table += "".join(",".join(repr(float(v)) for v in q / factors) + "\n" for q in serial)
    text, _ = compensate_text(calibration, table, "rows", StreamOptions(method="one-step"))
    live = Live(calibration, "serial")
    for q, line in zip(serial, text.splitlines()[1:], strict=True):
        given = dict(zip(columns, (q / factors).tolist(), strict=True))
        answer = answered(live, {"id": 7, **given, "t": "now"})
        cells = line.split(",")
        for column, cell in zip(columns, cells, strict=False):
            assert answer[column] == pytest.approx(float(cell), abs=1e-5)
        assert answer["status"] == cells[len(columns)]
        assert list(answer) == ["id", *columns, "t", "status"]
        assert (answer["id"], answer["t"]) == (7, "now")


def test_binary_rows_hold_the_same_numbers() -> None:
    calibration = calibrated("panda", "everything", True)
    live, again = Live(calibration, "serial"), Live(calibration, "serial")
    for q in targets(calibration):
        row = live.row_answer(struct.pack("<7d", *q))
        *joints, code = struct.unpack("<8d", row)
        expected, status = again.corrected(q)
        assert joints == expected.tolist()
        assert STATUSES[int(code)] == status


@pytest.mark.parametrize(
    ("line", "word"),
    [
        (b"", "not JSON"),
        (b"{", "not JSON"),
        (b"[1, 2, 3]", "expected one JSON object"),
        (b'{"j1_deg": 1, "j2_deg": 2}', "no j3_deg in the object"),
        (b'{"j1_deg": 1, "j2_deg": 2, "j3_mm": 2}', "joint 3 is revolute"),
        (b'{"j1_deg": 1, "j2_deg": 2, "j3_deg": "x"}', "'j3_deg' is \"x\"; expected a number"),
        (b'{"j1_deg": 1, "j2_deg": 2, "j3_deg": true}', "expected a number"),
        (b'{"j1_deg": 1, "j1_rad": 1, "j2_deg": 2, "j3_deg": 3}', "joint 1 twice"),
        (b'{"x_mm": 1}', "no j1_deg, j2_deg, j3_deg in the object"),
        (b'{"j1_deg": 1, "j2_deg": 2, "j3_deg": 3, "t": NaN}', "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b'{"j1_deg": "\xff"}', "not JSON"),
    ],
)
def test_a_line_that_is_no_row_is_answered_and_changes_nothing(line: bytes, word: str) -> None:
    calibration = calibrated("planar-3r", "local-poe", False)
    live, other = Live(calibration, "serial"), Live(calibration, "serial")
    good = {"j1_deg": 10, "j2_deg": 40, "j3_deg": -30}
    assert word in json.loads(live.object_answer(line))["error"]
    assert answered(live, good) == answered(other, good)


def test_positions_that_are_none_come_back_as_they_are() -> None:
    calibration = calibrated("planar-3r", "local-poe", False)
    live = Live(calibration, "serial")
    for value in (np.nan, np.inf, 1e7):
        q = np.array([0.1, value, 0.2])
        moved, status = live.corrected(q)
        assert status == NOT_FINITE
        np.testing.assert_array_equal(moved, q)
        *joints, code = struct.unpack("<4d", live.row_answer(struct.pack("<3d", *q)))
        assert STATUSES[int(code)] == NOT_FINITE
        np.testing.assert_array_equal(joints, q)
    answer = json.loads(live.object_answer(b'{"j1_deg": 1, "j2_deg": 1e999, "j3_deg": 3}'))
    assert (answer["j2_deg"], answer["status"]) == (None, NOT_FINITE)


def test_backlash_follows_the_motion_of_each_client() -> None:
    calibration = calibrated("planar-3r", "local-poe", False)
    widths = np.full(3, 1e-3)
    errors = calibration.base.errors.having(backlash=widths)
    from dataclasses import replace

    worn = replace(calibration, base=replace(calibration.base, errors=errors))
    up, down = Live(worn, "serial"), Live(worn, "serial")
    plain = Live(worn, "serial", backlash=False)
    q, step = np.array([0.3, 0.7, -0.5]), np.full(3, 0.05)
    up.corrected(q - step), down.corrected(q + step)
    higher, lower = up.corrected(q)[0], down.corrected(q)[0]
    np.testing.assert_allclose(higher - lower, 2 * widths, atol=1e-12)
    np.testing.assert_allclose((higher + lower) / 2, plain.corrected(q)[0], atol=1e-12)
