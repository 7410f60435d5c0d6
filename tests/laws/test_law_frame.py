"""Gauge laws of base and tool frame: nothing that was seen changes, and taught poses move least."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from strategies import configurations, geometric, measured, network, perfect, with_motion_errors

from calibtool.calibration import Calibration, identify
from calibtool.errormodel.robot_errors import RobotErrors
from calibtool.errors import InputError
from calibtool.measurement.setup import Setup
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, readonly

FREE = [(False, False), (False, True), (True, False)]  # frame known, targets known
SIX = ("fanuc-m1000ia", "ur5", "panda", "tiago-arm")
FEW = ("scara", "planar-3r", "gantry", "so100")


def made(robot: Robot, rng: np.random.Generator, with_network: bool) -> Calibration:
    """Made-up errors of 5 mm and 5 mrad, in every element."""
    q = configurations(robot, 20, rng)
    plain = identify(measured(robot, q, perfect(robot), rng), "nominal")
    errors = with_motion_errors(geometric(robot, rng, 5e-3), rng)
    base = replace(plain.base, model="complete", errors=errors)
    networks = (network(robot, plain.equivalent.p, q, rng),) if with_network else ()
    return replace(plain, base=base, networks=networks)


def unregistered(name: str, known: tuple[bool, bool], *, sensor: bool = False) -> Calibration:
    """The same in a set-up of which parts are unknown; with a network where n ≥ 6."""
    robot, rng = load_robot(name), np.random.default_rng(7)
    calibration = made(robot, rng, robot.n >= 6)
    setup = Setup(
        T_instrument_base=readonly(exp6(rng.normal(size=6))),
        targets=robot.targets[:1] if sensor else robot.targets,
        R_tool_sensor=readonly(exp6(rng.normal(size=6))[:3, :3]) if sensor else None,
        frame_known=known[0],
        targets_known=known[1],
    )
    return replace(calibration, base=replace(calibration.base, setup=setup))


def seen(calibration: Calibration, q: Array) -> tuple[Array, Array]:
    """Target points (N, m, 3) and sensor orientations (N, 3, 3) in the instrument's frame."""
    setup = calibration.setup
    pose = setup.T_instrument_base @ calibration.forward(q)
    sensor = np.eye(3) if setup.R_tool_sensor is None else setup.R_tool_sensor
    points = np.einsum("kab,mb->kma", pose[:, :3, :3], setup.targets) + pose[:, None, :3, 3]
    return points, pose[:, :3, :3] @ sensor


@pytest.mark.parametrize("sensor", [False, True])
@pytest.mark.parametrize("known", FREE)
@pytest.mark.parametrize("name", [*SIX, *FEW])
def test_what_the_instrument_sees_is_the_same_in_every_frame(
    name: str, known: tuple[bool, bool], sensor: bool, rng: np.random.Generator
) -> None:
    calibration = unregistered(name, known, sensor=sensor)
    robot = calibration.robot
    q = robot.lower + (robot.upper - robot.lower) * rng.random((20, robot.n))
    points, turns = seen(calibration, q)
    taught = calibration.in_frame("taught")
    for again in (taught, taught.in_frame("fitted"), taught.in_frame("fitted").in_frame("taught")):
        there, turned = seen(again, q)
        np.testing.assert_allclose(there, points, atol=1e-12)
        if sensor:
            np.testing.assert_allclose(turned, turns, atol=1e-12)
    moved = np.abs(taught.forward(q) - calibration.forward(q)).max()
    assert moved > 1e-4  # it is another frame


@pytest.mark.parametrize("known", FREE)
def test_a_known_part_of_the_set_up_stays(known: tuple[bool, bool]) -> None:
    calibration = unregistered("ur5", known)
    taught = calibration.in_frame("taught")
    same_base = np.array_equal(taught.setup.T_instrument_base, calibration.setup.T_instrument_base)
    same_targets = np.allclose(taught.setup.targets, calibration.setup.targets, rtol=0, atol=1e-15)
    assert (same_base, same_targets) == known


@pytest.mark.parametrize("known", FREE)
@pytest.mark.parametrize("name", ["ur5", "scara", "planar-3r"])
def test_what_is_nothing_but_another_frame_is_taken_back_whole(
    name: str, known: tuple[bool, bool]
) -> None:
    calibration = unregistered(name, known)
    robot, n = calibration.robot, calibration.robot.n
    placements = np.zeros((n + 1, 6))
    if not known[0]:
        placements[0] = [3e-3, -5e-3, 2e-3, 4e-3, -3e-3, 6e-3]
    if not known[1]:
        placements[-1] = [1e-3, 2e-3, -3e-3, 5e-3, 1e-3, -2e-3]
    base = replace(calibration.base, errors=RobotErrors.of(robot, placements=placements))
    alone = replace(calibration, base=base, networks=())
    nominal = robot.mechanism.forward(alone.q)
    assert np.abs(alone.forward(alone.q) - nominal).max() > 1e-3
    np.testing.assert_allclose(alone.in_frame("taught").forward(alone.q), nominal, atol=1e-9)


@pytest.mark.parametrize("known", FREE)
@pytest.mark.parametrize("name", ["fanuc-m1000ia", "gantry"])
def test_no_other_base_and_tool_move_the_commands_less(name: str, known: tuple[bool, bool]) -> None:
    """The sum of squares against that of scipy's minimiser over twelve numbers."""
    calibration = replace(unregistered(name, known), networks=())
    q, noise = calibration.q, (calibration.noise_position, calibration.noise_orientation)
    fitted, nominal = calibration.forward(q), calibration.robot.mechanism.forward(q)

    def errors(pose: Array) -> Array:
        turn = Rotation.from_matrix(pose[:, :3, :3] @ nominal[:, :3, :3].swapaxes(1, 2)).as_rotvec()
        return np.concatenate(
            [(pose - nominal)[:, :3, 3] / noise[0], turn / noise[1]], axis=-1
        ).ravel()

    def moved(x: Array) -> Array:
        base, tool = np.eye(4), np.eye(4)
        for T, part, fixed in ((base, x[:6], known[0]), (tool, x[6:], known[1])):
            if not fixed:
                T[:3, 3], T[:3, :3] = part[:3], Rotation.from_rotvec(part[3:]).as_matrix()
        return errors(base @ fitted @ tool)

    best = least_squares(moved, np.zeros(12), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    found = errors(calibration.in_frame("taught").forward(q))
    assert (found**2).sum() <= 2 * best.cost * (1 + 1e-7)
    assert (errors(fitted) ** 2).sum() > 1.05 * (found**2).sum()


def test_a_network_with_virtual_joints_keeps_the_frame_of_its_training() -> None:
    calibration = unregistered("scara", (False, False))
    networks = made(calibration.robot, np.random.default_rng(3), True).networks
    with pytest.raises(InputError, match="train again with --frame taught"):
        replace(calibration, networks=networks).in_frame("taught")
