"""Configuration data: the controllers' definitions on arms built after them, and the
branches that are found.
"""

from functools import cache
from itertools import product

import numpy as np
import pytest
from program_reading import solve_pose

from calibtool.programs.branches import Controller
from calibtool.programs.configurations import Abb, Configuration, Digit, Fanuc, Kuka, posture
from calibtool.programs.formats import coupling_of
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.source import source_from_urdf

# Axes and origins of a KUKA arm at zero: A1 and the wrist's roll axes count clockwise, the arm lies
# stretched along x.
KUKA = [
    ("0 0 -1", "0 0 0.675"),
    ("0 1 0", "0.26 0 0"),
    ("0 1 0", "0.68 0 0"),
    ("-1 0 0", "0.4 0 0.035"),
    ("0 1 0", "0.27 0 0"),
    ("-1 0 0", "0.158 0 0"),
]


@cache
def kuka() -> Robot:
    """An arm with a KUKA's joint directions; every joint ±170 deg, the last three ±350."""
    parts = ['<robot name="k"><link name="l0"/>']
    for k, (axis, origin) in enumerate(KUKA):
        limit = np.deg2rad(170 if k < 3 else 350)
        parts.append(
            f'<link name="l{k + 1}"/><joint name="a{k + 1}" type="revolute"><parent '
            f'link="l{k}"/><child link="l{k + 1}"/><origin xyz="{origin}"/><axis xyz="{axis}"/>'
            f'<limit lower="{-limit}" upper="{limit}" effort="0" velocity="0"/></joint>'
        )
    return Robot.from_source(source_from_urdf("".join([*parts, "</robot>"]), "k"))


@cache
def fanuc() -> Controller:
    robot = load_robot("fanuc-m1000ia")
    return Controller(robot, coupling_of(robot, "fanuc-ls", "controller"))


def controller_of(robot: Robot) -> Controller:
    return Controller(robot, np.eye(robot.n))


def digit(value: int) -> Digit:
    return Digit(0, 1, value)


def means(controller: Controller, configuration: Configuration, degrees: list[float]) -> bool:
    """Whether the controller's joint values are what the configuration data ask for."""
    q = np.deg2rad(np.array(degrees, dtype=float))
    zero = posture(controller.robot, np.zeros(6), np.zeros(6))
    here = posture(controller.robot, controller.to_serial(q), q)
    return configuration.branch(here, zero) and configuration.turns(q)


# --- the controllers' definitions -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("degrees", "status", "turn"),
    [
        ([-10, -60, 100, 5, 45, -20], 2, 35),  # the usual posture: S 2, T 35
        ([-10, -60, 100, -5, -45, 20], 6, 27),  # wrist flipped: S 6, T 27
        ([10, -60, -60, 5, 45, 20], 0, 6),
        ([10, -120, 20, 5, 45, 20], 3, 2),  # leaning back over axis 1: the overhead area
        ([10, -120, -80, 5, -45, 20], 5, 22),
    ],
)
def test_kuka(degrees: list[float], status: int, turn: int) -> None:
    controller = controller_of(kuka())
    assert means(controller, Kuka(status, digit(turn)), degrees)
    assert means(
        controller, Kuka(status | 16, digit(turn)), degrees
    )  # bit 4: a robot with absolute accuracy
    for bit in range(3):
        assert not means(controller, Kuka(status ^ 1 << bit, None), degrees)
    for bit in range(6):
        assert not means(controller, Kuka(None, digit(turn ^ 1 << bit)), degrees)


@pytest.mark.parametrize(
    ("degrees", "text"),
    [
        ([0, 0, 0, 0, -90, 0], "N U T"),
        ([0, 0, 0, 180, 90, 180], "F U T"),
        ([0, 10, -30, 0, -70, 0], "N U T"),
        ([0, -64, 78, 0, -30, 0], "N U B"),
        ([0, 60, 160, 0, -60, 0], "N D T"),
    ],
)
def test_fanuc(degrees: list[float], text: str) -> None:
    letters = [Fanuc(*c) for c in product("NF", "UD", "TB")]
    assert [c.text for c in letters if means(fanuc(), c, degrees)] == [f"{text}, 0, 0, 0"]
    assert not means(fanuc(), Fanuc(*text.split()), [*degrees[:5], 200])


def test_fanuc_couples_joints_2_and_3() -> None:
    """J3 is the forearm's angle against the horizontal: with J3 unchanged, moving J2
    does not tilt it.
    """
    controller = fanuc()
    forearm = [
        controller.robot.mechanism.forward(
            controller.to_serial(np.deg2rad([[0.0, j2, -15.0, 0.0, 0.0, 0.0]]))
        )[0, :3, 2]
        for j2 in (0.0, 40.0)
    ]
    np.testing.assert_allclose(forearm[0], forearm[1], atol=1e-12)
    q = np.random.default_rng(0).normal(size=(5, 6))
    np.testing.assert_allclose(controller.to_controller(controller.to_serial(q)), q, atol=1e-12)
    np.testing.assert_allclose(coupling_of(controller.robot, "fanuc-ls", "serial"), np.eye(6))
    np.testing.assert_allclose(coupling_of(controller.robot, "abb-rapid", None), np.eye(6))
    np.testing.assert_allclose(
        coupling_of(controller.robot, "fanuc-ls", None), controller.robot.coupling
    )


@pytest.mark.parametrize(
    ("degrees", "quadrants", "cfx"),
    [
        ([10, 10, -10, 20, 40, 100], (0, 0, 1), 0),
        ([-10, 10, -10, -100, -40, 190], (-1, -2, 2), 1),
        ([10, -64, 15, 20, 40, -300], (0, 0, -4), 4),
    ],
)
def test_abb(degrees: list[float], quadrants: tuple[int, int, int], cfx: int) -> None:
    """On an arm that stands as ABB's do at zero: upper arm up, forearm ahead."""
    controller = controller_of(load_robot("fanuc-m1000ia"))
    first, second, third = quadrants
    assert means(controller, Abb((digit(first), digit(second), digit(third)), cfx), degrees)
    assert means(controller, Abb((digit(first), digit(second), digit(third)), 0), degrees)
    assert not means(
        controller, Abb((digit(first), digit(second), digit(third)), cfx ^ 1 or 3), degrees
    )
    assert not means(controller, Abb((digit(first + 1), digit(second), digit(third)), cfx), degrees)


# --- what a correction changes --------------------------------------------------------------------


def test_turn_bits_and_quadrants_follow_the_joints() -> None:
    q = np.deg2rad([0.5, 10, -10, 20, 30, 40])
    turn = digit(0b000100)
    assert Kuka(2, turn).digits(q) == []
    assert Kuka(2, turn).digits(q - np.deg2rad([1, 0, 0, 0, 0, 0])) == [(turn, 0b000101)]
    quadrants = (Digit(0, 1, 0), Digit(2, 3, 0), Digit(4, 5, 0))
    assert Abb(quadrants, 0).digits(q) == []
    assert Abb(quadrants, 0).digits(q - np.deg2rad([1, 0, 0, 0, 0, 0])) == [(quadrants[0], -1)]


# --- the branch of a pose -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "degrees",
    [[-10, -60, 100, 5, 45, -20], [-10, -60, 100, -175, -45, 160], [10, -120, 20, 5, 45, 20]],
)
def test_the_branch_that_is_asked_for(degrees: list[float]) -> None:
    """From a home on another branch, and into the turn that T names."""
    robot = kuka()
    q = np.deg2rad(np.array(degrees, dtype=float))
    here = posture(robot, q, q)
    status = (not here.front) | here.bent << 1 | (not here.flexed) << 2
    turn = sum(1 << k for k, value in enumerate(q) if value < 0)
    T = robot.mechanism.forward(q[None])[0]
    found = solve_pose(
        controller_of(robot), T, Kuka(status, digit(turn)), np.deg2rad([20.0, -80, 80, 60, 60, 60])
    )
    np.testing.assert_allclose(np.rad2deg(found), degrees, atol=1e-5)


def test_without_configuration_data_the_target_before_decides() -> None:
    robot = kuka()
    T = robot.mechanism.forward(np.deg2rad([[-10.0, -60, 100, 5, 45, -20]]))[0]
    for degrees in ([-10, -60, 100, 5, 45, -20], [-10, -60, 100, -175, -45, 160]):
        found = solve_pose(controller_of(robot), T, None, np.deg2rad(np.array(degrees) + 2.0))
        np.testing.assert_allclose(np.rad2deg(found), degrees, atol=1e-5)


def test_why_there_is_no_answer() -> None:
    robot = kuka()
    controller = controller_of(robot)
    T = robot.mechanism.forward(np.deg2rad([[-10.0, -60, 100, 5, 45, -20]]))[0]
    assert solve_pose(controller, T, Kuka(2, digit(63)), None) == (
        "the pose cannot be reached with the configuration S 2, T 63"
    )
    T[0, 3] += 9.0
    assert "unreachable" in str(solve_pose(controller, T, None, None))
    three = load_robot("planar-3r")
    T = three.mechanism.forward(np.zeros((1, 3)))[0]
    assert "six-joint arm" in str(solve_pose(controller_of(three), T, Kuka(2, None), None))
