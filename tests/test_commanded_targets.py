"""Commanded targets beside driven joints: by order or by name, kept in the file."""

import io
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError
from calibtool.measurement.importing import CommandedFile, JointFile, read_table
from calibtool.measurement.importing.commanded_targets import commanded_poses
from calibtool.measurement.importing.joint_files import Join
from calibtool.measurement.measurements import Measurements
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import Array, readonly
from calibtool.storage import read_measurements, to_bytes
from calibtool.tables import parse_table

ROBOT = load_robot("planar-3r")
Q = np.deg2rad([[10.0, 20.0, 30.0], [-15.0, 40.0, 5.0], [60.0, -30.0, 12.0], [5.0, 6.0, 7.0]])
DRIVEN = Q + 1e-3
NAMES = ["a", "b", "c", "d"]


def joints(q: Array, names: list[str] | None = None, rows: tuple[int, ...] = (0, 1, 2, 3)) -> str:
    header = "j1_deg,j2_deg,j3_deg" + (",name" if names else "")
    lines = [
        ",".join([*(f"{v:.9f}" for v in np.rad2deg(q[k])), *([names[k]] if names else [])])
        for k in rows
    ]
    return "\n".join([header, *lines])


def poses(T: Array) -> str:
    header = "x_mm,y_mm,z_mm,qw,qx,qy,qz"
    turns = Rotation.from_matrix(T[:, :3, :3]).as_quat(scalar_first=True)
    values = np.hstack([T[:, :3, 3] * 1e3, turns])
    return "\n".join([header, *(",".join(f"{v:.12f}" for v in row) for row in values)])


def measured(
    names: list[str] | None = None, rows: tuple[int, ...] = (0, 1, 2, 3), with_joints: bool = False
) -> str:
    header = [f"t{t}_{axis}_mm" for t in (1, 2, 3) for axis in "xyz"]
    points = np.random.default_rng(0).uniform(-500, 500, (4, 9))
    if with_joints:
        header = ["j1_deg", "j2_deg", "j3_deg", *header]
        points = np.hstack([np.rad2deg(DRIVEN), points])
    lines = [
        ",".join([*(f"{v:.9f}" for v in points[k]), *([names[k]] if names else [])]) for k in rows
    ]
    return "\n".join([",".join([*header, *(["name"] if names else [])]), *lines])


def imported(
    table: str, commanded: str, driven: str | None = None, how: Join = "index"
) -> tuple[Measurements, list[str]]:
    found = read_table(
        table,
        "after.csv",
        ROBOT,
        frame="base",
        robot_targets=True,
        joints=None if driven is None else JointFile(driven, "driven.csv", how),
        commanded=CommandedFile(commanded, "targets.csv", how),
    )
    return found.measurements, found.warnings


def commanded_of(measurements: Measurements) -> Array:
    assert measurements.commanded is not None
    return measurements.commanded


NOMINAL = ROBOT.mechanism.forward(Q)


@pytest.mark.parametrize("as_poses", [False, True])
@pytest.mark.parametrize("own", [False, True])
def test_joints_are_the_driven_ones_and_commands_stand_apart(as_poses: bool, own: bool) -> None:
    targets = poses(NOMINAL) if as_poses else joints(Q)
    found, warnings = imported(measured(with_joints=own), targets, None if own else joints(DRIVEN))
    np.testing.assert_allclose(found.q, DRIVEN, atol=1e-10)
    np.testing.assert_allclose(commanded_of(found), NOMINAL, atol=1e-10)
    assert warnings == []


def test_rows_find_their_commands_by_name() -> None:
    """In any order, and through a file of joints that has fewer rows."""
    order = (2, 0, 3, 1)
    found, warnings = imported(
        measured(NAMES), joints(Q, NAMES, order), joints(DRIVEN, NAMES, (3, 1, 0)), "name"
    )
    np.testing.assert_allclose(found.q, DRIVEN[[0, 1, 3]], atol=1e-10)
    np.testing.assert_allclose(commanded_of(found), NOMINAL[[0, 1, 3]], atol=1e-10)
    assert len(warnings) == 1
    found, warnings = imported(
        measured(NAMES), joints(Q, NAMES, (1, 2)), joints(DRIVEN, NAMES), "name"
    )
    np.testing.assert_allclose(commanded_of(found), NOMINAL[[1, 2]], atol=1e-10)
    assert "line 2, 5" in warnings[0]


@pytest.mark.parametrize(
    ("targets", "message"),
    [
        (joints(Q, rows=(0, 1, 2)), r"targets\.csv: 3 rows, but after\.csv has 4 configurations"),
        (
            joints(np.vstack([Q, Q]), rows=(0, 1, 2, 3, 4)),
            r"targets\.csv: 5 rows, but after\.csv has 4",
        ),
        ("point\na\nb\nc\nd", r"targets\.csv: neither joints .* nor poses .*compensate"),
        ("", r"targets\.csv: empty"),
        (joints(Q).replace("10.0", "ten"), r"targets\.csv:2: column 'j1_deg' holds 'ten"),
    ],
)
def test_commands_that_do_not_fit_are_one_line(targets: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"^{message}"):
        imported(measured(with_joints=True), targets)


def test_a_row_with_joints_and_a_pose_is_commanded_by_its_pose() -> None:
    both = "\n".join(
        f"{a},{b}"
        for a, b in zip(joints(Q + 0.1).split("\n"), poses(NOMINAL).split("\n"), strict=True)
    )
    np.testing.assert_allclose(
        commanded_poses(parse_table(both, "t"), ROBOT, "serial"), NOMINAL, atol=1e-10
    )


def test_coupled_joints_are_converted_like_the_driven_ones() -> None:
    robot = load_robot("fanuc-m1000ia")
    q = np.deg2rad([[5.0, 10.0, -20.0, 3.0, -60.0, 2.0]])
    shown = np.rad2deg(robot.to_controller(q))[0]
    table = parse_table(
        "j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\n" + ",".join(map(str, shown)), "t"
    )
    np.testing.assert_allclose(
        commanded_poses(table, robot, "controller"), robot.mechanism.forward(q), atol=1e-12
    )
    other = commanded_poses(table, robot, "serial")
    assert np.abs(other - robot.mechanism.forward(q)).max() > 0.1


def test_commands_stay_with_their_rows_and_in_the_file() -> None:
    found, _ = imported(measured(with_joints=True), joints(Q))
    again = read_measurements(io.BytesIO(to_bytes(found)), "m.h5")
    assert np.array_equal(commanded_of(again), commanded_of(found))
    assert np.array_equal(commanded_of(again.rows(np.array([2, 0]))), commanded_of(found)[[2, 0]])
    assert (
        read_measurements(io.BytesIO(to_bytes(replace(found, commanded=None))), "m.h5").commanded
        is None
    )


def test_commands_are_as_many_rigid_motions_as_rows() -> None:
    found, _ = imported(measured(with_joints=True), joints(Q))
    with pytest.raises(InputError, match="not as many"):
        replace(found, commanded=readonly(NOMINAL[:3]))
    with pytest.raises(InputError, match="commanded poses: row 2 is no rigid motion"):
        replace(found, commanded=readonly(NOMINAL * np.array([1, 2, 1, 1])[:, None, None]))
