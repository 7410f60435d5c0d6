"""Streams of targets: batches do not show, JSON and CSV agree, paths stay on a branch, and what
is left is true.
"""

import io
import json
from functools import cache

import numpy as np
import pytest

from calibtool.calibration import Calibration, identify
from calibtool.compensation import stream as module
from calibtool.compensation.solve import compensate_joints
from calibtool.compensation.stream import (
    RowFormat,
    StreamOptions,
    StreamReport,
    compensate_stream,
    compensate_text,
)
from calibtool.compensation.targets import guarded
from calibtool.errors import InputError
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array

HEADER = "j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg"


@cache
def calibrated(name: str = "ur5", model: str = "local-poe") -> Calibration:
    robot = load_robot(name)
    simulation = Simulation(seed=1, configurations=30)
    return identify(simulate(robot, simulation), model)


def joints(count: int) -> Array:
    robot = load_robot("ur5")
    return sample_configurations(robot, robot.workspace(), count, np.random.default_rng(3))


def joint_csv(q: Array) -> str:
    return (
        HEADER + "\n" + "".join(",".join(f"{v:.12g}" for v in np.rad2deg(row)) + "\n" for row in q)
    )


def pose_csv(T: Array) -> str:
    lines = ["x_mm,y_mm,z_mm,rx_rad,ry_rad,rz_rad"]
    from scipy.spatial.transform import Rotation

    for pose in T:
        values = [*(pose[:3, 3] * 1e3), *Rotation.from_matrix(pose[:3, :3]).as_rotvec()]
        lines.append(",".join(f"{v:.15g}" for v in values))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("batch", [1, 7, 100])
def test_the_size_of_batches_does_not_show(batch: int) -> None:
    q = joints(20)
    for text in (
        joint_csv(q),
        pose_csv(load_robot("ur5").mechanism.forward(q[np.argsort(q[:, 0])])),
    ):
        whole, _ = compensate_text(calibrated(), text, "t.csv")
        parts, report = compensate_text(calibrated(), text, "t.csv", StreamOptions(batch=batch))
        a, b = (
            np.loadtxt(io.StringIO(t), delimiter=",", skiprows=1, usecols=range(6))
            for t in (whole, parts)
        )
        assert np.abs(a - b).max() < 1e-9
        assert whole.splitlines()[0] == parts.splitlines()[0]
        assert report.rows == 20


def test_lines_are_taken_only_as_they_are_needed() -> None:
    taken = []

    def lines() -> object:
        for line in joint_csv(joints(9)).splitlines(keepends=True):
            taken.append(line)
            yield line

    stream = compensate_stream(
        calibrated(), lines(), "t.csv", StreamOptions(batch=3), StreamReport()
    )
    next(stream)
    assert len(taken) == 4  # the header and three rows


def test_json_lines_state_the_same_as_csv() -> None:
    q = joints(5)
    rows, _ = compensate_text(calibrated(), joint_csv(q), "t.csv")
    objects = [
        {
            "name": "é",
            **{f"j{j + 1}_deg": v for j, v in enumerate(row)},
            "speed": 0.5,
            "tags": [1, None],
        }
        for row in np.rad2deg(q).tolist()
    ]
    lines = [json.dumps(given) + "\n" for given in objects]
    text = "".join(
        compensate_stream(calibrated(), lines, "t", StreamOptions(), StreamReport(), "ndjson")
    )
    found = [json.loads(line) for line in text.splitlines()]
    for row, answer in zip(rows.splitlines()[1:], found, strict=True):
        cells = row.split(",")
        assert [answer[f"j{j + 1}_deg"] for j in range(6)] == pytest.approx(
            [float(c) for c in cells[:6]], abs=1e-9
        )
        assert (answer["status"], answer["name"], answer["speed"], answer["tags"]) == (
            cells[6],
            "é",
            0.5,
            [1, None],
        )


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["[1]\n"], "t:1: expected one JSON object per line"),
        (['{"j1_deg": 1}\n', "{\n"], "t:2: not JSON"),
        (['{"a": 1}\n', '{"b": 1}\n'], "t:2: key 'a' is not in every object"),
        ([" \n"], "t: empty; expected one JSON object per line"),
    ],
)
def test_bad_json_is_named_by_its_line(lines: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        list(compensate_stream(calibrated(), lines, "t", StreamOptions(), StreamReport(), "ndjson"))


def test_a_bad_row_of_a_later_batch_is_named_by_its_line() -> None:
    text = joint_csv(joints(6)).replace("\n", "\r\n") + "1,2,3,4,n/a,6\r\n"
    with pytest.raises(InputError, match=r"t\.csv:8: column 'j5_deg' holds 'n/a'"):
        compensate_text(calibrated(), text, "t.csv", StreamOptions(batch=2))


@pytest.mark.parametrize("model", ["nominal", "local-poe", "complete"])
def test_verify_drives_the_calibrated_model_to_the_command(model: str) -> None:
    q, calibration = joints(20), calibrated(model=model)
    for method, limit in (("exact", 1e-9), ("one-step", 1e-4)):
        text, report = compensate_text(
            calibration,
            joint_csv(q),
            "t.csv",
            StreamOptions(method=method, verify=True),
        )
        assert report.remaining_position < limit
        header, *rows = (line.split(",") for line in text.splitlines())
        driven = np.deg2rad([[float(cell) for cell in row[:6]] for row in rows])
        remaining = calibration.forward(driven) - calibration.robot.mechanism.forward(q)
        stated = [float(row[header.index("left_mm")]) for row in rows]
        assert np.allclose(np.linalg.norm(remaining[:, :3, 3], axis=-1) * 1e3, stated, atol=2e-8)


def test_a_path_of_poses_stays_on_the_branch_of_its_first_row_and_jumps_are_named() -> None:
    robot = load_robot("ur5")
    start = np.deg2rad([10.0, -80.0, 100.0, -110.0, -90.0, 20.0])
    q = start + np.linspace(0, 1, 12)[:, None] * np.deg2rad([30, 10, -20, 5, 15, 40])
    text, report = compensate_text(calibrated(), pose_csv(robot.mechanism.forward(q)), "t.csv")
    found = np.deg2rad(np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1, usecols=range(6)))
    assert np.abs(np.diff(found, axis=0)).max() < 0.1
    assert not any("jumps" in remark for remark in report.remarks)
    far = np.concatenate([q[:3], q[:1] + np.deg2rad([120, 0, 0, 0, 0, 0])])
    _, report = compensate_text(
        calibrated(), pose_csv(robot.mechanism.forward(far)), "t.csv", StreamOptions(batch=3)
    )
    assert [remark.split(":")[:2] for remark in report.remarks if "jumps" in remark] == [
        ["t.csv", "5"]
    ]


def test_uncertainty_and_refusal_go_through_the_stream() -> None:
    calibration = calibrated(model="complete")
    q = np.concatenate([joints(2), joints(1) + np.array([1.5, 0, 0, 0, 0, 0])])
    options = StreamOptions(outside="refuse", uncertainty=True)
    text, report = compensate_text(calibration, joint_csv(q), "t.csv", options)
    rows = [line.split(",") for line in text.splitlines()]
    assert rows[0][6:] == ["status", "sd_mm", "sd_mrad"]
    refused = guarded(calibration, q, None, "exact", "refuse")
    assert [row[6] for row in rows[1:]] == list(refused.status)
    assert rows[3][:6] == [""] * 6
    assert rows[3][7:] == ["", ""]
    assert report.without_joints == 1
    assert np.isfinite(compensate_joints(calibration, q).q).all()


@pytest.mark.parametrize("row_format", ["csv", "ndjson"])
def test_processes_that_help_do_not_show(
    row_format: RowFormat, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_ALONE", 2)
    q = joints(20)
    text = joint_csv(q)
    if row_format == "ndjson":
        names = HEADER.split(",")
        rows = (dict(zip(names, row, strict=True)) for row in np.rad2deg(q).tolist())
        text = "".join(json.dumps(row) + "\n" for row in rows)

    def corrected(workers: int) -> tuple[str, StreamReport]:
        report, options = StreamReport(), StreamOptions(batch=3, workers=workers)
        lines = io.StringIO(text)
        parts = compensate_stream(calibrated(), lines, "t", options, report, row_format)
        return "".join(parts), report

    assert corrected(2) == corrected(1)
