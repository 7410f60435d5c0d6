"""Bad input: one line on stderr with place and remedy, the documented exit code, and no file
left half written.

`refused` checks all of this: exit code, one line, no traceback, empty stdout, and the folder
as it was before.
"""

import io
import re
from pathlib import Path
from shutil import copytree

import h5py
import numpy as np
import pytest
from commandline import Files, measured_table, only_line, refused, run, write_table

from calibtool.robot.catalogue import shipped

PLANAR = ["j1_deg", "j2_deg", "j3_deg"]
POINTS = [f"t{i}_{axis}_mm" for i in (1, 2, 3) for axis in "xyz"]


# --- what a file says -----------------------------------------------------------------------------


def test_words_of_a_file_neither_break_the_line_nor_move_the_cursor(files: Files) -> None:
    words = "a\x85b\u2028c\x1b[2J\u202e"
    line = refused(
        3, "compensate", files.local_poe, "-", stdin=f"{','.join(PLANAR)}\n1,2,{words}\n"
    )
    assert r"holds 'a\x85b\u2028c\x1b[2J\u202e'" in line
    assert r"no\x1b[2Jsuch.h5" in refused(2, "info", "no\x1b[2Jsuch.h5")


def test_names_of_files_are_shown_as_they_are(files: Files) -> None:
    copy = Path("c[bold]\x1b[31m.h5")
    copy.write_bytes(Path(files.local_poe).read_bytes())
    assert r"c[bold]\x1b[31m" in run("evaluate", str(copy), "--on", files.measurements).stderr


# --- names ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "near"),
    [
        (["train", "{m}", "--loss", "tsk"], "task"),
        (["train", "{m}", "--loss", "xyz"], "joint"),
        (["train", "{m}", "--optimizer", "ml"], "lm"),
        (["train", "{m}", "--base", "local-po"], "local-poe"),
        (["train", "{m}", "--base", "nominl"], "nominal"),
        (["identify", "{m}", "--model", "local"], "local-poe"),
        (["compensate", "{c}", "{m}", "--method", "exct"], "exact"),
        (["evaluate", "{c}", "--on", "{m}", "--method", "onestep"], "one-step"),
        (["plot", "errors", "{c}", "--on", "{m}", "-o", "a.svg", "--method", "one"], "one-step"),
        (["plot", "eror", "{c}", "-o", "a.svg"], "errors"),
        (["simulate", "planar-3r", "--errors", "gera"], "gear"),
        (["simulate", "planar-3r", "--workspace", "bnch"], "bench"),
        (["simulate", "fanuc-m1000"], "fanuc-m1000ia"),
        (["export", "{c}", "--format", "jsn"], "json"),
        (["import", "{m}", "--robot", "planar-3r", "--frame", "bas"], "base"),
        (["simulat", "planar-3r"], "simulate"),
        (["compensate", "{c}", "--metod", "exact"], "--method"),
    ],
)
def test_a_wrong_name_lists_the_near_ones(files: Files, arguments: list[str], near: str) -> None:
    given = [a.format(m=files.measurements, c=files.network) for a in arguments]
    message = refused(2, *given)
    assert any(word in message for word in given)
    assert re.search(rf"(?<![\w-]){re.escape(near)}(?![\w-])", message)


@pytest.mark.parametrize(
    "arguments",
    [
        ["bogus"],
        ["--bogus"],
        ["simulate"],
        ["simulate", "planar-3r", "extra"],
        ["simulate", "planar-3r", "--nope"],
        ["simulate", "planar-3r", "-n"],
        ["simulate", "planar-3r", "-n", "x"],
        ["simulate", "planar-3r", "-n", "1.5"],
        ["simulate", "planar-3r", "-n", "-4"],
        ["simulate", "planar-3r", "--seed", "abc"],
        ["simulate", "planar-3r", "--noise-mm", "0,05"],
        ["import", "t.csv"],
        ["identify"],
        ["evaluate", "c.h5"],
        ["evaluate", "--on", "m.h5"],
        ["compensate"],
        ["export", "c.h5"],
        ["plot", "training", "c.h5"],
        ["plot", "training", "-o", "a.svg"],
        ["info"],
        ["info", "a.h5", "b.h5"],
    ],
)
def test_wrong_usage(arguments: list[str]) -> None:
    refused(2, *arguments)


# --- files that are not there, and streams --------------------------------------------------------

READERS = {
    "identify": ["identify", "{x}"],
    "train": ["train", "{x}"],
    "train --base": ["train", "{m}", "--base", "{x}"],
    "evaluate": ["evaluate", "{x}", "--on", "{m}"],
    "evaluate --on": ["evaluate", "{c}", "--on", "{x}"],
    "compensate": ["compensate", "{x}", "targets.csv"],
    "export": ["export", "{x}", "--format", "json"],
    "plot": ["plot", "training", "{x}", "-o", "a.svg"],
    "plot --on": ["plot", "errors", "{c}", "--on", "{x}", "-o", "a.svg"],
    "info": ["info", "{x}"],
    "simulate --same-robot": ["simulate", "planar-3r", "--same-robot", "{x}"],
}
TABLE_READERS = {
    "compensate targets": ["compensate", "{c}", "{x}"],
    "import": ["import", "{x}", "--robot", "planar-3r"],
    "import --columns": ["import", "targets.csv", "--robot", "planar-3r", "--columns", "{x}"],
    "simulate --at": ["simulate", "planar-3r", "--at", "{x}"],
}
binary_reader = pytest.mark.parametrize("reader", READERS)
any_reader = pytest.mark.parametrize("reader", [*READERS, *TABLE_READERS])


def given(reader: str, path: str, files: Files) -> list[str]:
    """The arguments of a reader with `path` in the place that is tested."""
    write_table("targets.csv", PLANAR, [[10, 20, 30]])
    forms = {**READERS, **TABLE_READERS}[reader]
    return [form.format(x=path, m=files.measurements, c=files.network) for form in forms]


@any_reader
def test_a_file_that_does_not_exist(files: Files, reader: str) -> None:
    assert refused(2, *given(reader, "missing.h5", files)).startswith("missing.h5: no such file")


@any_reader
def test_a_folder_in_place_of_a_file(files: Files, reader: str) -> None:
    Path("folder.h5").mkdir()
    # A folder of programs needs another one for its results, a folder of images its joints.
    code = 2 if reader in ("compensate targets", "import") else 3
    assert refused(code, *given(reader, "folder.h5", files)).startswith("folder.h5: ")


@any_reader
def test_an_empty_file(files: Files, reader: str) -> None:
    Path("empty.h5").write_bytes(b"")
    assert refused(3, *given(reader, "empty.h5", files)).startswith("empty.h5: ")


@any_reader
def test_an_empty_stdin(files: Files, reader: str) -> None:
    assert refused(3, *given(reader, "-", files)).startswith("stdin: ")


@any_reader
def test_random_bytes(files: Files, reader: str) -> None:
    Path("noise.h5").write_bytes(np.random.default_rng(0).bytes(5000))
    assert refused(3, *given(reader, "noise.h5", files)).startswith("noise.h5: ")


@pytest.mark.parametrize(
    "arguments",
    [
        ["train", "-", "--base", "-"],
        ["evaluate", "-", "-", "--on", "m.h5"],
        ["evaluate", "-", "--on", "-"],
        ["compensate", "-"],
        ["compensate", "-", "-"],
        ["import", "-", "--columns", "-", "--robot", "planar-3r"],
        ["simulate", "planar-3r", "--same-robot", "-", "--at", "-"],
        ["plot", "errors", "-", "--on", "-", "-o", "a.svg"],
    ],
)
def test_stdin_cannot_be_read_twice(arguments: list[str]) -> None:
    assert "'-'" in refused(2, *arguments)


# --- HDF5 files -----------------------------------------------------------------------------------


@binary_reader
def test_a_file_of_the_other_kind(files: Files, reader: str) -> None:
    """Measurements where a calibration is expected, and the reverse."""
    if reader == "info":
        pytest.skip("info takes both")
    takes_measurements = reader in (
        "identify",
        "train",
        "simulate --same-robot",
    ) or reader.endswith("--on")
    wrong, expected = files.network, "measurements"
    if not takes_measurements:
        wrong, expected = files.measurements, "a calibration"
    message = refused(3, *given(reader, wrong, files))
    assert message.startswith(f"{wrong}: ")
    assert message.endswith(f"expected {expected}")


@binary_reader
def test_a_foreign_hdf5_file(files: Files, reader: str) -> None:
    with h5py.File("foreign.h5", "w") as file:
        file["temperature"] = [1.0, 2.0]
        file.attrs["schema"] = "somebody/else"
    message = refused(3, *given(reader, "foreign.h5", files))
    assert message.startswith("foreign.h5: ")
    assert "calibtool" in message


@binary_reader
def test_a_table_in_place_of_a_file(files: Files, reader: str) -> None:
    write_table("table.csv", PLANAR, [[1, 2, 3]])
    assert refused(3, *given(reader, "table.csv", files)).startswith("table.csv: ")


@pytest.mark.parametrize("name", ["measurements", "network"])
@pytest.mark.parametrize("part", [0.001, 0.1, 0.3, 0.5, 0.9, 0.999])
def test_a_truncated_file(files: Files, name: str, part: float) -> None:
    data = Path(getattr(files, name)).read_bytes()
    Path("cut.h5").write_bytes(data[: int(len(data) * part)])
    message = refused(3, "info", "cut.h5")
    assert message.startswith("cut.h5: ")
    assert refused(3, "info", "-", stdin=data[: int(len(data) * part)]) == message.replace(
        "cut.h5", "stdin", 1
    )


@pytest.mark.parametrize("name", ["measurements", "network"])
def test_a_newer_format(files: Files, name: str) -> None:
    Path("new.h5").write_bytes(Path(getattr(files, name)).read_bytes()[:-82])  # without the digest
    with h5py.File("new.h5", "r+") as file:
        file.attrs["schema_version"] = 99
    message = refused(3, "info", "new.h5")
    assert message.startswith("new.h5: ")
    assert "99" in message
    assert "newer" in message


def edited(files: Files, name: str, path: str, value: object) -> str:
    """A copy of a file in which one dataset is replaced, or removed for None."""
    data = io.BytesIO(Path(getattr(files, name)).read_bytes()[:-82])  # without the digest
    with h5py.File(data, "r+") as file:
        del file[path]
        if value is not None:
            file[path] = value
    Path("edited.h5").write_bytes(data.getvalue())
    return "edited.h5"


@pytest.mark.parametrize(
    ("name", "path", "value"),
    [
        ("measurements", "measurements/points", None),
        ("measurements", "measurements/points", np.full((40, 3, 3), np.nan)),
        ("measurements", "measurements/points", np.zeros((39, 3, 3))),
        ("measurements", "measurements/points", np.zeros((40, 2, 3))),
        ("measurements", "measurements/joint_positions", np.zeros((40, 6))),
        ("measurements", "measurements/joint_positions", "text"),
        ("measurements", "measurements", None),
        ("measurements", "robot", None),
        ("measurements", "robot/description", "name = 3"),
        ("measurements", "registration/T_instrument_base", np.zeros((3, 3))),
        ("network", "networks/0/hidden_weights", np.zeros((4, 5))),
        ("network", "networks/0/output_bias", None),
        ("network", "networks/0/hidden_bias", np.full(4, np.inf)),
        ("network", "model/errors/placements", np.zeros((9, 6))),
        ("network", "registration", None),
        ("network", "equivalent/virtual_joints", None),
    ],
)
def test_a_damaged_file(files: Files, name: str, path: str, value: object) -> None:
    assert refused(3, "info", edited(files, name, path, value)).startswith("edited.h5: ")


SECTORS = """
import sys
from typer.testing import CliRunner
from calibtool.cli import app
for path in sys.argv[1:]:
    data = open(path, "rb").read()
    for start in range(0, len(data), 512):
        print(path, start, end=" ", flush=True)
        lost = data[:start] + bytes(512) + data[start + 512:]
        print(CliRunner().invoke(app, ["info", "-"], input=lost).exit_code, flush=True)
"""


# --- robots that do not fit -----------------------------------------------------------------------


def test_a_calibration_of_another_robot(files: Files) -> None:
    for arguments in (
        ["evaluate", files.six_network, "--on", files.measurements, "-o", "e.csv"],
        ["plot", "errors", files.six_network, "--on", files.measurements, "-o", "e.svg"],
        ["train", files.measurements, "--base", files.six_network, "-o", "c.h5"],
        ["simulate", "planar-3r", "--same-robot", files.six_measurements, "-o", "m.h5"],
    ):
        message = refused(3, *arguments)
        assert "planar-3r" in message
        assert "fanuc-m1000ia" in message


def test_too_few_measurements() -> None:
    run("simulate", "fanuc-m1000ia", "-n", 3, "-o", "m.h5")
    for command, option in (("identify", "--model"), ("train", "--base")):
        message = refused(4, command, "m.h5", option, "local-poe", "-o", "c.h5")
        assert "3 configurations" in message
        assert "at least 5" in message


# --- tables ---------------------------------------------------------------------------------------


def places(files: Files, header: list[str], rows: list[list[object]]) -> list[str]:
    """The messages of every command that reads joints from a table, without the file's name."""
    write_table("t.csv", header, rows)
    measured = [[*row, *range(9)] for row in rows]
    write_table("m.csv", [*header, *POINTS], measured)
    messages = [
        refused(3, "compensate", files.network, "t.csv", "-o", "c.csv"),
        refused(3, "simulate", "planar-3r", "--at", "t.csv", "-o", "s.h5"),
        refused(3, "import", "m.csv", "--robot", "planar-3r", "-o", "i.h5"),
    ]
    found = [message.partition(".csv")[2] for message in messages]
    assert all(message.startswith(("t.csv", "m.csv")) for message in messages)
    return found


@pytest.mark.parametrize(
    "cell", ["NaN", "n/a", "inf", "1e999", "ten", "1,5e", "0x10", "1_0", "--3"]
)
def test_a_cell_that_is_no_number(files: Files, cell: str) -> None:
    cell = cell.replace(",", ".")
    for message in places(files, PLANAR, [[1, 2, 3], [4, cell, 6], [7, 8, 9]]):
        assert message == f":3: column 'j2_deg' holds '{cell}'; expected a number"


def test_an_empty_cell(files: Files) -> None:
    for message in places(files, PLANAR, [[1, 2, 3], [4, 5, ""]]):
        assert message == ":3: column 'j3_deg' is empty; expected a number"


def test_a_bad_cell_among_the_measured_values() -> None:
    write_table("m.csv", [*PLANAR, *POINTS], [[*range(12)], [*range(9), "n/a", 10, 11]])
    message = refused(3, "import", "m.csv", "--robot", "planar-3r", "-o", "i.h5")
    assert message == (
        "m.csv:3: column 't3_x_mm' holds 'n/a'; expected a number: where nothing was seen, leave "
        "all of t3_x_mm, t3_y_mm, t3_z_mm empty"
    )


def test_empty_lines_do_not_shift_the_line_that_is_named(files: Files) -> None:
    Path("t.csv").write_text("j1_deg,j2_deg,j3_deg\n\n1,2,3\n\n\n4,x,6\n")
    assert refused(3, "compensate", files.network, "t.csv").startswith("t.csv:6: column 'j2_deg'")


def test_an_unknown_joint(files: Files) -> None:
    for message in places(files, [*PLANAR, "j7_deg"], [[1, 2, 3, 4]]):
        assert "'j7_deg'" in message
        assert "3 joints" in message
    six = [f"j{k}_deg" for k in range(1, 8)]
    write_table("seven.csv", six, [range(7)])
    message = refused(3, "compensate", files.six_network, "seven.csv", "-o", "c.csv")
    assert message.startswith("seven.csv")
    assert "'j7_deg'" in message
    assert "6 joints" in message


def test_a_missing_joint(files: Files) -> None:
    for message in places(files, PLANAR[:2], [[1, 2]]):
        assert "j3_deg" in message
        assert "3 joints" in message


def test_a_joint_in_the_wrong_kind_of_unit(files: Files) -> None:
    for message in places(files, ["j1_deg", "j2_mm", "j3_deg"], [[1, 2, 3]]):
        assert "'j2_mm'" in message
        assert "revolute" in message


def test_a_joint_twice(files: Files) -> None:
    for message in places(files, [*PLANAR, "j1_rad"], [[1, 2, 3, 4]]):
        assert "'j1_deg'" in message
        assert "'j1_rad'" in message
    for message in places(files, [*PLANAR, "j1_deg"], [[1, 2, 3, 4]]):
        assert message.startswith(":1: column 'j1_deg' appears more than once")


def test_degrees_in_a_column_of_radians(files: Files) -> None:
    for message in places(files, ["j1_rad", "j2_rad", "j3_rad"], [[0.1, 0.2, 0.3], [10, -85, 30]]):
        assert message.startswith(":3: column 'j1_rad' holds 10 rad, which looks like degrees")
        assert "j1_deg" in message


def test_rows_of_another_length(files: Files) -> None:
    for text, cells in (("1,2,3\n4,5\n", "2 cells"), ("1,2,3\n4,5,6,7\n", "4 cells")):
        Path("t.csv").write_text("j1_deg,j2_deg,j3_deg\n" + text)
        for arguments in (
            ["compensate", files.network, "t.csv"],
            ["simulate", "planar-3r", "--at", "t.csv"],
        ):
            message = refused(3, *arguments, "-o", "out")
            assert message.startswith(f"t.csv:3: {cells}")
            assert "3 columns" in message


def test_a_header_without_rows(files: Files) -> None:
    Path("t.csv").write_text("j1_deg,j2_deg,j3_deg\n\n")
    assert refused(3, "compensate", files.network, "t.csv", "-o", "c.csv").startswith("t.csv: ")


def test_neither_joints_nor_poses(files: Files) -> None:
    write_table("t.csv", ["a", "b"], [[1, 2]])
    for arguments in (
        ["compensate", files.network, "t.csv"],
        ["simulate", "planar-3r", "--at", "t.csv"],
    ):
        message = refused(3, *arguments, "-o", "out")
        assert message.startswith("t.csv: ")
        assert "j1_deg" in message
        assert "x_mm" in message


@pytest.mark.parametrize(
    ("header", "row"),
    [
        (["x_mm", "y_mm", "z_mm"], [1, 2, 3]),
        (["x_mm", "y_m", "z_mm", "qw", "qx", "qy", "qz"], [1, 2, 3, 1, 0, 0, 0]),
        (["x_mm", "y_mm", "z_mm", "qw", "qx", "qy"], [1, 2, 3, 1, 0, 0]),
    ],
)
def test_half_a_pose(files: Files, header: list[str], row: list[object]) -> None:
    write_table("t.csv", header, [row])
    assert refused(3, "compensate", files.six_network, "t.csv", "-o", "c.csv").startswith("t.csv: ")


def test_a_quaternion_that_is_none(files: Files) -> None:
    write_table(
        "t.csv",
        ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"],
        [[1, 2, 3, 1, 0, 0, 0], [1, 2, 3, 1, 1, 0, 0]],
    )
    message = refused(3, "compensate", files.six_network, "t.csv", "-o", "c.csv")
    assert message.startswith("t.csv:3: quaternion")


def test_two_orientations(files: Files) -> None:
    header = ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz", "rx_rad", "ry_rad", "rz_rad"]
    write_table("t.csv", header, [[1, 2, 3, 1, 0, 0, 0, 0, 0, 0]])
    message = refused(3, "compensate", files.six_network, "t.csv", "-o", "c.csv")
    assert message.startswith("t.csv: two orientations")


@pytest.mark.parametrize(
    "row",
    ['1,2,3,"two\nlines"', '1,2,3,"no end', f"1,2,3,{'x' * 200_000}"],
    ids=["a cell of two lines", "a quote without end", "a cell of 200,000 letters"],
)
def test_unusual_cells(files: Files, row: str) -> None:
    """Refused with a line, or passed through; not an unexpected error."""
    Path("t.csv").write_text(f"j1_deg,j2_deg,j3_deg,note\n{row}\n4,5,6,next\n")
    result = run_any("compensate", files.network, "t.csv", "-o", "c.csv")
    if result == 3:
        assert not Path("c.csv").exists()
    else:
        assert result == 0
        assert Path("c.csv").exists()


def run_any(*arguments: str) -> int:
    """The exit code of a command that may be refused or done."""
    from typer.testing import CliRunner

    from calibtool.cli import app

    result = CliRunner().invoke(app, list(arguments), prog_name="calibtool")
    if result.exit_code:
        only_line(result.stderr)
    return result.exit_code


def test_text_that_is_not_utf8(files: Files) -> None:
    Path("t.csv").write_bytes("j1_deg,j2_deg,j3_deg,größe\n1,2,3,4\n".encode("latin-1"))
    message = refused(3, "compensate", files.network, "t.csv", "-o", "c.csv")
    assert message.startswith("t.csv: not a UTF-8 text file")


def test_unreachable_poses() -> None:
    """Nothing to measure at; `compensate` writes the other rows, see there."""
    write_table(
        "t.csv", ["x_mm", "y_mm", "z_mm", "rx_rad", "ry_rad", "rz_rad"], [[90000, 0, 0, 0, 0, 0]]
    )
    assert refused(4, "simulate", "fanuc-m1000ia", "--at", "t.csv", "-o", "m.h5").startswith(
        "t.csv:2: "
    )


# --- import ---------------------------------------------------------------------------------------

MAP = """
[joints]
columns = ["j1_deg", "j2_deg", "j3_deg"]
unit = "deg"

[[targets]]
measured = ["t1_x_mm", "t1_y_mm", "t1_z_mm"]
unit = "mm"
"""


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('"j3_deg"', '"j3_dg"', "t.csv: no column 'j3_dg'; did you mean j3_deg"),
        ('"t1_z_mm"', '"t1_zz_mm"', "t.csv: no column 't1_zz_mm'; did you mean t1_z_mm"),
        (', "j3_deg"', "", "t.csv: 2 joint columns, but planar-3r has 3 joints"),
        (
            'unit = "deg"',
            'unit = "mm"',
            "t.csv: column 'j1_deg' is in mm, but its joint is revolute",
        ),
        ('unit = "deg"', 'unit = "degree"', "map.toml: joints.unit"),
        ('unit = "deg"', 'unit = ["deg", "deg"]', "t.csv: 2 joint units for 3 joints"),
        ('unit = "deg"', "", "map.toml: joints.unit"),
        ("measured", "measure", "map.toml: unknown key"),
        ("[[targets]]", "[targets]", "map.toml: targets"),
        ("[joints]", "[joint]", "map.toml: "),
        ("[joints]", "[joints", "map.toml: not valid TOML"),
        (
            'unit = "mm"',
            'unit = "mm"\non_tool_mm = [1.0, nan, 0.0]',
            "map.toml: targets.0.on_tool_mm",
        ),
        ('unit = "mm"', 'unit = "mm"\n[noise]\nposition_mm = 0', "map.toml: noise.position_mm"),
        ('unit = "mm"', 'unit = "mm"\n[instrument]\nframe = "world"', "map.toml: instrument.frame"),
        ("\n[joints]", 'delimiter = ";;"\n[joints]', "map.toml: delimiter"),
        ("\n[joints]", 'delimiter = ""\n[joints]', "map.toml: delimiter"),
        ("\n[joints]", 'decimal = ";"\n[joints]', "map.toml: decimal"),
    ],
)
def test_a_wrong_map(files: Files, old: str, new: str, named: str) -> None:
    measured_table(files.measurements, "t.csv")
    assert old in MAP
    Path("map.toml").write_text(MAP.replace(old, new, 1))
    message = refused(
        3, "import", "t.csv", "--robot", "planar-3r", "--columns", "map.toml", "-o", "m.h5"
    )
    assert message.startswith(named)


def test_a_misspelt_key_is_named_before_what_it_leaves_missing(files: Files) -> None:
    measured_table(files.measurements, "t.csv")
    Path("map.toml").write_text(MAP.replace('unit = "deg"', 'units = "deg"'))
    message = refused(
        3, "import", "t.csv", "--robot", "planar-3r", "--columns", "map.toml", "-o", "m.h5"
    )
    assert "'joints.units'" in message
    assert "unit" in message.replace("units", "")


@pytest.mark.parametrize(
    ("header", "named"),
    [
        ([*PLANAR, "a", "b", "c"], "no measured points"),
        ([*PLANAR, "t1_x_mm", "t1_y_mm", "t1_z"], "no column 't1_z_mm'"),
        (["a", "b", "c", "x_mm", "y_mm", "z_mm"], "no joint columns"),
    ],
)
def test_a_header_that_import_cannot_read(header: list[str], named: str) -> None:
    write_table("t.csv", header, [range(6), range(6)])
    message = refused(3, "import", "t.csv", "--robot", "planar-3r", "-o", "m.h5")
    assert message.startswith("t.csv: ")
    assert named in message


def test_too_few_rows_to_find_the_set_up() -> None:
    write_table("t.csv", [*PLANAR, *POINTS], [[10, 20, 30, 1, 0, 0, 0, 1, 0, 0, 0, 1]])
    message = refused(4, "import", "t.csv", "--robot", "planar-3r", "-o", "m.h5")
    assert "configurations" in message


# --- collinear targets, and a robot of one's own --------------------------------------------------


def own_robot(old: str, new: str, file: str = "robot.toml") -> str:
    """A copy of planar-3r in which one piece of text is another."""
    copytree(shipped("robots") / "planar-3r", "mine")
    text = Path("mine", file).read_text(encoding="utf-8")
    assert old in text
    Path("mine", file).write_text(text.replace(old, new, 1), encoding="utf-8")
    return "mine"


TARGETS = "[[86.603, 0.0, 50.0], [-43.301, 75.0, 50.0], [-43.301, -75.0, 50.0]]"


def test_collinear_targets_of_a_robot_of_ones_own() -> None:
    robot = own_robot(TARGETS, "[[10.0, 0.0, 50.0], [20.0, 0.0, 60.0], [40.0, 0.0, 80.0]]")
    assert "collinear" in refused(3, "simulate", robot, "-n", "9", "-o", "m.h5")


def test_the_same_target_twice_of_a_robot_of_ones_own() -> None:
    robot = own_robot(TARGETS, "[[10.0, 0.0, 50.0], [10.0, 0.0, 50.0]]")
    assert "same point" in refused(3, "simulate", robot, "-n", "9", "-o", "m.h5")


def test_collinear_targets_of_a_table(files: Files) -> None:
    measured_table(files.measurements, "t.csv")
    header, *rows = (line.split(",") for line in Path("t.csv").read_text().splitlines())
    for row in rows:
        first, second = np.array(row[3:6], dtype=float), np.array(row[6:9], dtype=float)
        row[9:12] = [repr(v) for v in (first + 2.5 * (second - first)).tolist()]
    write_table("line.csv", header, rows)
    for options in ([], ["--frame", "base"]):
        message = refused(3, "import", "line.csv", "--robot", "planar-3r", *options, "-o", "m.h5")
        assert message.startswith("line.csv: ")
        assert "collinear" in message


def test_collinear_targets_of_a_map(files: Files) -> None:
    measured_table(files.measurements, "t.csv")
    targets = "".join(
        f'[[targets]]\nmeasured = ["t{i}_x_mm", "t{i}_y_mm", "t{i}_z_mm"]\nunit = "mm"\n'
        f"on_tool_mm = [{i}.0, 0.0, 5.0]\n"
        for i in (1, 2, 3)
    )
    Path("map.toml").write_text(MAP[: MAP.index("[[targets]]")] + targets)
    message = refused(
        3, "import", "t.csv", "--robot", "planar-3r", "--columns", "map.toml", "-o", "m.h5"
    )
    assert "collinear" in message


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('urdf = "robot.urdf"', 'urdf = "missing.urdf"', "mine/missing.urdf"),
        ('tool_frame = "tool0"', 'tool_frame = "tool"', "did you mean tool0"),
        ('tool_frame = "tool0"', 'tool_frame = "tool0', "mine/robot.toml: not valid TOML"),
        ("j3_deg = 20", "j7_deg = 20", "'j7_deg'"),
        ("j3_deg = 20", "j3_mm = 20", "'j3_mm'"),
        (", j3_deg = 20", "", "no value for j3"),
        ("cone_deg = 45", "cone_deg = 270", "mine/robot.toml: workspaces.bench.cone_deg"),
        ("cone_deg = 45", "cone_deg = 45\ncolour = 3", "'workspaces.bench.colour'"),
        ("[workspaces.bench]", "[workspaces.full]", "'full'"),
        ('name = "planar-3r"', 'name = ""', "mine/robot.toml: name"),
        (TARGETS, "[]", "mine/robot.toml: targets.points_mm"),
        (TARGETS, "[[1.0, nan, 3.0]]", "mine/robot.toml: targets.points_mm"),
    ],
)
def test_a_wrong_robot_of_ones_own(old: str, new: str, named: str) -> None:
    robot = own_robot(old, new)
    assert named in refused(3, "simulate", robot, "-n", "5", "-o", "m.h5")


def test_a_misspelt_key_of_a_robot_is_named_before_what_it_leaves_missing() -> None:
    robot = own_robot('tool_frame = "tool0"', 'tool_frme = "tool0"')
    message = refused(3, "robots", robot)
    assert message.startswith("mine/robot.toml: ")
    assert "tool_frme" in message


def test_messages_about_a_robot_of_ones_own_name_its_file() -> None:
    """A copy keeps the name of the robot it was made from: the name alone does not say
    which file is wrong.
    """
    robot = own_robot('tool_frame = "tool0"', 'tool_frame = "tool"')
    assert "mine" in refused(3, "robots", robot)


def test_a_workspace_out_of_reach() -> None:
    robot = own_robot("[0.5, 0.5, 0.1]", "[50.0, 50.0, 50.0]")
    message = refused(4, "simulate", robot, "-n", "5", "-o", "m.h5")
    assert "workspace" in message


@pytest.mark.parametrize("path", ["missing", "./missing", "missing.toml", "missing/robot.urdf"])
def test_a_robot_that_does_not_exist(path: str) -> None:
    assert "missing" in refused(2, "simulate", path, "-o", "m.h5")


def test_a_folder_without_a_robot() -> None:
    Path("mine").mkdir()
    assert "mine/robot.toml" in refused(3, "robots", "mine")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<child link="link_2"/>', '<chld link="link_2"/>'),
        ('xyz="0.5 0 0"', 'xyz="0.5 0 half"'),
        ("</robot>", ""),
        (None, ""),
        (None, "hello"),
        (None, '<robot name="x"><link name="a"/></robot>'),
    ],
    ids=["a tag", "a number", "the end", "nothing", "no XML", "no joint"],
)
def test_a_urdf_that_cannot_be_read(
    old: str | None, new: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """The URDF library writes lines of its own on the process's stderr; the
    user must not see them.
    """
    text = (shipped("robots") / "planar-3r" / "robot.urdf").read_text(encoding="utf-8")
    assert old is None or old in text
    Path("arm.urdf").write_text(new if old is None else text.replace(old, new), encoding="utf-8")
    message = refused(3, "simulate", "arm.urdf", "-n", "5", "-o", "m.h5")
    assert "arm" in message
    assert capfd.readouterr().err == ""
