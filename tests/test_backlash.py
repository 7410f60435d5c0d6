"""Backlash by the direction of motion: identified, kept with rows, taken up on paths,
named in exports.
"""

import io
import json
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from derivatives import assert_derivative
from scipy.spatial.transform import Rotation

from calibtool.calibration import Calibration, identify
from calibtool.calibration.fit import BaseOptions
from calibtool.calibration.uncertainty import predicted_uncertainty
from calibtool.compensation.backlash_path import BacklashPath
from calibtool.compensation.stream import StreamOptions, compensate_text
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.backlash import backlash_text
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.errormodel.operating_conditions import Conditions, directions
from calibtool.errors import InputError
from calibtool.evaluation.compare import evaluate
from calibtool.export.as_json import calibration_as_json
from calibtool.export.as_urdf import calibration_as_urdf
from calibtool.export.c_code import calibration_as_c
from calibtool.export.structured_text import calibration_as_structured_text
from calibtool.identification.complete import CompleteOptions, identify_complete
from calibtool.identification.parameters import Parameters, State
from calibtool.identification.report import parameter_rows
from calibtool.measurement.importing import import_table
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.programs.compensate import compensate_program
from calibtool.programs.correction import ProgramOptions
from calibtool.robot.catalogue import load_robot
from calibtool.robot.mechanism import Frames
from calibtool.robot.se3 import Array, log6, readonly
from calibtool.storage import read_any, to_bytes

WITHOUT = BaseOptions("complete", CompleteOptions(orders={"backlash": 0}))


@cache
def measured(name: str = "fanuc-m1000ia", count: int = 60, fresh: bool = False) -> Measurements:
    simulation = Simulation(
        seed=2, configurations=count, scales=ErrorScales(ERROR_KINDS), workspace="full"
    )
    if fresh:
        simulation = replace(simulation, same_robot=measured(name).truth)
    return simulate(load_robot(name), simulation)


@cache
def calibrated(name: str = "fanuc-m1000ia") -> Calibration:
    return identify(measured(name), "complete")


# --- directions -----------------------------------------------------------------------------------


def test_a_joint_that_stands_still_stays_on_its_side() -> None:
    q = np.array([[0.0], [0.0], [0.1], [0.1], [0.1 + 1e-9], [0.0], [0.0], [0.2]])
    assert directions(q)[:, 0].tolist() == [0, 0, 1, 1, 1, -1, -1, 1]
    assert directions(q, start=np.array([0.5]))[:, 0].tolist() == [-1, -1, 1, 1, 1, -1, -1, 1]
    assert directions(q, before=np.array([-1.0]))[:2, 0].tolist() == [-1, -1]


@pytest.mark.parametrize("creep", [0.4e-6, 0.9e-6, 0.11e-6])
def test_a_joint_that_creeps_back_is_on_the_other_side(creep: float) -> None:
    """Steps that no row takes for motion add up: measured from where the joint last
    counted as moved.
    """
    forth = np.linspace(0.0, 0.1, 5)
    back = 0.1 - creep * np.arange(1, 60)
    q = np.concatenate([forth, back])[:, None]
    found = directions(q)[:, 0]
    assert (found[1:6] == 1).all()
    assert found[-1] == -1
    turned = int(np.argmax(found == -1))
    assert 1e-6 < 0.1 - q[turned, 0] < 1e-6 + 2 * creep
    assert (found[turned:] == -1).all()
    path = BacklashPath(np.array([1.0]))
    parts = np.concatenate([path.taken_up(part) for part in np.array_split(q, 13)])
    np.testing.assert_array_equal(parts[:, 0], found)


def test_a_joint_that_trembles_stays_on_its_side(rng: np.random.Generator) -> None:
    q = np.concatenate([[0.0, 0.1], 0.1 + 0.4e-6 * rng.uniform(-1, 1, 100)])[:, None]
    assert (directions(q)[1:] == 1).all()


def test_the_way_back_has_the_opposite_directions(rng: np.random.Generator) -> None:
    q = rng.normal(size=(20, 6))
    np.testing.assert_array_equal(directions(q)[1:], -directions(q[::-1])[1:][::-1])


def test_a_path_may_come_in_batches_and_skips_rows_that_are_not_driven_to(
    rng: np.random.Generator,
) -> None:
    q = rng.normal(size=(30, 3)).round(0)  # many joints stand still
    width = np.array([1.0, 2.0, 3.0])
    whole = BacklashPath(width).taken_up(q)
    path = BacklashPath(width)
    gap = np.full((1, 3), np.nan)
    parts = np.concatenate(
        [path.taken_up(np.concatenate([part, gap]))[:-1] for part in np.array_split(q, 7)]
    )
    np.testing.assert_array_equal(parts, whole)
    assert not whole[0].any()


def test_no_joint_is_taken_beyond_a_limit(rng: np.random.Generator) -> None:
    q = np.clip(rng.normal(size=(50, 3)), -1.0, 1.0)
    q[::7] += np.array([0.5, 0.0, 0.0])  # commanded outside: there nothing is added outwards
    width = np.array([0.1, 0.2, 0.3])
    free = BacklashPath(width).taken_up(q)
    taken = BacklashPath(width, -np.ones(3), np.ones(3)).taken_up(q)
    inside = np.abs(q) <= 1.0
    assert (np.abs(q + taken)[inside] <= 1.0).all()
    assert (np.abs(q + taken)[~inside] <= np.abs(q)[~inside]).all()
    clear = np.abs(q) <= 0.7
    np.testing.assert_array_equal(taken[clear], free[clear])
    assert (taken != free).any()


def test_rows_keep_their_directions() -> None:
    measurements = measured()
    assert measurements.conditions.direction is not None
    order = np.array([7, 3, 50, 3])
    np.testing.assert_array_equal(
        measurements.rows(order).conditions.direction, measurements.conditions.direction[order]
    )
    with pytest.raises(InputError, match="directions"):
        replace(measurements, conditions=Conditions(0.5 * measurements.conditions.direction))


def test_a_file_tells_directions_by_its_order_before_rows_are_chosen() -> None:
    robot, q = (
        load_robot("ur5"),
        np.deg2rad(np.random.default_rng(0).uniform(-60, 60, (30, 6)).round(3)),
    )
    points = robot.mechanism.forward(q)[:, None, :3, 3] + np.zeros((30, 1, 3))
    rows = np.hstack([np.rad2deg(q), points[:, 0] * 1e3])
    header = ",".join([*(f"j{j}_deg" for j in range(1, 7)), "x_mm", "y_mm", "z_mm"])
    text = header + "\n" + "\n".join(",".join(f"{v:.12g}" for v in row) for row in rows) + "\n"
    taken, rest = import_table(text, "t.csv", robot).split("5:9", None, 0)
    expected = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    np.testing.assert_array_equal(taken.measurements.conditions.direction, expected[4:9])
    assert rest is not None
    np.testing.assert_array_equal(
        rest.measurements.conditions.direction, np.delete(expected, range(4, 9), axis=0)
    )


# --- identification -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "gantry"])
def test_half_widths_are_those_injected_within_their_covariance(name: str) -> None:
    base, truth = calibrated(name).base, measured(name).truth
    assert truth is not None
    assert base.posterior is not None
    std = base.posterior.std[base.posterior.parameters.blocks["backlash"]]
    deviation = (base.errors["backlash"] - truth.actual.errors["backlash"]) / std
    assert np.sqrt(np.mean(deviation**2)) < 1.7
    assert np.abs(deviation).max() < 3.5
    assert (std < 0.03e-3).sum() >= 4
    assert base.posterior.noise_factor < 1.3


def test_columns_of_the_half_widths_are_derivatives() -> None:
    measurements = measured().rows(np.arange(4))
    robot, conditions = measurements.robot, measurements.conditions
    parameters = Parameters.of(robot, measurements.setup, harmonics=1, gravity=1, backlash=1)
    block = parameters.blocks["backlash"]
    assert parameters.names[block] == [f"backlash{j}" for j in range(1, 7)]
    state = State.nominal(robot, measurements.setup)
    start = state.frames(measurements.q, conditions).tool

    def moved(x: Array) -> Array:
        step = np.zeros(parameters.count)
        step[block] = x
        frames: Frames = state.moved(parameters, step).frames(measurements.q, conditions)
        return log6(frames.tool @ np.linalg.inv(start))

    columns = parameters.pose_columns(state.errors.context(measurements.q, conditions))
    assert_derivative(moved, columns[..., block], np.zeros(robot.n), tolerance=1e-7)


def test_no_backlash_is_found_where_there_is_none_or_the_order_is_lost() -> None:
    kinds = tuple(kind for kind in ERROR_KINDS if kind != "backlash")
    plain = simulate(
        load_robot("ur5"),
        Simulation(configurations=40, scales=ErrorScales(kinds), workspace="full"),
    )
    shuffled = measured()
    wrong = np.random.default_rng(0).permutation(shuffled.conditions.direction)
    for measurements in (plain, replace(shuffled, conditions=Conditions(wrong))):
        base = identify_complete(measurements)
        assert base.posterior is not None
        assert "backlash" not in base.posterior.parameters.orders
        assert not base.errors["backlash"].any()


def test_unknown_directions_are_as_good_as_no_backlash() -> None:
    unknown = replace(measured(), conditions=Conditions())
    left_out = identify(measured(), WITHOUT)
    asked = BaseOptions("complete", CompleteOptions(compared=False))  # like WITHOUT
    assert to_bytes(identify(unknown, asked)) == to_bytes(left_out)
    with pytest.raises(InputError, match="from which side"):
        identify_complete(unknown, CompleteOptions(orders={"backlash": 1}))


def test_directions_and_half_widths_are_read_as_they_were_written() -> None:
    same = read_any(io.BytesIO(to_bytes(measured())), "m.h5")
    assert isinstance(same, Measurements)
    np.testing.assert_array_equal(same.conditions.direction, measured().conditions.direction)
    unknown = read_any(io.BytesIO(to_bytes(replace(measured(), conditions=Conditions()))), "m.h5")
    assert isinstance(unknown, Measurements)
    assert unknown.conditions.direction is None
    new = read_any(io.BytesIO(to_bytes(calibrated())), "c.h5")
    assert isinstance(new, Calibration)
    q, conditions = measured().q, measured().conditions
    np.testing.assert_array_equal(new.forward(q, conditions), calibrated().forward(q, conditions))


def test_without_a_direction_the_middle_is_predicted() -> None:
    q, ones = measured().q, np.ones_like(measured().q)
    plus, minus = (calibrated().forward(q, Conditions(side * ones))[:, :3, 3] for side in (1, -1))
    middle = calibrated().forward(q)[:, :3, 3]
    assert np.abs((plus + minus) / 2 - middle).max() < 1e-6
    assert np.linalg.norm(plus - minus, axis=-1).min() > 0.1e-3


def test_people_see_half_widths_in_mrad_and_mm() -> None:
    rows = {row.name: row for row in parameter_rows(calibrated("gantry").base)}
    prismatic = load_robot("gantry").prismatic
    assert [rows[f"backlash{j + 1}"].unit for j in range(len(prismatic))] == [
        "mm" if p else "mrad" for p in prismatic
    ]
    assert rows["backlash1"].value == pytest.approx(0.1, abs=0.05)
    assert rows["backlash1"].tolerance > 0.01
    assert (
        backlash_text(load_robot("planar-3r"), np.array([1e-4, 0.0, 2e-4]))
        == "0.100, 0.000, 0.200 mrad"
    )


# --- compensation ---------------------------------------------------------------------------------


def joint_csv(q: Array) -> str:
    header = ",".join(calibrated().robot.joint_columns)
    return (
        header
        + "\n"
        + "\n".join(",".join(f"{v:.15g}" for v in row) for row in np.rad2deg(q))
        + "\n"
    )


def corrected(text: str, backlash: bool = True, batch: int = 1000) -> Array:
    result, _ = compensate_text(
        calibrated(), text, "t.csv", StreamOptions(backlash=backlash, batch=batch)
    )
    return np.deg2rad(np.loadtxt(io.StringIO(result), delimiter=",", skiprows=1, usecols=range(6)))


def test_rows_in_order_leave_less_when_backlash_is_taken_up() -> None:
    fresh = measured(count=80, fresh=True)
    assert fresh.truth is not None
    nominal = fresh.robot.mechanism.forward(fresh.q)
    left = []
    for backlash in (False, True):
        driven = corrected(joint_csv(fresh.q), backlash)
        error = (fresh.truth.actual.forward(driven) - nominal)[
            1:, :3, 3
        ]  # nobody knows where the first row comes from
        left.append(np.linalg.norm(error, axis=-1).mean())
    assert left[1] < 0.35 * left[0]
    np.testing.assert_array_equal(
        corrected(joint_csv(fresh.q), batch=1), corrected(joint_csv(fresh.q))
    )


def test_poses_in_order_are_a_path_too() -> None:
    q = np.deg2rad([[0, 10, -10, 0, -70, 0], [10, 20, -30, 5, -60, 10], [-15, 5, 0, -10, -80, 30]])
    poses = load_robot("fanuc-m1000ia").mechanism.forward(q)
    joints = calibrated().robot.joint_columns
    lines = ["x_mm,y_mm,z_mm," + ",".join(joints) + ",roll_deg,pitch_deg,yaw_deg"]
    from scipy.spatial.transform import Rotation

    for pose, row in zip(poses, np.rad2deg(q), strict=True):
        angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
        lines.append(",".join(f"{v:.15g}" for v in (*(pose[:3, 3] * 1e3), *row, *angles)))
    text = "\n".join(lines) + "\n"
    results = []
    for backlash in (False, True):
        result, _ = compensate_text(calibrated(), text, "t.csv", StreamOptions(backlash=backlash))
        rows = [line.split(",") for line in result.splitlines()]
        results.append(
            np.deg2rad([[float(row[rows[0].index(joint)]) for joint in joints] for row in rows[1:]])
        )
    expected = calibrated().base.errors["backlash"] * directions(results[0])
    np.testing.assert_allclose(results[1] - results[0], expected, atol=1e-9)


def test_steps_smaller_than_their_corrections_are_taken_up_as_they_are_driven() -> None:
    """Creeping along, a correction turns some joints round: the side counts from which the actual
    robot's joints come.
    """
    fresh = measured(count=80, fresh=True)
    assert fresh.truth is not None
    actual = fresh.truth.actual
    rng = np.random.default_rng(5)
    q = fresh.q[0] + np.cumsum(
        rng.normal(size=(400, 6)) * [0.02, 0.02, 0.02, 2e-5, 2e-5, 2e-5], axis=0
    )
    driven = corrected(joint_csv(q))
    turned = directions(driven)[1:] != directions(q)[1:]
    assert turned[:, 3:].mean() > 0.05
    np.testing.assert_array_equal(
        directions(driven), directions(corrected(joint_csv(q), backlash=False))
    )
    nominal = fresh.robot.mechanism.forward(q)
    error = np.linalg.norm((actual.forward(driven) - nominal)[1:, :3, 3], axis=-1)
    assert error[turned.any(axis=1)].max() < 1.5 * error[~turned.any(axis=1)].max()


def test_an_evaluation_drives_with_the_backlash_taken_up() -> None:
    fresh = measured(count=80, fresh=True)
    methods = evaluate(
        [("without", identify(measured(), WITHOUT)), ("with", calibrated())], fresh
    ).methods
    assert methods[2].position_size.mean() < 0.35 * methods[1].position_size.mean()
    predicted = evaluate([("with", calibrated())], replace(fresh, truth=None)).methods[1]
    unknown = evaluate(
        [("with", calibrated())], replace(fresh, truth=None, conditions=Conditions())
    ).methods[1]
    assert predicted.position_size.mean() < 0.6 * unknown.position_size.mean()


def test_trajectories_take_up_backlash_and_other_programs_state_that_they_do_not() -> None:
    robot = load_robot("fanuc-m1000ia")
    q = np.array(
        [
            [0.0, 0.2, -0.2, 0.0, -1.2, 0.0],
            [0.1, 0.3, -0.5, 0.1, -1.0, 0.2],
            [-0.2, 0.3, 0.0, -0.2, -1.4, 0.5],
        ]
    )
    names = ", ".join(str(name) for name in robot.chain.model.names[1:])
    points = "".join(f"- positions: [{', '.join(f'{v:.12f}' for v in row)}]\n" for row in q)
    text = f"joint_names: [{names}]\npoints:\n{points}".encode()

    def positions(backlash: bool) -> Array:
        result = compensate_program(
            calibrated(),
            text,
            "t.yaml",
            "ros2-trajectory",
            ProgramOptions(backlash=backlash, joint_values="serial"),
        )
        lines = [line for line in result.data.decode().splitlines() if "positions" in line]
        return np.array([json.loads(line.split(":", 1)[1]) for line in lines])

    expected = calibrated().base.errors["backlash"] * directions(positions(False))
    np.testing.assert_allclose(positions(True) - positions(False), expected, atol=1e-9)
    script = f"movej([{', '.join(f'{v:.6f}' for v in q[0])}], a=1.0, v=1.0)\n".encode()
    options = ProgramOptions(joint_values="serial")
    result = compensate_program(calibrated(), script, "p.script", "ur-script", options)
    assert any("backlash" in note for note in result.notes)


# --- uncertainty ----------------------------------------------------------------------------------


def exactly_known(name: str) -> Calibration:
    """A calibration whose parameters have no ±."""
    posterior = calibrated(name).base.posterior
    assert posterior is not None
    sure = replace(posterior, covariance=readonly(0.0 * posterior.covariance))
    return replace(calibrated(name), base=replace(calibrated(name).base, posterior=sure))


@pytest.mark.parametrize("name", ["fanuc-m1000ia", "gantry"])
def test_backlash_from_a_side_that_is_not_known_is_in_the_uncertainty(name: str) -> None:
    """As much as the poses of all sides scatter; joints whose side is known add nothing."""
    calibration = exactly_known(name)
    n, q = calibration.robot.n, calibration.q[:4]
    assert calibration.base.errors["backlash"].any()
    known = np.zeros((4, n))
    known[:, 0] = -1.0
    for direction in (None, known):
        sides = np.array(list(product((-1.0, 1.0), repeat=n)))
        if direction is not None:
            sides[:, 0] = -1.0
        apart = []
        mean = calibration.forward(q)
        if direction is not None:
            mean = calibration.forward(q, Conditions(direction=readonly(known)))
        for side in sides:
            there = Conditions(direction=readonly(np.tile(side, (4, 1))))
            pose = calibration.forward(q, there)
            turn = Rotation.from_matrix(pose[:, :3, :3] @ np.swapaxes(mean[:, :3, :3], 1, 2))
            apart.append(np.hstack([pose[:, :3, 3] - mean[:, :3, 3], turn.as_rotvec()]))
        expected = np.einsum("ski,skj->kij", np.array(apart), np.array(apart)) / len(sides)
        found = predicted_uncertainty(calibration, q, direction).covariance
        np.testing.assert_allclose(found, expected, atol=0.01 * np.abs(expected).max())
    assert not predicted_uncertainty(calibration, q, np.ones((4, n))).covariance.any()


def test_rows_whose_backlash_is_taken_up_are_less_uncertain() -> None:
    q = measured(count=30, fresh=True).q
    deviations = []
    for taken_up in (True, False):
        options = StreamOptions(uncertainty=True, backlash=taken_up)
        rows = compensate_text(calibrated(), joint_csv(q), "t.csv", options)[0].splitlines()
        column = rows[0].split(",").index("sd_mm")
        deviations.append([float(row.split(",")[column]) for row in rows[1:]])
    taken, left = np.array(deviations)
    assert taken[0] == left[0]  # nothing has moved: no side is known
    assert (taken[1:] < left[1:]).all()


# --- exports --------------------------------------------------------------------------------------


def test_exports_state_that_backlash_is_not_in_them() -> None:
    text = backlash_text(calibrated().robot, calibrated().base.errors["backlash"])
    exported = json.loads(calibration_as_json(calibrated()))
    assert (
        exported["base_model"]["backlash_rad_or_m"] == calibrated().base.errors["backlash"].tolist()
    )
    errors = calibrated().base.errors
    having, plain = (
        replace(calibrated(), base=replace(calibrated().base, errors=e))
        for e in (errors, errors.without("backlash"))
    )
    for export in (
        lambda calibration: calibration_as_c(calibration, "arm")[0],
        lambda calibration: calibration_as_structured_text(calibration),
        lambda calibration: "\n".join(calibration_as_urdf(calibration)[1]),
    ):
        assert f"backlash ({text})" in str(export(having))
        assert "backlash" not in str(export(plain))
