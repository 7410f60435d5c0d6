"""Instrument tables become measurements: by header or by map, in every convention, with warnings
and clear errors.
"""

import numpy as np
import pytest
from cases import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError, NoSolutionError, UsageError
from calibtool.measurement.checks import check_measurements
from calibtool.measurement.importing import choose_rows, import_table, parse_column_map, read_table
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.sampling import sample_configurations
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot

Array = np.ndarray

UR5 = load_robot("ur5")
N = 12
Q = sample_configurations(UR5, UR5.workspace(), N, np.random.default_rng(0))
Q_DEG = np.rad2deg(Q)
POSES = UR5.mechanism.forward(Q)
JOINTS = [f"j{i}_deg" for i in range(1, 7)]
JOINT_MAP = """
[joints]
columns = ["j1_deg", "j2_deg", "j3_deg", "j4_deg", "j5_deg", "j6_deg"]
unit = "deg"
"""


def instrument() -> Array:
    """An instrument standing somewhere, T_instrument_base."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()
    T[:3, 3] = [3.0, -1.5, 0.7]
    return T


def points_mm(targets: Array, T: Array | None = None) -> Array:
    """(N, m, 3) target points in mm, in K_0 or in an instrument's frame, without noise."""
    poses = POSES if T is None else T @ POSES
    return (np.einsum("kab,mb->kma", poses[:, :3, :3], targets) + poses[:, None, :3, 3]) * 1e3


def csv(columns: dict[str, Array], delimiter: str = ",", decimal: str = ".") -> str:
    values = np.column_stack(list(columns.values()))
    lines = [delimiter.join(columns)]
    lines += [delimiter.join(f"{v:.17g}".replace(".", decimal) for v in row) for row in values]
    return "\n".join(lines) + "\n"


def joint_cells() -> dict[str, Array]:
    return {name: Q_DEG[:, j] for j, name in enumerate(JOINTS)}


def named(prefix: str, values: Array, unit: str = "mm") -> dict[str, Array]:
    return {f"{prefix}{axis}_{unit}": values[:, a] for a, axis in enumerate("xyz")}


def three_targets_csv(points: Array) -> str:
    cells = joint_cells()
    for i in range(3):
        cells |= named(f"t{i + 1}_", points[:, i])
    return csv(cells)


def imported(text: str, toml: str | None = None, **options: object) -> Measurements:
    column_map = None if toml is None else parse_column_map(toml, "map.toml")
    measurements, warnings, *_ = import_table(text, "table.csv", UR5, column_map, **options)
    assert warnings == []
    return measurements


TRIPLE_MAP = JOINT_MAP + "".join(
    f'[[targets]]\nmeasured = ["t{i}_x_mm", "t{i}_y_mm", "t{i}_z_mm"]\nunit = "mm"\n'
    for i in (1, 2, 3)
)


# --- points ---------------------------------------------------------------------------------------


def test_joints_and_points_arrive_in_radians_and_metres() -> None:
    points = points_mm(UR5.targets, instrument())
    measurements = imported(three_targets_csv(points))
    assert np.allclose(measurements.q, Q, atol=1e-14)
    assert np.allclose(measurements.points, points / 1e3, atol=1e-14)
    assert measurements.rotations is None
    assert measurements.kind == "points"


def test_a_map_and_the_header_s_names_give_the_same_measurements() -> None:
    text = three_targets_csv(points_mm(UR5.targets, instrument()))
    by_name, by_map = imported(text), imported(text, TRIPLE_MAP)
    assert np.array_equal(by_name.q, by_map.q)
    assert np.array_equal(by_name.points, by_map.points)
    assert np.array_equal(by_name.setup.targets, by_map.setup.targets)
    assert np.array_equal(by_name.setup.T_instrument_base, by_map.setup.T_instrument_base)


def test_columns_with_other_names_delimiters_and_decimal_commas_are_the_same_measurements() -> None:
    points = points_mm(UR5.targets, instrument())
    cells = {f"axis {j}": Q[:, 5 - j] for j in range(6)}  # radians, in reverse order
    for i in range(3):
        cells |= {f"P{i}{axis}": points[:, i, a] / 1e3 for a, axis in enumerate("XYZ")}
    toml = 'delimiter = ";"\ndecimal = ","\n[joints]\nunit = "rad"\ncolumns = ['
    toml += ", ".join(f'"axis {j}"' for j in (5, 4, 3, 2, 1, 0)) + "]\n"
    toml += "".join(
        f'[[targets]]\nmeasured = ["P{i}X", "P{i}Y", "P{i}Z"]\nunit = "m"\n' for i in range(3)
    )
    foreign, own = imported(csv(cells, ";", ","), toml), imported(three_targets_csv(points))
    assert np.allclose(foreign.q, own.q, atol=1e-14)
    assert np.allclose(foreign.points, own.points, atol=1e-14)


def test_unknown_instrument_and_targets_are_registered() -> None:
    targets = np.array([[0.1, 0.0, 0.05], [-0.08, 0.12, 0.02], [-0.05, -0.2, 0.1]])
    setup = imported(three_targets_csv(points_mm(targets, instrument()))).setup
    assert not setup.known
    assert np.abs(setup.targets - targets).max() < 1e-9
    assert np.abs(setup.T_instrument_base - instrument()).max() < 1e-9


def test_points_in_the_base_frame_with_the_robot_s_targets_need_no_registration() -> None:
    text = three_targets_csv(points_mm(UR5.targets))
    setup = imported(text, frame="base", robot_targets=True).setup
    assert setup.known
    assert np.array_equal(setup.T_instrument_base, np.eye(4))
    assert np.array_equal(setup.targets, UR5.targets)


def test_places_of_targets_can_be_given_in_the_map() -> None:
    text = three_targets_csv(points_mm(UR5.targets, instrument()))
    toml = TRIPLE_MAP
    for i, (x, y, z) in enumerate(UR5.targets * 1e3):
        toml = toml.replace(
            f'"t{i + 1}_z_mm"]\n', f'"t{i + 1}_z_mm"]\non_tool_mm = [{x}, {y}, {z}]\n'
        )
    setup = imported(text, toml).setup
    assert setup.targets_known
    assert not setup.frame_known
    assert np.allclose(setup.targets, UR5.targets, atol=1e-15)
    assert np.abs(setup.T_instrument_base - instrument()).max() < 1e-9


def test_one_target_is_position_only() -> None:
    target = np.array([[0.03, -0.02, 0.11]])
    text = csv(joint_cells() | named("", points_mm(target, instrument())[:, 0]))
    measurements = imported(text)
    assert measurements.points.shape == (N, 1, 3)
    assert measurements.rotations is None
    assert np.abs(measurements.setup.targets - target).max() < 1e-9


def test_the_option_frame_overrides_the_map() -> None:
    text = three_targets_csv(points_mm(UR5.targets))
    assert imported(text, TRIPLE_MAP + '[instrument]\nframe = "base"\n').setup.frame_known
    assert not imported(
        text, TRIPLE_MAP + '[instrument]\nframe = "base"\n', frame="unknown"
    ).setup.frame_known


@pytest.mark.parametrize(
    ("error_is", "sign"), [("measured-minus-nominal", 1), ("nominal-minus-measured", -1)]
)
def test_nominal_points_and_errors_add_up_to_what_was_measured(error_is: str, sign: int) -> None:
    measured = points_mm(np.array([[0.0, 0.0, 0.031]]))[:, 0]
    error = np.random.default_rng(1).normal(size=measured.shape)
    nominal = measured - sign * error
    cells = joint_cells() | {f"n{a}": nominal[:, i] for i, a in enumerate("xyz")}
    cells |= {f"e{a}": error[:, i] for i, a in enumerate("xyz")}
    toml = (
        JOINT_MAP
        + '[[targets]]\nnominal = ["nx", "ny", "nz"]\nerror = ["ex", "ey", "ez"]\nunit = "mm"\n'
    )
    toml += (
        f'error_is = "{error_is}"\non_tool_mm = [0.0, 0.0, 31.0]\n[instrument]\nframe = "base"\n'
    )
    assert np.allclose(imported(csv(cells), toml).points[:, 0] * 1e3, measured, atol=1e-10)


def test_nominal_points_and_errors_are_recognised_by_name() -> None:
    measured = points_mm(UR5.targets, instrument())
    error = np.random.default_rng(2).normal(size=measured.shape)
    cells = joint_cells()
    for i in range(3):
        cells |= named(f"t{i + 1}_nominal_", (measured - error)[:, i]) | named(
            f"t{i + 1}_error_", error[:, i]
        )
    assert np.allclose(imported(csv(cells)).points * 1e3, measured, atol=1e-9)


def test_stated_noise_is_taken_over() -> None:
    text = three_targets_csv(points_mm(UR5.targets, instrument()))
    measurements = imported(
        text, TRIPLE_MAP + "[noise]\nposition_mm = 0.02\norientation_mrad = 0.3\n"
    )
    assert np.isclose(measurements.noise_position, 0.02e-3)
    assert np.isclose(measurements.noise_orientation, 0.3e-3)


# --- poses ----------------------------------------------------------------------------------------

SENSOR = Rotation.from_rotvec([0.3, 0.2, -2.5]).as_matrix()
ORIGIN = np.array([0.02, -0.05, 0.12])


def pose_readings() -> tuple[Array, Rotation]:
    T = instrument() @ POSES
    return (T[:, :3, :3] @ ORIGIN + T[:, :3, 3]) * 1e3, Rotation.from_matrix(T[:, :3, :3] @ SENSOR)


def elementary(axis: str, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


@pytest.mark.parametrize("orientation_unit", ["deg", "rad"])
@pytest.mark.parametrize("axes", ["xyz", "zyx", "zyz"])
@pytest.mark.parametrize("kind", ["intrinsic", "fixed"])
def test_euler_angles_multiply_up_to_the_measured_rotation(
    kind: str, axes: str, orientation_unit: str
) -> None:
    position, rotation = pose_readings()
    angles = rotation.as_euler(axes.upper() if kind == "intrinsic" else axes)
    cells = joint_cells() | {f"p{a}": position[:, i] for i, a in enumerate("xyz")}
    factor = 180.0 / np.pi if orientation_unit == "deg" else 1.0
    cells |= {f"r{i}": angles[:, i] * factor for i in range(3)}
    toml = (
        JOINT_MAP
        + '[pose]\nposition = ["px", "py", "pz"]\nunit = "mm"\norientation = ["r0", "r1", "r2"]\n'
    )
    toml += f'convention = "{kind}-{axes}"\norientation_unit = "{orientation_unit}"\n'
    measurements = imported(csv(cells), toml)
    assert measurements.kind == "pose"
    assert measurements.rotations is not None
    for k in range(N):
        a, b, c = (elementary(axis, angle) for axis, angle in zip(axes, angles[k], strict=True))
        product = a @ b @ c if kind == "intrinsic" else c @ b @ a
        assert np.abs(measurements.rotations[k] - product).max() < 1e-9
    assert np.allclose(measurements.points[:, 0] * 1e3, position, atol=1e-9)


@pytest.mark.parametrize(
    "convention", ["rotation-vector", "quaternion-wxyz", "quaternion-xyzw", "intrinsic-xyz"]
)
def test_all_conventions_give_the_same_poses_and_the_same_sensor(convention: str) -> None:
    position, rotation = pose_readings()
    values = {
        "rotation-vector": rotation.as_rotvec(),
        "quaternion-wxyz": rotation.as_quat(scalar_first=True),
        "quaternion-xyzw": rotation.as_quat(),
        "intrinsic-xyz": rotation.as_euler("XYZ"),
    }[convention]
    names = [f"r{i}" for i in range(values.shape[1])]
    cells = joint_cells() | {f"p{a}": position[:, i] for i, a in enumerate("xyz")}
    cells |= {name: values[:, i] for i, name in enumerate(names)}
    toml = JOINT_MAP + '[pose]\nposition = ["px", "py", "pz"]\nunit = "mm"\n'
    toml += (
        f'orientation = [{", ".join(repr(n) for n in names)}]\nconvention = "{convention}"\n'
        'orientation_unit = "rad"\n'
    )
    measurements = imported(csv(cells), toml)
    assert np.abs(measurements.rotations - rotation.as_matrix()).max() < 1e-9
    setup = measurements.setup
    assert setup.R_tool_sensor is not None
    assert np.abs(setup.T_instrument_base - instrument()).max() < 1e-8
    assert np.abs(setup.targets - ORIGIN).max() < 1e-8
    assert np.abs(setup.R_tool_sensor - SENSOR).max() < 1e-8


@pytest.mark.parametrize("form", ["quaternion", "rotation vector", "roll pitch yaw"])
def test_poses_are_recognised_by_name(form: str) -> None:
    position, rotation = pose_readings()
    orientation: dict[str, Array]
    if form == "quaternion":
        q = rotation.as_quat(scalar_first=True)
        orientation = {name: q[:, i] for i, name in enumerate(("qw", "qx", "qy", "qz"))}
    elif form == "rotation vector":
        v = rotation.as_rotvec()
        orientation = {f"r{a}_rad": v[:, i] for i, a in enumerate("xyz")}
    else:
        e = rotation.as_euler("ZYX", degrees=True)
        orientation = {"roll_deg": e[:, 2], "pitch_deg": e[:, 1], "yaw_deg": e[:, 0]}
    measurements = imported(csv(joint_cells() | named("", position / 1e3, "m") | orientation))
    assert measurements.rotations is not None
    assert np.abs(measurements.rotations - rotation.as_matrix()).max() < 1e-9
    assert np.allclose(measurements.points[:, 0] * 1e3, position, atol=1e-9)


def test_a_quaternion_that_is_no_rotation_is_refused_by_line() -> None:
    position, rotation = pose_readings()
    q = rotation.as_quat(scalar_first=True)
    q[4] *= 1.1
    cells = (
        joint_cells()
        | named("", position)
        | {n: q[:, i] for i, n in enumerate(("qw", "qx", "qy", "qz"))}
    )
    with pytest.raises(InputError, match=r"^table\.csv:6: quaternion of length 1\.1; expected 1"):
        imported(csv(cells))


def test_a_convention_with_the_wrong_number_of_columns_is_refused() -> None:
    toml = (
        JOINT_MAP
        + '[pose]\nposition = ["px", "py", "pz"]\nunit = "mm"\norientation = ["a", "b", "c"]\n'
    )
    toml += 'convention = "quaternion-wxyz"\n'
    cells = joint_cells() | {name: np.ones(N) for name in ("px", "py", "pz", "a", "b", "c")}
    with pytest.raises(InputError, match="quaternion-wxyz takes 4 columns, 3 are mapped"):
        imported(csv(cells), toml)


# --- what is wrong is named -----------------------------------------------------------------------


def test_degrees_in_a_radian_column_are_noticed() -> None:
    text = three_targets_csv(points_mm(UR5.targets))
    with pytest.raises(
        InputError,
        match=r"^table\.csv:\d+: column 'j\d_deg' holds .* rad, which looks like degrees",
    ):
        imported(text, TRIPLE_MAP.replace('"deg"', '"rad"'))


def test_collinear_targets_are_refused() -> None:
    line = np.array([[0.0, 0.0, 0.1], [0.1, 0.0, 0.1], [0.25, 0.0, 0.1]])
    text = three_targets_csv(points_mm(line, instrument()))
    with pytest.raises(
        InputError, match=r"^table\.csv: measured points: the 3 target points are collinear"
    ):
        imported(text)


def test_one_point_given_twice_is_refused() -> None:
    points = points_mm(np.array([[0.0, 0.1, 0.1]]), instrument())[:, 0]
    text = csv(joint_cells() | named("t1_", points) | named("t2_", points))
    with pytest.raises(InputError, match="targets 1 and 2 are the same point"):
        imported(text)


def test_a_missing_column_is_named_with_its_near_ones() -> None:
    text = three_targets_csv(points_mm(UR5.targets))
    with pytest.raises(InputError, match=r"no column 't2_yy_mm'; did you mean .*t2_y_mm"):
        imported(text, TRIPLE_MAP.replace("t2_y_mm", "t2_yy_mm"))
    with pytest.raises(InputError, match=r"no column 't3_z_mm'"):
        imported(text.replace("t3_z_mm", "other"))


@pytest.mark.parametrize("value", [9_999_999.0, -1.0])
def test_one_row_of_marks_is_no_line_of_targets(value: float) -> None:
    """The first row as well as any other: what is in most rows counts."""
    for row in (0, 4):
        points = points_mm(UR5.targets)
        points[row, :2] = value
        found = import_table(three_targets_csv(points), "t.csv", UR5).measurements
        assert len(found) == N
        (shape,) = (f for f in check_measurements(found) if f.name == "target_out_of_place")
        assert shape.numbers["rows"] == [row + 1]


@pytest.mark.parametrize("rows", [[0], [3, 7]])
def test_rows_of_zeros_are_left_out_as_empty_ones_are(rows: list[int]) -> None:
    points = points_mm(UR5.targets)
    text = three_targets_csv(points).splitlines()
    points[rows] = 0.0
    found = read_table(three_targets_csv(points), "t.csv", UR5)
    for row in rows:
        text[1 + row] = ",".join(text[1 + row].split(",")[:6] + [""] * 9)
    empty = read_table("\n".join(text), "t.csv", UR5)
    assert found.warnings == empty.warnings
    assert "in which nothing was measured left out" in found.warnings[0]
    np.testing.assert_array_equal(found.measurements.points, empty.measurements.points)


def test_a_target_that_never_moves_was_not_seen() -> None:
    points = points_mm(UR5.targets)
    points[:, 1] = 9_999_999.0
    with pytest.raises(InputError, match="of target 2 are the same in every row; where"):
        imported(three_targets_csv(points))


def test_a_table_without_a_header_says_so_and_how_its_columns_are_called() -> None:
    text = "\n".join(three_targets_csv(points_mm(UR5.targets)).splitlines()[1:])
    with pytest.raises(InputError, match=r"without a header .* c1 … c15; .*--map-template"):
        imported(text)


def test_a_table_without_joints_or_points_states_what_it_lacks() -> None:
    with pytest.raises(InputError, match="no joint columns j1_deg"):
        imported(csv(named("t1_", np.ones((N, 3)))))
    with pytest.raises(InputError, match="no measured points"):
        imported(csv(joint_cells()))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("[joints]", "[joint]"), "joints"),
        (("[[targets]]", "[[target]]"), "unknown key 'target'; did you mean targets"),
        (
            ("[joints]", "[instrumnt]\nframe = 'base'\n[joints]"),
            "unknown key 'instrumnt'; did you mean instrument",
        ),
        (
            ("[joints]", "[noise]\npositon_mm = 0.05\n[joints]"),
            "noise.*positon_mm.*did you mean position_mm",
        ),
        (
            ("[joints]", "[instrument]\nframe = 'tracker'\n[joints]"),
            r"instrument\.frame: .*'base' or 'unknown'",
        ),
        (
            ("[joints]", "[noise]\nposition_mm = -0.05\n[joints]"),
            r"noise\.position_mm: .*greater than 0",
        ),
        (('unit = "deg"', 'unit = "degrees"'), r"joints\.unit"),
        (('unit = "mm"', 'unit = "inch"'), r"targets\.0\.unit"),
        (("[joints]", "[joints"), "not valid TOML"),
    ],
)
def test_a_wrong_key_or_value_of_the_map_is_named(change: tuple[str, str], message: str) -> None:
    with pytest.raises(InputError, match=rf"^map\.toml: .*{message}"):
        parse_column_map(TRIPLE_MAP.replace(*change), "map.toml")


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        (
            TRIPLE_MAP + '[pose]\nposition = ["a", "b", "c"]\nunit = "mm"\n'
            'orientation = ["d", "e", "f", "g"]\n'
            'convention = "quaternion-wxyz"\n',
            r"give either \[\[targets\]\], \[pose\] or \[lengths\]",
        ),
        (
            JOINT_MAP + '[[targets]]\nunit = "mm"\n',
            "give either 'measured', or 'nominal' together with 'error'",
        ),
        (
            JOINT_MAP + '[[targets]]\nunit = "mm"\nnominal = ["a", "b", "c"]\n',
            "together with 'error'",
        ),
        (
            TRIPLE_MAP.replace('"t1_z_mm"]', '"t1_z_mm"]\non_tool_mm = [0, 0, 1]'),
            "on_tool_mm is given for some",
        ),
        (JOINT_MAP + '[[targets]]\nunit = "mm"\nmeasured = ["a", "b"]\n', "measured"),
    ],
)
def test_a_map_that_contradicts_itself_is_refused(toml: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_column_map(toml, "map.toml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('"j5_deg", "j6_deg"]', '"j5_deg"]'), "5 joint columns, but ur5 has 6 joints"),
        (('unit = "deg"', 'unit = ["deg", "deg"]'), "2 joint units for 6 joints"),
        (('unit = "deg"', 'unit = "mm"'), "column 'j1_deg' is in mm, but its joint is revolute"),
    ],
)
def test_a_map_for_another_kind_of_robot_is_refused(change: tuple[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        imported(three_targets_csv(points_mm(UR5.targets)), TRIPLE_MAP.replace(*change, 1))


def test_targets_of_the_robot_must_be_as_many_as_are_measured() -> None:
    text = csv(joint_cells() | named("", points_mm(UR5.targets)[:, 0]))
    with pytest.raises(InputError, match="1 measured targets, but ur5 describes 3"):
        imported(text, robot_targets=True)


def test_too_few_rows_to_register_have_no_solution() -> None:
    text = three_targets_csv(points_mm(UR5.targets, instrument()))
    with pytest.raises(NoSolutionError, match="measure more configurations"):
        imported("\n".join(text.splitlines()[:2]) + "\n")


def test_rows_outside_the_joint_limits_are_kept_with_a_warning() -> None:
    text = three_targets_csv(points_mm(UR5.targets, instrument())).splitlines()
    cells = text[3].split(",")
    cells[5] = repr(float(cells[5]) + 720.0)  # the same pose, two turns on
    text[3] = ",".join(cells)
    measurements, warnings, *_ = import_table("\n".join(text), "table.csv", UR5)
    assert len(measurements) == N
    assert warnings == [f"table.csv:4: 1 of {N} rows are outside the joint limits of ur5; kept"]


def test_a_long_table_is_imported_whole_and_registered_to_a_part_of_its_rows() -> None:
    """More rows than a block of reading and than registration takes: every row arrives, and the
    set-up is found.
    """
    count = 20_500
    rows = three_targets_csv(points_mm(UR5.targets, instrument())).splitlines()
    text = "\n".join([rows[0], *(rows[1 + k % N] for k in range(count))])
    measurements = imported(text)
    assert np.allclose(measurements.q, Q[np.arange(count) % N], atol=1e-14)
    assert np.abs(measurements.setup.T_instrument_base - instrument()).max() < 1e-8


# --- rows -----------------------------------------------------------------------------------------

ALL = imported(three_targets_csv(points_mm(UR5.targets, instrument())))


def positions_of(part: Measurements) -> list[int]:
    """Which rows of ALL a part holds, from its joint positions; points must have moved along."""
    found = [int(np.flatnonzero((ALL.q == row).all(axis=1))[0]) for row in part.q]
    assert np.array_equal(part.points, ALL.points[found])
    return found


@given(
    first=st.integers(1, N),
    last=st.integers(1, N),
    sample=st.none() | st.integers(1, N),
    seed=st.integers(0, 99),
)
@examples(40)
def test_chosen_rows_and_the_rest_are_a_partition(
    first: int, last: int, sample: int | None, seed: int
) -> None:
    first, last = min(first, last), max(first, last)
    if sample is not None:
        sample = min(sample, last - first + 1)
    chosen, rest = choose_rows(N, f"{first}:{last}", sample, seed)
    taken = positions_of(ALL.rows(chosen))
    assert sorted(taken + positions_of(ALL.rows(rest))) == list(range(N))
    assert len(taken) == (last - first + 1 if sample is None else sample)
    assert set(taken) <= set(range(first - 1, last))
    assert taken == sorted(taken)


def test_all_rows_are_chosen_by_default() -> None:
    chosen, rest = choose_rows(N, None, None, 0)
    assert chosen.tolist() == list(range(N))
    assert len(rest) == 0


def test_a_sample_depends_on_its_seed_only() -> None:
    draws = [tuple(choose_rows(N, None, 5, seed)[0]) for seed in (0, 0, 1, 2, 3)]
    assert draws[0] == draws[1]
    assert len(set(draws)) > 1


@pytest.mark.parametrize("rows", ["0:3", "3:2", f"1:{N + 1}", "1-3", "a:b", "", "1:", "-1:3"])
def test_a_range_that_does_not_fit_is_wrong_usage(rows: str) -> None:
    with pytest.raises(UsageError, match=rf"--rows {rows}: expected A:B with 1 <= A <= B <= {N}"):
        choose_rows(N, rows, None, 0)


def test_a_sample_larger_than_the_rows_is_wrong_usage() -> None:
    with pytest.raises(UsageError, match="--sample 4: there are only 3 rows"):
        choose_rows(N, "1:3", 4, 0)


# --- whose joint values ---------------------------------------------------------------------------


def test_a_controller_s_joint_values_become_those_of_the_chain(fanuc: Robot) -> None:
    measured = simulate(fanuc, Simulation(configurations=12, seed=4, workspace="full"))
    header = [
        *(f"j{j}_rad" for j in range(1, 7)),
        *(f"t{i}_{axis}_m" for i in (1, 2, 3) for axis in "xyz"),
    ]

    def text(q: Array) -> str:
        rows = np.hstack([q, measured.points.reshape(12, -1)])
        return "\n".join(
            [",".join(header), *(",".join(map(repr, map(float, row))) for row in rows)]
        )

    shown = text(fanuc.to_controller(measured.q))
    found, *_ = import_table(shown, "t", fanuc, frame="base", joint_values="controller")
    np.testing.assert_allclose(found.q, measured.q, atol=1e-12)
    with pytest.raises(
        UsageError, match=r"^t: .*q3 = J3 \+ J2.*--joint-values serial or --joint-values controller"
    ):
        import_table(text(measured.q), "t", fanuc, frame="base")
    for values, stated in (("controller", shown), ("serial", text(measured.q))):
        stated = stated.replace("j3_rad", f"j3_{values}_rad")
        again, *_ = import_table(stated, "t", fanuc, frame="base")
        np.testing.assert_allclose(again.q, measured.q, atol=1e-12)
        other = {"controller": "serial", "serial": "controller"}[values]
        with pytest.raises(UsageError, match=f"header says that the joint values are {values}"):
            import_table(stated, "t", fanuc, frame="base", joint_values=other)
    targets = "".join(
        f'[[targets]]\nmeasured = ["t{i}_x_m", "t{i}_y_m", "t{i}_z_m"]\nunit = "m"\n'
        for i in (1, 2, 3)
    )
    joints = (
        f'[joints]\ncolumns = {header[:6]}\nunit = "rad"\nvalues = "controller"\n{targets}'.replace(
            "'", '"'
        )
    )
    mapped, *_ = import_table(shown, "t", fanuc, parse_column_map(joints, "map.toml"), frame="base")
    np.testing.assert_allclose(mapped.q, measured.q, atol=1e-12)
    overridden, *_ = import_table(
        text(measured.q),
        "t",
        fanuc,
        parse_column_map(joints, "map.toml"),
        frame="base",
        joint_values="serial",
    )
    np.testing.assert_array_equal(overridden.q, measured.q)


# --- not seen -------------------------------------------------------------------------------------


@pytest.mark.parametrize("cells", [[(3, 1)], [(0, 0), (0, 2), (11, 1)]])
def test_a_cell_of_zeros_is_a_target_that_was_not_seen(cells: list[tuple[int, int]]) -> None:
    points = points_mm(UR5.targets, instrument())
    spoiled = points.copy()
    for row, target in cells:
        spoiled[row, target] = 0.0
    found, warnings, *_ = import_table(three_targets_csv(spoiled), "table.csv", UR5)
    rows = {row for row, _ in cells}
    places = "1 place" if len(cells) == 1 else f"{len(cells)} places"
    assert f"'not seen' in {places}: " in warnings[0]
    assert all(str(row + 2) in warnings[0] for row in rows)
    assert {(int(k), int(i)) for k, i in np.argwhere(~found.seen)} == set(cells)
    whole = imported(three_targets_csv(points))
    np.testing.assert_allclose(found.setup.targets, whole.setup.targets, atol=1e-6)


def test_a_zero_in_one_coordinate_is_a_number() -> None:
    points = points_mm(UR5.targets, instrument())
    points[4, 1, 2] = 0.0
    found = import_table(three_targets_csv(points), "table.csv", UR5)[0]
    assert found.seen.all()
