"""Coupled joint values: what a controller shows and what the chain does, there and back, and
wrong descriptions.
"""

import numpy as np
import pytest
from poe import poe_frames

from calibtool.errors import InputError, UsageError
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.source import parse_source


def planar(coupling: str) -> Robot:
    source = load_robot("planar-3r").source
    return Robot.from_source(
        parse_source(
            f"{source.toml_text}\n[coupling]\n{coupling}\n", source.urdf_text, "robot.toml"
        )
    )


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "fanuc-m900ib-700"])
def test_joint_2_of_a_fanuc_leaves_the_forearm_as_it_leans(name: str) -> None:
    """J3 is the forearm's angle to the horizon: with J3 kept, J2 shifts the forearm and
    does not turn it.
    """
    robot = load_robot(name)
    shown = np.deg2rad([[10, -20, 15, 5, 30, 7], [10, 35, 15, 5, 30, 7]])
    forearm = poe_frames(robot.chain.placements, robot.chain.twists, robot.to_serial(shown)).after[
        :, 2
    ]
    np.testing.assert_allclose(forearm[1, :3, :3], forearm[0, :3, :3], atol=1e-12)
    assert np.linalg.norm(forearm[1, :3, 3] - forearm[0, :3, 3]) > 0.1
    assert robot.to_serial(shown)[0, 2] == pytest.approx(np.deg2rad(15 - 20))


def test_controller_values_come_back(robot: Robot, rng: np.random.Generator) -> None:
    q = rng.normal(size=(5, robot.n))
    np.testing.assert_allclose(robot.to_controller(robot.to_serial(q)), q, atol=1e-13)
    np.testing.assert_allclose(robot.to_serial(robot.to_controller(q[0])), q[0], atol=1e-13)
    assert robot.coupled == robot.name.startswith("fanuc")


def test_a_matrix_and_its_short_form_are_the_same() -> None:
    short = planar("add = { j2 = { j1 = 1 }, j3 = { j1 = 1, j2 = -0.5 } }")
    whole = planar("matrix = [[1, 0, 0], [1, 1, 0], [1, -0.5, 1]]")
    q = np.array([0.1, 0.2, 0.4])
    np.testing.assert_allclose(short.to_serial(q), [0.1, 0.3, 0.1 - 0.1 + 0.4])
    np.testing.assert_allclose(whole.to_serial(q), short.to_serial(q))


def test_without_a_coupling_values_are_as_they_are() -> None:
    robot = load_robot("planar-3r")
    q = np.array([[0.1, 0.2, 0.3]])
    np.testing.assert_array_equal(robot.coupling, np.eye(3))
    assert robot.serial_from("controller", q) is q
    assert load_robot("fanuc-m1000ia").serial_from("serial", q) is q


@pytest.mark.parametrize(
    ("coupling", "text"),
    [
        ("add = { j3 = { j2 = 1 } }", "q3 = J3 + J2"),
        (
            "add = { j2 = { j1 = -1 }, j3 = { j1 = 1, j2 = -0.5 } }",
            "q2 = J2 - J1, q3 = J3 + J1 - 0.5 J2",
        ),
        ("matrix = [[1, 0, 0], [0, -1, 0], [0, 1, 2]]", "q2 = - J2, q3 = 2 J3 + J2"),
        ("matrix = [[0, 1, 0], [1, 0, 0], [0, 0, 1]]", "q1 = J2, q2 = J1"),
    ],
)
def test_what_differs_is_reported(coupling: str, text: str) -> None:
    """In the message for unstated values, and in the names of the columns of those joints."""
    robot = planar(coupling)
    with pytest.raises(
        UsageError, match=r"^t\.csv: .*--joint-values serial or --joint-values controller"
    ) as caught:
        robot.joint_values("t.csv", None, None)
    assert f"({text})" in str(caught.value)
    named = {f"j{part.split()[0][1:]}_controller_deg" for part in text.split(", ")}
    assert {column for column in robot.columns("controller") if "controller" in column} == named
    assert robot.columns(None) == ["j1_deg", "j2_deg", "j3_deg"]


def test_what_header_and_option_state_is_weighed() -> None:
    robot = planar("add = { j3 = { j2 = 1 } }")
    assert robot.joint_values("t", None, "controller") == "controller"
    assert robot.joint_values("t", "serial", None) == "serial"
    assert robot.joint_values("t", "serial", "serial") == "serial"
    with pytest.raises(
        UsageError,
        match="header says that the joint values are serial, but --joint-values says controller",
    ):
        robot.joint_values("t", "serial", "controller")
    plain = load_robot("planar-3r")
    assert plain.joint_values("t") == "serial"
    assert plain.joint_columns == plain.columns("controller") == ["j1_deg", "j2_deg", "j3_deg"]


@pytest.mark.parametrize(
    ("coupling", "finding"),
    [
        ("matrix = [[1, 0], [0, 1]]", "2 rows of 2 numbers; the robot has 3 joints, so give 3 x 3"),
        ("matrix = [[1, 0, 0], [0, 1], [0, 0, 1]]", "3 rows of 2 and 3 numbers"),
        ("matrix = []", "0 rows"),
        ("matrix = [[1, 0, 0], [1, 0, 0], [0, 0, 1]]", "coupling.matrix is singular"),
        ("add = { j1 = { j2 = 1 }, j2 = { j1 = 1 } }", "coupling.add is singular"),
        ("matrix = [[1, 0, 0], [0, nan, 0], [0, 0, 1]]", "coupling.matrix.1.1"),
        ("add = { j3 = { j4 = 1 } }", "unknown joint 'j4'; the robot has j1 to j3"),
        ("add = { j3 = { j3 = 1 } }", "coupling.add.j3 names itself"),
        ("add = { elbow = { j1 = 1 } }", "coupling.add.elbow"),
        ("add = {}", "exactly one of 'matrix' and 'add'"),
        ("matrix = [[1]]\nadd = { j3 = { j2 = 1 } }", "exactly one of 'matrix' and 'add'"),
        ("fanuc = true", "unknown key 'coupling.fanuc'"),
    ],
)
def test_a_wrong_coupling_is_refused_in_one_line(coupling: str, finding: str) -> None:
    with pytest.raises(InputError) as caught:
        planar(coupling)
    message = str(caught.value)
    assert message.startswith("robot.toml: ")
    assert finding in message
    assert "\n" not in message
