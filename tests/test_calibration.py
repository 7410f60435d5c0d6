"""A calibration is its base model and a network on top; it belongs to one robot and one set-up."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from calibtool.calibration import Calibration, check_same_robot, fitting_setup, identify, train
from calibtool.calibration.calibration import CrossValidation
from calibtool.equivalent.training import TrainingOptions
from calibtool.errors import InputError
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array
from calibtool.robot.source import parse_source


def twist_matrix(twist: Array) -> Array:
    v, (a, b, c) = twist[:3], twist[3:]
    return np.array([[0, -c, b, v[0]], [c, 0, -a, v[1]], [-b, a, 0, v[2]], [0, 0, 0, 0]])


def trained(name: str, base: str = "nominal") -> tuple[Calibration, Array]:
    robot = load_robot(name)
    workspace = robot.workspace()
    measurements = simulate(robot, Simulation(seed=1, workspace=workspace, configurations=60))
    calibration = train(
        measurements, base, TrainingOptions(regularisation="early-stopping", restarts=1)
    )
    return calibration, sample_configurations(robot, workspace, 5, np.random.default_rng(9))


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "panda", "scara"])
def test_the_calibrated_pose_is_the_base_model_s_moved_by_the_network(name: str) -> None:
    calibration, q = trained(name)
    assert calibration.network is not None
    robot, n = calibration.robot, calibration.robot.n
    for k in range(len(q)):
        # The spatial Jacobian of actuated joints by differences, and Ad(T) columns of virtual
        # ones, written out.
        pose = robot.mechanism.forward(q[k : k + 1])[0]
        columns = []
        for j in range(n):
            e = 1e-6 * np.eye(n)[j]
            rate = (
                robot.mechanism.forward((q[k] + e)[None])[0]
                - robot.mechanism.forward((q[k] - e)[None])[0]
            ) / 2e-6
            D = rate @ np.linalg.inv(pose)
            columns.append([*D[:3, 3], D[2, 1], D[0, 2], D[1, 0]])
        for joint in calibration.equivalent.virtual_joints:
            axis = pose[:3, "xyz".index(joint[-1])]
            turning = joint.startswith("r")
            columns.append(
                [*np.cross(pose[:3, 3], axis), *axis] if turning else [*axis, 0.0, 0.0, 0.0]
            )
        dy = np.array(columns).T @ calibration.network(q[k : k + 1])[0]
        expected = expm(twist_matrix(dy)) @ pose
        assert np.abs(calibration.forward(q[k : k + 1])[0] - expected).max() < 1e-9
        assert np.abs(expected - pose).max() > 1e-5


def test_without_a_network_it_is_the_base_model(fanuc: Robot, fanuc_local_poe: Calibration) -> None:
    q = sample_configurations(fanuc, fanuc.workspace(), 5, np.random.default_rng(9))
    assert fanuc_local_poe.network is None
    assert fanuc_local_poe.training is None
    for k in range(5):
        T = np.eye(4)
        for j in range(7):
            T = (
                T
                @ fanuc.chain.placements[j]
                @ expm(twist_matrix(fanuc_local_poe.base.errors["placements"][j]))
            )
            if j < 6:
                T = T @ expm(twist_matrix(fanuc.chain.twists[j]) * q[k, j])
        assert np.abs(fanuc_local_poe.forward(q[k : k + 1])[0] - T).max() < 1e-9


def test_the_nominal_calibration_is_the_nominal_robot(
    fanuc: Robot, fanuc_measurements: Measurements
) -> None:
    calibration = identify(fanuc_measurements, "nominal")
    q = fanuc_measurements.q[:5]
    assert np.abs(calibration.forward(q) - fanuc.mechanism.forward(q)).max() < 1e-12


def test_pose_and_jacobian_agree_with_the_pose_alone(
    fanuc_network: Calibration, fanuc_local_poe: Calibration
) -> None:
    q = np.linspace(-0.5, -0.1, 12).reshape(2, 6)
    for calibration in (fanuc_network, fanuc_local_poe):
        assert np.abs(calibration.forward_and_jacobian(q)[0] - calibration.forward(q)).max() < 1e-12


def test_an_identified_base_is_used_as_it_is(
    fanuc_measurements: Measurements, fanuc_local_poe: Calibration
) -> None:
    calibration = train(
        fanuc_measurements,
        fanuc_local_poe,
        TrainingOptions(regularisation="early-stopping", restarts=1),
    )
    assert np.array_equal(
        calibration.base.errors["placements"], fanuc_local_poe.base.errors["placements"]
    )
    by_name = train(
        fanuc_measurements,
        "local-poe",
        TrainingOptions(regularisation="early-stopping", restarts=1),
    )
    q = fanuc_measurements.q[:5]
    assert np.array_equal(calibration.forward(q), by_name.forward(q))


def test_the_facts_of_the_measurements_are_kept(
    fanuc_measurements: Measurements, fanuc_network: Calibration
) -> None:
    assert fanuc_network.configurations == 100
    assert fanuc_network.noise_position == fanuc_measurements.noise_position
    assert fanuc_network.base.model == "nominal"


@pytest.mark.parametrize("other", ["ur5", "fanuc-m900ib-700"])
def test_a_base_for_another_robot_is_refused(other: str, fanuc_local_poe: Calibration) -> None:
    robot = load_robot(other)
    measurements = simulate(robot, Simulation(configurations=20))
    with pytest.raises(
        InputError, match=f"for 'fanuc-m1000ia', but the measurements for '{other}'"
    ):
        train(
            measurements,
            fanuc_local_poe,
            TrainingOptions(regularisation="early-stopping", restarts=1),
        )


def test_a_robot_is_the_same_by_its_kinematics_and_not_by_its_name(fanuc: Robot) -> None:
    source = fanuc.source
    renamed = Robot.from_source(
        parse_source(
            source.toml_text.replace('name = "fanuc-m1000ia"', 'name = "mine"'),
            source.urdf_text,
            "mine",
        )
    )
    check_same_robot(fanuc, renamed, "a", "b")
    longer = Robot.from_source(
        parse_source(source.toml_text, source.urdf_text.replace("1.221", "1.222"), "longer")
    )
    assert np.abs(longer.chain.placements - fanuc.chain.placements).max() > 1e-4
    with pytest.raises(InputError, match="the kinematics differ"):
        check_same_robot(fanuc, longer, "a", "b")


# --- set-ups --------------------------------------------------------------------------------------


def test_an_unknown_setup_is_that_of_the_calibration(fanuc: Robot) -> None:
    workspace = fanuc.workspace()
    first = simulate(fanuc, Simulation(seed=1, workspace=workspace, unregistered=True))
    again = simulate(fanuc, Simulation(seed=1, workspace=workspace, same_robot=first.truth))
    calibration = identify(first, "local-poe")
    setup = fitting_setup(calibration, again)
    poses = setup.T_instrument_base @ calibration.forward(again.q)
    predicted = np.einsum("kab,mb->kma", poses[:, :3, :3], setup.targets) + poses[:, None, :3, 3]
    # δξ and δq are not all representable; the set-up must not add anything of its
    # own size (metres).
    assert np.abs(predicted - again.points).max() < 2e-3


def test_a_known_setup_is_that_of_the_measurements(
    fanuc_measurements: Measurements, fanuc_network: Calibration
) -> None:
    moved = replace(
        fanuc_measurements,
        setup=Setup(
            fanuc_measurements.setup.T_instrument_base, fanuc_measurements.setup.targets * 2
        ),
    )
    assert fitting_setup(fanuc_network, moved) is moved.setup


def test_targets_of_another_number_do_not_fit(fanuc: Robot, fanuc_network: Calibration) -> None:
    q = np.zeros((4, 6))
    one = Setup(np.eye(4), np.zeros((1, 3)), frame_known=False, targets_known=False)
    points = fanuc.mechanism.forward(q)[:, None, :3, 3]
    for measurements in (
        Measurements(fanuc, q, points, None, one, 1e-4, 1e-4),
        Measurements(
            fanuc, q, np.repeat(points, 3, axis=1), fanuc.mechanism.forward(q)[:, :3, :3],
            Setup(np.eye(4), np.zeros((3, 3)), np.eye(3), False, False), 1e-4, 1e-4,
        ),
    ):  # fmt: skip
        with pytest.raises(InputError, match="made with other targets"):
            fitting_setup(fanuc_network, measurements)


@pytest.mark.parametrize(
    ("gain", "error", "told"),
    [
        (12.34, 3.4, "+12.3 ± 3.4 %"),
        (0.0431, 0.012, "+0.04 ± 0.01 %"),
        (-0.0001, 0.2, "+0.0 ± 0.2 %"),
        (1e-9, 1e-9, "+0.0 ± 0.0 %"),
    ],
)
def test_a_small_gain_is_reported_with_two_decimals(gain: float, error: float, told: str) -> None:
    assert str(CrossValidation(5, gain, error)) == told
