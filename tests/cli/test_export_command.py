"""calibtool export: every format as a file and on stdout; C corrects as `compensate
--method one-step` does.
"""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from commandline import Files, answer, refused, remarks, rows_of, run, write_table
from exported import STATUS


def test_json_on_stdout_and_in_a_file(files: Files) -> None:
    result = run("export", files.network, "--format", "json")
    assert remarks(result) == ""
    run("export", files.network, "--format", "json", "-o", "c.json")
    assert Path("c.json").read_text(encoding="utf-8") == result.stdout
    assert (
        run("export", "-", "--format", "json", stdin=Path(files.network).read_bytes()).stdout
        == result.stdout
    )


def test_json_holds_what_a_reader_needs(files: Files) -> None:
    value = json.loads(run("export", files.network, "--format", "json").stdout)
    assert (value["schema"], value["schema_version"]) == ("calibtool/compensator", 4)
    assert value["robot"] == "planar-3r"
    assert [joint["unit"] for joint in value["joints"]] == ["rad"] * 3
    assert np.shape(value["nominal_placements_m"]) == (4, 4, 4)
    assert np.shape(value["nominal_twists_per_rad_or_m"]) == (3, 6)
    assert (
        value["equivalent_robot"]["virtual_joints"]
        == answer("robots", "planar-3r")["virtual_joints"]
    )
    assert np.shape(value["network"]["hidden_weights"]) == (4, 3)
    assert np.shape(value["network"]["output_weights"]) == (6, 4)
    assert value["provenance"] == answer("info", files.network)["provenance"]
    assert json.loads(run("export", files.local_poe, "--format", "json").stdout)["network"] is None


def test_c_is_a_source_and_a_header_beside_it(files: Files) -> None:
    Path("src").mkdir()
    result = run("export", files.network, "--format", "c", "-o", "src/robot_a.c")
    assert result.stdout_bytes == b""
    assert remarks(result) == ""
    assert sorted(path.name for path in Path("src").iterdir()) == ["robot_a.c", "robot_a.h"]
    source, header = Path("src/robot_a.c").read_text(), Path("src/robot_a.h").read_text()
    assert '#include "robot_a.h"' in source
    assert "int robot_a_correct(" in header
    assert "int robot_a_correct(" in source


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("network", []),
        ("local_poe", []),
        ("paper", []),
        ("six_network", ["--joint-values", "serial"]),
        ("six_network", ["--joint-values", "controller"]),
    ],
)
def test_c_corrects_as_the_command_does(files: Files, name: str, more: list[str]) -> None:
    """Compiled with warnings as errors, and run on the joints of a table."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("no C compiler")
    calibration = getattr(files, name)
    rows = [[0.3, -0.5, 0.8, 0.1, -1.2, 0.4], [-0.7, 0.2, -0.1, -0.4, -0.9, 2.0]]
    n = 6 if name.startswith("six") else 3
    names = [f"j{k}_rad" for k in range(1, n + 1)]
    write_table("t.csv", names, [row[:n] for row in rows])
    corrected = rows_of(
        run("compensate", calibration, "t.csv", "--method", "one-step", *more).stdout
    )
    expected = [[float(cell) for cell in list(row.values())[:n]] for row in corrected]

    run("export", calibration, "--format", "c", *more, "-o", "comp.c")
    numbers = ", ".join("{" + ", ".join(map(str, row[:n])) + "}" for row in rows)
    Path("main.c").write_text(
        '#include <stdio.h>\n#include "comp.h"\n'
        f"int main(void) {{\n  const double q[2][COMP_N] = {{{numbers}}};\n  double q_m[COMP_N];\n"
        "  for (int k = 0; k < 2; k++) {\n"
        '    printf("%d ", comp_correct(q[k], q_m));\n'
        '    for (int j = 0; j < COMP_N; j++) printf("%.17g ", q_m[j]);\n  }\n  return 0;\n}\n'
    )
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    subprocess.run(
        [compiler, *strict, "main.c", "comp.c", "-lm", "-o", "main"], check=True, timeout=60
    )
    printed = subprocess.run(["./main"], capture_output=True, check=True, timeout=60).stdout
    found = np.array(printed.split(), dtype=float).reshape(2, n + 1)
    np.testing.assert_allclose(found[:, 1:], expected, rtol=0, atol=1e-12)
    for code, row in zip(found[:, 0], corrected, strict=True):
        assert row["status"] in (
            STATUS[int(code)],
            "outside",
        )  # of the training: a controller does not know it


@pytest.mark.parametrize("name", ["delta_x.c", "my robot.c", "3axis-new.v2.c", "src/arm.c"])
@pytest.mark.parametrize("prefix", ["arm", "x_"])
def test_c_with_a_prefix_includes_the_header_that_was_written(
    files: Files, name: str, prefix: str
) -> None:
    """The compiler finds the header: names of files and of symbols are independent."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("no C compiler")
    Path("src").mkdir()
    run("export", files.network, "--format", "c", "--prefix", prefix, "-o", name)
    header = Path(name).with_suffix(".h")
    assert f"int {prefix}_correct(" in header.read_text()
    subprocess.run([compiler, "-std=c99", "-c", name, "-o", "out.o"], check=True, timeout=60)


@pytest.mark.parametrize("name", ["é.c", 'a"b.c', "a*.c"])
def test_c_needs_a_name_that_a_source_can_include(files: Files, name: str) -> None:
    said = refused(2, "export", files.network, "--format", "c", "--prefix", "arm", "-o", name)
    assert "header" in said
    assert not Path(name).exists()


@pytest.mark.parametrize(
    "output", [[], ["-o", "-"], ["-o", "comp"], ["-o", "comp.h"], ["-o", "comp.cpp"]]
)
def test_c_needs_a_name_that_ends_in_c(files: Files, output: list[str]) -> None:
    assert ".c" in refused(2, "export", files.network, "--format", "c", *output)


@pytest.mark.parametrize("name", ["comp-x.c", "3axis.c", "my robot.c", "é.c", ".c"])
def test_c_needs_a_name_that_can_begin_a_symbol(files: Files, name: str) -> None:
    refused(2, "export", files.network, "--format", "c", "-o", name)


def test_structured_text_is_named_by_its_file(files: Files) -> None:
    run("export", files.network, "--format", "st", "-o", "robot_a.st")
    assert "\nFUNCTION_BLOCK robot_a\n" in Path("robot_a.st").read_text(encoding="ascii")
    printed = run(
        "export",
        "-",
        "--format",
        "st",
        "--precision",
        "REAL",
        stdin=Path(files.network).read_bytes(),
    ).stdout
    assert "\nFUNCTION_BLOCK calibtool\n" in printed
    assert "LREAL;" not in printed
    assert "function block" in refused(
        2, "export", files.network, "--format", "st", "-o", "robot-a.st"
    )


def test_c_in_single_precision(files: Files) -> None:
    run("export", files.network, "--format", "c", "--precision", "float", "-o", "comp.c")
    assert "comp_correct(const float q[" in Path("comp.h").read_text()


def test_onnx_is_one_binary_file(files: Files) -> None:
    onnx = pytest.importorskip("onnx", reason="onnx is not installed")
    run("export", files.network, "--format", "onnx", "-o", "network.onnx")
    model = onnx.load("network.onnx")
    assert [output.name for output in model.graph.output] == ["rho"]
    piped = run("export", files.paper, "--format", "onnx", "--precision", "float").stdout_bytes
    onnx.checker.check_model(piped, full_check=True)


def test_onnx_needs_a_network(files: Files) -> None:
    assert "no network" in refused(
        3, "export", files.local_poe, "--format", "onnx", "-o", "network.onnx"
    )


def test_a_urdf_is_a_robot_again_and_lists_what_it_leaves_out(files: Files) -> None:
    result = run("export", files.network, "--format", "urdf", "-o", "calibrated.urdf")
    assert result.stdout == ""
    assert "not in the URDF: network: up to " in result.stderr
    assert answer("robots", "calibrated.urdf")["joints"] == answer("robots", "planar-3r")["joints"]
    assert run("export", files.local_poe, "--format", "urdf").stderr == ""


@pytest.mark.parametrize(
    ("format", "precision"),
    [("json", "double"), ("urdf", "float"), ("c", "REAL"), ("st", "float"), ("onnx", "LREAL")],
)
def test_a_precision_that_the_format_does_not_have_is_refused(
    files: Files, format: str, precision: str
) -> None:
    assert "--precision" in refused(
        2, "export", files.network, "--format", format, "--precision", precision
    )


@pytest.mark.parametrize("existing", ["comp.c", "comp.h"])
def test_neither_c_file_is_overwritten_unasked(files: Files, existing: str) -> None:
    Path(existing).write_text("mine")
    assert existing in refused(2, "export", files.network, "--format", "c", "-o", "comp.c")
    run("export", files.network, "--format", "c", "-o", "comp.c", "--force")
    assert "comp_correct" in Path(existing).read_text()


def test_the_same_calibration_gives_the_same_text(files: Files) -> None:
    for folder in ("a", "b"):
        Path(folder).mkdir()
        run("export", files.network, "--format", "c", "-o", f"{folder}/comp.c")
    for name in ("comp.c", "comp.h"):
        assert Path("a", name).read_bytes() == Path("b", name).read_bytes()


def test_the_suffix_tells_the_format(files: Files) -> None:
    for name, start in (("a.json", "{"), ("b.c", "/*"), ("c.st", "(*"), ("d.urdf", "<?xml")):
        run("export", files.local_poe, "-o", name)
        assert Path(name).read_text().startswith(start)
    assert "names no format; give --format json, c" in refused(
        2, "export", files.local_poe, "-o", "table.csv"
    )
    assert "names no format" in refused(2, "export", files.local_poe)


def test_a_prefix_names_the_symbols(files: Files) -> None:
    run("export", files.local_poe, "-o", "2nd-cell.c", "--prefix", "cell_2")
    assert "int cell_2_correct(" in Path("2nd-cell.h").read_text()
    run("export", files.local_poe, "-o", "x.st", "--prefix", "Cell2")
    assert "FUNCTION_BLOCK Cell2" in Path("x.st").read_text()
    assert "--prefix names symbols of c and st" in refused(
        2, "export", files.local_poe, "-o", "x.json", "--prefix", "a"
    )


def test_geometries_are_robots_again_and_list_what_they_leave_out(files: Files) -> None:
    for format in ("dh", "mdh"):
        said = remarks(run("export", files.local_poe, "--format", format, "-o", f"{format}.csv"))
        assert all(line.startswith(f"not in the {format}: ") for line in said.splitlines())
        assert answer("robots", f"{format}.csv")["joints"] == "RRR"
    run("export", files.local_poe, "--format", "offsets", "-o", "offsets.csv")
    assert "joint,offset,correction,unit,values" in Path("offsets.csv").read_text()
    assert "six revolute joints" in refused(3, "export", files.local_poe, "-o", "x.yaml")
    assert "six revolute joints" in refused(3, "export", files.local_poe, "-o", "x.dat")
    assert "the dh's joints are the serial chain's" in refused(
        2, "export", files.local_poe, "--format", "dh", "--joint-values", "controller"
    )


def test_backlash_that_is_left_out_is_said(files: Files) -> None:
    simulated = ["--errors", "geometric,backlash", "--backlash-mrad", "2", "-n", "150"]
    run("simulate", "planar-3r", *simulated, "-o", "m.h5")
    run("identify", "m.h5", "--backlash", "-o", "c.h5")
    for name in ("c.json", "c.c", "c.st"):
        said = remarks(run("export", "c.h5", "-o", name))
        assert said.startswith("warning: left out: backlash (")
        assert said.count("\n") == 1
        held = Path(name).with_suffix(".h") if name == "c.c" else Path(name)
        assert "backlash" in held.read_text()
