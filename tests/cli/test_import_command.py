"""calibtool import: an instrument's table by its header's names or by a map, in
parts, with warnings.
"""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from commandline import Files, answer, measured_table, refused, remarks, run, stored, write_table
from scipy.spatial.transform import Rotation

from calibtool.robot.catalogue import load_robot

JOINTS, POINTS = "measurements/joint_positions", "measurements/points"


@pytest.fixture
def table(files: Files) -> str:
    """40 rows of planar-3r in degrees and mm, named as calibtool names them."""
    return measured_table(files.measurements, "tracker.csv")


def map_text(joints: list[str], targets: str, unit: str = "deg", more: str = "") -> str:
    columns = ", ".join(f'"{name}"' for name in joints)
    return f'{more}[joints]\ncolumns = [{columns}]\nunit = "{unit}"\n{targets}'


def test_by_the_names_of_the_header(files: Files, table: str) -> None:
    result = run("import", table, "--robot", "planar-3r", "-o", "m.h5")
    assert result.stdout_bytes == b""
    assert remarks(result) == ""
    np.testing.assert_allclose(
        stored("m.h5", JOINTS), stored(files.measurements, JOINTS), atol=1e-14
    )
    np.testing.assert_allclose(
        stored("m.h5", POINTS), stored(files.measurements, POINTS), atol=1e-14
    )
    value = answer("info", "m.h5")
    assert value["simulated"] is False
    assert value["observation"] == "3 target points"
    assert value["registration"]["frame"] == value["registration"]["targets"] == "estimated"
    assert (
        value["provenance"]["sha256_table"] == hashlib.sha256(Path(table).read_bytes()).hexdigest()
    )


def test_from_stdin(table: str) -> None:
    run("import", "-", "--robot", "planar-3r", "-o", "m.h5", stdin=Path(table).read_bytes())
    assert answer("info", "m.h5")["configurations"] == 40


def test_order_of_columns_and_units_do_not_matter(files: Files) -> None:
    q, points = stored(files.measurements, JOINTS), stored(files.measurements, POINTS)
    header = [
        "t2_x_m",
        "t2_y_m",
        "t2_z_m",
        "comment",
        "j3_rad",
        "j1_rad",
        "j2_deg",
        "t1_z_mm",
        "t1_y_mm",
        "t1_x_mm",
    ]
    rows = [
        [*p[1], "ok", a[2], a[0], np.rad2deg(a[1]), *(p[0][::-1] * 1e3)]
        for a, p in zip(q, points[:, :2], strict=True)
    ]
    write_table(
        "t.csv",
        header,
        [[v if isinstance(v, str) else repr(float(v)) for v in row] for row in rows],
    )
    run("import", "t.csv", "--robot", "planar-3r", "-o", "m.h5")
    np.testing.assert_allclose(stored("m.h5", JOINTS), q, atol=1e-14)
    np.testing.assert_allclose(stored("m.h5", POINTS), points[:, :2], atol=1e-14)


def test_spellings_of_a_table(table: str) -> None:
    """Byte order mark, Windows line ends, empty lines, tabs, semicolons with decimal
    comma: the same table.
    """
    text = Path(table).read_text()
    lines = text.splitlines()
    spellings = {
        "mark": "\ufeff" + text,
        "windows": text.replace("\n", "\r\n"),
        "gaps": "\n" + "\n\n".join(lines) + "\n\n",
        "tabs": text.replace(",", "\t"),
        "blanks": text.replace(",", "   "),
        "comma": text.replace(",", ";").replace(".", ","),
    }
    run("import", table, "--robot", "planar-3r", "-o", "m.h5")
    for name, spelling in spellings.items():
        Path(f"{name}.csv").write_bytes(spelling.encode())
        run("import", f"{name}.csv", "--robot", "planar-3r", "-o", f"{name}.h5")
        assert np.array_equal(stored(f"{name}.h5", JOINTS), stored("m.h5", JOINTS)), name
        assert np.array_equal(stored(f"{name}.h5", POINTS), stored("m.h5", POINTS)), name


# --- maps -----------------------------------------------------------------------------------------


def test_by_a_map(files: Files) -> None:
    measured_table(files.measurements, "t.csv", ["A1", "A2", "A3"])
    targets = "".join(
        f'[[targets]]\nmeasured = ["t{i}_x_mm", "t{i}_y_mm", "t{i}_z_mm"]\nunit = "mm"\n'
        for i in (3, 1, 2)
    )
    Path("map.toml").write_text(
        map_text(["A1", "A2", "A3"], targets + "[noise]\nposition_mm = 0.02\n")
    )
    run("import", "t.csv", "--robot", "planar-3r", "--columns", "map.toml", "-o", "m.h5")
    np.testing.assert_allclose(
        stored("m.h5", JOINTS), stored(files.measurements, JOINTS), atol=1e-14
    )
    np.testing.assert_allclose(
        stored("m.h5", POINTS), stored(files.measurements, POINTS)[:, [2, 0, 1]], atol=1e-14
    )
    value = answer("info", "m.h5")
    assert value["noise_position_mm"] == pytest.approx(0.02)
    assert (
        value["provenance"]["sha256_columns"]
        == hashlib.sha256(Path("map.toml").read_bytes()).hexdigest()
    )


@pytest.mark.parametrize(
    ("sign", "error_is"), [(1, "measured-minus-nominal"), (-1, "nominal-minus-measured")]
)
def test_nominal_points_and_errors(sign: int, error_is: str) -> None:
    header = ["a", "b", "c", "x", "y", "z", "dx", "dy", "dz"]
    write_table(
        "t.csv", header, [[0.1 * k, 5 * k, 20, 100 + k, 200, 300, 1, 2, 3] for k in range(8)], ";"
    )
    target = (
        '[[targets]]\nnominal = ["x", "y", "z"]\nerror = ["dx", "dy", "dz"]\n'
        f'error_is = "{error_is}"\nunit = "mm"\non_tool_mm = [0.0, 0.0, 31.0]\n[instrument]\n'
        'frame = "base"\n'
    )
    Path("map.toml").write_text(map_text(["a", "b", "c"], target, more='delimiter = ";"\n'))
    run("import", "t.csv", "--robot", "planar-3r", "--columns", "map.toml", "-o", "m.h5")
    expected = [
        [[0.1 + k * 1e-3 + sign * 1e-3, 0.2 + sign * 2e-3, 0.3 + sign * 3e-3]] for k in range(8)
    ]
    np.testing.assert_allclose(stored("m.h5", POINTS), expected, atol=1e-15)
    registration = answer("info", "m.h5")["registration"]
    assert (registration["frame"], registration["targets"]) == ("known", "known")
    assert registration["targets_on_tool_mm"] == [[0.0, 0.0, 31.0]]


@pytest.mark.parametrize(
    ("convention", "columns"),
    [
        ("rotation-vector", 3),
        ("quaternion-wxyz", 4),
        ("quaternion-xyzw", 4),
        ("intrinsic-xyz", 3),
        ("fixed-zyx", 3),
    ],
)
def test_six_dimensional_poses_by_a_map(convention: str, columns: int) -> None:
    robot = load_robot("ur10")
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (20, 6))
    T = robot.mechanism.forward(q)
    turn = Rotation.from_matrix(T[:, :3, :3])
    values = {
        "rotation-vector": turn.as_rotvec(degrees=True),
        "quaternion-wxyz": turn.as_quat(scalar_first=True),
        "quaternion-xyzw": turn.as_quat(),
        "intrinsic-xyz": turn.as_euler("XYZ", degrees=True),
        "fixed-zyx": turn.as_euler("zyx", degrees=True),
    }[convention]
    names = [f"o{k}" for k in range(columns)]
    rows = np.hstack([q, T[:, :3, 3], values])
    joints = [f"a{k}" for k in range(6)]
    write_table("t.csv", [*joints, "x", "y", "z", *names], rows.tolist())
    listed = ", ".join(f'"{name}"' for name in names)
    pose = (
        f'[pose]\nposition = ["x", "y", "z"]\nunit = "m"\norientation = [{listed}]\n'
        f'convention = "{convention}"\norientation_unit = "deg"\n'
    )
    Path("map.toml").write_text(map_text(joints, pose, unit="rad"))
    run("import", "t.csv", "--robot", "ur10", "--columns", "map.toml", "-o", "m.h5")
    np.testing.assert_allclose(stored("m.h5", "measurements/rotations"), T[:, :3, :3], atol=1e-12)
    np.testing.assert_allclose(stored("m.h5", POINTS)[:, 0], T[:, :3, 3], atol=1e-12)
    value = answer("info", "m.h5")
    assert value["observation"] == "6-D pose"
    assert "noise_orientation_mrad" in value


def test_six_dimensional_poses_by_the_header() -> None:
    robot = load_robot("ur10")
    q = np.random.default_rng(2).uniform(-1.5, 1.5, (20, 6))
    T = robot.mechanism.forward(q)
    angles = Rotation.from_matrix(T[:, :3, :3]).as_euler("xyz", degrees=True)
    header = [
        *(f"j{k}_rad" for k in range(1, 7)),
        "x_mm",
        "y_mm",
        "z_mm",
        "roll_deg",
        "pitch_deg",
        "yaw_deg",
    ]
    rows = np.hstack([q, T[:, :3, 3] * 1e3, angles])
    write_table("t.csv", header, rows.tolist())
    run("import", "t.csv", "--robot", "ur10", "-o", "m.h5")
    np.testing.assert_allclose(stored("m.h5", "measurements/rotations"), T[:, :3, :3], atol=1e-12)
    assert answer("info", "m.h5")["observation"] == "6-D pose"


# --- set-up ---------------------------------------------------------------------------------------


def test_known_frame_and_targets(table: str) -> None:
    run("import", table, "--robot", "planar-3r", "--frame", "base", "--robot-targets", "-o", "m.h5")
    registration = answer("info", "m.h5")["registration"]
    assert (registration["frame"], registration["targets"]) == ("known", "known")
    assert registration["targets_on_tool_mm"] == answer("robots", "planar-3r")["targets_mm"]


def test_an_unknown_set_up_is_found() -> None:
    """An exact robot seen by an instrument somewhere else: import finds where it stands and where
    the targets sit.
    """
    exact = ["--length-error-mm", 0, "--angle-error-mrad", 0, "--noise-mm", 0]
    run("simulate", "fanuc-m1000ia", "-n", 20, "--unregistered", *exact, "-o", "true.h5")
    measured_table("true.h5", "t.csv")
    run("import", "t.csv", "--robot", "fanuc-m1000ia", "--joint-values", "serial", "-o", "m.h5")
    for name in ("T_instrument_base", "targets"):
        true = stored("true.h5", f"truth/registration/{name}")
        np.testing.assert_allclose(stored("m.h5", f"registration/{name}"), true, atol=1e-7)


def test_one_target_measures_positions_only() -> None:
    run("simulate", "ur10", "-n", 30, "-o", "true.h5")
    q, points = stored("true.h5", JOINTS), stored("true.h5", POINTS)
    header = [*(f"j{k}_rad" for k in range(1, 7)), "x_m", "y_m", "z_m"]
    write_table("t.csv", header, np.hstack([q, points[:, 0]]).tolist())
    run("import", "t.csv", "--robot", "ur10", "-o", "m.h5")
    assert answer("info", "m.h5")["observation"] == "1 target points"
    run("identify", "m.h5", "-o", "c.h5")
    assert answer("evaluate", "c.h5", "--on", "m.h5")["methods"][0]["orientation_mrad"] is None


def test_wrong_number_of_targets_for_the_robot(files: Files) -> None:
    q, points = stored(files.measurements, JOINTS), stored(files.measurements, POINTS)
    header = ["j1_rad", "j2_rad", "j3_rad", "x_m", "y_m", "z_m"]
    write_table("t.csv", header, np.hstack([q, points[:, 0]]).tolist())
    message = refused(3, "import", "t.csv", "--robot", "planar-3r", "--robot-targets", "-o", "m.h5")
    assert message.startswith("t.csv: ")


# --- a part of the rows ---------------------------------------------------------------------------


def split(table: str, *options: object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of the table that were taken, that were left, and all of them, by their (unique)
    joint positions.
    """
    run(
        "import",
        table,
        "--robot",
        "planar-3r",
        *options,
        "-o",
        "taken.h5",
        "--rest",
        "rest.h5",
        "--force",
    )
    run("import", table, "--robot", "planar-3r", "-o", "all.h5", "--force")
    every = stored("all.h5", JOINTS)

    def rows(path: str) -> np.ndarray:
        same = (stored(path, JOINTS)[:, None] == every[None]).all(axis=-1)
        assert (same.sum(axis=-1) == 1).all()
        return np.argmax(same, axis=-1)

    return rows("taken.h5"), rows("rest.h5"), np.arange(len(every))


def test_rows(table: str) -> None:
    taken, rest, every = split(table, "--rows", "5:30")
    assert taken.tolist() == list(range(4, 30))
    assert rest.tolist() == [k for k in every if k not in range(4, 30)]


def test_sample_and_rest_are_a_partition(table: str) -> None:
    taken, rest, every = split(table, "--sample", 25)
    assert len(taken) == 25
    assert sorted([*taken, *rest]) == every.tolist()
    assert taken.tolist() != list(range(25))


def test_sample_of_some_rows(table: str) -> None:
    taken, rest, every = split(table, "--rows", "11:40", "--sample", 10)
    assert len(taken) == 10
    assert taken.min() >= 10
    assert sorted([*taken, *rest]) == every.tolist()


def test_a_sample_depends_on_its_seed_alone(table: str) -> None:
    first, again, other = (
        split(table, "--sample", 20, "--seed", seed)[0].tolist() for seed in (1, 1, 2)
    )
    assert first == again
    assert first != other


def test_both_parts_share_the_registration(table: str) -> None:
    split(table, "--sample", 25)
    for name in ("T_instrument_base", "targets"):
        assert np.array_equal(
            stored("taken.h5", f"registration/{name}"), stored("rest.h5", f"registration/{name}")
        )


@pytest.mark.parametrize("rows", ["0:5", "5:41", "7:6", "5", "a:b", "-1:4", "1:2:3", ""])
def test_rows_that_are_not_there(table: str, rows: str) -> None:
    message = refused(2, "import", table, "--robot", "planar-3r", f"--rows={rows}", "-o", "m.h5")
    assert message.startswith("--rows")


def test_a_sample_larger_than_the_table(table: str) -> None:
    assert "--sample" in refused(
        2, "import", table, "--robot", "planar-3r", "--sample", 41, "-o", "m.h5"
    )


def test_there_is_no_empty_rest(table: str) -> None:
    """A file of no measurements is of no use to any command; it is refused
    where it would be made.
    """
    message = refused(
        2, "import", table, "--robot", "planar-3r", "--rows", "1:40", "--rest", "r.h5", "-o", "m.h5"
    )
    assert "--rest" in message


@pytest.mark.parametrize("rest", ["m.h5", "./m.h5", "../work/m.h5"])
def test_rest_and_output_are_two_files(table: str, rest: str) -> None:
    for force in ([], ["--force"]):
        message = refused(
            2,
            "import",
            table,
            "--robot",
            "planar-3r",
            "--sample",
            10,
            "-o",
            "m.h5",
            "--rest",
            rest,
            *force,
        )
        assert "--rest" in message


def test_rest_is_checked_before_anything_is_written(table: str) -> None:
    Path("r.h5").write_text("mine")
    message = refused(
        2, "import", table, "--robot", "planar-3r", "--sample", 9, "-o", "m.h5", "--rest", "r.h5"
    )
    assert "r.h5" in message


# --- warnings -------------------------------------------------------------------------------------


def test_rows_outside_the_limits_are_kept_with_a_warning(files: Files) -> None:
    """A full turn more is the same pose: nothing is wrong but the limits."""
    q, points = stored(files.measurements, JOINTS).copy(), stored(files.measurements, POINTS)
    q[[4, 9], 0] += 2 * np.pi
    header = [
        "j1_deg",
        "j2_deg",
        "j3_deg",
        *(f"t{i}_{axis}_m" for i in (1, 2, 3) for axis in "xyz"),
    ]
    write_table("t.csv", header, np.hstack([np.rad2deg(q), points.reshape(len(q), -1)]).tolist())
    result = run("import", "t.csv", "--robot", "planar-3r", "-o", "m.h5")
    assert remarks(result).count("\n") == 1
    assert result.stderr.startswith("warning: t.csv:6: 2 of 40 rows")
    np.testing.assert_allclose(stored("m.h5", JOINTS), q, atol=1e-14)


def test_a_joint_of_500_deg_is_kept_and_named(table: str) -> None:
    """It spoils the registration; the warnings tell which row to mend."""
    lines = Path(table).read_text().splitlines()
    lines[2] = "500" + lines[2][lines[2].index(",") :]
    Path("t.csv").write_text("\n".join(lines))
    stderr = run("import", "t.csv", "--robot", "planar-3r", "-o", "m.h5").stderr
    assert "warning: t.csv:3: 1 of 40 rows" in stderr
    assert "warning: row 2 does not belong to the others" in stderr


def test_findings_are_on_stderr_and_in_info(table: str) -> None:
    """The first joint's column in radians under a header in degrees."""
    lines = [line.split(",") for line in Path(table).read_text().splitlines()]
    rows = [[repr(float(row[0]) * np.pi / 180), *row[1:]] for row in lines[1:]]
    write_table("t.csv", lines[0], rows)
    stderr = remarks(run("import", "t.csv", "--robot", "planar-3r", "-o", "m.h5"))
    assert stderr.startswith("warning: the nominal robot fits the points to ")
    assert "joint 1 is in rad, given as degrees" in stderr
    finding = answer("info", "m.h5")["findings"][0]
    assert (finding["name"], finding["severity"]) == ("angle_unit", "warning")
    assert stderr == f"warning: {finding['message']}\n"
    assert finding["numbers"]["repaired_rms_mm"] < finding["numbers"]["rms_mm"] / 3
    assert finding["message"] in run("info", "m.h5").stdout


def test_a_clean_file_has_no_findings(table: str) -> None:
    assert remarks(run("import", table, "--robot", "planar-3r", "-o", "m.h5")) == ""
    assert answer("info", "m.h5")["findings"] == []


def test_joint_values_of_a_controller(files: Files) -> None:
    table = measured_table(files.six_measurements, "tracker.csv")
    message = refused(2, "import", table, "--robot", "fanuc-m1000ia", "-o", "plain.h5")
    assert message.startswith("tracker.csv: ")
    assert "q3 = J3 + J2" in message
    assert "--joint-values serial or --joint-values controller" in message
    run("import", table, "--robot", "fanuc-m1000ia", "--joint-values", "controller", "-o", "m.h5")
    q, serial = stored("m.h5", JOINTS), stored(files.six_measurements, JOINTS)
    np.testing.assert_allclose(q[:, 2], serial[:, 1] + serial[:, 2], atol=1e-12)
    result = run(
        "import", table, "--robot", "fanuc-m1000ia", "--joint-values", "serial", "-o", "s.h5"
    )
    assert remarks(result) == ""
    assert "--joint-values" in refused(
        2, "import", table, "--robot", "fanuc-m1000ia", "--joint-values", "arm"
    )


@pytest.mark.parametrize("mistake", ["100 mm", "10 km", "the row before", "targets exchanged"])
def test_a_row_that_does_not_belong_does_not_move_the_set_up(table: str, mistake: str) -> None:
    """The set-up is that of the other rows; the row stays in the file, and is named."""
    header, *lines = Path(table).read_text().splitlines()
    own, before = lines[6].split(","), lines[5].split(",")
    bad = {
        "100 mm": [*own[:3], *(str(float(cell) + 100) for cell in own[3:])],
        "10 km": [*own[:3], "9999999", "9999999", "9999999", *own[6:]],
        "the row before": own[:3] + before[3:],
        "targets exchanged": own[:3] + own[6:9] + own[3:6] + own[9:],
    }[mistake]
    Path("spoilt.csv").write_text("\n".join([header, *lines[:6], ",".join(bad), *lines[7:]]))
    Path("others.csv").write_text("\n".join([header, *lines[:6], *lines[7:]]))
    run("import", "others.csv", "--robot", "planar-3r", "-o", "others.h5")
    result = run("import", "spoilt.csv", "--robot", "planar-3r", "-o", "spoilt.h5")
    assert "row 7" in result.stderr
    assert len(stored("spoilt.h5", JOINTS)) == len(lines)
    for part in ("T_instrument_base", "targets"):
        np.testing.assert_allclose(
            stored("spoilt.h5", f"registration/{part}"),
            stored("others.h5", f"registration/{part}"),
            atol=1e-7,
        )
