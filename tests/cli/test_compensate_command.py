"""calibtool compensate: joints or poses in, joints out; units, other columns, status, and what
cannot be reached.
"""

from pathlib import Path

import numpy as np
import pytest
from commandline import Files, refused, remarks, rows_of, run, stored, write_table
from scipy.spatial.transform import Rotation

from calibtool.robot.catalogue import load_robot

PLANAR = ["j1_deg", "j2_deg", "j3_deg"]
SIX = [
    "j1_deg",
    "j2_deg",
    "j3_serial_deg",
    "j4_deg",
    "j5_deg",
    "j6_deg",
]  # of a FANUC: states whose joint 3
SERIAL = ["--joint-values", "serial"]
ANGLES = [[0, 10, -10, 0, -70, 0], [10, 20, -30, 5, -60, 10], [-15, 5, 0, -10, -80, 30]]


def joints_of(text: str, columns: list[str]) -> np.ndarray:
    return np.array(
        [[float(row[c]) if row[c] else np.nan for c in columns] for row in rows_of(text)]
    )


def poses_of_angles() -> np.ndarray:
    """Where the nominal arm's tool is at ANGLES."""
    return load_robot("fanuc-m1000ia").mechanism.forward(np.deg2rad(ANGLES))


def pose_table(
    path: str, T: np.ndarray, form: str = "quaternion", unit: str = "mm", **more: list[str]
) -> str:
    turn = Rotation.from_matrix(T[:, :3, :3])
    names, values = {
        "quaternion": (["qw", "qx", "qy", "qz"], turn.as_quat(scalar_first=True)),
        "rotation vector": (["rx_rad", "ry_rad", "rz_rad"], turn.as_rotvec()),
        "roll pitch yaw": (
            ["roll_deg", "pitch_deg", "yaw_deg"],
            turn.as_euler("xyz", degrees=True),
        ),
    }[form]
    positions = T[:, :3, 3] * (1e3 if unit == "mm" else 1)
    rows = np.hstack([positions, values]).tolist()
    header = [*(f"{axis}_{unit}" for axis in "xyz"), *names, *more]
    return write_table(
        path, header, [[*row, *(c[k] for c in more.values())] for k, row in enumerate(rows)]
    )


# --- joints ---------------------------------------------------------------------------------------


def test_corrected_joints_bring_the_actual_robot_where_it_should_be(files: Files) -> None:
    """By files alone: the drawing, the actual robot as commanded, the actual robot as corrected."""
    write_table("targets.csv", SIX, ANGLES)
    run("compensate", files.six_network, "targets.csv", "-o", "corrected.csv")
    exact = ["--length-error-mm", 0, "--angle-error-mrad", 0, "--noise-mm", 0]
    again = ["--same-robot", files.six_measurements, "--noise-mm", 0]
    run("simulate", "fanuc-m1000ia", "--at", "targets.csv", *exact, "-o", "drawing.h5")
    run("simulate", "fanuc-m1000ia", "--at", "targets.csv", *again, "-o", "before.h5")
    run("simulate", "fanuc-m1000ia", "--at", "corrected.csv", *again, "-o", "after.h5")
    drawing, before, after = (
        stored(f"{n}.h5", "measurements/points") for n in ("drawing", "before", "after")
    )
    error_before, error_after = (
        np.linalg.norm(p - drawing, axis=-1).mean(axis=1) for p in (before, after)
    )
    assert (error_after < 0.35 * error_before).all()


@pytest.mark.parametrize(
    "names", [PLANAR, ["j1_rad", "j2_rad", "j3_rad"], ["j1_deg", "j2_rad", "j3_deg"]]
)
def test_joints_keep_their_units(files: Files, names: list[str]) -> None:
    factors = [np.pi / 180 if name.endswith("rad") else 1.0 for name in names]
    write_table("deg.csv", PLANAR, [[10, 20, 30], [-40, 70, 15]])
    write_table("t.csv", names, (np.array([[10, 20, 30], [-40, 70, 15]]) * factors).tolist())
    expected = joints_of(run("compensate", files.network, "deg.csv").stdout, PLANAR)
    result = run("compensate", files.network, "t.csv").stdout
    assert result.splitlines()[0].split(",")[:3] == names
    np.testing.assert_allclose(joints_of(result, names) / factors, expected, atol=1e-10)
    assert np.abs(expected - [[10, 20, 30], [-40, 70, 15]]).max() < 3


def test_prismatic_joints_in_mm_and_m() -> None:
    run("simulate", "gantry", "-n", 15, "-o", "m.h5")
    run("identify", "m.h5", "-o", "c.h5")
    write_table(
        "mm.csv", ["j1_mm", "j2_mm", "j3_mm", "j4_deg", "j5_deg"], [[1500, 900, 400, 10, 40]]
    )
    write_table("m.csv", ["j1_m", "j2_m", "j3_m", "j4_deg", "j5_deg"], [[1.5, 0.9, 0.4, 10, 40]])
    mm = joints_of(
        run("compensate", "c.h5", "mm.csv").stdout, ["j1_mm", "j2_mm", "j3_mm", "j4_deg", "j5_deg"]
    )
    m = joints_of(
        run("compensate", "c.h5", "m.csv").stdout, ["j1_m", "j2_m", "j3_m", "j4_deg", "j5_deg"]
    )
    np.testing.assert_allclose(mm, m * [1000, 1000, 1000, 1, 1], rtol=1e-12)


def test_other_columns_pass_through(files: Files) -> None:
    text = (
        'id,j2_deg,j1_deg,speed mm/s,j3_deg,comment\n7,20,10,0.50,30,"left, then ""up"""\n'
        "8,21,11,,31,é\n"
    )
    Path("t.csv").write_text(text, encoding="utf-8")
    rows = rows_of(run("compensate", files.network, "t.csv").stdout)
    kept = ["id", "speed mm/s", "comment"]
    assert list(rows[0]) == ["j2_deg", "j1_deg", "j3_deg", *kept, "status", "left_mm", "left_mrad"]
    assert [row["id"] for row in rows] == ["7", "8"]
    assert [row["speed mm/s"] for row in rows] == ["0.50", ""]
    assert [row["comment"] for row in rows] == ['left, then "up"', "é"]
    write_table("plain.csv", PLANAR, [[10, 20, 30], [11, 21, 31]])
    expected = joints_of(run("compensate", files.network, "plain.csv").stdout, PLANAR)
    np.testing.assert_array_equal(
        joints_of(run("compensate", files.network, "t.csv").stdout, PLANAR), expected
    )


def test_the_corrected_table_can_be_measured_at(files: Files) -> None:
    """Output of one command, input of the next: joints and extra columns."""
    write_table("t.csv", [*PLANAR, "id"], [[10, 20, 30, "a"]])
    run("compensate", files.network, "t.csv", "-o", "corrected.csv")
    run("simulate", "planar-3r", "--at", "corrected.csv", "-o", "m.h5")
    expected = np.deg2rad(joints_of(Path("corrected.csv").read_text(), PLANAR))
    np.testing.assert_allclose(stored("m.h5", "measurements/joint_positions"), expected, atol=1e-14)


def test_a_corrected_table_is_not_corrected_twice(files: Files) -> None:
    write_table("t.csv", PLANAR, [[10, 20, 30]])
    run("compensate", files.network, "t.csv", "-o", "corrected.csv")
    message = refused(3, "compensate", files.network, "corrected.csv", "-o", "twice.csv")
    assert message.startswith("corrected.csv: ")
    assert "'status'" in message


def test_what_no_joint_can_correct_is_stated_for_few_joints(files: Files) -> None:
    write_table("t.csv", PLANAR, [[20, 60, 20]])
    (row,) = rows_of(run("compensate", files.network, "t.csv").stdout)
    assert row["status"] == "ok"
    assert 0 < float(row["left_mm"]) < 2
    assert 0 < float(row["left_mrad"]) < 10
    write_table("six.csv", SIX, ANGLES)
    assert list(rows_of(run("compensate", files.six_network, "six.csv").stdout)[0]) == [
        *SIX,
        "status",
    ]


def test_seven_joints() -> None:
    run("simulate", "panda", "-n", 25, "-o", "m.h5")
    run("identify", "m.h5", "-o", "c.h5")
    names = [f"j{k}_deg" for k in range(1, 8)]
    write_table("t.csv", names, [[0, -20, 0, -100, 0, 90, 30]])
    result = run("compensate", "c.h5", "t.csv")
    assert rows_of(result.stdout)[0]["status"] == "ok"
    assert np.abs(joints_of(result.stdout, names) - [[0, -20, 0, -100, 0, 90, 30]]).max() < 1


def test_exact_and_one_step(files: Files) -> None:
    write_table("t.csv", SIX, ANGLES)
    default, exact, one = (
        joints_of(run("compensate", files.six_network, "t.csv", *options).stdout, SIX)
        for options in ([], ["--method", "exact"], ["--method", "one-step"])
    )
    np.testing.assert_array_equal(default, exact)
    assert 0 < np.abs(exact - one).max() < 0.02


def test_without_errors_nothing_is_corrected() -> None:
    exact = ["--length-error-mm", 0, "--angle-error-mrad", 0, "--noise-mm", 0]
    run("simulate", "fanuc-m1000ia", "-n", 20, *exact, "-o", "m.h5")
    run("identify", "m.h5", "-o", "c.h5")
    write_table("t.csv", SIX, ANGLES)
    np.testing.assert_allclose(
        joints_of(run("compensate", "c.h5", "t.csv").stdout, SIX), ANGLES, atol=1e-7
    )


# --- poses ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["quaternion", "rotation vector", "roll pitch yaw"])
@pytest.mark.parametrize("unit", ["mm", "m"])
def test_poses_in_every_form(files: Files, form: str, unit: str) -> None:
    """The nominal poses of ANGLES lead to the same corrected joints as ANGLES themselves."""
    write_table("joints.csv", SIX, ANGLES)
    expected = joints_of(run("compensate", files.six_network, "joints.csv").stdout, SIX)
    pose_table("poses.csv", poses_of_angles(), form, unit, id=["a", "b", "c"])
    result = run("compensate", files.six_network, "poses.csv", *SERIAL).stdout
    assert list(rows_of(result)[0]) == [*SIX, "id", "status"]
    assert [row["id"] for row in rows_of(result)] == ["a", "b", "c"]
    np.testing.assert_allclose(joints_of(result, SIX), expected, atol=1e-5)


def test_joints_beside_a_pose_choose_the_branch(files: Files) -> None:
    """A wrist has two ways to one orientation: flip joints 4 and 6 by half a turn and
    turn joint 5 round.
    """
    T = poses_of_angles()[1:2]
    flipped = [10, 20, -30, 5 - 180, 60, 10 - 180]
    np.testing.assert_allclose(
        load_robot("fanuc-m1000ia").mechanism.forward(np.deg2rad([flipped])), T, atol=1e-9
    )
    for branch in (ANGLES[1], flipped):
        seeds = {name: [str(value + 2)] for name, value in zip(SIX, branch, strict=True)}
        pose_table("poses.csv", T, **seeds)
        found = joints_of(run("compensate", files.six_network, "poses.csv").stdout, SIX)
        assert np.abs(found - [branch]).max() < 2


def test_an_unreachable_pose(files: Files) -> None:
    """Exit code 4; its joints are empty, the other rows are written, the line is named."""
    T = poses_of_angles()
    T[1, 0, 3] += 10.0
    pose_table("poses.csv", T, id=["a", "b", "c"])
    result = run(
        "compensate", files.six_network, "poses.csv", *SERIAL, "-o", "corrected.csv", code=4
    )
    rows = rows_of(Path("corrected.csv").read_text())
    assert [row["status"] for row in rows] == ["ok", "unreachable", "ok"]
    assert [row["id"] for row in rows] == ["a", "b", "c"]
    assert [rows[1][name] for name in SIX] == [""] * 6
    write_table("joints.csv", SIX, ANGLES)
    expected = joints_of(run("compensate", files.six_network, "joints.csv").stdout, SIX)
    np.testing.assert_allclose(
        joints_of(Path("corrected.csv").read_text(), SIX)[[0, 2]], expected[[0, 2]], atol=1e-5
    )
    lines = remarks(result).splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("poses.csv:3: ")
    assert lines[1].startswith("limit of the change of a joint: ")
    assert lines[2].startswith("poses.csv: 1 of 3 rows")
    assert result.stdout_bytes == b""


def test_many_remarks_are_counted(files: Files) -> None:
    write_table("t.csv", PLANAR, [[175, 20, 30]] * 25)
    result = run("compensate", files.network, "t.csv")
    lines = remarks(result).splitlines()
    assert [line.split(": ")[0] for line in lines[:-2]] == [f"t.csv:{k}" for k in range(2, 12)]
    assert "15 more rows" in lines[-2]
    assert len(rows_of(result.stdout)) == 25


# --- status ---------------------------------------------------------------------------------------


def test_near_singular_rows_are_marked(files: Files) -> None:
    """Joint 5 at zero lines joints 4 and 6 up: the correction is damped, not thrown about."""
    write_table("t.csv", SIX, [ANGLES[0], [0, 10, -10, 0, 0, 0]])
    result = run("compensate", files.six_network, "t.csv")
    assert [row["status"] for row in rows_of(result.stdout)] == ["ok", "near-singular"]
    assert np.abs(joints_of(result.stdout, SIX)[1] - [0, 10, -10, 0, 0, 0]).max() < 6
    assert result.stderr.startswith("t.csv:3: near a singularity")
    assert result.stderr.count("t.csv:") == 1


def test_rows_outside_the_limits_are_marked(files: Files) -> None:
    write_table("t.csv", PLANAR, [[20, 60, 20], [175, 20, 30]])
    result = run("compensate", files.network, "t.csv")
    assert [row["status"] for row in rows_of(result.stdout)] == ["ok", "out-of-limits"]
    assert result.stderr.startswith("t.csv:3: ")
    assert result.stderr.count("t.csv:") == 1


# --- bounds ---------------------------------------------------------------------------------------


def test_the_largest_change_is_reported_and_kept(files: Files) -> None:
    write_table("t.csv", SIX, ANGLES)
    free = run("compensate", files.six_network, "t.csv")
    told = [
        line
        for line in free.stderr.splitlines()
        if line.startswith("limit of the change of a joint: ")
    ]
    assert len(told) == 1
    assert float(told[0].split(": ")[1].split()[0]) > 0.1
    bounded = run("compensate", files.six_network, "t.csv", "--largest-change-deg", "0.003")
    assert "limit of the change of a joint: 0.003 deg (--largest-change-deg)" in bounded.stderr
    change = np.abs(joints_of(bounded.stdout, SIX) - ANGLES)
    assert change.max() == pytest.approx(0.003, abs=1e-9)
    assert {row["status"] for row in rows_of(bounded.stdout)} == {"limited"}
    assert np.abs(joints_of(free.stdout, SIX) - ANGLES).max() > 0.003


@pytest.mark.parametrize("given", ["0", "-1", "nan", "0.0"])
def test_a_largest_change_that_is_none_is_wrong_usage(files: Files, given: str) -> None:
    write_table("t.csv", SIX, ANGLES)
    message = refused(
        2, "compensate", files.six_network, "t.csv", "-o", "c.csv", "--largest-change-deg", given
    )
    assert "--largest-change-deg is" in message
    assert not Path("c.csv").exists()


def test_weights_for_fewer_than_six_joints(files: Files) -> None:
    write_table("t.csv", PLANAR, [[20, 60, 20], [30, 50, 10]])
    plain, equal = (
        run("compensate", files.network, "t.csv", *options).stdout
        for options in ([], ["--weights", "1,1,1,1,1,1"])
    )
    assert np.abs(joints_of(plain, PLANAR) - joints_of(equal, PLANAR)).max() > 1e-6
    left = [
        sum(
            float(row["left_mm"]) ** 2 / 550**2 + (float(row["left_mrad"]) * 1e-3) ** 2
            for row in rows_of(text)
        )
        for text in (plain, equal)
    ]
    assert left[1] < left[0]


@pytest.mark.parametrize(
    ("weights", "text"),
    [
        ("1,1,1", "six numbers"),
        ("a,b", "expected six numbers"),
        ("1,1,0,0,0,0", "2 weights are positive"),
    ],
)
def test_weights_that_are_none_are_wrong_usage(files: Files, weights: str, text: str) -> None:
    write_table("t.csv", PLANAR, [[20, 60, 20]])
    assert text in refused(
        2, "compensate", files.network, "t.csv", "-o", "c.csv", "--weights", weights
    )
    write_table("six.csv", SIX, ANGLES)
    six = refused(
        2, "compensate", files.six_network, "six.csv", "-o", "c.csv", "--weights", "1,1,1,1,1,1"
    )
    assert "fewer than six joints" in six
    assert not Path("c.csv").exists()


# --- streams --------------------------------------------------------------------------------------


def test_targets_come_from_stdin_and_go_to_stdout_by_default(files: Files) -> None:
    write_table("t.csv", PLANAR, [[10, 20, 30]])
    expected = run("compensate", files.network, "t.csv").stdout
    data = Path("t.csv").read_bytes()
    assert run("compensate", files.network, stdin=data).stdout == expected
    assert run("compensate", files.network, "-", stdin=data).stdout == expected
    run("compensate", files.network, "-", "-o", "c.csv", stdin=data)
    assert Path("c.csv").read_text() == expected
    assert (
        run("compensate", "-", "t.csv", stdin=Path(files.network).read_bytes()).stdout == expected
    )


def test_errors_in_stdin_are_placed_in_stdin(files: Files) -> None:
    message = refused(
        3, "compensate", files.network, "-o", "c.csv", stdin="j1_deg,j2_deg,j3_deg\n1,2,x\n"
    )
    assert message.startswith("stdin:2: column 'j3_deg' holds 'x'")


def test_numbers_keep_their_digits(files: Files) -> None:
    write_table("t.csv", PLANAR, [[10.123456789, 20, 30], [10.123456790, 20, 30]])
    a, b = joints_of(run("compensate", files.network, "t.csv").stdout, PLANAR)[:, 0]
    assert b - a == pytest.approx(1e-9, rel=0.2)


def test_joint_values_of_a_controller(files: Files) -> None:
    """With J3 = q3 − J2 in and out, the corrected joints are the same once converted by hand."""
    joints = [f"j{j}_deg" for j in range(1, 7)]
    write_table("serial.csv", joints, [[5, 10, -15, 4, -60, 9]])
    write_table("shown.csv", joints, [[5, 10, -25, 4, -60, 9]])
    (serial,) = rows_of(run("compensate", files.six_network, "serial.csv", *SERIAL).stdout)
    (shown,) = rows_of(
        run("compensate", files.six_network, "shown.csv", "--joint-values", "controller").stdout
    )
    for joint in joints:
        if joint != "j3_deg":
            assert float(shown[joint]) == pytest.approx(float(serial[joint]), abs=1e-9)
    assert float(shown["j3_controller_deg"]) + float(shown["j2_deg"]) == pytest.approx(
        float(serial["j3_serial_deg"]), abs=1e-9
    )
    message = refused(
        2, "compensate", files.six_network, "serial.csv", "--joint-values", "controler"
    )
    assert "--joint-values: unknown 'controler'; did you mean controller" in message


@pytest.mark.parametrize("form", ["quaternion", "roll pitch yaw"])
def test_joints_beside_poses_choose_the_branch_and_it_is_said(files: Files, form: str) -> None:
    """Joints of another branch of the same poses give corrected joints of that branch."""
    T = poses_of_angles()[:2]
    columns = {name: [str(row[k]) for row in ANGLES[:2]] for k, name in enumerate(SIX)}
    beside = run("compensate", files.six_network, pose_table("both.csv", T, form, **columns))
    assert "both.csv: joints and poses in every row: the poses are corrected" in beside.stderr
    alone = run("compensate", files.six_network, pose_table("alone.csv", T, form), *SERIAL)
    assert "joints and poses" not in alone.stderr
    assert np.abs(joints_of(beside.stdout, SIX) - ANGLES[:2]).max() < 1.0
