"""Several set-ups: labels in a table, several files, lengths and boards instead of points."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from commandline import answer, refused, remarks, run, stored, write_table

from calibtool.measurement.checks import check_measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.inverse import inverse_kinematics

CASES = Path(__file__).parents[1] / "imports"
PLACE = "measurements/place"
UR10 = ("--robot", "ur10")


@pytest.fixture(autouse=True)
def _beside_the_files() -> None:
    for name in ("stations", "two_sockets", "touched_table", "ball_bar", "camera_sees_board"):
        shutil.copy(CASES / f"{name}.csv", Path.cwd())


def test_a_station_for_every_label() -> None:
    assert remarks(run("import", "stations.csv", *UR10, "-o", "m.h5")) == ""
    assert np.array_equal(np.bincount(stored("m.h5", "measurements/place")), [24, 24])
    assert stored("m.h5", "registration/further_frames").shape == (1, 4, 4)
    assert answer("info", "m.h5")["places"] == ["A", "B"]
    value = answer("identify", "m.h5", "-o", "c.h5")
    assert value["base"]["residual_rms_mm"] < 0.08  # 0.05 mm of noise
    text = Path("stations.csv").read_text().splitlines()
    Path("moved.csv").write_text("\n".join([text[0], *text[30:], *text[1:10]]))  # B, then A
    run("import", "moved.csv", *UR10, "-o", "a.h5")
    message = refused(3, "evaluate", "c.h5", "--on", "a.h5")
    assert "--refit-setup finds theirs in these rows" in message
    judged = answer("evaluate", "c.h5", "--on", "a.h5", "--refit-setup")["methods"]
    assert judged[1]["position_mm"]["rms"] < 0.5 * judged[0]["position_mm"]["rms"]


def test_files_are_set_ups_of_their_own() -> None:
    """Two files of one table with labels give what the table gives."""
    run("import", "stations.csv", *UR10, "-o", "m.h5")
    run("import", "stations.csv", *UR10, "--rows", "1:24", "-o", "a.h5")
    run("import", "stations.csv", *UR10, "--rows", "25:48", "-o", "b.h5")
    run("identify", "m.h5", "-o", "one.h5", "--no-backlash")
    run("identify", "a.h5", "b.h5", "-o", "two.h5", "--no-backlash")
    one, two = (stored(f"{n}.h5", "model/errors/placements") for n in ("one", "two"))
    assert np.abs(one - two).max() < 1e-6
    run("import", "touched_table.csv", *UR10, "-o", "t.h5")
    message = refused(3, "identify", "a.h5", "t.h5", "-o", "n.h5")
    assert message == "t.h5: the kind of observation differs from a.h5; identify them apart"


def test_a_gauge_in_three_places() -> None:
    header, *rows = Path("two_sockets.csv").read_text().split()
    labels = [f"p{k // 16}" for k in range(48)]
    lines = [[label, *row.split(",")] for label, row in zip(labels, rows, strict=True)]
    write_table("labelled.csv", ["Placement", *header.split(",")], lines)
    assert remarks(run("import", "labelled.csv", *UR10, "-o", "m.h5")) == ""
    assert answer("identify", "m.h5", "-o", "c.h5")["base"]["residual_rms_mm"] < 0.08


@pytest.mark.parametrize(
    ("name", "observation"),
    [("touched_table", "heights above planes"), ("ball_bar", "distances to fixed points")],
)
def test_one_number_per_row(name: str, observation: str) -> None:
    assert remarks(run("import", f"{name}.csv", *UR10, "-o", "m.h5")) == ""
    assert answer("info", "m.h5")["observation"] == observation
    if name == "ball_bar":
        assert "16 equations for 18 unknowns" in refused(4, "identify", "m.h5", "-o", "c.h5")
        return
    value = answer("identify", "m.h5", "-o", "c.h5")
    assert value["base"]["residual_rms_mm"] < 0.1
    judged = answer("evaluate", "c.h5", "--on", "m.h5")["methods"]
    assert judged[1]["position_mm"]["rms"] < judged[0]["position_mm"]["rms"]


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("touched_table", ["32, 1 length each", "z_mm [mm]", "heights above a plane"]),
        ("ball_bar", ["16, 1 length each", "distance_mm [mm]"]),
        ("stations", ["48, 1 target each", "station: A, B", "after registration: 0."]),
    ],
)
def test_a_dry_run_says_what_was_understood(name: str, says: list[str]) -> None:
    shown = run("import", f"{name}.csv", *UR10, "--dry-run").stdout
    for text in says:
        assert text in shown
    assert "nominal robot after registration: " in shown


def test_a_wire_of_negative_length_is_refused_by_line() -> None:
    text = Path("ball_bar.csv").read_text().splitlines()
    text[3] = text[3].replace("300.00000", "-300.00000")
    Path("ball_bar.csv").write_text("\n".join(text))
    message = refused(3, "import", "ball_bar.csv", *UR10, "-o", "m.h5")
    assert message == (
        "ball_bar.csv:4: column 'distance_mm' holds a distance that is not above zero"
    )


def test_a_wire_that_says_0_was_not_read() -> None:
    """Beside another one; a row of nothing else is refused."""
    robot = load_robot("ur10")
    q = robot.anywhere(40, np.random.default_rng(5))
    tip = robot.mechanism.forward(q)[:, :3, 3]
    anchors = np.array([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [-1.0, -1.0, 2.0]])
    lengths = np.linalg.norm(tip[:, None] - anchors, axis=-1) * 1e3
    lengths[7, 1] = lengths[21, 2] = 0.0
    header = [f"j{j + 1}_deg" for j in range(6)] + [f"d{k + 1}_mm" for k in range(3)]
    rows = np.hstack([np.rad2deg(q), lengths]).tolist()
    write_table("wires.csv", header, rows)
    found = remarks(run("import", "wires.csv", *UR10, "-o", "m.h5"))
    assert "a distance of 0 was taken for 'not read' in 2 places: line 9, 23" in found
    values = stored("m.h5", "measurements/values")
    assert np.argwhere(np.isnan(values)).tolist() == [[7, 1], [21, 2]]
    rows[3][6:] = [0.0, 0.0, 0.0]
    write_table("none.csv", header, rows)
    message = refused(3, "import", "none.csv", *UR10, "-o", "x.h5")
    assert message == "none.csv:5: column 'd1_mm' holds a distance that is not above zero"


def test_a_board_in_a_camera_on_the_flange() -> None:
    found = run("import", "camera_sees_board.csv", *UR10, "--poses-of", "board", "-o", "m.h5")
    assert remarks(found) == ""
    assert answer("info", "m.h5")["observation"] == "poses of a board in a camera on the tool"
    value = answer("identify", "m.h5", "-o", "c.h5")
    assert value["base"]["residual_rms_mm"] < 0.15  # its noise is 0.1 mm
    message = refused(2, "import", "stations.csv", *UR10, "--poses-of", "board", "-o", "n.h5")
    assert message.startswith("--poses-of board: the table holds no poses")


@pytest.mark.parametrize("kind", ["contact", "distance", "plane", "board", "camera"])
def test_every_instrument_is_simulated_and_used(kind: str) -> None:
    options = ("--observe", kind, "--places", "2", "-n", "60", "--seed", "3")
    run("simulate", "ur5", *options, "-o", "m.h5")
    run("identify", "m.h5", "-o", "c.h5")
    judged = answer("evaluate", "c.h5", "--on", "m.h5")
    assert judged["kind"] == "predicted"
    before, after = (entry["position_mm"]["mean"] for entry in judged["methods"])
    assert after < 0.5 * before
    assert refused(2, "simulate", "ur5", "--observe", "sonar").startswith("--observe: unknown")


def test_a_probe_on_spheres_with_and_without_a_known_radius() -> None:
    run("simulate", "ur10", "--observe", "sphere", "--places", 2, "-n", 60, "-o", "t.h5")
    q, place = np.rad2deg(stored("t.h5", "measurements/joint_positions")), stored("t.h5", PLACE)
    radius = stored("t.h5", "truth/registration/spheres")[:, 3] * 1e3
    gaps = stored("t.h5", "measurements/values")[:, 0] * 1e3
    joints = [f"j{i}_deg" for i in range(1, 7)]
    labels = [f"ball {int(p)}" for p in place]
    for name, lengths, parameters in (("gap_mm", gaps, 2), ("radius_mm", gaps + radius[0], 0)):
        cells = [[*row, f"{value:.5f}"] for row, value in zip(q, lengths, strict=True)]
        rows = [[*cell, label] for cell, label in zip(cells, labels, strict=True)]
        write_table("s.csv", [*joints, name, "Kugel"], rows)
        said = run("import", "s.csv", *UR10, "-o", "s.h5", "--force").stderr
        assert said == "wrote s.h5: 60 configurations of ur10, distances from spheres\n"
        assert answer("info", "s.h5")["observation"] == "distances from spheres"
        found = stored("s.h5", "registration/spheres")[:, 3]
        assert (np.abs(found) > 0.05).sum() == parameters
        value = answer("identify", "s.h5", "-o", "c.h5", "--force")
        assert value["base"]["residual_rms_mm"] < 0.06


def test_a_tool_seen_from_a_second_arm() -> None:
    run("simulate", "ur10", "--observe", "second-arm", "-n", 60, "-o", "t.h5")
    arm = load_robot("ur10")
    first = np.rad2deg(stored("t.h5", "measurements/joint_positions"))
    flange = stored("t.h5", "registration/T_base2_flange2")
    solved = inverse_kinematics(arm, flange)
    second = solved.q
    assert np.all(solved.reached)
    points = stored("t.h5", "measurements/points")[:, 0] * 1e3
    joints = [f"j{i}_deg" for i in range(1, 7)]
    header = [*joints, *(f"second_{j}" for j in joints), "x_mm", "y_mm", "z_mm"]
    rows = np.concatenate([first, np.rad2deg(second), points], axis=-1).tolist()
    write_table("two.csv", header, rows)
    said = run("import", "two.csv", *UR10, "--second-arm", "ur10", "-o", "m.h5").stderr
    assert said.startswith("wrote m.h5: 60 configurations of ur10, points of the tool (1) in a")
    assert np.abs(stored("m.h5", "registration/T_base2_flange2") - flange).max() < 1e-6
    value = answer("identify", "m.h5", "-o", "c.h5")
    assert value["base"]["residual_rms_mm"] < 0.06
    run("identify", "t.h5", "-o", "d.h5")
    one, two = (stored(f"{n}.h5", "model/errors/placements") for n in "cd")
    assert np.abs(one - two).max() < 1e-5
    message = refused(3, "import", "two.csv", *UR10, "--second-arm", "planar-3r", "-o", "n.h5")
    assert message.startswith("two.csv:1: 'j4_deg' names joint 4")


def test_a_station_that_nothing_ties_to_the_others_is_named() -> None:
    header, *rows = Path("stations.csv").read_text().split()
    Path("alone.csv").write_text("\n".join([header, *rows[:24], *rows[24:26]]))
    said = run("import", "alone.csv", *UR10, "-o", "m.h5").stderr
    assert "warning: B: 2 rows with 6 readings, but 6 are needed to determine where it is" in said
    assert "measure at least 4 rows there" in said
    assert "B: 2 rows with 6 readings" in run("identify", "m.h5", "-o", "c.h5").stderr


@pytest.mark.parametrize(("kind", "enough"), [("plane", 3), ("sphere", 4), ("camera", 1)])
def test_a_place_with_too_few_rows_is_named_for_every_kind(kind: str, enough: int) -> None:
    seen = simulate(load_robot("ur5"), Simulation(1, 60, "full", instrument=kind, places=2))
    assert seen.place is not None
    first = np.flatnonzero(seen.place == 0)
    for rows, named in ((enough, 1), (enough + 1, 0)):
        kept = np.concatenate([first, np.flatnonzero(seen.place == 1)[:rows]])
        found = [f for f in check_measurements(seen.rows(kept)) if f.name == "lonely_place"]
        assert len(found) == named
