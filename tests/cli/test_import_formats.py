"""calibtool import beyond plain tables: lists of points, workbooks, joint files, stated units, dry
runs, held-out rows.
"""

import io
from pathlib import Path

import numpy as np
import pytest
from commandline import Files, answer, measured_table, refused, remarks, run, stored, write_table

JOINTS, POINTS = "measurements/joint_positions", "measurements/points"
ARM = ["--robot", "planar-3r"]


@pytest.fixture
def exported(files: Files) -> tuple[str, str]:
    """What a tracker and a controller wrote of 40 configurations: points.txt (mm) and
    joints.csv (deg).
    """
    q, points = stored(files.measurements, JOINTS), stored(files.measurements, POINTS) * 1e3
    lines = ["// SA 2024", "// Collection Group Target x y z offset"]
    for k, row in enumerate(points, start=1):
        lines += [
            f"A,p{k},T{i},{x:.9f},{y:.9f},{z:.9f},0.0" for i, (x, y, z) in enumerate(row, start=1)
        ]
    Path("points.txt").write_text("\r\n".join(lines), encoding="utf-8-sig")
    rows = [[f"p{k}", *map(repr, row)] for k, row in enumerate(np.rad2deg(q).tolist(), start=1)]
    write_table("joints.csv", ["name", "j1_deg", "j2_deg", "j3_deg"], rows)
    return "points.txt", "joints.csv"


def same(path: str, reference: str, rows: object = slice(None)) -> None:
    np.testing.assert_allclose(stored(path, JOINTS), stored(reference, JOINTS)[rows], atol=1e-13)
    np.testing.assert_allclose(stored(path, POINTS), stored(reference, POINTS)[rows], atol=1e-12)


def test_spatial_analyzer_points_with_a_joint_file(files: Files, exported: tuple[str, str]) -> None:
    points, joints = exported
    run("import", points, *ARM, "--unit", "mm", "--joints", joints, "-o", "m.h5")
    same("m.h5", files.measurements)
    run(
        "import",
        "-",
        *ARM,
        "--unit",
        "mm",
        "--joints",
        joints,
        "-o",
        "n.h5",
        stdin=Path(points).read_bytes(),
    )
    same("n.h5", files.measurements)
    assert "sha256_joints" in answer("info", "m.h5")["provenance"]


def test_joints_by_name_in_another_order_and_without_some(
    files: Files, exported: tuple[str, str]
) -> None:
    points, joints = exported
    header, *rows = Path(joints).read_text().splitlines()
    Path(joints).write_text("\n".join([header, *rows[:4:-1]]))  # backwards, without p1 … p5
    result = run(
        "import", points, *ARM, "--unit", "mm", "--joints", joints, "--join", "name", "-o", "m.h5"
    )
    assert remarks(result) == (
        "warning: points.txt: 5 of 40 rows have no partner of that name in joints.csv and "
        "are left out: line 3, 6, 9, 12, 15\n"
    )
    same("m.h5", files.measurements, slice(5, None))
    message = refused(3, "import", points, *ARM, "--unit", "mm", "--joints", joints, "-o", "n.h5")
    assert message.startswith("joints.csv: 35 rows, but points.txt has 40 configurations")


def test_a_missing_target_is_named_by_line(exported: tuple[str, str]) -> None:
    points, joints = exported
    lines = Path(points).read_text(encoding="utf-8-sig").splitlines()
    del lines[6]  # p2, T2
    Path(points).write_text("\n".join(lines))
    result = run("import", points, *ARM, "--unit", "mm", "--joints", joints, "-o", "m.h5")
    assert (
        "points.txt: target 2 (T2 x …) is missing in 1 of 40 rows; their other "
        "targets count: line 6" in result.stderr
    )
    assert np.isnan(stored("m.h5", POINTS)[1, 1]).all()


def test_what_is_not_stated_is_asked_for(exported: tuple[str, str]) -> None:
    points, joints = exported
    message = refused(3, "import", points, *ARM, "--joints", joints, "-o", "m.h5")
    assert (
        message == "points.txt: a list of points does not state its unit; give --unit mm, m or in"
    )
    assert "--joints FILE" in refused(3, "import", points, *ARM, "--unit", "mm", "-o", "m.h5")
    assert "--joints FILE" in refused(2, "import", joints, *ARM, "--join", "name", "-o", "m.h5")


@pytest.mark.parametrize(
    "option", ["--join", "--format", "--layout", "--unit", "--angle-unit", "--frame"]
)
def test_an_unknown_choice(exported: tuple[str, str], option: str) -> None:
    message = refused(
        2, "import", exported[0], *ARM, "--joints", exported[1], option, "bogus", "-o", "m.h5"
    )
    assert message.startswith(f"{option}: unknown 'bogus'")


def test_a_layout_for_a_table_and_a_sheet_for_a_text(files: Files) -> None:
    measured_table(files.measurements, "t.csv")
    assert "--layout groups" in refused(
        2, "import", "t.csv", *ARM, "--layout", "groups", "-o", "m.h5"
    )
    assert "--sheet one" in refused(2, "import", "t.csv", *ARM, "--sheet", "one", "-o", "m.h5")


def test_a_workbook(files: Files) -> None:
    openpyxl = pytest.importorskip(
        "openpyxl", reason="openpyxl is not installed; pip install 'calibtool[excel]'"
    )
    measured_table(files.measurements, "t.csv")
    header, *rows = (line.split(",") for line in Path("t.csv").read_text().splitlines())
    book = openpyxl.Workbook()
    book.active.append(["notes"])
    sheet = book.create_sheet("tracker")
    for row in [header, *([float(cell) for cell in row] for row in rows)]:
        sheet.append(row)
    out = io.BytesIO()
    book.save(out)
    Path("t.xlsx").write_bytes(out.getvalue())
    run("import", "t.xlsx", "--sheet", "tracker", *ARM, "-o", "m.h5")
    same("m.h5", files.measurements)
    assert refused(3, "import", "t.xlsx", *ARM, "-o", "n.h5").startswith("t.xlsx[Sheet]: ")


def test_a_text_in_utf_16_is_the_same_table(files: Files) -> None:
    measured_table(files.measurements, "t.csv")
    Path("u.txt").write_bytes(Path("t.csv").read_text().replace(",", "\t").encode("utf-16"))
    run("import", "u.txt", *ARM, "-o", "m.h5")
    same("m.h5", files.measurements)


def test_mixed_line_ends_are_one_table(files: Files) -> None:
    measured_table(files.measurements, "t.csv")
    lines = Path("t.csv").read_text().splitlines()
    text = "".join(line + ("\n", "\r\n", "\r", "\r\n\n")[k % 4] for k, line in enumerate(lines))
    Path("m.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    run("import", "m.csv", *ARM, "-o", "m.h5")
    same("m.h5", files.measurements)


def test_a_dry_run_states_how_the_table_is_understood_and_writes_nothing(
    exported: tuple[str, str],
) -> None:
    points, joints = exported
    before = sorted(Path().iterdir())
    shown = run("import", points, *ARM, "--unit", "mm", "--joints", joints, "--dry-run").stdout
    assert sorted(Path().iterdir()) == before
    for part in (
        "planar-3r, 3 joints",
        "SpatialAnalyzer points, layout groups, targets T1, T2, T3",
        "40, 3 targets each",
        "j1 = j1_deg [deg]",
        "T2 x, T2 y, T2 z [mm]",
        "to be estimated",
        "assumed",
        "mm rms",
    ):
        assert part in " ".join(shown.split())
    first = next(line for line in shown.splitlines() if line.split()[:1] == ["3"])
    values = [float(cell) for cell in first.split()[1:]]
    row = Path(joints).read_text().splitlines()[1].split(",")[1:]
    assert np.allclose(values[:3], [float(cell) for cell in row], atol=1e-3)


def test_a_dry_run_shows_columns_that_are_not_used_and_needs_no_output(files: Files) -> None:
    measured_table(files.measurements, "t.csv")
    lines = Path("t.csv").read_text().splitlines()
    Path("t.csv").write_text(
        "\n".join([lines[0] + ",comment", *(line + ",ok" for line in lines[1:])])
    )
    shown = run("import", "t.csv", *ARM, "--frame", "base", "--robot-targets", "--dry-run").stdout
    assert "comment (t.csv)" in shown
    assert "the robot's base" in shown


def test_held_out_rows_do_not_touch_the_registration(files: Files) -> None:
    """What the rows that are left out hold, does not change a digit of the set-up that
    the taken ones get.
    """
    measured_table(files.measurements, "t.csv")
    header, *rows = (line.split(",") for line in Path("t.csv").read_text().splitlines())
    for row in rows[20:]:
        row[3:] = [repr(float(cell) + 5.0) for cell in row[3:]]
    write_table("shifted.csv", header, rows)
    run("import", "t.csv", *ARM, "--rows", "1:20", "-o", "m.h5", "--rest", "r.h5")
    run("import", "shifted.csv", *ARM, "--rows", "1:20", "-o", "n.h5")
    write_table("only.csv", header, rows[:20])
    run("import", "only.csv", *ARM, "-o", "o.h5")
    for name in ("T_instrument_base", "targets"):
        taken = stored("m.h5", f"registration/{name}")
        for other in ("n.h5", "o.h5", "r.h5"):
            assert np.array_equal(stored(other, f"registration/{name}"), taken), (name, other)


def test_the_name_of_a_robot_in_capitals_finds_the_one_that_is_meant(files: Files) -> None:
    measured_table(files.measurements, "t.csv")
    assert "did you mean ur5" in refused(2, "import", "t.csv", "--robot", "UR5", "-o", "m.h5")
