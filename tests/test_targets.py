"""Tables of targets in, corrected joints out: units, other columns and order kept, every doubtful
row named by line.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify
from calibtool.compensation.solve import Method, compensate_joints, compensate_poses
from calibtool.compensation.stream import StreamOptions, compensate_text
from calibtool.compensation.targets import read_configurations
from calibtool.errors import InputError, NoSolutionError
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.coupling import JointValues
from calibtool.robot.se3 import Array


class CompensatedTable(NamedTuple):
    """What `compensate_text` gives, in one."""

    text: str
    rows: int
    remarks: list[str]
    unreachable: int


def compensate_table(
    calibration: Calibration,
    text: str,
    name: str,
    method: Method,
    joint_values: JointValues = "serial",
) -> CompensatedTable:
    options = StreamOptions(method=method, joint_values=joint_values)
    corrected, report = compensate_text(calibration, text, name, options)
    return CompensatedTable(corrected, report.rows, report.remarks, report.without_joints)


UR5_HOME = np.array([0.0, -80.0, 100.0, -110.0, -90.0, 0.0])


@cache
def calibrated(name: str = "ur5") -> Calibration:
    robot = load_robot(name)
    return identify(
        simulate(robot, Simulation(seed=1, configurations=30)),
        "local-poe",
    )


def configurations(name: str = "ur5", count: int = 5) -> Array:
    robot = load_robot(name)
    return sample_configurations(robot, robot.workspace(), count, np.random.default_rng(3))


def csv(header: list[str], values: Array, extra: str = "") -> str:
    rows = [",".join([*(f"{v:.17g}" for v in row)]) + extra for row in values]
    return "\n".join([",".join(header), *rows]) + "\n"


def joint_header(unit: str = "deg", n: int = 6, j3: str = "") -> list[str]:
    """j3: the word with which the third joint of a FANUC states whose values it holds."""
    return [f"j{i}_{j3}_{unit}" if j3 and i == 3 else f"j{i}_{unit}" for i in range(1, n + 1)]


def pose_values(T: Array) -> Array:
    quaternion = Rotation.from_matrix(T[:, :3, :3]).as_quat(scalar_first=True)
    return np.hstack([T[:, :3, 3] * 1e3, quaternion])


POSE_HEADER = ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]


def cells(result: CompensatedTable) -> tuple[list[str], list[list[str]]]:
    lines = [line.split(",") for line in result.text.splitlines()]
    assert result.rows == len(lines) - 1
    return lines[0], lines[1:]


def numbers(result: CompensatedTable, columns: list[str]) -> Array:
    header, rows = cells(result)
    return np.array([[float(row[header.index(column)]) for column in columns] for row in rows])


# --- joints ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["exact", "one-step"])
@pytest.mark.parametrize(("unit", "factor"), [("deg", 180 / np.pi), ("rad", 1.0)])
def test_joints_come_back_corrected_in_their_units(unit: str, factor: float, method: str) -> None:
    q = configurations()
    result = compensate_table(calibrated(), csv(joint_header(unit), q * factor), "t.csv", method)
    expected = compensate_joints(calibrated(), q, method).q
    assert np.allclose(numbers(result, joint_header(unit)), expected * factor, atol=1e-11)
    assert np.abs(expected - q).max() > 1e-5
    assert cells(result)[0] == [*joint_header(unit), "status"]


def test_prismatic_joints_keep_their_units() -> None:
    q = configurations("scara")
    expected = compensate_joints(calibrated("scara"), q).q
    for unit, factor in (("mm", 1e3), ("m", 1.0)):
        header = ["j1_deg", "j2_rad", f"j3_{unit}", "j4_deg"]
        scale = np.array([180 / np.pi, 1.0, factor, 180 / np.pi])
        result = compensate_table(calibrated("scara"), csv(header, q * scale), "t.csv", "exact")
        assert np.allclose(numbers(result, header), expected * scale, atol=1e-9)


def test_joint_columns_keep_their_order() -> None:
    q = configurations()
    header = joint_header()
    turned = header[::-1]
    straight = compensate_table(calibrated(), csv(header, np.rad2deg(q)), "t.csv", "exact")
    backwards = compensate_table(
        calibrated(), csv(turned, np.rad2deg(q)[:, ::-1]), "t.csv", "exact"
    )
    assert cells(backwards)[0][:6] == turned
    assert np.array_equal(numbers(straight, header), numbers(backwards, header))


def test_other_columns_pass_through_untouched() -> None:
    text = "point;j1_deg;j2_deg;j3_deg;speed;j4_deg;j5_deg;j6_deg;note\n"
    text += "P1;0,5;-80;100;250,0;-110;-90;0;weld, slowly\n\nP2;1,5;-80;100;0100;-110;-90;0;\n"
    header, rows = cells(
        compensate_table(calibrated(), text.replace(", slowly", " slowly"), "t.csv", "exact")
    )
    kept = [[row[header.index(name)] for name in ("point", "speed", "note")] for row in rows[:2]]
    assert header[-1] == "status"
    assert [row[0] for row in kept] == ["P1", "P2"]
    assert kept[1][1:] == ["0100", ""]


def test_a_text_with_commas_passes_through_in_quotes() -> None:
    values = ",".join(map(str, UR5_HOME))
    result = compensate_table(
        calibrated(), f'note,{",".join(joint_header())}\n"a, b",{values}\n', "t.csv", "exact"
    )
    assert '"a, b"' in result.text


def test_rows_keep_their_order_and_do_not_touch_each_other() -> None:
    q = configurations(count=4)
    together = numbers(
        compensate_table(calibrated(), csv(joint_header(), np.rad2deg(q)), "t.csv", "exact"),
        joint_header(),
    )
    for k in range(4):
        alone = compensate_table(
            calibrated(), csv(joint_header(), np.rad2deg(q[k : k + 1])), "t.csv", "exact"
        )
        assert np.allclose(numbers(alone, joint_header())[0], together[k], atol=1e-9)


# --- poses ----------------------------------------------------------------------------------------


def test_poses_become_joints_in_degrees() -> None:
    robot = calibrated().robot
    T = robot.mechanism.forward(configurations())
    result = compensate_table(calibrated(), csv(POSE_HEADER, pose_values(T)), "t.csv", "exact")
    header, _ = cells(result)
    assert header == [*joint_header(), "status"]
    reached = calibrated().forward(np.deg2rad(numbers(result, joint_header())))
    assert np.abs(reached - T).max() < 1e-9


def test_poses_of_a_robot_with_prismatic_joints_become_degrees_and_millimetres() -> None:
    robot = load_robot("gantry")
    q = configurations("gantry")
    T = robot.mechanism.forward(q)
    result = compensate_table(
        calibrated("gantry"), csv(POSE_HEADER, pose_values(T)), "t.csv", "exact"
    )
    columns = ["j1_mm", "j2_mm", "j3_mm", "j4_deg", "j5_deg"]
    assert cells(result)[0] == [*columns, "status", "left_mm", "left_mrad"]
    found = numbers(result, columns) * [1e-3, 1e-3, 1e-3, np.pi / 180, np.pi / 180]
    assert np.abs(found - compensate_joints(calibrated("gantry"), q).q).max() < 1e-6


def test_with_both_the_pose_is_commanded_and_the_joints_choose_the_branch() -> None:
    robot = load_robot("fanuc-m1000ia")
    home = robot.workspace().home
    flipped = home * [1, 1, 1, 1, -1, 1] + [0, 0, 0, np.pi, 0, np.pi]
    T = robot.mechanism.forward(home[None])
    for branch in (home, flipped):
        off = branch + 0.01  # near the branch, not at the pose
        values = np.hstack([np.rad2deg(off)[None], pose_values(T)])
        text = csv([*joint_header(), *POSE_HEADER], values)
        result = compensate_table(calibrated("fanuc-m1000ia"), text, "t.csv", "exact")
        header = joint_header(j3="serial")
        assert cells(result)[0] == [*header, "status"]
        q = np.deg2rad(numbers(result, header))
        assert np.abs(q - branch).max() < 0.02
        assert np.abs(calibrated("fanuc-m1000ia").forward(q) - T).max() < 1e-9


def test_extra_columns_of_poses_pass_through() -> None:
    T = calibrated().robot.mechanism.forward(configurations(count=1))
    text = csv(["id", *POSE_HEADER], np.hstack([[[7.0]], pose_values(T)]))
    header, rows = cells(compensate_table(calibrated(), text, "t.csv", "exact"))
    assert header == [*joint_header(), "id", "status"]
    assert rows[0][header.index("id")] == "7"


@pytest.mark.parametrize("name", ["gantry", "scara", "ur5"])
def test_poses_rounded_to_micrometres_and_microradians_are_reachable(name: str) -> None:
    """A text file rounds; an arm with n < 6 cannot follow the last digit, and need not."""
    robot = load_robot(name)
    T = robot.mechanism.forward(configurations(name))
    turns = Rotation.from_matrix(T[:, :3, :3]).as_rotvec()
    values = np.hstack([(T[:, :3, 3] * 1e3).round(3), turns.round(6)])
    text = csv(["x_mm", "y_mm", "z_mm", "rx_rad", "ry_rad", "rz_rad"], values)
    assert compensate_table(calibrated(name), text, "t.csv", "exact").unreachable == 0
    q = read_configurations(text, "t.csv", robot)
    assert np.abs(robot.mechanism.forward(q)[:, :3, 3] - T[:, :3, 3]).max() < 5e-6


# --- status and remarks ---------------------------------------------------------------------------


def doubtful() -> tuple[str, list[str]]:
    """Four rows, an empty line between them: fine, at the wrist
    singularity, beyond a limit, fine.
    """
    singular, beyond = UR5_HOME.copy(), UR5_HOME.copy()
    singular[4] = 0.1
    beyond[0] = 375.0
    rows = [",".join(map(str, row)) for row in (UR5_HOME, singular, beyond, UR5_HOME)]
    return "\n".join(
        [",".join(joint_header()), rows[0], "", rows[1], rows[2], rows[3]]
    ) + "\n", rows


def test_the_status_column_and_the_remarks_tell_of_doubtful_rows() -> None:
    result = compensate_table(calibrated(), doubtful()[0], "t.csv", "exact")
    header, rows = cells(result)
    assert [row[header.index("status")] for row in rows] == [
        "ok",
        "near-singular",
        "out-of-limits",
        "ok",
    ]
    assert len(result.remarks) == 2
    assert result.remarks[0].startswith("t.csv:4: near a singularity")
    assert result.remarks[1].startswith(
        "t.csv:5: a joint is held at its limit, or outside its limits"
    )
    assert result.unreachable == 0


def test_an_unreachable_pose_has_empty_joints_and_a_remark() -> None:
    T = calibrated().robot.mechanism.forward(np.deg2rad(UR5_HOME)[None]).repeat(2, axis=0)
    T[0, :3, 3] *= 20
    result = compensate_table(calibrated(), csv(POSE_HEADER, pose_values(T)), "t.csv", "exact")
    header, rows = cells(result)
    assert rows[0][:6] == [""] * 6
    assert [row[header.index("status")] for row in rows] == ["unreachable", "ok"]
    assert (result.unreachable, result.rows) == (1, 2)
    assert len(result.remarks) == 1
    assert result.remarks[0].startswith("t.csv:2: the pose is unreachable")


def test_what_fewer_joints_cannot_correct_is_reported_for_every_row() -> None:
    q = configurations("scara")
    header = ["j1_rad", "j2_rad", "j3_m", "j4_rad"]
    result = compensate_table(calibrated("scara"), csv(header, q), "t.csv", "exact")
    left = numbers(result, ["left_mm", "left_mrad"])
    reached = calibrated("scara").forward(numbers(result, header))
    wanted = load_robot("scara").mechanism.forward(q)
    turn = Rotation.from_matrix(
        reached[:, :3, :3] @ np.swapaxes(wanted[:, :3, :3], -1, -2)
    ).magnitude()
    assert np.allclose(
        left[:, 0],
        np.linalg.norm((reached - wanted)[:, :3, 3], axis=-1) * 1e3,
        rtol=1e-4,
        atol=1e-6,
    )
    assert np.allclose(left[:, 1], turn * 1e3, rtol=1e-4, atol=1e-6)
    assert left[:, 1].min() > 1e-3


# --- wrong tables ---------------------------------------------------------------------------------


def test_a_table_without_targets_is_refused() -> None:
    for text in ("a,b\n1,2\n", "x_mm,y_mm,z_mm\n1,2,3\n"):
        with pytest.raises(InputError, match=r"^t\.csv: neither joints .* nor poses"):
            compensate_table(calibrated(), text, "t.csv", "exact")
        with pytest.raises(InputError, match=r"^t\.csv: neither joints .* nor poses"):
            read_configurations(text, "t.csv", load_robot("ur5"))


@pytest.mark.parametrize("column", ["status", "left_mm", "left_mrad"])
def test_an_output_is_not_corrected_twice(column: str) -> None:
    text = csv([*joint_header(), column], np.array([[*UR5_HOME, 0.0]]))
    with pytest.raises(InputError, match=f"column '{column}' is there already"):
        compensate_table(calibrated(), text, "t.csv", "exact")


def test_a_bad_cell_is_named_by_line_and_column() -> None:
    text = csv(joint_header(), UR5_HOME[None]).rstrip() + "\n0,-80,n/a,-110,-90,0\n"
    with pytest.raises(
        InputError, match=r"^poses\.csv:3: column 'j3_deg' holds 'n/a'; expected a number"
    ):
        compensate_table(calibrated(), text, "poses.csv", "exact")


# --- configurations to measure at -----------------------------------------------------------------


def test_configurations_are_read_from_joints_or_poses() -> None:
    robot = load_robot("ur5")
    q = configurations()
    assert np.allclose(
        read_configurations(csv(joint_header(), np.rad2deg(q)), "t.csv", robot), q, atol=1e-12
    )
    T = robot.mechanism.forward(q)
    found = read_configurations(csv(POSE_HEADER, pose_values(T)), "t.csv", robot)
    assert np.abs(robot.mechanism.forward(found) - T).max() < 1e-7
    assert robot.within_limits(found).all()


def test_an_unreachable_configuration_is_named_by_its_line() -> None:
    robot = load_robot("ur5")
    T = robot.mechanism.forward(np.deg2rad(UR5_HOME)[None]).repeat(3, axis=0)
    T[1, :3, 3] *= 20
    with pytest.raises(NoSolutionError, match=r"^t\.csv:3: the pose is unreachable; 1 rows are"):
        read_configurations(csv(POSE_HEADER, pose_values(T)), "t.csv", robot)


def test_poses_are_followed_as_the_library_follows_them() -> None:
    T = calibrated().robot.mechanism.forward(np.deg2rad(UR5_HOME)[None]).repeat(4, axis=0)
    T[:, 2, 3] += np.linspace(0, 0.1, 4)
    result = compensate_table(calibrated(), csv(POSE_HEADER, pose_values(T)), "t.csv", "exact")
    expected = compensate_poses(calibrated(), T).q
    assert np.abs(np.deg2rad(numbers(result, joint_header())) - expected).max() < 1e-8


# --- whose joint values ---------------------------------------------------------------------------


@pytest.mark.parametrize("columns", [[1, 2, 3, 4, 5, 6], [3, 1, 2, 6, 5, 4]])
def test_a_controller_s_joints_come_in_and_go_out(columns: list[int]) -> None:
    calibration = calibrated("fanuc-m1000ia")
    robot, q = calibration.robot, configurations("fanuc-m1000ia")
    header = [f"j{j}_rad" for j in columns]
    order = np.array(columns) - 1
    shown = csv(header, robot.to_controller(q)[:, order])
    result = compensate_table(calibration, shown, "t", "exact", joint_values="controller")
    expected = compensate_joints(calibration, q, "exact").q
    written = numbers(result, joint_header("rad", j3="controller"))
    np.testing.assert_allclose(robot.to_serial(written), expected, atol=1e-12)
    assert np.abs(written - expected).max() > 0.01


def test_poses_give_a_controller_s_joints() -> None:
    calibration = calibrated("fanuc-m1000ia")
    robot = calibration.robot
    poses = csv(POSE_HEADER, pose_values(robot.mechanism.forward(configurations("fanuc-m1000ia"))))
    results = {
        values: compensate_table(calibration, poses, "t", "exact", joint_values=values)
        for values in ("serial", "controller")
    }
    serial, controller = (
        np.deg2rad(numbers(r, joint_header(j3=values))) for values, r in results.items()
    )
    np.testing.assert_allclose(robot.to_serial(controller), serial, atol=1e-12)
