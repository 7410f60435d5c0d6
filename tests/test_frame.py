"""The frame of a calibration: everything speaks in it, the file keeps both, and how sure it is."""

import io
import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import h5py
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify, train
from calibtool.calibration.fit import BaseOptions
from calibtool.calibration.frame import FRAMES, FrameName, taught_frame
from calibtool.calibration.frame_report import frame_report
from calibtool.calibration.transfer import refit
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.compensation.solve import compensate_joints
from calibtool.errors import InputError, UsageError
from calibtool.evaluation.view.scene import scene_of
from calibtool.export.as_json import calibration_as_json
from calibtool.export.as_urdf import calibration_as_urdf
from calibtool.export.rendering import compensator_values
from calibtool.identification.complete import CompleteOptions
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, readonly
from calibtool.storage import read_calibration, to_bytes


def seen(calibration: Calibration, q: Array) -> Array:
    """Target points in the instrument's frame: (N, m, 3)."""
    setup = calibration.setup
    return at(setup.T_instrument_base @ calibration.forward(q), setup.targets)


def at(pose: Array, points: Array) -> Array:
    """Points (m, 3) of a frame at poses (N, 4, 4): (N, m, 3)."""
    return np.einsum("kab,mb->kma", pose[:, :3, :3], points) + pose[:, None, :3, 3]


# --- everything speaks in the chosen frame --------------------------------------------------------


@cache
def arm(name: str = "ur5", frame: FrameName = "taught", model: str = "complete") -> Calibration:
    """Identified from simulated measurements in an unknown set-up."""
    robot = load_robot(name)
    data = simulate(
        robot,
        Simulation(seed=4, configurations=40, unregistered=True),
    )
    options = BaseOptions(model, CompleteOptions(orders={"harmonics": 0, "gravity": 0}))
    return identify(data, options, frame)


@pytest.mark.parametrize("frame", FRAMES)
def test_exported_numbers_are_those_of_the_frame(frame: FrameName) -> None:
    calibration = arm(frame=frame)
    contents = json.loads(calibration_as_json(calibration))
    base = contents["base_model"]
    assert contents["frame"] == frame
    twists = np.array(contents["nominal_twists_per_rad_or_m"]) + np.array(
        base["twist_errors_per_rad_or_m"]
    )
    for q, pose in zip(calibration.q[:5], calibration.forward(calibration.q[:5]), strict=True):
        T = np.eye(4)
        moved = q + np.array(base["offset_errors_rad_or_m"])
        for placement, twist, angle in zip(base["placements_m"], twists, moved, strict=False):
            x = np.zeros((4, 4))
            x[:3, :3] = [
                [0, -twist[5], twist[4]],
                [twist[5], 0, -twist[3]],
                [-twist[4], twist[3], 0],
            ]
            x[:3, 3] = twist[:3]
            T = T @ np.array(placement) @ expm(x * angle)
        np.testing.assert_allclose(T @ np.array(base["placements_m"][-1]), pose, atol=1e-12)
    T, targets = (
        np.array(contents["setup"]["T_instrument_base_m"]),
        np.array(contents["setup"]["targets_m"]),
    )
    other = seen(arm(frame="fitted"), calibration.q)
    there = at(T @ calibration.forward(calibration.q), targets)
    np.testing.assert_allclose(there, other, atol=1e-12)


@pytest.mark.parametrize("frame", FRAMES)
def test_numbers_of_exported_code_are_those_of_the_frame(frame: FrameName) -> None:
    """What C and Structured Text are rendered from."""
    calibration = arm(frame=frame, model="local-poe")
    values = compensator_values(calibration, "double", "serial")
    placements = values["nominal_placements"] + values["placement_changes"]
    T = np.repeat(placements[:1], len(calibration.q), axis=0)
    for j, twist in enumerate(values["base_twists"]):
        T = T @ exp6(calibration.q[:, j : j + 1] * twist) @ placements[j + 1]
    np.testing.assert_allclose(T, calibration.forward(calibration.q), atol=1e-12)


@pytest.mark.parametrize("frame", FRAMES)
def test_urdf_and_view_and_corrections_are_in_the_frame(frame: FrameName) -> None:
    calibration = arm(frame=frame, model="local-poe")  # placements alone: a URDF holds them all
    robot, q = calibration.robot, calibration.q
    nominal, pose = robot.mechanism.forward(q), calibration.forward(q)
    apart = float(np.linalg.norm((pose - nominal)[:, :3, 3], axis=-1).mean())
    text, _ = calibration_as_urdf(calibration)
    kinematics = robot.source.description.kinematics
    name = (
        "tool0"
        if f'"{kinematics.tool_frame}_calibrated"' not in text
        else f"{kinematics.tool_frame}_calibrated"
    )
    description = robot.source.description
    described = description.model_copy(
        update={"kinematics": kinematics.model_copy(update={"tool_frame": name})}
    )
    exported = Robot.from_source(replace(robot.source, urdf_text=text, description=described))
    np.testing.assert_allclose(exported.mechanism.forward(q), pose, atol=1e-9)
    sizes = scene_of(calibration).error_rms
    assert 0.5 * apart < sizes.mean() < 2 * apart
    corrected = compensate_joints(calibration, q).q
    np.testing.assert_allclose(calibration.forward(corrected), nominal, atol=1e-7)


def test_taught_corrections_are_smaller_than_fitted_ones() -> None:
    moved = {}
    for frame in FRAMES:
        calibration = arm("fanuc-m1000ia", frame)
        nominal = calibration.robot.mechanism
        before, after = calibration.q, compensate_joints(calibration, calibration.q).q
        change = nominal.forward(after) - nominal.forward(before)
        moved[frame] = np.linalg.norm(change[:, :3, 3], axis=-1)
    assert moved["taught"].max() < 0.7 * moved["fitted"].max()
    assert np.sqrt((moved["taught"] ** 2).mean()) < 0.5 * np.sqrt((moved["fitted"] ** 2).mean())


def test_the_choice_is_kept_in_the_file_with_both_frames() -> None:
    for frame in FRAMES:
        calibration = arm(frame=frame)
        again = read_calibration(io.BytesIO(to_bytes(calibration)), "c.h5")
        assert again.frame is not None
        assert again.frame.name == frame
        for name in FRAMES:
            a, b = calibration.in_frame(name), again.in_frame(name)
            assert np.array_equal(a.forward(a.q), b.forward(b.q))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda group: group.attrs.__setitem__("name", b"tought"),
            "/frame: name 'tought' is none of fitted, taught",
        ),
        (
            lambda group: group["T_tool_taught"].__setitem__((0, 0), 2.0),
            "/frame/T_tool_taught: row 1 is no rigid motion",
        ),
        (lambda group: group["T_taught_fitted"].__setitem__((0, 3), np.nan), "not finite"),
        (lambda group: group.__delitem__("T_tool_taught"), "damaged"),
    ],
)
def test_a_damaged_frame_is_refused(change: Callable[[h5py.Group], None], message: str) -> None:
    plain = to_bytes(arm())[:-82]  # without the digest
    buffer = io.BytesIO(plain)
    with h5py.File(buffer, "r+") as file:
        change(file["frame"])
    with pytest.raises(InputError, match=message):
        read_calibration(io.BytesIO(buffer.getvalue()), "c.h5")


def test_the_report_states_what_scipy_states_of_the_frames() -> None:
    calibration = arm()
    report = frame_report(calibration)
    assert report is not None
    assert calibration.frame is not None
    there = calibration.in_frame("fitted").forward(calibration.q)
    nominal = calibration.robot.mechanism.forward(calibration.q)
    base, tool = np.eye(4), np.eye(4)
    for T, part in ((base, report.base), (tool, report.tool)):
        T[:3, 3], T[:3, :3] = part[:3], Rotation.from_rotvec(part[3:]).as_matrix()
    left = base @ there @ tool
    np.testing.assert_allclose(
        np.linalg.norm((left - nominal)[:, :3, 3], axis=-1), report.position, atol=1e-12
    )
    turn = Rotation.from_matrix(left[:, :3, :3] @ nominal[:, :3, :3].swapaxes(1, 2)).magnitude()
    np.testing.assert_allclose(turn, report.orientation, atol=1e-9)


def test_a_known_set_up_and_the_nominal_base_leave_nothing_to_choose() -> None:
    robot = load_robot("ur5")
    workspace = robot.workspace()
    registered = simulate(robot, Simulation(seed=4, configurations=30, workspace=workspace))
    free = simulate(
        robot, Simulation(seed=4, configurations=30, workspace=workspace, unregistered=True)
    )
    for calibration in (identify(registered, "local-poe"), identify(free, "nominal")):
        assert calibration.frame is None
        assert not calibration.frame_is_free
        assert calibration.in_frame("taught") is calibration
        assert frame_report(calibration) is None
    with pytest.raises(UsageError, match="frame: unknown 'tought'; did you mean taught"):
        identify(free, "local-poe", "tought")


@pytest.mark.parametrize("frame", [None, *FRAMES])
def test_training_on_a_base_keeps_its_frame_unless_another_is_asked_for(
    frame: FrameName | None,
) -> None:
    robot = load_robot("planar-3r")
    data = simulate(
        robot, Simulation(seed=2, configurations=25, unregistered=True, workspace="full")
    )
    base = identify(data, "local-poe", "fitted")
    trained = train(data, base, frame=frame)
    assert trained.frame is not None
    assert trained.frame.name == (frame or "fitted")


@pytest.mark.parametrize("frame", FRAMES)
def test_a_moved_tracker_is_registered_in_the_frame(frame: FrameName) -> None:
    """`--refit` leaves the poses as they are and finds the set-up that belongs to them."""
    robot = load_robot("ur5")
    data = simulate(
        robot,
        Simulation(seed=4, configurations=40, unregistered=True),
    )
    calibration = arm(frame=frame)
    turn = Rotation.from_rotvec([0.5, -0.3, 1.2]).as_matrix()
    moved = replace(data, points=readonly(data.points @ turn.T + [1.0, -2.0, 0.5]))
    refitted, _ = refit(calibration, moved, ("base", "tool"))
    assert np.array_equal(refitted.forward(data.q), calibration.forward(data.q))
    left = seen(refitted, data.q) - moved.points
    assert np.sqrt((left**2).mean()) < 0.06e-3


# --- how sure: the deviation of what was measured -------------------------------------------------


@pytest.mark.parametrize("frame", FRAMES)
def test_the_frame_follows_every_error_of_the_parameters(frame: FrameName) -> None:
    """The covariance against moved parameters, one deviation each, and the frames chosen again."""
    calibration = arm(frame=frame)
    base, q = calibration.base, calibration.q[::8]
    posterior, robot = base.posterior, calibration.robot
    assert posterior is not None
    nominal = robot.mechanism.forward(calibration.q)
    noise = calibration.noise_position, calibration.noise_orientation
    values, vectors = np.linalg.eigh(posterior.covariance)
    total = np.zeros((len(q), 6, 6))
    for value, vector in zip(values, vectors.T, strict=True):
        poses = []
        for sign in (1e-2, -1e-2):
            state = base.state.moved(posterior.parameters, sign * np.sqrt(max(value, 0.0)) * vector)
            changed = state.errors.mechanism
            chosen = taught_frame(changed.forward(calibration.q), nominal, base.setup, *noise)
            pose = chosen.T_taught_fitted @ changed.forward(q) @ chosen.T_tool_taught
            poses.append(pose)
        turn = Rotation.from_matrix(
            poses[0][:, :3, :3] @ poses[1][:, :3, :3].swapaxes(1, 2)
        ).as_rotvec()
        slope = np.concatenate([(poses[0] - poses[1])[:, :3, 3], turn], axis=-1) / 2e-2
        total += slope[:, :, None] * slope[:, None, :]
    found = predicted_uncertainty(calibration, q).covariance
    deviation = np.sqrt(np.einsum("kii->ki", total))
    scale = deviation[:, :, None] * deviation[:, None, :]
    # The slope of the choice is that of Gauss and Newton: exact for a robot near its drawing.
    assert (np.abs(found - total) / scale).max() < 1e-2


def test_predicted_deviations_are_those_of_fresh_robots() -> None:
    """Taught poses of identified arms against those of the true ones, in units of ±."""
    robot = load_robot("ur5")
    workspace = robot.workspace()
    options = BaseOptions(
        complete=CompleteOptions(orders={"harmonics": 0, "gravity": 0, "twists": 1})
    )
    ratios = []
    for seed in range(8):
        data = simulate(
            robot, Simulation(seed=seed, configurations=30, workspace=workspace, unregistered=True)
        )
        fresh = simulate(
            robot,
            Simulation(seed=seed, configurations=30, workspace=workspace, same_robot=data.truth),
        )
        calibration = identify(data, options)
        assert data.truth is not None
        actual, nominal = data.truth.actual.forward, robot.mechanism.forward
        noise = data.noise_position, data.noise_orientation
        true = taught_frame(actual(data.q), nominal(data.q), data.setup, *noise)
        wanted = true.T_taught_fitted @ actual(fresh.q) @ true.T_tool_taught
        error = (calibration.forward(fresh.q) - wanted)[:, :3, 3]
        sd = predicted_uncertainty(calibration, fresh.q).position
        ratios.append(float(((error**2).sum(axis=-1) / sd**2).mean()))
        assert sd.max() < 0.2e-3  # not the prior's millimetre
    assert 0.5 < np.mean(ratios) < 1.6, ratios
