"""Text and workbooks of an attacker: no other file is read, no nesting, no number and no name
brings a reader down.
"""

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from program_reading import reader
from readers import READERS, arm, journals, six, studied, study, workbooks

from calibtool.compensation.stream import StreamOptions, StreamReport, compensate_stream
from calibtool.errors import CalibtoolError, InputError, UsageError
from calibtool.evaluation.study import parse_definition
from calibtool.evaluation.study.journal import Journal
from calibtool.evaluation.study.study_table import parse_csv
from calibtool.measurement.importing import parse_column_map
from calibtool.measurement.importing.excel import parse_workbook
from calibtool.programs.frames import read_frames
from calibtool.robot.catalogue import load_robot
from calibtool.robot.robot import Robot
from calibtool.robot.source import parse_source, read_source, source_from_urdf
from calibtool.robot.tree import urdf_tree

URDF, TOML = arm().source.urdf_text, arm().source.toml_text


# --- TOML and JSON --------------------------------------------------------------------------------

TOML_READERS: list[Callable[[str], object]] = [
    lambda text: parse_source(text, URDF, "x.toml"),
    lambda text: parse_column_map(text, "x.toml"),
    lambda text: read_frames(text, "x.toml"),
]


@pytest.mark.parametrize("read", TOML_READERS, ids=["robot", "columns", "frames"])
@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 5000,
        "a = " + "{b=" * 5000,
        "a = " + "9" * 5000,
        "a." * 30_000 + "b = 1",
        "a = 1e999",
        "a = 0x",
    ],
    ids=["lists", "tables", "digits", "dots", "infinite", "syntax"],
)
def test_toml_that_python_cannot_follow(read: Callable[[str], object], text: str) -> None:
    with pytest.raises(InputError, match=r"^x\.toml: "):
        read(text)


@pytest.mark.parametrize(
    "value",
    [
        "[" * 100_000,
        '{"a":' * 100_000,
        "9" * 5000,
        "1e999",
        "NaN",
        "-Infinity",
        "[1]",
        "true",
        "1e300",
    ],
)
def test_json_values_that_are_no_number(value: str) -> None:
    from readers import calibrations

    rows = [f'{{"j1_deg": {value}, "j2_deg": 0, "j3_deg": 0}}']
    with pytest.raises(InputError, match=r"^x:1: "):
        list(
            compensate_stream(
                calibrations()[0], rows, "x", StreamOptions(), StreamReport(), "ndjson"
            )
        )


# --- robots ---------------------------------------------------------------------------------------


def folder_with(tmp_path: Path, urdf: str) -> Path:
    folder = tmp_path / "robot"
    folder.mkdir()
    (folder / "robot.toml").write_text(TOML.replace('"robot.urdf"', repr(urdf)), encoding="utf-8")
    (tmp_path / "outside.urdf").write_text(URDF, encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    "urdf", ["../outside.urdf", "/etc/passwd", "a/../../outside.urdf", "/dev/zero", ".."]
)
def test_a_description_reads_nothing_outside_of_its_folder(tmp_path: Path, urdf: str) -> None:
    with pytest.raises(
        InputError, match=r"robot\.toml: kinematics\.urdf: .* is outside of .*; copy the file there"
    ):
        read_source(folder_with(tmp_path, urdf))


def test_example_robot_data_is_not_left_either(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, "robot.urdf")
    text = TOML.replace(
        'urdf = "robot.urdf"', 'example_robot_data = "../../../../../../etc/passwd"'
    )
    (folder / "robot.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="is outside of"):
        read_source(folder)


def test_links_are_followed_inside_of_the_folder_only(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, "link.urdf")
    (folder / "link.urdf").symlink_to(tmp_path / "outside.urdf")
    with pytest.raises(InputError, match="is outside of"):
        read_source(folder)
    (folder / "link.urdf").unlink()
    (folder / "link.urdf").symlink_to(folder / "link.urdf")
    with pytest.raises(InputError):
        read_source(folder)
    (folder / "link.urdf").unlink()
    (folder / "real.urdf").write_text(URDF, encoding="utf-8")
    (folder / "link.urdf").symlink_to("real.urdf")
    assert Robot.from_source(read_source(folder)).n == 3


def test_a_folder_that_is_itself_a_link(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, "robot.urdf")
    (folder / "robot.urdf").write_text(URDF, encoding="utf-8")
    (tmp_path / "arm").symlink_to(folder)
    assert load_robot(str(tmp_path / "arm")).n == 3


@pytest.mark.parametrize(
    "head",
    [
        '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE robot SYSTEM "file:///etc/passwd">',
        "<!DOCTYPE robot ["
        + '<!ENTITY a0 "ha">'
        + "".join(f'<!ENTITY a{k + 1} "&a{k};&a{k};">' for k in range(40))
        + "]>",
        '<!doctype robot [<!entity % p SYSTEM "http://127.0.0.1:9/"> %p;]>',
    ],
    ids=["external entity", "external DTD", "billion laughs", "parameter entity"],
)
def test_document_types_and_entities_are_refused(head: str) -> None:
    with pytest.raises(InputError, match=r"the URDF holds a document type or entities"):
        source_from_urdf(URDF.replace("<robot", head + "<robot", 1), "x.urdf")


@pytest.mark.parametrize(
    "mesh", ["package://../../etc/passwd", "/dev/zero", "file:///etc/passwd", "../../../x.stl"]
)
def test_meshes_are_not_looked_at(mesh: str) -> None:
    visual = f'<visual><geometry><mesh filename="{mesh}"/></geometry></visual>'
    text = URDF.replace('<link name="link_1"/>', f'<link name="link_1">{visual}</link>')
    assert visual in text
    robot = Robot.from_source(source_from_urdf(text, "x"))
    assert np.array_equal(robot.chain.placements, arm().chain.placements)


@pytest.mark.parametrize("value", ["nan", "inf", "1e999", "-1e308"])
@pytest.mark.parametrize(
    "attribute", ['xyz="0.5 0 0"', 'rpy="0 0 0"', 'axis xyz="0 0 1"', 'upper="2.96705972839"']
)
def test_numbers_of_a_urdf_are_finite(attribute: str, value: str) -> None:
    name, _, old = attribute.partition('="')
    text = URDF.replace(
        attribute, f'{name}="{old.replace(old.split()[0], value, 1)}' + ("" if " " in old else '"')
    )
    try:
        robot = Robot.from_source(source_from_urdf(text, "x"))
    except InputError:
        return
    assert np.isfinite(robot.chain.placements).all()
    assert np.isfinite(robot.lower).all()
    assert np.isfinite(robot.upper).all()


# --- workbooks ------------------------------------------------------------------------------------


def with_sheet(xml: str, **extra: bytes) -> bytes:
    archive = zipfile.ZipFile(io.BytesIO(workbooks()[0]))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        for name in archive.namelist():
            new.writestr(name, xml if name.endswith("sheet1.xml") else archive.read(name))
        for name, data in extra.items():
            new.writestr(name, data)
    return out.getvalue()


SHEET = (
    '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">'
    "<sheetData>{}</sheetData></worksheet>"
)


def test_a_zip_bomb() -> None:
    data = with_sheet(SHEET.format(""), bomb=bytes(40 << 20))
    assert len(data) < 100_000
    with pytest.raises(InputError, match=r"^w\.xlsx: a workbook of \d+ bytes that unpacks to \d+"):
        parse_workbook(data, "w.xlsx")


def test_a_row_at_the_end_of_the_world() -> None:
    row = '<row r="{}"><c r="A1"><v>1</v></c></row>'
    with pytest.raises(InputError, match="a row beyond 1048576"):
        parse_workbook(with_sheet(SHEET.format(row.format(1) + row.format(10**15))), "w.xlsx")


def test_entities_of_a_workbook() -> None:
    laughs = '<!ENTITY a0 "ha">' + "".join(f'<!ENTITY a{k + 1} "&a{k};&a{k};">' for k in range(40))
    cell = '<row r="1"><c t="str"><v>&{};</v></c></row>'
    for head, name in ((laughs, "a40"), ('<!ENTITY f SYSTEM "file:///etc/passwd">', "f")):
        text = f"<!DOCTYPE x [{head}]>" + SHEET.format(cell.format(name))
        with pytest.raises(InputError, match=r"^w\.xlsx"):
            parse_workbook(with_sheet(text), "w.xlsx")


def test_openpyxl_does_not_write_to_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    archive = zipfile.ZipFile(io.BytesIO(workbooks()[0]))
    styles = archive.read("xl/styles.xml")
    first, last = styles.index(b"<cellStyleXfs"), styles.index(b"</cellStyleXfs>")
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as new:
        for name in archive.namelist():
            lost = styles[:first] + b"<cellStyleXfs>" + styles[last:]
            new.writestr(name, lost if name == "xl/styles.xml" else archive.read(name))
    with pytest.raises(InputError, match="not a readable Excel workbook"):
        parse_workbook(out.getvalue(), "w.xlsx")
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("data", [b"PK\x03\x04", b"PK\x05\x06" + bytes(18), workbooks()[0][:-30]])
def test_what_is_no_workbook(data: bytes) -> None:
    with pytest.raises(InputError, match=r"^w\.xlsx: not a readable Excel workbook: "):
        parse_workbook(data, "w.xlsx")


# --- tables and programs --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("csv", b"j" + b"9" * 5000 + b"_deg,j1_deg\n1,2\n"),
        ("csv", b"j1_deg,j2_deg,j3_deg\n1e308,1,1\n"),
        ("csv", b"x_mm,y_mm,z_mm,qw,qx,qy,qz\n1,1,1,1e300,1,1,1\n"),
        ("csv", b",".join(b"c%d" % k for k in range(50_000)) + b"\n"),
        ("import", b"j1_deg,j2_deg,j3_deg,t" + b"1" * 5000 + b"_x_mm\n1,2,3,4\n"),
        ("import", b'j1_deg,j2_deg,j3_deg,x_mm,y_mm,z_mm\n1,2,3,4,5,"' + b"6" * 140_000 + b'"\n'),
        ("spatial-analyzer", b"A,B," + b"p" * 140_000 + b",1,2,3\n"),
        ("spatial-analyzer", b"A,B,p_" + b"1" * 5000 + b",1,2,3\n"),
        ("spatial-analyzer", b"A,B,T1,1e300,2,3\nA,B,T2,-1e300,2,3\n"),
        ("column-map", b"[[targets]]\nmeasured=['x','y','z']\nunit='mm'\non_tool_mm=[1e300,0,0]\n"),
    ],
)
def test_tables_with_endless_names_and_numbers(name: str, data: bytes) -> None:
    with pytest.raises(CalibtoolError):
        READERS[name].read(data)


@pytest.mark.parametrize(
    "name", ["fanuc-ls", "kuka-krl", "abb-rapid", "ur-script", "ros2-trajectory"]
)
@pytest.mark.parametrize(
    "word",
    ["[", "{", "(", "a", "END", "P[1]{", "/POS\n", "robtarget a := [", "robtarget a {", "MoveL ",
        "movej(", "E6POS A={",
     "LIN {X 1,", "positions: [", "joint_names:\n- ", "- ", " ", "\n", "'", '"', "#", "a=[", "GP1:",
     "Offs(", "//"],
)  # fmt: skip
def test_a_word_again_and_again(name: str, word: str) -> None:
    # The time grows with the length, not with its square: 100,000 characters would take
    # minutes otherwise.
    program = reader(name)(word * (100_000 // len(word)), six())
    assert all(literal.not_corrected for literal in program.literals)


def test_a_program_of_numbers_without_end() -> None:
    for value in ("1e999", "9" * 400, "1e308"):
        program = reader("ur-script")(f"movej([{value}, 0, 0, 0, 0, 0])", six())
        assert [bool(literal.not_corrected) for literal in program.literals] == [True]
    program = reader("ros2-trajectory")("points:\n- positions: [1, 2, 3, 4, 5, 6]\n", six())
    assert [literal.bad for literal in program.literals] == [True]


@pytest.mark.parametrize(
    "word", ["robtarget a", "robtarget a{1}", "MoveL a", "CONST jointtarget b :="]
)
@pytest.mark.parametrize("blank", [" ", "\n", "x"])
def test_a_name_and_endless_blanks(word: str, blank: str) -> None:
    """The time grows with the length here too."""
    assert reader("abb-rapid")(word + blank * 100_000 + ";", six()).literals == ()


def test_instructions_that_are_never_ended() -> None:
    """Each of them would reach to the semicolon at the end."""
    program = reader("abb-rapid")("MoveL p,\n" * 10_000 + ";", six())
    assert len(program.remarks) == 9_999
    assert {remark.why for remark in program.remarks} == {"no ; at its end"}


# --- studies --------------------------------------------------------------------------------------

TABLE = studied().as_csv()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0.125", "1e999"),
        ("0.125", "0.1_2"),
        ("0.125", "٣"),
        (",2,", f",{2**63},"),
        (",2,", "," + "9" * 5000 + ","),
    ],
    ids=["infinite", "underscore", "another script", "64 bits", "5000 digits"],
)
def test_cells_of_a_study_that_are_no_number(old: str, new: str) -> None:
    assert old in TABLE
    with pytest.raises(InputError, match=r"^s\.csv:\d+: a cell is not the number"):
        parse_csv(TABLE.replace(old, new, 1), "s.csv")


def test_a_cell_of_a_study_without_end() -> None:
    with pytest.raises(InputError, match=r"^s\.csv:\d+: "):
        parse_csv(TABLE.replace("planar-3r", "x" * 140_000), "s.csv")


@pytest.mark.parametrize(
    "text", ["runs = [" + "[" * 5000, "runs = " + "9" * 5000, "a." * 30_000 + "b = 1"]
)
def test_definitions_that_python_cannot_follow(text: str) -> None:
    with pytest.raises(InputError, match=r"^s\.toml: "):
        parse_definition(text, "s.toml")


@pytest.mark.parametrize(
    "line",
    [
        '{"run": 1e999, "rows": []}',
        '{"run": 3, "rows": []}',
        '{"run": 0, "rows": [["a"]]}',
        "[" * 100_000,
        '{"run": true}',
    ],
    ids=["infinite", "beyond the study", "another table", "nesting", "no number"],
)
def test_lines_of_a_journal_that_are_no_run(tmp_path: Path, line: str) -> None:
    path = tmp_path / "s.csv.journal"
    path.write_text(journals()[0].decode().splitlines()[0] + "\n" + line + "\n", encoding="utf-8")
    with pytest.raises(UsageError, match=r"journal:2: damaged"):
        Journal(path, study())


# --- trees that no robot is -----------------------------------------------------------------------


def chain_of(count: int, start: str = "l0") -> str:
    """A URDF of `count` joints in a row."""
    parts = ["<link name='l0'/>"]
    for k in range(1, count + 1):
        parts.append(
            f"<link name='l{k}'/><joint name='j{k}' type='continuous'><parent link='l{k - 1}'/>"
            f"<child link='l{k}'/><axis xyz='0 0 1'/></joint>"
        )
    return f"<robot name='r'>{''.join(parts)}</robot>"


def star_of(count: int) -> str:
    links = "".join(f"<link name='l{k}'/>" for k in range(count + 1))
    joints = "".join(
        f"<joint name='j{k}' type='fixed'><parent link='l0'/><child link='l{k}'/></joint>"
        for k in range(1, count + 1)
    )
    return f"<robot name='r'>{links}{joints}</robot>"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (chain_of(501), "500 joints in a row"),
        (chain_of(10_000), "2000 links"),
        (star_of(2000), "2000 links"),
        ("<robot name='r'>" + "<link name='a'/>" * 2001 + "</robot>", "2000 links"),
    ],
)
def test_urdfs_with_more_links_than_any_robot(text: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        source_from_urdf(text, "robot.urdf")


def test_a_long_urdf_that_a_robot_may_be() -> None:
    assert Robot.from_source(source_from_urdf(chain_of(500), "r")).n == 500
    assert len(urdf_tree(star_of(1999), "r").links) == 2000


def test_links_in_a_circle() -> None:
    joints = "".join(
        f"<joint name='j{a}' type='fixed'><parent link='{a}'/><child link='{b}'/></joint>"
        for a, b in ("ab", "bc", "ca")
    )
    links = "".join(f"<link name='{name}'/>" for name in "abcd")
    with pytest.raises(InputError):
        source_from_urdf(f"<robot name='r'>{links}{joints}</robot>", "r")


@pytest.mark.parametrize("word", ["a", "actual", "j1", "joint 1", "1"])
@pytest.mark.parametrize("sign", [".", " ", "_"])
def test_a_column_of_endless_words(word: str, sign: str) -> None:
    """Found by the fuzzer: the time grew with the square of their number."""
    name = sign.join([word] * (60_000 // len(word)))
    with pytest.raises(CalibtoolError):
        READERS["import"].read(f"j1_rad,j2_rad,{name}\n1,2,3\n".encode())


@pytest.mark.parametrize("text", ["a=", "a = ", "def p():\n a =", "global a=\n", "a = [", "a[0]="])
def test_a_program_that_ends_in_an_assignment(text: str) -> None:
    """Found by the fuzzer: URScript that was cut off behind `=`."""
    assert reader("ur-script")(text, six()).literals == ()
