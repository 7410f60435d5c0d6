"""Poses as matrices, under the names that controllers, ROS and scripts give their numbers."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError
from calibtool.measurement.importing import Imported, Stated, parse_column_map, read_table
from calibtool.robot.catalogue import load_robot

ARM = load_robot("ur10")
ROWS = 5
RNG = np.random.default_rng(7)
Q = RNG.uniform(-90, 90, (ROWS, 6))
R = Rotation.random(ROWS, random_state=RNG).as_matrix()
P = RNG.uniform(-900, 900, (ROWS, 3))
T = np.zeros((ROWS, 4, 4))
T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = R, P, 1.0
J = [f"j{k}_deg" for k in range(1, 7)]
NOAP = [f"{c}{x}" for c in "noap" for x in "xyz"]
ROT, MOVED, WHOLE = R.reshape(ROWS, 9), T[:, :3].reshape(ROWS, 12), T.reshape(ROWS, 16)
COLUMNS = np.swapaxes(T, 1, 2)  # row k is column k of T


def names(pattern: str, rows: int, columns: int, first: int = 1) -> list[str]:
    return [pattern.format(i + first, j + first) for i in range(rows) for j in range(columns)]


def numbered(pattern: str, count: int, first: int = 0) -> list[str]:
    return [pattern.format(k + first) for k in range(count)]


def read(header: list[str], values: np.ndarray, **stated: str) -> Imported:
    cells = np.concatenate([Q, values], axis=1)
    lines = [";".join(f"{v:.9f}" for v in row) for row in cells]
    text = "\n".join([";".join([*J, *header]), *lines])
    return read_table(text, "t.csv", ARM, stated=Stated(**stated))


HEADERS = {
    "r and t": ([*names("r{}{}", 3, 3), "t1", "t2", "t3"], np.hstack([ROT, P])),
    "r and xyz": ([*names("R{}{}", 3, 3), "X [mm]", "Y [mm]", "Z [mm]"], np.hstack([ROT, P])),
    "rot and p": ([*names("rot_{}_{}", 3, 3), "px", "py", "pz"], np.hstack([ROT, P])),
    "R(1,1)": ([*names("R({}:{})", 3, 3), "tx", "ty", "tz"], np.hstack([ROT, P])),
    "place first": (["x", "y", "z", *names("r{}{}", 3, 3)], np.hstack([P, ROT])),
    "3 x 4": (names("T_{}{}", 3, 4), MOVED),
    "3 x 4, from zero": (names("m{}{}", 3, 4, 0), MOVED),
    "3 x 4 in brackets": (names("T[{}][{}]", 3, 4, 0), MOVED),
    "4 x 4": (names("T_{}_{}", 4, 4), WHOLE),
    "4 x 4, from zero": (names("pose_{}{}", 4, 4, 0), WHOLE),
    "n o a p": (NOAP, COLUMNS[:, :, :3].reshape(ROWS, 12)),
    "N S A P": ([c.upper().replace("O", "S") for c in NOAP], COLUMNS[:, :, :3].reshape(ROWS, 12)),
    "16 by rows": (numbered("pose[{}]", 16), WHOLE),
    "16 by rows, from one": (numbered("T{}", 16, 1), WHOLE),
    "16 by columns": (numbered("O_T_EE[{}]", 16), COLUMNS.reshape(ROWS, 16)),
    "12 by rows": (numbered("tf_{}", 12), MOVED),
    "12 by columns": (numbered("H{}", 12, 1), COLUMNS[:, :, :3].reshape(ROWS, 12)),
}


@pytest.mark.parametrize("case", HEADERS)
def test_a_matrix_is_a_pose(case: str) -> None:
    header, values = HEADERS[case]
    found = read(header, values, **({} if "mm" in str(header) else {"unit": "mm"})).measurements
    assert found.kind == "pose"
    np.testing.assert_allclose(found.points[:, 0], P * 1e-3, atol=1e-11)
    np.testing.assert_allclose(found.rotations, R, atol=1e-8)


def test_units_of_the_columns_of_a_matrix_count() -> None:
    header = names("T{}{}", 3, 4)
    header = [f"{name} [m]" if name.endswith("4") else name for name in header]
    scaled = MOVED.copy()
    scaled[:, 3::4] *= 1e-3
    np.testing.assert_allclose(read(header, scaled).measurements.points[:, 0], P * 1e-3, atol=1e-8)
    with pytest.raises(InputError, match="the unit of column 'T14' is not stated"):
        read(names("T{}{}", 3, 4), MOVED)


def test_the_commanded_matrix_beside_the_measured_one_is_not_used() -> None:
    header = [*names("cmd_r{}{}", 3, 3), *names("r{}{}", 3, 3), "x_mm", "y_mm", "z_mm"]
    found = read(header, np.hstack([np.roll(ROT, 1, axis=0), ROT, P]))
    np.testing.assert_allclose(found.measurements.rotations, R, atol=1e-8)
    assert found.understood.ignored["t.csv"] == header[:9]
    twice = [*names("a r{}{}", 3, 3), *names("b r{}{}", 3, 3), "x_mm", "y_mm", "z_mm"]
    with pytest.raises(InputError, match=r"'a r11' and of 'b r11'; map the columns"):
        read(twice, np.hstack([ROT, ROT, P]))


def test_a_matrix_that_is_no_rotation_is_refused_with_its_row() -> None:
    header = [*names("r{}{}", 3, 3), "x_mm", "y_mm", "z_mm"]
    wrong = ROT.copy()
    wrong[3, 4] += 0.1
    with pytest.raises(
        InputError, match=r"t.csv:5: the matrix is no rotation: R Rᵀ is 0\.\d+ from"
    ):
        read(header, np.hstack([wrong, P]))
    with pytest.raises(InputError, match=r"t.csv:2: the matrix has the determinant -1"):
        read(header, np.hstack([ROT * ([1, 1, -1] * 3), P]))


@pytest.mark.parametrize("digits", [4, 6])
def test_rounded_matrices_give_the_nearest_rotation(digits: int) -> None:
    header = [*names("r{}{}", 3, 3), "x_mm", "y_mm", "z_mm"]
    found = read(header, np.hstack([np.round(ROT, digits), P])).measurements.rotations
    assert found is not None
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-12)
    np.testing.assert_allclose(
        found @ np.swapaxes(found, 1, 2), np.eye(3)[None].repeat(ROWS, 0), atol=1e-12
    )
    assert np.abs(found - R).max() < 2 * 10.0**-digits


def test_numbers_that_do_not_turn_are_no_matrix() -> None:
    """Twelve temperatures beside a point, and nine elements of a covariance."""
    sensors = RNG.uniform(20, 25, (ROWS, 12))
    header = [*numbered("S{}", 12, 1), *names("cov{}{}", 3, 3), "x_mm", "y_mm", "z_mm"]
    found = read(header, np.hstack([sensors, 0.01 * np.ones((ROWS, 9)), P]))
    assert found.measurements.kind == "points"
    assert found.understood.ignored["t.csv"] == header[:21]


@pytest.mark.parametrize("separator", [";", ",", "\t", " "])
def test_without_a_header_columns_are_named_by_their_numbers(separator: str) -> None:
    """Sixteen numbers of a matrix behind the joints, and a map that says so."""
    rows = np.hstack([Q, WHOLE])
    text = "\n".join(separator.join(f"{v:.9f}" for v in row) for row in rows)
    nine = [f"c{7 + 4 * i + j}" for i in range(3) for j in range(3)]
    words = {"columns": [f"c{k}" for k in range(1, 7)], "position": ["c10", "c14", "c18"]}
    columns = parse_column_map(
        f'[joints]\ncolumns = {words["columns"]}\nunit = "deg"\n[pose]\nunit = "mm"\n'
        f'position = {words["position"]}\norientation = {nine}\nconvention = "matrix"\n',
        "map.toml",
    )
    found = read_table(text, "t.txt", ARM, columns)
    np.testing.assert_allclose(found.measurements.rotations, R, atol=1e-8)
    np.testing.assert_allclose(found.measurements.points[:, 0] * 1e3, P, atol=1e-6)
    assert "t.txt: no header; its columns are called c1 … c22 (--columns MAP.toml)" in (
        found.understood.notes
    )
    with pytest.raises(InputError, match="no joint columns"):
        read_table(text, "t.txt", ARM)
    broken = text.split("\n")
    broken[2] = separator.join(broken[2].split(separator)[:-1])
    with pytest.raises(InputError, match=r"t\.txt:3: 21 cells, but the header has 22 columns"):
        read_table("\n".join(broken), "t.txt", ARM, columns)


@pytest.mark.parametrize("convention", ["matrix", "matrix-columns"])
def test_a_map_says_how_nine_numbers_stand(convention: str) -> None:
    header = [*numbered("c{}", 9), "x", "y", "z"]
    nine = R if convention == "matrix" else np.swapaxes(R, 1, 2)
    lines = np.hstack([Q, nine.reshape(ROWS, 9), P])
    columns = parse_column_map(
        f'[pose]\nposition = ["x", "y", "z"]\nunit = "mm"\nconvention = "{convention}"\n'
        f"orientation = {header[:9]}\n".replace("'", '"'),
        "map.toml",
    )
    text = "\n".join(";".join(map(str, row)) for row in [[*J, *header], *lines.tolist()])
    found = read_table(text, "t.csv", ARM, columns).measurements
    np.testing.assert_allclose(found.rotations, R, atol=1e-12)
