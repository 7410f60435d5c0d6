"""Whose joint values they are: said by header or option, or refused, at every command."""

from pathlib import Path

import numpy as np
import pytest
from commandline import Files, answer, refused, rows_of, run, stored, write_table

from calibtool.robot.catalogue import load_robot

PLAIN = [f"j{k}_deg" for k in range(1, 7)]
SPELLINGS = "--joint-values serial or --joint-values controller"
POSE = ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]
Q = [[5.0, 10.0, -15.0, 4.0, -60.0, 9.0], [-20.0, 25.0, -40.0, 10.0, -50.0, 30.0]]


def header(values: str) -> list[str]:
    return [f"j3_{values}_deg" if name == "j3_deg" else name for name in PLAIN]


def shown() -> list[list[float]]:
    """Q as the controller shows it, by hand: J3 = q3 − J2."""
    return [[*row[:2], row[2] - row[1], *row[3:]] for row in Q]


def written(text: str, values: str) -> np.ndarray:
    return np.array([[float(row[name]) for name in header(values)] for row in rows_of(text)])


@pytest.mark.parametrize(
    ("command", "place"),
    [
        (["compensate", "six", "joints.csv", "-o", "out"], "joints.csv: "),
        (["compensate", "six", "poses.csv", "-o", "out"], "poses.csv: "),
        (["compensate", "six", "rows.ndjson", "-o", "out"], "rows.ndjson: "),
        (["simulate", "fanuc-m1000ia", "--at", "joints.csv", "-o", "out"], "joints.csv: "),
        (
            ["plan", "fanuc-m900ib-700", "-n", 4, "--candidates", 20, "-o", "out"],
            "fanuc-m900ib-700: ",
        ),
        (["plan", "fanuc-m1000ia", "--json", "-n", 4, "--candidates", 20], "fanuc-m1000ia: "),
        (["plan", "fanuc-m1000ia", "--iso9283", "-o", "out"], "fanuc-m1000ia: "),
        (["export", "six", "--format", "c", "-o", "out.c"], "fanuc-m1000ia: "),
        (["export", "six", "--format", "st", "-o", "out"], "fanuc-m1000ia: "),
        (["export", "six", "--format", "json", "-o", "out"], "fanuc-m1000ia: "),
        (["import", "measured.csv", "--robot", "fanuc-m1000ia", "-o", "out"], "measured.csv: "),
    ],
)
def test_values_of_a_coupled_robot_without_saying_which(
    files: Files, command: list[object], place: str
) -> None:
    write_table("joints.csv", PLAIN, Q)
    write_table("poses.csv", POSE, [[2000, 0, 600, 0, 1, 0, 0]])
    Path("rows.ndjson").write_text(
        "{" + ", ".join(f'"{name}": 10' for name in PLAIN) + "}\n", encoding="utf-8"
    )
    write_table("measured.csv", [*PLAIN, "x_mm", "y_mm", "z_mm"], [[*row, 1, 2, 3] for row in Q])
    message = refused(2, *(files.six_network if word == "six" else word for word in command))
    assert message.startswith(place)
    assert SPELLINGS in message
    assert "q3 = J3 + J2" in message
    assert not [path for path in Path().iterdir() if path.name.startswith("out")]


def test_a_stream_is_refused_before_its_first_row_is_written(files: Files) -> None:
    table = write_table("joints.csv", PLAIN, Q)
    assert SPELLINGS in refused(2, "compensate", files.six_network, stdin=Path(table).read_bytes())


def test_robots_without_coupling_need_no_answer(files: Files) -> None:
    write_table("t.csv", ["j1_deg", "j2_deg", "j3_deg"], [[10, 20, 30]])
    plain = run("compensate", files.network, "t.csv").stdout
    for values in ("serial", "controller"):
        assert run("compensate", files.network, "t.csv", "--joint-values", values).stdout == plain
    assert plain.startswith("j1_deg,j2_deg,j3_deg,")


@pytest.mark.parametrize("values", ["serial", "controller"])
def test_headers_that_state_it_need_no_option(files: Files, values: str) -> None:
    """What is written can be read again by every command, and a wrong option is noticed."""
    write_table("plain.csv", PLAIN, Q if values == "serial" else shown())
    write_table("said.csv", header(values), Q if values == "serial" else shown())
    option = ["--joint-values", values]
    text = run("compensate", files.six_network, "plain.csv", *option, "-o", "-").stdout
    assert run("compensate", files.six_network, "said.csv").stdout == text
    assert list(rows_of(text)[0])[:6] == header(values)
    Path("corrected.csv").write_text(text, encoding="utf-8")
    run("simulate", "fanuc-m1000ia", "--at", "corrected.csv", "-o", "again.h5")
    q = load_robot("fanuc-m1000ia").serial_from(values, np.deg2rad(written(text, values)))
    np.testing.assert_allclose(stored("again.h5", "measurements/joint_positions"), q, atol=1e-12)
    other = {"serial": "controller", "controller": "serial"}[values]
    for command in (
        ["compensate", files.six_network, "said.csv", "-o", "x.csv"],
        ["simulate", "fanuc-m1000ia", "--at", "corrected.csv", "-o", "x.h5"],
    ):
        message = refused(2, *command, "--joint-values", other)
        assert (
            f"header says that the joint values are {values}, but --joint-values says {other}"
            in message
        )


def test_both_kinds_are_the_same_joints(files: Files) -> None:
    write_table("serial.csv", header("serial"), Q)
    write_table("shown.csv", header("controller"), shown())
    serial, controller = (
        written(
            run("compensate", files.six_network, f"{name}.csv", "--joint-values", values).stdout,
            values,
        )
        for name, values in (("serial", "serial"), ("shown", "controller"))
    )
    controller[:, 2] += controller[:, 1]
    np.testing.assert_allclose(controller, serial, atol=1e-9)


@pytest.mark.parametrize(
    ("names", "word"),
    [
        ([*header("serial")[:3], "j4_controller_deg", *PLAIN[4:]], "some joint columns are serial"),
        ([*header("serial"), "j3_controller_deg"], "joint 3 has two columns"),
    ],
)
def test_a_header_that_states_both(files: Files, names: list[str], word: str) -> None:
    write_table("t.csv", names, [[0] * len(names)])
    message = refused(3, "compensate", files.six_network, "t.csv", "-o", "x.csv")
    assert message.startswith("t.csv")
    assert word in message


def test_radians_and_other_orders_keep_their_word(files: Files) -> None:
    names = ["j3_controller_rad", "j2_rad", "j1_rad", "j4_rad", "j5_rad", "j6_rad"]
    rows = [[np.deg2rad(row[k]) for k in (2, 1, 0, 3, 4, 5)] for row in shown()]
    write_table("t.csv", names, rows)
    write_table("plain.csv", PLAIN, shown())
    expected = written(
        run("compensate", files.six_network, "plain.csv", "--joint-values", "controller").stdout,
        "controller",
    )
    found = rows_of(run("compensate", files.six_network, "t.csv").stdout)
    assert list(found[0])[:6] == names
    values = np.rad2deg([[float(row[name]) for name in names] for row in found])
    np.testing.assert_allclose(values[:, [2, 1, 0, 3, 4, 5]], expected, atol=1e-6)


def test_a_plan_is_written_as_it_is_asked_for() -> None:
    plan = ["plan", "fanuc-m1000ia", "-n", 5, "--candidates", 60, "--no-refine"]
    serial, controller = (
        written(run(*plan, "--joint-values", values).stdout, values)
        for values in ("serial", "controller")
    )
    controller[:, 2] += controller[:, 1]
    np.testing.assert_allclose(controller, serial, atol=2e-6)
    value = answer(*plan, "--joint-values", "controller")
    assert list(value["plan"][0]) == header("controller")
    cube = answer("plan", "fanuc-m1000ia", "--iso9283", "--joint-values", "controller")["iso9283"]
    assert set(header("controller")) <= set(cube["poses"][0])


def test_from_a_plan_to_a_calibration_without_a_word_in_between() -> None:
    plan = run(
        "plan",
        "fanuc-m1000ia",
        "-n",
        12,
        "--candidates",
        60,
        "--no-refine",
        "--joint-values",
        "controller",
    )
    measured = run("simulate", "fanuc-m1000ia", "--at", "-", stdin=plan.stdout_bytes).stdout_bytes
    Path("m.h5").write_bytes(measured)
    q = load_robot("fanuc-m1000ia").to_serial(np.deg2rad(written(plan.stdout, "controller")))
    np.testing.assert_allclose(stored("m.h5", "measurements/joint_positions"), q, atol=1e-12)


def test_poses_to_measure_at_need_no_word() -> None:
    write_table("poses.csv", POSE, [[2000, 0, 600, 0, 1, 0, 0]])
    run("simulate", "fanuc-m1000ia", "--at", "poses.csv", "-o", "m.h5")
    assert "--at" in refused(
        2, "simulate", "fanuc-m1000ia", "--joint-values", "serial", "-o", "x.h5"
    )


def test_a_urdf_holds_the_serial_chain(files: Files) -> None:
    run("export", files.six_network, "--format", "urdf", "-o", "a.urdf")
    message = refused(
        2,
        "export",
        files.six_network,
        "--format",
        "urdf",
        "--joint-values",
        "controller",
        "-o",
        "b.urdf",
    )
    assert "serial" in message


def test_what_the_controller_read_is_converted_too() -> None:
    """Columns j1_read_deg … are those of the same controller: no difference is reported."""
    run("simulate", "fanuc-m1000ia", "-n", 20, "--noise-mm", 0, "-o", "m.h5")
    q = stored("m.h5", "measurements/joint_positions")
    points = stored("m.h5", "measurements/points")
    degrees = np.rad2deg(load_robot("fanuc-m1000ia").to_controller(q))
    read = [name.replace("_deg", "_read_deg") for name in PLAIN]
    targets = [f"t{i}_{axis}_mm" for i in (1, 2, 3) for axis in "xyz"]
    rows = np.hstack([degrees, degrees, points.reshape(len(q), -1) * 1e3])
    write_table("t.csv", [*header("controller"), *read, *targets], rows.tolist())
    result = run(
        "import",
        "t.csv",
        "--robot",
        "fanuc-m1000ia",
        "--frame",
        "base",
        "--robot-targets",
        "-o",
        "i.h5",
    )
    assert "commanded and read" not in result.stderr
    np.testing.assert_allclose(stored("i.h5", "measurements/joint_positions"), q, atol=1e-9)


def test_a_column_map_states_it_or_the_option_does() -> None:
    run("simulate", "fanuc-m1000ia", "-n", 12, "-o", "m.h5")
    q, points = (
        stored("m.h5", "measurements/joint_positions"),
        stored("m.h5", "measurements/points"),
    )
    rows = np.hstack([np.rad2deg(q), points[:, 0] * 1e3])
    names = ["a", "b", "c", "d", "e", "f", "x", "y", "z"]
    write_table("t.csv", names, rows.tolist())
    text = f'[joints]\ncolumns = {names[:6]}\nunit = "deg"\n'.replace("'", '"')
    targets = '[[targets]]\nmeasured = ["x", "y", "z"]\nunit = "mm"\n'
    Path("map.toml").write_text(text + targets, encoding="utf-8")
    table = ["import", "t.csv", "--robot", "fanuc-m1000ia", "--columns", "map.toml"]
    assert SPELLINGS in refused(2, *table, "-o", "a.h5")
    run(*table, "--joint-values", "serial", "-o", "b.h5")
    Path("map.toml").write_text(f'{text}values = "serial"\n{targets}', encoding="utf-8")
    run(*table, "-o", "c.h5")
    for name in ("b.h5", "c.h5"):
        np.testing.assert_allclose(stored(name, "measurements/joint_positions"), q, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "word"),
    [
        (
            "weld.ls",
            "joint values are the controller's, q3 = J3 + J2; if not: --joint-values serial",
        ),
        (
            "drill.src",
            "joint values are the serial chain's; if not, q3 = J3 + J2: --joint-values controller",
        ),
    ],
)
def test_a_program_s_format_states_it_and_so_does_the_summary(
    files: Files, name: str, word: str
) -> None:
    sample = Path(__file__).parent.parent / "programs" / name
    said = run("compensate", files.six_network, sample, "--partial", "-o", "out").stderr
    assert f"{name}: note: {word}" in said


def test_a_robot_s_page_states_which_limits_it_shows() -> None:
    assert answer("robots", "fanuc-m1000ia")["joint_values"] == "serial (q3 = J3 + J2)"
    assert "joint_values" not in answer("robots", "ur5")
