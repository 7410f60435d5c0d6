"""Checks on import: each finds the damage that was done, with its numbers, and clean
measurements raise no warning.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibtool.errormodel.actual import ErrorScales
from calibtool.measurement.auxiliary import AuxiliaryReadings
from calibtool.measurement.checks import Finding, check_measurements, design_findings
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.observation import measured_in_base
from calibtool.measurement.registration import register
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.setup import Setup
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.planning.visiting_order import short_order
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.se3 import Array, exp6, inverse, readonly, transform_points

SIX = ("fanuc-m1000ia", "ur5")


def measured(robot: Robot, count: int = 40, **options: object) -> Measurements:
    return simulate(
        robot,
        Simulation(seed=1, configurations=count, **options),
    )


def damaged(
    measurements: Measurements, *, q: Array | None = None, points: Array | None = None
) -> Measurements:
    """Other joint positions or points, and the set-up registered to them, as an import would."""
    result = replace(
        measurements,
        q=measurements.q if q is None else readonly(q),
        points=measurements.points if points is None else readonly(points),
    )
    return replace(result, setup=register(result))


def named(found: list[Finding], name: str, severity: str = "warning") -> Finding:
    """The one finding of that name."""
    matching = [finding for finding in found if finding.name == name]
    assert len(matching) == 1, [str(finding) for finding in found]
    assert matching[0].severity == severity
    return matching[0]


def names(found: list[Finding]) -> set[str]:
    return {finding.name for finding in found}


def warned(found: list[Finding]) -> list[str]:
    return [finding.message for finding in found if finding.severity == "warning"]


@pytest.mark.parametrize("unregistered", [False, True])
def test_clean_measurements_raise_no_warning(robot: Robot, unregistered: bool) -> None:
    for seed in range(3):
        workspace = robot.workspace()
        simulation = Simulation(
            seed=seed, configurations=40, workspace=workspace, unregistered=unregistered
        )
        assert warned(check_measurements(simulate(robot, simulation))) == []


# --- targets
# ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unregistered", [False, True])
def test_a_bumped_target_is_named_with_its_row_and_how_far(
    fanuc: Robot, unregistered: bool
) -> None:
    clean = measured(fanuc, unregistered=unregistered)
    assert "target_moved" not in names(check_measurements(clean))
    truth = clean.truth
    assert truth is not None
    others = truth.setup.targets[1:].mean(axis=0)
    away = truth.setup.targets[0] - others
    shift = (
        0.4e-3 * away / np.linalg.norm(away)
    )  # in the plane of the targets, where distances see all of it
    moved = clean.points.copy()
    turns = truth.setup.T_instrument_base[:3, :3] @ truth.actual.forward(clean.q)[:, :3, :3]
    moved[24:, 0] += turns[24:] @ shift
    numbers = named(check_measurements(damaged(clean, points=moved)), "target_moved").numbers
    assert numbers["targets"] == [1]
    assert numbers["row"] == 25
    assert numbers["shift_mm"] == pytest.approx(0.4, abs=0.05)


def test_a_single_row_with_a_target_out_of_place(fanuc: Robot) -> None:
    clean = measured(fanuc)
    points = clean.points.copy()
    points[11, 2] += [0.0, 2e-3, 0.0]
    found = check_measurements(damaged(clean, points=points))
    assert named(found, "target_out_of_place").numbers["rows"] == [12]
    assert "target 3" in named(found, "target_out_of_place").message
    assert "target_moved" not in names(found)


def test_noise_that_is_larger_than_stated(fanuc: Robot) -> None:
    clean = measured(fanuc, noise=0.2e-3)
    assert "noise_of_distances" not in names(check_measurements(clean))
    found = named(check_measurements(replace(clean, noise_position=0.05e-3)), "noise_of_distances")
    assert found.numbers["estimated_noise_mm"] == pytest.approx(0.2, rel=0.15)


def test_a_coordinate_that_was_taken_twice(fanuc: Robot) -> None:
    clean = measured(fanuc, unregistered=True)
    points = clean.points.copy()
    points[:, 1, 2] = points[:, 1, 0]
    found = check_measurements(damaged(clean, points=points))
    assert "t2_x and t2_z" in named(found, "duplicate_columns").message


@pytest.mark.parametrize("name", SIX)
@pytest.mark.parametrize("unregistered", [False, True])
@pytest.mark.parametrize("rows", [slice(7, 8), slice(30, 40), slice(4, 20)])
def test_rows_whose_targets_are_swapped(name: str, unregistered: bool, rows: slice) -> None:
    clean = measured(load_robot(name), unregistered=unregistered)
    points = clean.points.copy()
    points[rows] = points[rows][:, [1, 0, 2]]
    found = check_measurements(damaged(clean, points=points))
    assert named(found, "target_order").numbers["rows"] == list(
        range(rows.start + 1, rows.stop + 1)
    )
    assert len(warned(found)) == 1  # nothing else is blamed for it


@pytest.mark.parametrize("order", [[1, 0, 2], [1, 2, 0]])
@pytest.mark.parametrize("frame_known", [False, True])
def test_targets_in_another_order_than_the_robots(
    fanuc: Robot, order: list[int], frame_known: bool
) -> None:
    clean = measured(fanuc)
    setup = replace(clean.setup, frame_known=frame_known)
    found = check_measurements(damaged(replace(clean, setup=setup), points=clean.points[:, order]))
    assert named(found, "target_order").numbers["order"] == [i + 1 for i in order]
    free = replace(clean, setup=replace(setup, frame_known=False, targets_known=False))
    found = check_measurements(damaged(free, points=clean.points[:, order]))
    assert named(found, "target_order", "note").numbers["order"] == [i + 1 for i in order]


def test_a_frame_that_is_not_where_it_was_stated(fanuc: Robot) -> None:
    clean = measured(fanuc)
    found = check_measurements(
        replace(clean, points=readonly(clean.points + np.array([0.5, 0.0, 0.0])))
    )
    assert named(found, "given_setup").numbers["rms_mm"] == pytest.approx(500, rel=0.02)


# --- what the nominal robot would explain
# ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", SIX)
@pytest.mark.parametrize("targets", [1, 3])
def test_left_handed_axes(name: str, targets: int) -> None:
    clean = only_targets(measured(load_robot(name), unregistered=True), targets)
    mirrored = clean.points.copy()
    mirrored[..., 2] *= -1
    found = check_measurements(damaged(clean, points=mirrored))
    named(found, "left_handed_axes")
    assert len(warned(found)) == 1


def only_targets(measurements: Measurements, count: int) -> Measurements:
    setup = replace(measurements.setup, targets=measurements.setup.targets[:count])
    return replace(measurements, points=measurements.points[:, :count], setup=setup, truth=None)


@pytest.mark.parametrize("name", SIX)
@pytest.mark.parametrize("factor", [180 / np.pi, np.pi / 180])
def test_angles_in_the_wrong_unit(name: str, factor: float) -> None:
    clean = measured(load_robot(name), unregistered=True)
    found = named(check_measurements(damaged(clean, q=clean.q * factor)), "angle_unit")
    assert found.message.endswith("given as rad" if factor > 1 else "given as degrees")
    one = clean.q.copy()
    one[:, 2] *= factor
    assert "joint 3 is in" in named(check_measurements(damaged(clean, q=one)), "angle_unit").message


def test_a_joint_counted_backwards_two_swapped_and_one_coupled(fanuc: Robot) -> None:
    clean = measured(fanuc, unregistered=True)
    backwards = clean.q * [1, 1, -1, 1, 1, 1]
    assert (
        "joint 3 " in named(check_measurements(damaged(clean, q=backwards)), "joint_sign").message
    )
    swapped = clean.q[:, [0, 1, 2, 4, 3, 5]]
    assert (
        "joints 4 and 5"
        in named(check_measurements(damaged(clean, q=swapped)), "joint_order").message
    )
    coupled = clean.q.copy()
    coupled[:, 2] -= coupled[:, 1]
    found = named(check_measurements(damaged(clean, q=coupled)), "joint_coupling")
    assert "add joint 2: --joint-values controller)" in found.message


def test_rows_that_do_not_belong_together(fanuc: Robot) -> None:
    clean, order = measured(fanuc, unregistered=True), np.random.default_rng(0).permutation(40)
    named(check_measurements(damaged(clean, q=clean.q[order])), "nominal_robot")


@pytest.mark.parametrize(("by", "side"), [(1, "before"), (-1, "after"), (2, "before")])
@pytest.mark.parametrize("name", SIX)
def test_points_that_belong_to_another_row(name: str, by: int, side: str) -> None:
    clean = measured(load_robot(name), unregistered=True)
    late = only_targets(clean, 1)
    late = damaged(late, points=np.roll(late.points, by, axis=0))
    message = named(check_measurements(late), "row_shift").message
    assert f"{side} (shifted by {abs(by)})" in message


@pytest.mark.parametrize(
    ("factor", "says"),
    [
        (1 / 25.4, "inches, given as mm"),
        (25.4, "mm, given as inches"),
        (1e-3, "metres, given as mm"),
        (1e3, "mm, given as metres"),
    ],
)
@pytest.mark.parametrize(("name", "targets"), [("fanuc-m1000ia", 3), ("planar-3r", 1), ("ur5", 1)])
def test_lengths_in_the_wrong_unit(name: str, targets: int, factor: float, says: str) -> None:
    clean = only_targets(measured(load_robot(name), unregistered=True), targets)
    scaled = replace(clean, points=readonly(clean.points * factor))
    assert says in named(check_measurements(scaled), "length_unit").message


@pytest.mark.parametrize(
    ("name", "joint", "degrees"),
    [("ur10", 4, 90.0), ("ur5", 2, -90.0), ("fanuc-m1000ia", 3, 45.0), ("ur3", 5, 173.0)],
)
def test_one_joint_counted_from_another_zero(name: str, joint: int, degrees: float) -> None:
    clean = measured(load_robot(name), unregistered=True)
    q = clean.q.copy()
    q[:, joint - 1] -= np.deg2rad(degrees)
    found = named(check_measurements(damaged(clean, q=q)), "joint_zero")
    assert found.numbers["joints"] == [joint]
    (add,) = found.numbers["add_deg_or_mm"]
    assert add == pytest.approx(degrees, abs=0.4)


def test_one_zero_that_is_a_little_elsewhere(fanuc: Robot) -> None:
    clean = measured(fanuc, unregistered=True)
    q = clean.q.copy()
    q[:, 3] -= np.deg2rad(1.5)
    found = named(check_measurements(damaged(clean, q=q)), "joint_zero")
    assert "joint 4" in found.message
    assert found.numbers["add_deg_or_mm"][0] == pytest.approx(1.5, abs=0.3)


@pytest.mark.parametrize("name", SIX)
def test_poses_of_a_fixed_board_in_a_camera_on_the_flange(name: str) -> None:
    robot = load_robot(name)
    clean = six_dimensional(robot)
    T = inverse(as_poses(clean))
    turned = replace(clean, points=readonly(T[:, None, :3, 3]), rotations=readonly(T[:, :3, :3]))
    turned = replace(turned, setup=replace(turned.setup, frame_known=False, targets_known=False))
    found = named(check_measurements(turned), "inverse_poses")
    assert found.numbers["repaired_rms_mm"] < 5.0


def as_poses(measurements: Measurements) -> Array:
    """What a 6-D instrument measured as (N, 4, 4)."""
    assert measurements.rotations is not None
    T = np.tile(np.eye(4), (len(measurements), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = measurements.rotations, measurements.points[:, 0]
    return T


@pytest.mark.parametrize(("name", "starts"), [("ur5", [0, 25]), ("fanuc-m1000ia", [0, 15, 35])])
@pytest.mark.parametrize("targets", [1, 3])
def test_an_instrument_that_was_moved_in_between(
    name: str, starts: list[int], targets: int
) -> None:
    clean = only_targets(measured(load_robot(name), 50, unregistered=True), targets)
    points, rng = clean.points.copy(), np.random.default_rng(1)
    for start in starts[1:]:
        T = exp6(np.concatenate([rng.normal(size=3), rng.normal(size=3)]))
        points[start:] = transform_points(T, points[start:])
    found = named(check_measurements(damaged(clean, points=points)), "groups_of_rows")
    assert found.numbers["first_rows"] == [start + 1 for start in starts]


def test_rows_of_a_steady_arm_in_order_of_travel_do_not_drift() -> None:
    """The stated error rate is 1 %: of 24 sets of a rising thermometer none is a drift."""
    for name in ("ur10", "fanuc-m1000ia"):
        robot = load_robot(name)
        home = robot.workspace().home
        for seed in range(6):
            for kinds in (("geometric",), ("geometric", "gear", "gravity", "backlash")):
                rng = np.random.default_rng(seed)
                q = sample_configurations(robot, robot.workspace(), 30, rng)
                q = q[short_order(robot, q, home)]
                scales = ErrorScales(kinds=kinds)
                steady = simulate(
                    robot, Simulation(seed=seed, at=q, scales=scales, unregistered=True)
                )
                auxiliary = AuxiliaryReadings(temperature_c=21.4 + 0.4 * np.linspace(0, 1, 30))
                named(check_measurements(steady, auxiliary), "temperature_trend", "note")


def test_a_row_with_another_rows_joints(fanuc: Robot) -> None:
    clean = measured(fanuc, unregistered=True)
    q = clean.q.copy()
    q[[8, 9]] = q[[9, 8]]
    found = check_measurements(damaged(clean, q=q))
    assert named(found, "rows_out_of_place").numbers["rows"] == [9, 10]
    assert "rows 9, 10 do not belong" in str(named(found, "rows_out_of_place"))


@pytest.mark.parametrize(("row", "joint", "degrees"), [(7, 3, 10.0), (20, 4, -15.0)])
def test_a_row_with_one_joint_a_little_off(
    fanuc: Robot, row: int, joint: int, degrees: float
) -> None:
    """Too little for the whole fit to look wrong, enough to spoil an identification."""
    clean = only_targets(measured(fanuc), 1)
    assert "rows_out_of_place" not in names(check_measurements(clean))
    q = clean.q.copy()
    q[row, joint] += np.deg2rad(degrees)
    found = named(check_measurements(damaged(clean, q=q)), "rows_out_of_place")
    assert found.numbers["rows"] == [row + 1]


def six_dimensional(robot: Robot) -> Measurements:
    q = measured(robot).q
    T = robot.mechanism.forward(q)
    setup = Setup(np.eye(4), np.zeros((1, 3)), np.eye(3), frame_known=False, targets_known=False)
    return Measurements(
        robot, q, readonly(T[:, None, :3, 3]), readonly(T[:, :3, :3]), setup, 0.05e-3, 0.1e-3
    )


def test_orientations_in_another_convention(fanuc: Robot) -> None:
    clean = six_dimensional(fanuc)
    assert clean.rotations is not None
    assert warned(check_measurements(clean)) == []
    inverted = replace(clean, rotations=readonly(np.swapaxes(clean.rotations, -1, -2)))
    named(check_measurements(inverted), "orientation_convention")


# --- design
# ------------------------------------------------------------------------------------------------


def test_a_joint_that_never_moves(fanuc: Robot) -> None:
    q = measured(fanuc).q.copy()
    assert design_findings(fanuc, q) == []
    q[:, 3] = 0.3
    assert named(design_findings(fanuc, q), "joint_never_moves").numbers["joints"] == [4]


def test_two_joints_with_the_same_numbers(fanuc: Robot) -> None:
    q = measured(fanuc).q.copy()
    q[:, 4] = q[:, 1]
    assert named(design_findings(fanuc, q), "duplicate_columns").numbers["joints"] == [2, 5]


def test_one_joint_at_a_time(fanuc: Robot) -> None:
    home = fanuc.workspace().home
    q = np.tile(home, (36, 1))
    for j in range(6):
        q[6 * j : 6 * j + 6, j] += np.linspace(-0.4, 0.5, 6)
    assert named(design_findings(fanuc, q), "one_joint_at_a_time").numbers["rows_percent"] == 100


def test_positions_in_one_plane(fanuc: Robot) -> None:
    flat = np.zeros((20, 6))
    flat[:, 1:3] = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 2))
    assert "flat_design" in names(design_findings(fanuc, flat))


def test_repeated_configurations_give_the_repeatability(fanuc: Robot) -> None:
    rng = np.random.default_rng(2)
    few = measured(fanuc, 20).q
    q = (
        np.repeat(few, 5, axis=0) + rng.normal(size=(100, 6)) * 0.05e-3
    )  # the residual does not care that they differ
    measurements = simulate(fanuc, Simulation(at=q, noise=0.1e-3))
    numbers = named(check_measurements(measurements), "repeatability", "note").numbers
    assert (numbers["rows"], numbers["scatter_mm"]) == (80, pytest.approx(0.1, rel=0.1))
    quiet = replace(measurements, noise_position=0.02e-3)
    named(check_measurements(quiet), "repeatability")
    assert named(design_findings(fanuc, q), "repeated_configurations", "note").numbers["rows"] == 80


# --- auxiliary
# ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("drift", [0.0, 0.3e-3])
def test_drift_of_the_base_against_the_instrument(fanuc: Robot, drift: float) -> None:
    clean = measured(fanuc)
    rng = np.random.default_rng(3)
    fixed = rng.uniform(-1, 1, (2, 3)) + rng.normal(size=(40, 2, 3)) * 0.03e-3
    fixed += np.linspace(0, 1, 40)[:, None, None] * [0.0, 0.0, drift]
    fixed[::3] = np.nan  # not measured every time
    auxiliary = AuxiliaryReadings(time_s=np.arange(40) * 90.0, reference_points=fixed)
    found = named(
        check_measurements(clean, auxiliary), "reference_drift", "warning" if drift else "note"
    )
    if drift:
        assert found.numbers["moved_mm"] == pytest.approx(0.27, abs=0.06)
        assert found.numbers["first_to_last_mm"][2] > 0.2
        assert "0.925 h" in found.message


@pytest.mark.parametrize("growth", [0.0, 12e-6])
def test_trend_with_temperature(fanuc: Robot, growth: float) -> None:
    clean = measured(fanuc, 100)
    temperature = 20 + 15 * np.linspace(0, 1, 100)
    points = clean.points * (1 + growth * (temperature - 20))[:, None, None]
    found = check_measurements(
        replace(clean, points=readonly(points)), AuxiliaryReadings(temperature_c=temperature)
    )
    trend = named(found, "temperature_trend", "warning" if growth else "note")
    assert (trend.numbers["p_value"] < 1e-3) == bool(growth)


def test_commanded_or_read_positions(fanuc: Robot) -> None:
    rng = np.random.default_rng(4)
    read = measured(fanuc, 60).q
    commanded = read + rng.normal(size=read.shape) * 0.5e-3
    robot_was_at_read = simulate(fanuc, Simulation(at=read))
    both = AuxiliaryReadings(q_commanded=commanded, q_read=read)
    found = named(check_measurements(robot_was_at_read, both), "commanded_or_read", "note")
    share, error = found.numbers["share_of_read"], found.numbers["share_standard_error"]
    assert abs(share - 1) < 4 * error < 1
    assert found.numbers["read_rms_mm"] < found.numbers["commanded_rms_mm"]
    file_of_commanded = replace(robot_was_at_read, q=readonly(commanded))
    assert (
        "the file holds the commanded ones"
        in named(check_measurements(file_of_commanded, both), "commanded_or_read").message
    )
    same = AuxiliaryReadings(q_commanded=read, q_read=read)
    assert "commanded_or_read" not in names(check_measurements(robot_was_at_read, same))


def test_the_checks_change_nothing_and_survive_anything(fanuc: Robot) -> None:
    clean = measured(fanuc, 40, unregistered=True)
    for count in (1, 2, 3, 5):
        check_measurements(clean.rows(np.arange(count)))
    holes = clean.points.copy()
    holes[::2, 1] = np.nan
    holes[1::2, 2] = np.nan
    assert warned(check_measurements(replace(clean, points=readonly(holes)))) == []
    points = measured_in_base(clean, clean.setup).points
    assert np.isfinite(points).all()


def test_reference_points_seen_a_few_times_state_nothing_of_drift(fanuc: Robot) -> None:
    fixed = np.full((40, 1, 3), np.nan)
    fixed[::8] = np.linspace(0, 1, 5)[:, None, None]
    assert "reference_drift" not in names(
        check_measurements(measured(fanuc), AuxiliaryReadings(reference_points=fixed))
    )


def test_a_drift_in_time_is_not_taken_for_the_temperature(fanuc: Robot) -> None:
    """Points that drift with the rows while a thermometer follows roughly: the order of the rows
    explains more.
    """
    clean, rng = measured(fanuc, 100), np.random.default_rng(5)
    time = np.linspace(0, 1, 100)
    points = clean.points + time[:, None, None] * [0.0, 0.0, 1e-3]
    temperature = 20 + 5 * time + rng.normal(size=100)
    found = check_measurements(
        replace(clean, points=readonly(points)), AuxiliaryReadings(temperature_c=temperature)
    )
    assert "something drifts with time" in named(found, "temperature_trend").message


def test_read_positions_are_compared_with_the_file_s_where_no_commanded_ones_are_given(
    fanuc: Robot,
) -> None:
    rng = np.random.default_rng(4)
    measurements = measured(fanuc, 60)
    others = AuxiliaryReadings(
        q_read=measurements.q + rng.normal(size=measurements.q.shape) * 0.5e-3
    )
    share = named(check_measurements(measurements, others), "commanded_or_read", "note").numbers[
        "share_of_read"
    ]
    assert abs(share) < 0.3


@pytest.mark.parametrize("count", [2, 3])
def test_a_list_of_targets_without_names_is_told(fanuc: Robot, count: int) -> None:
    """One point per row, k rows with the same joints; rows measured again are no such list."""
    seen = simulate(fanuc, Simulation(seed=3, configurations=20))
    q = np.repeat(seen.q, count, axis=0)
    points = seen.points[:, :count].reshape(-1, 1, 3)
    listed = Measurements.from_points(fanuc, q, points)
    told = named(check_measurements(listed), "nominal_robot")
    assert f"{count} rows each repeat their joints" in str(told)
    assert "P1_T1" in str(told)
    again = Measurements.from_points(fanuc, q[::-1], np.repeat(seen.points[:, :1], count, axis=0))
    assert "repeat their joints" not in " ".join(map(str, check_measurements(again)))
