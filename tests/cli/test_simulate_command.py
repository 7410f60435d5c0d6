"""calibtool simulate: which robot, where it is measured, with which
errors; the truth kept apart.
"""

import hashlib
import os
import pty
import subprocess
import sys
from pathlib import Path
from shutil import copytree

import h5py
import numpy as np
import pytest
from commandline import ENVIRONMENT, Files, answer, only_line, refused, run, stored, write_table
from scipy.spatial.transform import Rotation

from calibtool.robot.catalogue import load_robot, shipped

EXACT = ("--length-error-mm", 0, "--angle-error-mrad", 0, "--noise-mm", 0)
KINDS = ["geometric", "gear", "gravity", "backlash", "payload", "thermal", "bending", "wobble"]


def truth_of(path: str) -> dict[str, np.ndarray | float]:
    """Everything in the group truth, by its path."""
    found: dict[str, np.ndarray | float] = {}
    with h5py.File(path, "r") as file:
        file["truth"].visititems(
            lambda name, item: (
                found.__setitem__(name, item[()]) if isinstance(item, h5py.Dataset) else None
            )
        )
        found["temperature_c"] = float(file["truth"].attrs["temperature_c"])
    return found


def same_truth(a: str, b: str) -> bool:
    one, two = truth_of(a), truth_of(b)
    return one.keys() == two.keys() and all(np.array_equal(one[name], two[name]) for name in one)


# --- robots and numbers ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "n"), [("planar-3r", 3), ("scara", 4), ("gantry", 5), ("ur3", 6), ("panda", 7)]
)
def test_any_number_of_joints(name: str, n: int) -> None:
    run("simulate", name, "-n", 6, "-o", "m.h5")
    assert stored("m.h5", "measurements/joint_positions").shape == (6, n)
    assert stored("m.h5", "measurements/points").shape == (6, 3, 3)
    value = answer("info", "m.h5")
    assert (value["kind"], value["robot"], value["configurations"]) == ("measurements", name, 6)
    assert value["simulated"] is True


def test_a_hundred_configurations_by_default() -> None:
    run("simulate", "planar-3r", "-o", "m.h5")
    assert answer("info", "m.h5")["configurations"] == 100


def test_without_errors_the_measured_points_are_those_of_the_drawing() -> None:
    """Planar arm by hand: tool0 stands at the end of the links with its z
    axis along the last one.
    """
    run("simulate", "planar-3r", "-n", 5, *EXACT, "-o", "m.h5")
    turned = np.cumsum(stored("m.h5", "measurements/joint_positions"), axis=1)
    tool = sum(
        length * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
        for length, angle in zip((0.5, 0.4, 0.2), turned.T, strict=True)
    )
    along = np.stack([np.cos(turned[:, 2]), np.sin(turned[:, 2]), 0 * turned[:, 2]], axis=-1)
    across = np.stack([-np.sin(turned[:, 2]), np.cos(turned[:, 2]), 0 * turned[:, 2]], axis=-1)
    down = np.array([0.0, 0.0, -1.0])
    targets = np.array(answer("robots", "planar-3r")["targets_mm"]) * 1e-3
    expected = (
        tool[:, None]
        + targets[:, 0, None] * down
        + targets[None, :, 1, None] * across[:, None]
        + targets[None, :, 2, None] * along[:, None]
    )
    np.testing.assert_allclose(stored("m.h5", "measurements/points"), expected, atol=1e-9)


def test_noise_has_the_size_that_was_asked_for() -> None:
    for noise in (0, 0.2):
        run("simulate", "planar-3r", "-n", 400, "--noise-mm", noise, "-o", f"{noise}.h5")
    difference = stored("0.2.h5", "measurements/points") - stored("0.h5", "measurements/points")
    assert difference.std() == pytest.approx(0.2e-3, rel=0.1)
    assert answer("info", "0.2.h5")["noise_position_mm"] == pytest.approx(0.2)


def test_geometric_errors_have_the_sizes_that_were_asked_for() -> None:
    run("simulate", "panda", "-n", 4, "--length-error-mm", 2, "--angle-error-mrad", 0, "-o", "m.h5")
    placements = stored("m.h5", "truth/errors/placements")
    assert placements[:, :3].std() == pytest.approx(2e-3, rel=0.4)
    assert not placements[:, 3:].any()


@pytest.mark.parametrize(
    "form", [["--length-error-mm", "-1"], ["-n", "0"], ["--seed", "-1"], ["--noise-mm", "nan"]]
)
def test_numbers_out_of_range(form: list[str]) -> None:
    assert form[0] in refused(2, "simulate", "planar-3r", *form, "-o", "m.h5")


def test_infinite_noise_is_wrong_usage() -> None:
    message = refused(2, "simulate", "planar-3r", "-n", 4, "--noise-mm", "inf", "-o", "m.h5")
    assert "noise" in message
    assert "finite" in message


# --- kinds of errors ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_one_kind_of_errors(kind: str) -> None:
    run("simulate", "fanuc-m1000ia", "-n", 4, "--errors", kind, "-o", "m.h5")
    assert answer("info", "m.h5")["errors"] == [kind]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("all", KINDS),
        ("gear,geometric", ["geometric", "gear"]),
        ("thermal, gravity", ["gravity", "thermal"]),
    ],
)
def test_several_kinds_of_errors(text: str, expected: list[str]) -> None:
    run("simulate", "fanuc-m1000ia", "-n", 4, "--errors", text, "-o", "m.h5")
    assert answer("info", "m.h5")["errors"] == expected


def test_geometric_errors_are_the_default() -> None:
    run("simulate", "fanuc-m1000ia", "-n", 4, "-o", "m.h5")
    assert answer("info", "m.h5")["errors"] == ["geometric"]


def test_one_more_kind_leaves_the_others_as_they_were() -> None:
    run("simulate", "fanuc-m1000ia", "-n", 4, "-o", "one.h5")
    run("simulate", "fanuc-m1000ia", "-n", 4, "--errors", "all", "-o", "all.h5")
    for name in ("errors/placements", "errors/twists", "errors/offsets"):
        assert np.array_equal(stored("one.h5", f"truth/{name}"), stored("all.h5", f"truth/{name}"))
    joints = "measurements/joint_positions"
    assert np.array_equal(stored("one.h5", joints), stored("all.h5", joints))


@pytest.mark.parametrize("text", ["gears", "geometric,geer", "geometric,,gear", ""])
def test_unknown_kind_of_errors(text: str) -> None:
    message = refused(2, "simulate", "planar-3r", "--errors", text, "-o", "m.h5")
    assert message.startswith("--errors: ")
    assert all(kind in message for kind in ("all", *KINDS))


# --- the same robot again -------------------------------------------------------------------------


def test_seeds_make_other_robots_and_other_configurations() -> None:
    for seed in (0, 1):
        run("simulate", "planar-3r", "-n", 5, "--seed", seed, "-o", f"{seed}.h5")
    assert not same_truth("0.h5", "1.h5")
    joints = "measurements/joint_positions"
    assert not np.isclose(stored("0.h5", joints), stored("1.h5", joints)).any()


def test_same_robot_keeps_the_truth_and_takes_fresh_configurations() -> None:
    """Even with the same seed, no configuration may come twice: the
    second file judges the first.
    """
    run("simulate", "planar-3r", "-n", 20, "--errors", "all", "--seed", 3, "-o", "first.h5")
    run(
        "simulate", "planar-3r", "-n", 20, "--seed", 3, "--same-robot", "first.h5", "-o", "fresh.h5"
    )
    assert same_truth("first.h5", "fresh.h5")
    assert answer("info", "fresh.h5")["errors"] == answer("info", "first.h5")["errors"]
    first, fresh = (stored(f, "measurements/joint_positions") for f in ("first.h5", "fresh.h5"))
    assert np.abs(first[:, None] - fresh[None]).max(axis=-1).min() > 1e-6


def test_same_robot_keeps_an_unknown_set_up() -> None:
    run("simulate", "ur10", "-n", 10, "--unregistered", "-o", "first.h5")
    run("simulate", "ur10", "-n", 10, "--same-robot", "first.h5", "-o", "fresh.h5")
    assert same_truth("first.h5", "fresh.h5")
    assert answer("info", "fresh.h5")["registration"]["frame"] == "estimated"


def test_same_robot_takes_stdin(files: Files) -> None:
    data = Path(files.measurements).read_bytes()
    run("simulate", "planar-3r", "-n", 5, "--same-robot", "-", "-o", "fresh.h5", stdin=data)
    assert same_truth(files.measurements, "fresh.h5")
    assert (
        answer("info", "fresh.h5")["provenance"]["sha256_same_robot"]
        == hashlib.sha256(data).hexdigest()
    )


def test_same_robot_of_another_robot(files: Files) -> None:
    message = refused(
        3, "simulate", "fanuc-m1000ia", "--same-robot", files.measurements, "-o", "m.h5"
    )
    assert "planar-3r" in message
    assert "fanuc-m1000ia" in message


def test_same_robot_needs_a_simulation(files: Files) -> None:
    table = [
        ["j1_deg", "j2_deg", "j3_deg", "x_mm", "y_mm", "z_mm"],
        [[10 * k, 7 * k, 50, k, 2, 3] for k in range(9)],
    ]
    write_table("real.csv", table[0], table[1])
    run(
        "import",
        "real.csv",
        "--robot",
        "planar-3r",
        "--frame",
        "base",
        "--rows",
        "1:8",
        "-o",
        "real.h5",
    )
    message = refused(3, "simulate", "planar-3r", "--same-robot", "real.h5", "-o", "m.h5")
    assert message.startswith("real.h5: ")
    assert files.folder.is_dir()


def test_same_robot_contradicts_unregistered(files: Files) -> None:
    message = refused(
        2,
        "simulate",
        "planar-3r",
        "--same-robot",
        files.measurements,
        "--unregistered",
        "-o",
        "m.h5",
    )
    assert "--unregistered" in message


# --- where it is measured -------------------------------------------------------------------------


def test_at_joints_in_degrees_and_radians() -> None:
    angles = [[10.0, -20.5, 30.25], [0.0, 90.0, -45.0]]
    write_table(
        "deg.csv", ["name", "j3_deg", "j1_deg", "j2_deg"], [["p", a[2], a[0], a[1]] for a in angles]
    )
    write_table("rad.csv", ["j1_rad", "j2_rad", "j3_rad"], np.deg2rad(angles).tolist())
    for unit in ("deg", "rad"):
        run("simulate", "planar-3r", "--at", f"{unit}.csv", "-o", f"{unit}.h5")
        np.testing.assert_allclose(
            stored(f"{unit}.h5", "measurements/joint_positions"), np.deg2rad(angles), atol=1e-15
        )
        digest = hashlib.sha256(Path(f"{unit}.csv").read_bytes()).hexdigest()
        assert answer("info", f"{unit}.h5")["provenance"]["sha256_at"] == digest


def test_at_prismatic_joints_in_mm() -> None:
    write_table("t.csv", ["j1_mm", "j2_mm", "j3_m", "j4_deg", "j5_deg"], [[1500, 900, 0.4, 10, 40]])
    run("simulate", "gantry", "--at", "t.csv", "-o", "m.h5")
    expected = [[1.5, 0.9, 0.4, np.deg2rad(10), np.deg2rad(40)]]
    np.testing.assert_allclose(stored("m.h5", "measurements/joint_positions"), expected, atol=1e-15)


def test_at_poses() -> None:
    """The configurations found put the nominal tool at the poses asked for."""
    robot = load_robot("ur10")
    q = np.deg2rad([[10, -80, 70, -60, -80, 20], [-30, -100, 90, -100, -70, 0]])
    T = robot.mechanism.forward(q)
    values = np.hstack([T[:, :3, 3] * 1e3, Rotation.from_matrix(T[:, :3, :3]).as_rotvec()])
    write_table(
        "poses.csv", ["x_mm", "y_mm", "z_mm", "rx_rad", "ry_rad", "rz_rad"], values.tolist()
    )
    run("simulate", "ur10", "--at", "poses.csv", "-o", "m.h5")
    found = robot.mechanism.forward(stored("m.h5", "measurements/joint_positions"))
    np.testing.assert_allclose(found, T, atol=1e-7)


def test_the_first_workspace_is_the_default() -> None:
    run("simulate", "planar-3r", "-n", 20, "-o", "default.h5")
    run("simulate", "planar-3r", "-n", 20, "--workspace", "bench", "-o", "bench.h5")
    joints = "measurements/joint_positions"
    assert np.array_equal(stored("default.h5", joints), stored("bench.h5", joints))


def test_configurations_stay_in_the_workspace() -> None:
    """machining: a cube of 1 m about the home position, the tool axis within 30 deg
    of that at home.
    """
    run("simulate", "fanuc-m1000ia", "-n", 60, "-o", "m.h5")
    robot = load_robot("fanuc-m1000ia")
    value = answer("robots", "fanuc-m1000ia")
    T = robot.mechanism.forward(stored("m.h5", "measurements/joint_positions"))
    home = np.array(value["home_tool_position_mm"]) * 1e-3
    assert np.abs(T[:, :3, 3] - home).max() <= 0.5 + 1e-5
    axis = robot.mechanism.forward(np.deg2rad([[0, 10, -10, 0, -70, 0]]))[0, :3, 2]
    assert np.degrees(np.arccos(T[:, :3, 2] @ axis)).max() <= 30 + 1e-6


def test_full_is_the_joint_range() -> None:
    run("simulate", "ur3", "-n", 300, "--workspace", "full", "-o", "m.h5")
    q = np.rad2deg(stored("m.h5", "measurements/joint_positions"))
    for joint, values in zip(answer("robots", "ur3")["joint_table"], q.T, strict=True):
        low, high = joint["lower_deg"], joint["upper_deg"]
        assert low <= values.min() < low + 0.1 * (high - low)
        assert high >= values.max() > high - 0.1 * (high - low)


def test_unknown_workspace_lists_near_names() -> None:
    message = refused(2, "simulate", "planar-3r", "--workspace", "benhc", "-o", "m.h5")
    assert "'benhc'" in message
    assert "bench" in message.replace("benhc", "")
    assert "full" in refused(2, "simulate", "planar-3r", "--workspace", "xyz", "-o", "m.h5")


# --- set-up ---------------------------------------------------------------------------------------


def test_the_set_up_is_known_by_default() -> None:
    run("simulate", "ur10", "-n", 5, "-o", "m.h5")
    registration = answer("info", "m.h5")["registration"]
    assert (registration["frame"], registration["targets"]) == ("known", "known")
    assert registration["base_in_instrument_mm"] == [0.0, 0.0, 0.0]


def test_unregistered_estimates_what_it_hides() -> None:
    """With an exact robot and no noise the estimate is the truth; the instrument
    stands somewhere else.
    """
    run("simulate", "ur10", "-n", 15, "--unregistered", *EXACT, "-o", "m.h5")
    registration = answer("info", "m.h5")["registration"]
    assert (registration["frame"], registration["targets"]) == ("estimated", "estimated")
    for name in ("T_instrument_base", "targets"):
        estimated, true = (
            stored("m.h5", f"registration/{name}"),
            stored("m.h5", f"truth/registration/{name}"),
        )
        np.testing.assert_allclose(estimated, true, atol=1e-7)
    assert np.linalg.norm(stored("m.h5", "truth/registration/T_instrument_base")[:3, 3]) > 0.1


def test_unregistered_needs_enough_configurations() -> None:
    message = refused(4, "simulate", "planar-3r", "-n", 1, "--unregistered", "-o", "m.h5")
    assert "configurations" in message


# --- a robot of one's own -------------------------------------------------------------------------


def test_a_robot_of_ones_own() -> None:
    copytree(shipped("robots") / "planar-3r", "mine")
    run("simulate", "planar-3r", "-n", 5, "-o", "built-in.h5")
    for k, path in enumerate(("mine", "./mine", "mine/robot.toml", str(Path("mine").resolve()))):
        run("simulate", path, "-n", 5, "-o", f"{k}.h5")
        for name in ("measurements/joint_positions", "measurements/points"):
            assert np.array_equal(stored(f"{k}.h5", name), stored("built-in.h5", name))
    run("simulate", "mine/robot.urdf", "-n", 5, "-o", "urdf.h5")
    assert answer("info", "urdf.h5")["configurations"] == 5


def test_a_file_is_used_without_the_folder_it_came_from() -> None:
    copytree(shipped("robots") / "scara", "mine")
    run("simulate", "mine", "-n", 12, "-o", "m.h5")
    for path in Path("mine").iterdir():
        path.unlink()
    Path("mine").rmdir()
    run("identify", "m.h5", "-o", "c.h5")
    assert answer("info", "c.h5")["robot"] == "scara"


# --- output ---------------------------------------------------------------------------------------


def test_nothing_but_data_is_printed() -> None:
    result = run("simulate", "planar-3r", "-n", 4)
    assert result.stdout_bytes.startswith(b"\x89HDF\r\n\x1a\n")
    assert result.stderr == ""
    assert run("simulate", "planar-3r", "-n", 4, "-o", "m.h5").stdout_bytes == b""


def test_binary_is_never_written_to_a_terminal() -> None:
    main, terminal = pty.openpty()
    try:
        finished = subprocess.run(
            [sys.executable, "-m", "calibtool", "simulate", "planar-3r", "-n", "4"],
            stdout=terminal,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            env=ENVIRONMENT,
            timeout=60,
        )
        assert finished.returncode == 2
        message = only_line(finished.stderr.decode())
        assert "terminal" in message
        assert "-o" in message
        os.set_blocking(main, False)
        with pytest.raises(BlockingIOError):
            os.read(main, 1)
    finally:
        os.close(main)
        os.close(terminal)


# --- payload and temperature ----------------------------------------------------------------------


def test_payload_and_temperature_from_simulation_to_corrected_joints_and_code() -> None:
    kinds = ("--errors", "geometric,payload,thermal", "--payload-mrad", 2)
    loads = (*kinds, "--payload-kg", "0,10", "--temperature-c", "20,60")
    run("simulate", "ur5", "-n", 80, *loads, "-o", "m.h5")
    assert np.ptp(stored("m.h5", "measurements/payload_kg")) > 5
    assert stored("m.h5", "measurements/temperature_c")[[0, -1]].tolist() == [20, 60]
    families = answer("identify", "m.h5", "-o", "c.h5")["base"]["families"]
    assert {"payload", "temperature"} <= set(families)
    Path("t.csv").write_text("j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\n10,-60,50,-40,30,20\n")
    joints = []
    for load in ((), ("--payload-kg", 10), ("--payload-kg", 10, "--temperature-c", 60)):
        run("compensate", "c.h5", "t.csv", *load, "-o", "out.csv", "--force")
        joints.append(
            [float(cell) for cell in Path("out.csv").read_text().splitlines()[1].split(",")[:6]]
        )
    assert np.abs(np.diff(joints, axis=0)).max(axis=1).min() > 1e-4
    run("export", "c.h5", "--format", "c", "--payload-kg", 10, "--temperature-c", 60, "-o", "arm.c")
    assert "10 kg at the tool, links at 60 C" in Path("arm.h").read_text()


def test_a_payload_is_refused_without_its_errors() -> None:
    run("simulate", "planar-3r", "-n", 20, "-o", "m.h5")
    run("identify", "m.h5", "-o", "c.h5")
    Path("t.csv").write_text("j1_deg,j2_deg,j3_deg\n10,20,30\n")
    assert "payload_kg" in refused(
        2, "compensate", "c.h5", "t.csv", "--payload-kg", 5, "-o", "out.csv"
    )
    for bad in ("1,2,3", "-1", "x"):
        assert "--payload-kg" in refused(2, "simulate", "ur5", f"--payload-kg={bad}", "-o", "n.h5")


def test_the_same_robot_by_another_instrument_needs_its_name() -> None:
    run("simulate", "ur10", "--observe", "distance", "-n", 20, "-o", "wires.h5")
    message = refused(2, "simulate", "ur10", "--same-robot", "wires.h5", "-o", "m.h5")
    assert "give --observe" in message
    run("simulate", "ur10", "--same-robot", "wires.h5", "--observe", "distance", "-o", "m.h5")
