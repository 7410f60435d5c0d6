"""calibtool plan: a table to drive, what to measure next, acceptance poses; the loop with
simulate and identify.
"""

from pathlib import Path

import numpy as np
import pytest
from commandline import Files, answer, refused, rows_of, run, stored

FEW = ["--candidates", 60, "--no-refine"]
SERIAL = ["--joint-values", "serial"]


def joints(text: str, count: int = 6) -> np.ndarray:
    return np.array([[float(cell) for cell in list(row.values())[:count]] for row in rows_of(text)])


def test_the_loop_of_plan_simulate_and_identify() -> None:
    table = run("plan", "planar-3r", "-n", 15, *FEW).stdout_bytes
    measured = run("simulate", "planar-3r", "--at", "-", stdin=table).stdout_bytes
    run("identify", "-", "-o", "c.h5", stdin=measured)
    assert np.allclose(
        stored("c.h5", "model/joint_positions"), np.deg2rad(joints(table.decode(), 3)), atol=1e-14
    )


def test_stdout_is_the_table_and_stderr_the_report() -> None:
    result = run("plan", "scara", "-n", 6, *FEW)
    rows = rows_of(result.stdout)
    assert list(rows[0]) == ["j1_deg", "j2_deg", "j3_mm", "j4_deg"]
    assert len(rows) == 6
    for word in ("scara, bench", "before", "random", "selected", "parameters known", "--json"):
        assert word in result.stderr


def test_keys_of_the_json() -> None:
    value = answer(
        "plan", "scara", "-n", 9, *FEW, "--workspace", "full", "--criterion", "i", "-o", "plan.csv"
    )
    assert (value["schema"], value["schema_version"]) == ("calibtool/plan", 1)
    assert (value["robot"], value["workspace"], value["configurations"]) == ("scara", "full", 9)
    assert (value["criterion"], value["candidates"], value["seed"]) == ("i", 60, 0)
    for part in ("before", "random", "selected"):
        assert {"effective_parameters", "target_std_mean_mm", "target_std_max_mm"} <= set(
            value[part]
        )
    assert set(value["selected"]["observability"]) == {"O1", "O2", "O3", "O4", "O5"}
    assert value["selected"]["target_std_mean_mm"] < value["random"]["target_std_mean_mm"]
    written = rows_of(Path("plan.csv").read_text())
    assert [{c: float(cell) for c, cell in row.items()} for row in written] == value["plan"]


def test_what_to_measure_next(files: Files) -> None:
    run("identify", files.six_measurements, "-o", "c.h5")
    value = answer("plan", "fanuc-m1000ia", "-n", 5, "--from", "c.h5", *SERIAL, *FEW)
    assert value["before"]["effective_parameters"] > 20
    first = answer("plan", "fanuc-m1000ia", "-n", 5, *SERIAL, *FEW)
    assert first["before"]["effective_parameters"] == 0
    assert value["plan"] != first["plan"]
    assert value["selected"]["target_std_mean_mm"] < value["before"]["target_std_mean_mm"]


def test_constraints_hold_in_the_table() -> None:
    box = "500,-4000,-4000,5000,-100,4000"
    limits = ["--floor-mm", -1000, "--joint-margin", 5, "--min-singularity-distance", 0.06]
    sight = ["--instrument", "6000,2000,500", "--cone-deg", 70]
    free, bound = (
        joints(
            run(
                "plan", "fanuc-m1000ia", "-n", 5, "--workspace", "full", *SERIAL, *FEW, *more
            ).stdout
        )
        for more in ([], ["--keep-out", box, *limits, *sight])
    )
    assert free.shape == bound.shape == (5, 6)
    q1_range = 360 * 0.45
    assert np.abs(bound[:, 0]).max() <= q1_range + 1e-6


def test_poses_of_an_acceptance_test_and_their_figures(files: Files) -> None:
    run(
        "plan",
        "fanuc-m1000ia",
        "--iso9283",
        "--cycles",
        5,
        "--cube-mm",
        600,
        *SERIAL,
        "-o",
        "test.csv",
    )
    rows = rows_of(Path("test.csv").read_text())
    assert [row["pose"] for row in rows[:6]] == ["P5", "P4", "P3", "P2", "P1", "P5"]
    assert [row["cycle"] for row in rows] == [str(1 + k // 5) for k in range(25)]
    run(
        "simulate",
        "fanuc-m1000ia",
        "--at",
        "test.csv",
        "--same-robot",
        files.six_measurements,
        "-o",
        "m.h5",
    )
    value = answer("evaluate", files.six_network, "--on", "m.h5")["iso9283"]
    assert value["poses"] == ["P1", "P2", "P3", "P4", "P5"]
    assert [entry["name"] for entry in value["methods"]] == ["nominal", "six-network"]
    assert len(value["rp_mm"]) == len(value["methods"][1]["ap_mrad"]) == 5
    shown = run("evaluate", files.six_network, "--on", "m.h5").stderr
    for word in ("ISO 9283, 5 poses measured 5 times", "AP nominal", "AP six-network", "RP", "P5"):
        assert word in shown


def test_the_cube_in_json() -> None:
    value = answer("plan", "ur5", "--iso9283")
    assert value["configurations"] == 150
    assert value["iso9283"]["cube_mm"] == pytest.approx(400)
    assert [pose["pose"] for pose in value["iso9283"]["poses"]] == ["P1", "P2", "P3", "P4", "P5"]
    assert {"x_mm", "y_mm", "z_mm", "j1_deg", "j6_deg"} <= set(value["iso9283"]["poses"][0])


# --- wrong input ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "arguments", "words"),
    [
        (2, ["-n", 30, "--candidates", 20], "-n 30: only 20 candidates --candidates"),
        (2, ["--workspace", "machinin"], "no workspace 'machinin' machining"),
        (2, ["--criterion", "a"], "--criterion: unknown 'a'"),
        (2, ["--keep-out", "1,2,3"], "--keep-out: '1,2,3' is not 6 numbers"),
        (2, ["--keep-out", "0,0,0,1,1,x"], "--keep-out: is not 6 numbers"),
        (2, ["--keep-out", "5,0,0,1,1,1"], "--keep-out: empty x0 < x1"),
        (2, ["--instrument", "1,2"], "--instrument: '1,2' is not 3 numbers"),
        (2, ["--instrument", "1,2,nan"], "--instrument: nan is no finite number"),
        (2, ["--instrument", "1,2,3", "--normal", "0,0,0"], "--normal: no direction"),
        (2, ["--floor-mm", "inf"], "--floor-mm: inf is no finite number"),
        (2, ["--cone-deg", "20"], "--cone-deg --instrument"),
        (2, ["--cube-mm", "500"], "--cube-mm belongs to --iso9283"),
        (2, ["--cycles", "5"], "--cycles belongs to --iso9283"),
        (2, ["--iso9283", "--from", "c.h5"], "--iso9283 --from"),
        (2, ["--from", "nothing.h5"], "nothing.h5: no such file"),
        (2, ["--json", "-o", "-"], "--json and -o -"),
        (
            4,
            ["-n", 3, "--workspace", "full", "--keep-out", "-9e3,-9e3,-9e3,9e3,9e3,9e3", *SERIAL],
            "keep the constraints --keep-out loosen",
        ),
        (4, ["--iso9283", "--cube-mm", "9000", *SERIAL], "9000 mm cube fails the reach --cube-mm"),
    ],
)
def test_wrong_use_is_one_line_with_a_remedy(
    code: int, arguments: list[object], words: str
) -> None:
    line = refused(
        code, "plan", "fanuc-m1000ia", *arguments, *([] if "--candidates" in arguments else FEW)
    )
    for word in words.split(" "):
        assert word in line


def test_calibrations_that_are_no_start(files: Files) -> None:
    line = refused(3, "plan", "ur5", "--from", files.six_network)
    assert "six-network.h5" in line
    assert "kinematics differ" in line
    line = refused(3, "plan", "planar-3r", "--from", files.local_poe)
    assert "local-poe.h5" in line
    assert "--model complete" in line
    assert "--unregistered" in refused(
        2, "plan", "planar-3r", "--from", files.local_poe, "--unregistered"
    )
    assert "MEASUREMENTS" not in refused(3, "plan", "planar-3r", "--from", files.measurements)


def test_a_plan_for_a_probe_its_program_and_the_next_one() -> None:
    """Planes are proposed; where they really stand is known after a few rows."""
    observe = ("--observe", "plane", "--places", 3, "--candidates", 150)
    made = run("plan", "ur5", "-n", 12, *observe, "-o", "p.csv", "--program", "rows.script")
    assert made.stderr.count("note: plane ") == 3
    header, *rows = Path("p.csv").read_text().splitlines()
    assert header.endswith(",plane")
    assert len(rows) == 12
    program = Path("rows.script").read_text()
    assert program.count("movej(") == 12
    assert "# plane 3" in program
    message = refused(2, "plan", "ur5", *observe, "--program", "rows.txt")
    assert message.startswith("rows.txt: a program of rows is .ls (FANUC)")
    run("simulate", "ur5", "--observe", "plane", "--places", 2, "-n", 60, "-o", "m.h5")
    run("identify", "m.h5", "-o", "c.h5")
    message = refused(2, "plan", "ur5", "--from", "c.h5")
    assert message.startswith("c.h5: it was identified from another instrument (heights above")
    next_rows = ("--set-up", "m.h5", "--candidates", 150, "-n", 6)
    value = answer("plan", "ur5", "--from", "c.h5", *next_rows, "-o", "n.csv")
    after, before = (value[k]["target_std_mean_mm"] for k in ("selected", "before"))
    assert after < before
    assert {row["plane"] for row in value["plan"]} <= {"plane 1", "plane 2"}
    assert refused(2, "plan", "ur5", *observe, "--set-up", "m.h5").startswith("--observe and")
