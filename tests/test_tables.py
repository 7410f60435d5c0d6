"""Tables: every common way of writing the same numbers is read alike; a bad one is named by
line and column.
"""

import csv

import numpy as np
import pytest
from cases import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibtool.errors import InputError
from calibtool.joint_and_pose_columns import joints_from_header, poses_from_header
from calibtool.robot.catalogue import load_robot
from calibtool.tables import csv_lines, format_table, number, parse_table

Array = np.ndarray

VALUES = np.array([[1.5, -20.25, 300.0], [0.0, 1e-3, -7.125]])
HEADER = ["alpha", "beta", "gamma"]


def written(delimiter: str = ",", decimal: str = ".", newline: str = "\n") -> str:
    rows = [HEADER, *([repr(float(v)).replace(".", decimal) for v in row] for row in VALUES)]
    return newline.join(delimiter.join(row) for row in rows) + newline


def joints_csv(*rows: str, header: str = "j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg") -> str:
    return "\n".join([header, *rows]) + "\n"


# --- the same numbers, however they are written ---------------------------------------------------


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("delimiter", "decimal"),
    [
        (",", "."),
        (";", "."),
        (";", ","),
        ("\t", "."),
        ("\t", ","),
        (" ", "."),
        (" ", ","),
        (" ; ", ","),
    ],
)
def test_delimiter_and_decimal_sign_are_recognised(
    delimiter: str, decimal: str, newline: str
) -> None:
    table = parse_table(written(delimiter, decimal, newline), "t.csv")
    assert table.header == HEADER
    assert np.array_equal(table.numbers(HEADER), VALUES)


def test_a_decimal_comma_is_recognised_although_the_first_row_holds_whole_numbers() -> None:
    table = parse_table("a;b\n1;2\n1,5;-2,25\n", "t.csv")
    assert np.array_equal(table.numbers(["a", "b"]), [[1.0, 2.0], [1.5, -2.25]])


def test_delimiter_and_decimal_sign_can_be_given() -> None:
    table = parse_table("a,x|b,y\n1,5|2,5\n", "t.csv", delimiter="|", decimal=",")
    assert np.array_equal(table.numbers(["b,y", "a,x"]), [[2.5, 1.5]])


def test_byte_order_mark_and_empty_lines_do_not_matter() -> None:
    text = "\ufeff\n\n" + written().replace("\n", "\n\n  \n")
    table = parse_table(text, "t.csv")
    assert table.header == HEADER
    assert np.array_equal(table.numbers(HEADER), VALUES)


def test_quotes_and_blanks_around_cells_do_not_matter() -> None:
    table = parse_table('"alpha" , beta\n"1.5", 2 \n"3" ,"4"\n', "t.csv")
    assert np.array_equal(table.numbers(["beta", "alpha"])[1], [4.0, 3.0])


def test_columns_come_in_the_order_asked_for() -> None:
    table = parse_table(written(), "t.csv")
    assert np.array_equal(table.numbers(["gamma", "alpha"]), VALUES[:, [2, 0]])


def test_lines_are_counted_as_an_editor_counts_them() -> None:
    table = parse_table("\na\n\n1\n\nx\n", "t.csv")
    assert [table.place(row) for row in range(len(table))] == ["t.csv:4", "t.csv:6"]


@given(
    rows=st.lists(
        st.lists(st.floats(-1e9, 1e9, allow_subnormal=False), min_size=2, max_size=2),
        min_size=1,
        max_size=5,
    )
)
@examples(25)
def test_a_written_table_is_read_back_to_fifteen_digits(rows: list[list[float]]) -> None:
    text = format_table(["a", "b"], [[number(v) for v in row] for row in rows])
    assert np.allclose(parse_table(text, "t.csv").numbers(["a", "b"]), rows, rtol=1e-14, atol=0)


@given(
    cells=st.lists(
        st.text(
            st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Zl", "Zp"]),
            min_size=1,
            max_size=8,
        ).filter(str.strip),
        min_size=1,
        max_size=4,
    )
)
@examples(25)
def test_text_cells_survive_writing_and_reading(cells: list[str]) -> None:
    header = [f"c{i}" for i in range(len(cells))]
    table = parse_table(format_table(header, [cells]), "t.csv", delimiter=",")
    for found, cell in zip(table.rows[0], cells, strict=True):
        assert found == cell.strip() or (found == f"'{cell}".strip() and cell.strip()[0] in "=@+-")


@pytest.mark.parametrize(
    ("cell", "written"),
    [
        *((text, text) for text in ("-1", "+2.5e-3", "-1,5", "-.5", "-", "+", "a=b", "'=1", "x-y")),
        *((text, f"'{text}") for text in ("=1", " =1", "@A1", "-A1", "+1+2", "-1-1", "\t=1")),
    ],
)
def test_a_text_that_begins_a_formula_gets_an_apostrophe(cell: str, written: str) -> None:
    assert next(csv.reader([next(csv_lines([[cell]]))])) == [written]


def test_not_a_number_is_written_as_an_empty_cell() -> None:
    assert number(float("nan")) == ""


# --- what is wrong is named -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cell", "says"),
    [
        ("n/a", "holds 'n/a'"),
        ("", "is empty"),
        ("nan", "holds 'nan'"),
        ("NaN", "holds 'NaN'"),
        ("inf", "holds 'inf'"),
        ("-inf", "holds '-inf'"),
        ("1e999", "holds '1e999'"),
        ("1.2.3", "holds '1.2.3'"),
        ("0x10", "holds '0x10'"),
    ],
)
def test_a_bad_cell_is_named_by_line_and_column(cell: str, says: str) -> None:
    table = parse_table(f"alpha,beta\n1,2\n\n3,{cell}\n", "poses.csv")
    with pytest.raises(InputError) as error:
        table.numbers(["alpha", "beta"])
    assert str(error.value) == f"poses.csv:4: column 'beta' {says}; expected a number"


def test_a_bad_cell_in_a_table_with_decimal_commas_is_shown_as_it_is_written() -> None:
    table = parse_table("a;b\n1,5;2,5\n1,5;2,5x\n", "t.csv")
    with pytest.raises(InputError, match=r"t\.csv:3: column 'b' holds '2,5x'"):
        table.numbers(["a", "b"])


def test_a_bad_cell_in_a_column_that_is_not_used_does_not_matter() -> None:
    table = parse_table("a,note\n1,n/a\n", "t.csv")
    assert np.array_equal(table.numbers(["a"]), [[1.0]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"^t\.csv: empty"),
        ("\n \n\n", r"^t\.csv: empty"),
        ("\ufeff", r"^t\.csv: empty"),
        ("a,b\n", r"^t\.csv: a header but no rows"),
        ("a,b\n1,2\n1,2,3\n", r"^t\.csv:3: 3 cells, but the header has 2 columns"),
        ("a,b\n\n1\n", r"^t\.csv:3: 1 cells, but the header has 2 columns"),
        ("a b\n1 2 3\n", r"^t\.csv:2: 3 cells"),
        ("a,b,a\n1,2,3\n", r"^t\.csv:1: column 'a' appears more than once"),
        ("\n\na, b ,b\n1,2,3\n", r"^t\.csv:3: column 'b' appears more than once"),
    ],
)
def test_a_malformed_table_is_refused_with_its_place(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_table(text, "t.csv")


@pytest.mark.parametrize(
    "text",
    ['a,b\n1,2\n"3,4\n5",6\n', 'a,b\n1,"2\n3,4\n', "a,b\n" + "1" * 200_000 + ",2\n"],
    ids=["quoted line break", "open quote", "endless cell"],
)
def test_broken_quotes_are_bad_input_and_not_a_crash(text: str) -> None:
    with pytest.raises(InputError, match=r"^t\.csv"):
        parse_table(text, "t.csv").numbers(["a", "b"])


@given(text=st.text(alphabet="ab01.,;\t \"\n\r-e'", max_size=60))
@examples(150)
def test_any_text_is_a_table_or_bad_input(text: str) -> None:
    try:
        table = parse_table(text, "t.csv")
    except InputError as error:
        assert str(error).startswith("t.csv")  # noqa: PT017
    else:
        assert all(len(row) == len(table.header) for row in table.rows)
        assert len(table.lines) == len(table)


def test_a_missing_column_is_named_with_its_near_ones() -> None:
    with pytest.raises(InputError, match=r"^t\.csv: no column 'gama'; did you mean gamma"):
        parse_table(written(), "t.csv").numbers(["gama"])


# --- joints ---------------------------------------------------------------------------------------


def test_degrees_and_radians_are_the_same_joints() -> None:
    robot = load_robot("ur5")
    degrees = np.array([[10.0, -90.0, 45.0, 0.0, -120.0, 180.0]])
    in_degrees = joints_csv(",".join(map(str, degrees[0])))
    in_radians = joints_csv(
        ",".join(map(repr, np.deg2rad(degrees[0]).tolist())),
        header="j1_rad,j2_rad,j3_rad,j4_rad,j5_rad,j6_rad",
    )
    mixed = joints_csv(
        f"10,-90,{np.deg2rad(45.0)!r},0,-120,180".replace("np.float64(", "").replace(")", ""),
        header="j1_deg,j2_deg,j3_rad,j4_deg,j5_deg,j6_deg",
    )
    for text in (in_degrees, in_radians, mixed):
        found = joints_from_header(parse_table(text, "q.csv"), robot)
        assert found is not None
        assert np.allclose(found[0], np.deg2rad(degrees), atol=1e-15)


def test_joint_columns_may_stand_in_any_order_among_others() -> None:
    robot = load_robot("ur5")
    text = joints_csv(
        "6,a,1,5,2,4,b,3", header="j6_deg,note,j1_deg,j5_deg,j2_deg,j4_deg,more,j3_deg"
    )
    found = joints_from_header(parse_table(text, "q.csv"), robot)
    assert found is not None
    assert np.allclose(np.rad2deg(found[0]), [[1, 2, 3, 4, 5, 6]])
    assert found[1] == [f"j{i}_deg" for i in range(1, 7)]


@pytest.mark.parametrize(("unit", "written_value"), [("mm", "125"), ("m", "0.125")])
def test_prismatic_joints_are_read_in_millimetres_or_metres(unit: str, written_value: str) -> None:
    scara = load_robot("scara")
    text = joints_csv(f"10,20,{written_value},30", header=f"j1_deg,j2_deg,j3_{unit},j4_deg")
    found = joints_from_header(parse_table(text, "q.csv"), scara)
    assert found is not None
    assert np.allclose(found[0], [[np.deg2rad(10), np.deg2rad(20), 0.125, np.deg2rad(30)]])


def test_a_header_without_joints_has_none() -> None:
    assert joints_from_header(parse_table("x_mm,y_mm\n1,2\n", "q.csv"), load_robot("ur5")) is None


@pytest.mark.parametrize(
    ("name", "header", "message"),
    [
        ("ur5", "j1_deg,j2_deg,j3_deg,j4_deg,j5_deg", r"no column j6_deg; ur5 has 6 joints"),
        ("ur5", "j2_deg,j4_deg,j5_deg,j6_deg", r"no column j1_deg, j3_deg"),
        ("scara", "j1_deg,j2_deg,j4_deg", r"no column j3_mm"),
        (
            "ur5",
            "j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg,j7_deg",
            r"'j7_deg' names joint 7, but .* 6 joints",
        ),
        (
            "ur5",
            "j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg,j6_rad",
            r"joint 6 has two columns, 'j6_deg' and 'j6_rad'",
        ),
        (
            "ur5",
            "j1_mm,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg",
            r"'j1_mm': joint 1 is revolute; its unit is rad or deg",
        ),
        (
            "scara",
            "j1_deg,j2_deg,j3_deg,j4_deg",
            r"'j3_deg': joint 3 is prismatic; its unit is m or mm",
        ),
    ],
)
def test_joint_columns_that_do_not_fit_the_robot_are_refused(
    name: str, header: str, message: str
) -> None:
    table = parse_table(
        joints_csv(",".join("0" for _ in header.split(",")), header=header), "q.csv"
    )
    with pytest.raises(InputError, match=message):
        joints_from_header(table, load_robot(name))


def test_a_wrong_joint_column_is_placed_at_the_line_of_the_header() -> None:
    table = parse_table("\n\nj1_deg,j9_deg\n1,2\n", "q.csv")
    with pytest.raises(InputError, match=r"^q\.csv:3: 'j9_deg'"):
        joints_from_header(table, load_robot("ur5"))


def test_degrees_in_a_radian_column_are_noticed() -> None:
    header = "j1_rad,j2_rad,j3_rad,j4_rad,j5_rad,j6_rad"
    table = parse_table(joints_csv("0,0,0,0,0,0", "0,0,-90,0,0,0", header=header), "q.csv")
    with pytest.raises(
        InputError, match=r"^q\.csv:3: column 'j3_rad' holds -90 rad, which looks like degrees"
    ):
        joints_from_header(table, load_robot("ur5"))


def test_a_bad_joint_cell_is_named() -> None:
    table = parse_table(joints_csv("0,0,0,0,0,0", "0,0,n/a,0,0,0"), "poses.csv")
    with pytest.raises(InputError) as error:
        joints_from_header(table, load_robot("ur5"))
    assert str(error.value) == "poses.csv:3: column 'j3_deg' holds 'n/a'; expected a number"


# --- poses ----------------------------------------------------------------------------------------


@given(seed=st.integers(0, 10_000))
@examples(20)
def test_the_three_ways_to_write_an_orientation_give_the_same_pose(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(rng=rng)
    x, y, z = rng.uniform(-2000, 2000, 3).round(3)
    w = rotation.as_quat(scalar_first=True)
    a, b, c = rotation.as_rotvec()
    yaw, pitch, roll = rotation.as_euler(
        "ZYX", degrees=True
    )  # fixed x, y, z is moving z, y, x backwards
    tables = [
        f"x_mm,y_mm,z_mm,qw,qx,qy,qz\n{x},{y},{z}," + ",".join(f"{v:.17g}" for v in w),
        f"x_mm,y_mm,z_mm,qw,qx,qy,qz\n{x},{y},{z}," + ",".join(f"{-v:.17g}" for v in w),
        "rx_rad,ry_rad,rz_rad,x_m,y_m,z_m\n"
        f"{a:.17g},{b:.17g},{c:.17g},{x / 1e3!r},{y / 1e3!r},{z / 1e3!r}".replace(
            "np.float64(", ""
        ).replace(")", ""),
        "x_mm,y_mm,z_mm,roll_deg,pitch_deg,yaw_deg\n"
        f"{x},{y},{z},{roll:.17g},{pitch:.17g},{yaw:.17g}",
    ]
    for text in tables:
        found = poses_from_header(parse_table(text, "p.csv"))
        assert found is not None
        T = found[0][0]
        assert np.allclose(T[:3, 3] * 1e3, [x, y, z], atol=1e-9)
        assert np.abs(T[:3, :3] - rotation.as_matrix()).max() < 1e-9
        assert np.array_equal(T[3], [0, 0, 0, 1])


def test_roll_pitch_yaw_turn_about_fixed_axes_in_this_order() -> None:
    # Tool x along base x; roll by 90° about x takes y to z; then yaw by 90° about the fixed z takes
    # x to y, z stays.
    found = poses_from_header(
        parse_table("x_mm,y_mm,z_mm,roll_deg,pitch_deg,yaw_deg\n0,0,0,90,0,90\n", "p.csv")
    )
    assert found is not None
    R = found[0][0, :3, :3]
    assert np.allclose(R @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    assert np.allclose(R @ [0, 1, 0], [0, 0, 1], atol=1e-12)


def test_a_position_without_an_orientation_is_no_pose() -> None:
    assert poses_from_header(parse_table("x_mm,y_mm,z_mm\n1,2,3\n", "p.csv")) is None
    assert poses_from_header(parse_table("x_mm,y_mm,qw,qx,qy,qz\n1,2,1,0,0,0\n", "p.csv")) is None


@pytest.mark.parametrize("quaternion", ["0.9,0,0,0", "0,0,0,0", "1,0,0,1", "2,0,0,0"])
def test_a_quaternion_that_is_no_rotation_is_refused_by_line(quaternion: str) -> None:
    text = f"x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,0,0,1,0,0,0\n0,0,0,{quaternion}\n"
    with pytest.raises(InputError, match=r"^p\.csv:3: quaternion of length .*; expected 1"):
        poses_from_header(parse_table(text, "p.csv"))


def test_two_orientations_in_one_table_are_refused() -> None:
    header = "x_mm,y_mm,z_mm,qw,qx,qy,qz,rx_rad,ry_rad,rz_rad"
    with pytest.raises(InputError, match=r"p\.csv: two orientations"):
        poses_from_header(parse_table(header + "\n0,0,0,1,0,0,0,0,0,0\n", "p.csv"))


# --- long tables ----------------------------------------------------------------------------------


@pytest.fixture
def blocks_of_three(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calibtool.tables._BLOCK", 3)


@pytest.mark.usefixtures("blocks_of_three")
@pytest.mark.parametrize(
    ("delimiter", "decimal"), [(",", "."), (";", ","), ("\t", "."), (" ", ".")]
)
def test_a_table_in_blocks_holds_every_number_once(delimiter: str, decimal: str) -> None:
    values = np.random.default_rng(0).normal(size=(11, 3))
    lines = [delimiter.join(f"{v!r}".replace(".", decimal) for v in row) for row in values.tolist()]
    table = parse_table("\n".join([delimiter.join("abc"), *lines]), "t.csv")
    assert np.array_equal(table.numbers(["c", "a"]), values[:, [2, 0]])


@pytest.mark.usefixtures("blocks_of_three")
def test_bad_and_empty_cells_of_a_later_block_are_named_by_their_own_line() -> None:
    rows = [f"{k},{k},note" for k in range(10)]
    rows[7] = ",,note"
    table = parse_table("\n".join(["a,b,c", *rows]), "t.csv")
    expected = np.repeat(np.arange(10.0)[:, None], 2, axis=1)
    expected[7] = np.nan
    assert np.array_equal(table.optional_numbers(["a", "b"]), expected, equal_nan=True)
    with pytest.raises(InputError, match=r"^t\.csv:9: column 'a' is empty"):
        table.numbers(["a"])
    rows[8] = "8,,note"
    with pytest.raises(InputError, match=r"^t\.csv:10: column 'b' is empty"):
        parse_table("\n".join(["a,b,c", *rows]), "t.csv").optional_numbers(["a", "b"])


def test_chosen_rows_keep_the_lines_they_come_from() -> None:
    table = parse_table("a,b\n1,x\n\n2,y\n3,z\n", "t.csv").take([2, 0])
    assert (table.texts("b"), table.lines) == (["z", "x"], [5, 2])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1.5,2.25,3\n4,5,6\n", "p.csv:1: the first line holds numbers"),
        ("\n-12.25;3,5;100\n1;2;3\n", "p.csv:2: the first line holds numbers"),
        ("<robot name='a'>\n</robot>\n", "p.csv:1: an XML file"),
        ('<?xml version="1.0"?>\n<a/>\n', "p.csv:1: an XML file"),
    ],
)
def test_what_is_no_header_is_told(text: str, told: str) -> None:
    with pytest.raises(InputError) as error:
        parse_table(text, "p.csv")
    assert str(error.value).startswith(told)


def test_columns_may_be_called_by_numbers() -> None:
    assert parse_table("1,2,3\n4,5,6\n", "p.csv").header == ["1", "2", "3"]


# --- decimal commas in quotes, and what is no number ---


@pytest.mark.parametrize("header", ["a,b,c", '"a","b","c"'])
def test_decimal_commas_in_quotes_are_those_of_semicolons(header: str) -> None:
    """As spreadsheets with decimal commas write them between commas, whole numbers without."""
    values = np.array([[12.5, -0.125, 3.0], [1234.75, 2e-3, -4.0]])
    cells = [[f"{value:g}".replace(".", ",") for value in row] for row in values]
    quoted = [[f'"{cell}"' if "," in cell else cell for cell in row] for row in cells]
    semicolons = parse_table("\n".join(["a;b;c", *map(";".join, cells)]), "t")
    commas = parse_table("\n".join([header, *map(",".join, quoted)]), "t")
    for columns in (["a", "b", "c"], ["a"], ["c", "b"]):
        np.testing.assert_array_equal(commas.numbers(columns), semicolons.numbers(columns))
    np.testing.assert_array_equal(commas.numbers(["a", "b", "c"]), values)


@pytest.mark.parametrize("cells", ['"1,234","5,678"', '"1,234",5.5', '"12,5",0.25', '"-3,883.5",1'])
def test_quoted_thousands_are_no_decimals(cells: str) -> None:
    """All of them may be thousands, or there are decimal points as well."""
    with pytest.raises(InputError, match=r"t:2: column 'a' .* thousands"):
        parse_table(f"a,b\n{cells}\n", "t").numbers(["a", "b"])


def test_a_stated_decimal_comma_does_not_join_cells() -> None:
    table = parse_table('a,b\n1,2\n"1,5",3\n', "t", decimal=",")
    np.testing.assert_array_equal(table.numbers(["a"]), [[1.0], [1.5]])
    np.testing.assert_array_equal(table.numbers(["a", "b"]), [[1.0, 2.0], [1.5, 3.0]])


@pytest.mark.parametrize(
    ("cell", "remedy"),
    [
        ("n/a", "leave all of a, b empty$"),
        ("NaN", "leave all of a, b empty$"),
        ("", "leave all of a, b empty$"),
        ("12.5 mm", "write the unit into the header$"),
        ("12,5°", "write the unit into the header$"),
        ("1'234.5", "without separators of thousands$"),
        ("1 234,5", "without separators of thousands$"),
        ("wrong", "expected a number$"),
    ],
)
def test_a_cell_that_is_no_number_comes_with_a_remedy(cell: str, remedy: str) -> None:
    table = parse_table(f"a;b\n1;2\n{cell};2\n", "t")
    with pytest.raises(InputError, match=f"t:3: column 'a' .*{remedy}"):
        table.optional_numbers(["a", "b"])
