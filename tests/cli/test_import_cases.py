"""Files as people have them (tests/imports): each is understood, or its mistake is named with the
right value.
"""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from commandline import answer, refused, remarks, run, stored

CASES = Path(__file__).parents[1] / "imports"


@pytest.fixture(autouse=True)
def _beside_the_files() -> None:
    for file in CASES.iterdir():
        shutil.copy(file, Path.cwd())


def imported(name: str, *options: object) -> str:
    """What stderr says about a file; m.h5 is written."""
    result = run("import", f"{name}.csv", "--robot", "ur10", *options, "-o", "m.h5")
    assert result.stdout_bytes == b""
    return remarks(result)


def warnings(stderr: str) -> list[str]:
    return [line for line in stderr.splitlines() if line.startswith("warning: ")]


def size(expected: str) -> tuple[int, str]:
    value = answer("info", "m.h5")
    assert value["observation"] == expected
    return value["configurations"], value["observation"]


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("control_swapped", "0.752 mm if the columns of joints 1 and 3 are swapped"),
        ("inch_as_mm", "0.752 mm if the lengths are in inches"),
        ("m_as_mm", "0.765 mm if the lengths are in metres"),
        ("row_shift", "the points belong to the joints of the row before (shifted by 1)"),
        ("zero_j4", "0.752 mm if the zero position of joint 4 is 90 deg off (add -90)"),
        ("camera_sees_board", "0.545 mm if the poses are inverted"),
        (
            "two_sockets",
            "groups of rows much better: 1-16 (0.326 mm), 17-32 (0.254 mm), 33-48 (0.267 mm);",
        ),
    ],
)
def test_the_one_mistake_is_named_with_what_the_robot_fits_without_it(name: str, says: str) -> None:
    (warning,) = warnings(imported(name))
    assert says in warning
    if name != "control_swapped":
        assert "swapped" not in warning
    assert "angles" not in warning
    # It travels in the file and is said again by who reads it.
    again = run("train", "m.h5", "--base", "nominal", "--seed", "1", "-o", "c.h5")
    assert warning.replace("warning: ", "warning: m.h5: ", 1) in again.stderr
    assert says in run("evaluate", "c.h5", "--on", "m.h5").stderr


def test_a_quaternion_of_an_abb_controller_is_an_orientation() -> None:
    assert imported("abb_quaternion") == ""
    size("6-D pose")
    q1 = [float(line.split(",")[9]) for line in Path("abb_quaternion.csv").read_text().split()[1:]]
    found = stored("m.h5", "measurements/rotations")
    assert np.allclose(np.trace(found, axis1=1, axis2=2), 4 * np.array(q1) ** 2 - 1, atol=1e-5)


def test_a_payload_is_used() -> None:
    assert imported("payload") == ""
    assert set(stored("m.h5", "measurements/payload_kg")) == {0.0, 12.0}


def test_two_clocks_are_told_by_their_offset() -> None:
    options = ("--joints", "moving_joints.csv", "--join", "time")
    (warning,) = warnings(imported("moving_points", *options))
    found = re.search(
        r"with (\S+) s added to the stamps .* to (\S+) mm rms, now to 7.14 mm", warning
    )
    assert found is not None
    assert float(found[1]) == pytest.approx(-0.05, abs=0.2e-3)
    assert float(found[2]) == pytest.approx(0.62, abs=0.005)
    assert "left out" not in warning
    said = imported("moving_points", *options, "--clock-offset", "-0.05", "--force")
    assert warnings(said) == []
    assert "the clocks agree to" in said
    said = imported("moving_points", *options, "--clock-offset", "auto", "--force")
    estimate = re.search(r"note: clock offset (\S+) s, ± (\S+) ms", said)
    assert estimate is not None
    assert float(estimate[1]) == pytest.approx(-0.05, abs=0.2e-3)
    assert float(estimate[2]) < 0.2
    assert warnings(said) == []
    refusal = refused(
        2, "import", "moving_points.csv", "--robot", "ur10", *options, "--clock-offset", "x"
    )
    assert refusal.startswith("--clock-offset: 'x' is no number of seconds, nor auto")


def test_interpolation_is_linear_between_the_rows_of_the_stream() -> None:
    imported("moving_points", "--joints", "moving_joints.csv", "--join", "time")
    log = np.loadtxt("moving_joints.csv", delimiter=",", skiprows=1)
    stamps = np.loadtxt("moving_points.csv", delimiter=",", skiprows=1)[:, 0]
    expected = [np.interp(stamps, log[:, 0], log[:, j]) for j in range(1, 7)]
    found = np.rad2deg(stored("m.h5", "measurements/joint_positions"))
    assert np.abs(found - np.transpose(expected)).max() < 1e-9


@pytest.mark.parametrize("name", ["tracker_degree", "tracker_preamble"])
@pytest.mark.parametrize("options", [("--columns", "columns.toml"), ()])
def test_a_spreadsheet_s_export(name: str, options: tuple[str, ...]) -> None:
    said = imported(name, *options)
    assert warnings(said) == []
    assert size("3 target points")[0] == 12
    assert f"{name}.csv: not used: Nr" in said
    told = {"tracker_degree": "read as cp1252", "tracker_preamble": "the header is line 5"}
    assert told[name] in said
    assert np.isclose(np.rad2deg(stored("m.h5", "measurements/joint_positions")[0, 0]), 1.419)
    assert stored("m.h5", "measurements/temperature_c")[0] == 21.4


def test_a_stated_encoding_is_taken() -> None:
    assert "read as" not in imported("tracker_degree", "--encoding", "cp1252")
    message = refused(
        3, "import", "tracker_degree.csv", "--robot", "ur10", "--encoding", "ascii", "-o", "n.h5"
    )
    assert message == "tracker_degree.csv: not ascii (byte 13)"
    message = refused(
        2, "import", "tracker_degree.csv", "--robot", "ur10", "--encoding", "klingon", "-o", "n.h5"
    )
    assert "--encoding klingon: unknown" in message


UNITS = ("--unit", "mm", "--angle-unit", "deg")


def test_one_point_per_line() -> None:
    said = imported("long_points", "--joints", "long_joints.csv", "--join", "name", *UNITS)
    assert "12 configurations of 3 targets (T1, T2, T3)" in said
    assert warnings(said) == []
    long = stored("m.h5", "measurements/points")
    imported("short_header", *UNITS, "--force")  # the same measurements, side by side
    assert np.array_equal(stored("m.h5", "measurements/points"), long)


def test_plain_headers_with_stated_units() -> None:
    assert imported("short_header", *UNITS) == ""
    assert size("3 target points")[0] == 12
    message = refused(3, "import", "short_header.csv", "--robot", "ur10", "-o", "n.h5")
    assert "the unit of column 'J1' is not stated" in message


def test_joint_names_of_the_urdf_in_any_order() -> None:
    assert imported("ros_names", "--unit", "m", "--angle-unit", "rad") == ""
    assert size("1 target points")[0] == 24
    assert np.isclose(stored("m.h5", "measurements/joint_positions")[0, 0], 0.024759)  # pan


def test_lost_mastering_is_found() -> None:
    imported("mastering")
    run("identify", "m.h5", "-o", "c.h5")
    run("import", "mastering_check.csv", "--robot", "ur10", "-o", "v.h5")
    judged = answer("evaluate", "c.h5", "--on", "v.h5", "--refit-setup")
    assert judged["methods"][1]["position_mm"]["mean"] < 0.10


def test_lost_mastering_as_joint_offsets_alone() -> None:
    """The offsets of the file, and those of joints 1 and 6 that one target cannot show."""
    imported("mastering")
    lines = run("identify", "m.h5", "--only", "q", "-o", "c.h5").stderr.splitlines()
    said = [line for line in lines if line.startswith("offset of joint ")]
    assert len(said) == 6
    for joint, expected in zip((2, 3, 4, 5), (1.21, -0.80, 2.01, -1.50), strict=True):
        value = float(said[joint - 1].split(": ")[1].split(" ")[0])
        assert value == pytest.approx(expected, abs=0.02)
    assert all(said[j].endswith("(not observable here)") for j in (0, 5))
    run("import", "mastering_check.csv", "--robot", "ur10", "-o", "v.h5")
    judged = answer("evaluate", "c.h5", "--on", "v.h5", "--refit-setup")
    assert judged["methods"][1]["position_mm"]["mean"] < 0.10
    message = refused(2, "identify", "m.h5", "--only", "ofsets", "-o", "n.h5")
    assert message.startswith("--only: no family 'ofsets'; did you mean offsets")
    assert "give one of them" in refused(2, "identify", "m.h5", "--only", "q", "--fix", "twists")
    fixed = run("identify", "m.h5", "--fix", "placements,twists,harmonics,gravity,backlash")
    assert [line for line in fixed.stderr.splitlines() if "offset of joint 2" in line] == [said[1]]


def test_an_arm_that_stays_the_same_does_not_drift() -> None:
    said = imported("steady_temperature")
    assert warnings(said) == []
    assert "no trend with temperature between 21.4 and 21.8 °C" in said


def test_another_robot_is_refused_without_consent() -> None:
    table = "inch_as_mm.csv"  # of a ur10
    message = refused(3, "import", table, "--robot", "fanuc-m1000ia", "--joint-values", "serial")
    assert "the nominal robot fits the points to" in message
    assert "--accept-misfit" in message
    options = ("--joint-values", "serial", "--accept-misfit", "-o", "m.h5")
    said = remarks(run("import", table, "--robot", "fanuc-m1000ia", *options))
    assert "fits the points to" in warnings(said)[-1]


def test_the_template_of_a_map_is_the_map() -> None:
    run("import", "tracker_preamble.csv", "--robot", "ur10", "--map-template", "-o", "own.toml")
    by_name = imported("tracker_preamble")
    points = stored("m.h5", "measurements/points")
    assert imported("tracker_preamble", "--columns", "own.toml", "--force") == by_name
    assert np.array_equal(stored("m.h5", "measurements/points"), points)


def test_the_template_says_what_the_header_does_not() -> None:
    text = run("import", "short_header.csv", "--robot", "ur10", "--map-template").stdout
    assert 'columns = ["J1", "J2", "J3", "J4", "J5", "J6"]' in text
    assert "# Check the unit: short_header.csv: the unit of column 'J1' is not stated" in text
    Path("odd.csv").write_text("alpha,beta,gamma\n1,2,3\n")
    text = run("import", "odd.csv", "--robot", "ur10", "--map-template").stdout
    assert "# odd.csv: no joint columns j1_deg" in text
    assert 'measured = ["?", "?", "?"]' in text
