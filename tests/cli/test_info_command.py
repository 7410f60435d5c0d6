"""calibtool info: what a file holds, for people and as JSON."""

import hashlib
import re
from importlib.metadata import version
from pathlib import Path

import pytest
from commandline import Files, answer, refused, run


def test_a_measurements_file(files: Files) -> None:
    value = answer("info", files.measurements)
    assert (value["schema"], value["schema_version"]) == ("calibtool/info", 1)
    assert (value["kind"], value["robot"], value["configurations"]) == (
        "measurements",
        "planar-3r",
        40,
    )
    assert value["observation"] == "3 target points"
    assert value["noise_position_mm"] == pytest.approx(0.05)
    assert value["simulated"] is True
    assert (
        value["registration"]["targets_on_tool_mm"] == answer("robots", "planar-3r")["targets_mm"]
    )


def test_a_calibration_file(files: Files) -> None:
    value = answer("info", files.network)
    assert (value["kind"], value["robot"], value["configurations"]) == (
        "calibration",
        "planar-3r",
        40,
    )
    assert value["base"]["model"] == "local-poe"
    assert value["network"]["used"] is True
    assert value["network"]["restarts"] == 1
    assert answer("info", files.local_poe)["network"] == {"used": False}
    assert answer("info", files.paper)["base"]["model"] == "nominal"


def test_provenance(files: Files) -> None:
    provenance = answer("info", files.network)["provenance"]
    assert provenance["seed"] == "0"
    assert (
        provenance["command"]
        == f"calibtool train {files.measurements} --restarts 1 --base local-poe --regularisation "
        "early-stopping"
    )
    assert (
        provenance["sha256_measurements"]
        == hashlib.sha256(Path(files.measurements).read_bytes()).hexdigest()
    )
    assert provenance["version_calibtool"] == version("calibtool")
    assert provenance["version_numpy"] == version("numpy")


@pytest.mark.parametrize("name", ["measurements", "network", "local_poe", "paper", "ten"])
def test_text_and_json_state_the_same(files: Files, name: str) -> None:
    path = getattr(files, name)
    result = run("info", path)
    assert result.stderr == ""
    value = answer("info", path)
    for key in value:
        if key != "schema":
            assert f"\n{key}:" in "\n" + result.stdout
    assert f"robot: {value['robot']}\n" in result.stdout
    assert f"command: {value['provenance']['command']}\n" in result.stdout


def test_long_lists_are_cut_for_people_only(files: Files) -> None:
    run("identify", files.measurements, "--model", "complete", "-o", "c.h5")
    values = answer("info", "c.h5")["base"]["singular_values"]
    assert len(values) > 24
    assert f"… {len(values)} in all]" in run("info", "c.h5").stdout


@pytest.mark.parametrize("name", ["measurements", "network"])
def test_from_stdin(files: Files, name: str) -> None:
    path = getattr(files, name)
    data = Path(path).read_bytes()
    assert run("info", "-", stdin=data).stdout == run("info", path).stdout
    assert answer("info", "-", stdin=data) == answer("info", path)


@pytest.mark.parametrize("name", ["s.csv", "s.h5"])
def test_the_table_of_a_study(name: str) -> None:
    run(
        "study",
        "planar-3r",
        "--runs",
        2,
        "-n",
        "10,20",
        "--fresh",
        10,
        "--methods",
        "local-poe",
        "--workers",
        1,
        "-o",
        name,
    )
    value = answer("info", name)
    assert (value["schema"], value["kind"], value["robots"]) == (
        "calibtool/info",
        "study",
        ["planar-3r"],
    )
    assert (value["methods"], value["configurations"]) == (["nominal", "local-poe"], [10, 20])
    assert (value["runs"], value["rows"], value["finished"], value["failed"]) == (4, 8, 8, 0)
    assert [(m["method"], m["configurations"]) for m in value["medians"]] == [
        (method, count) for count in (10, 20) for method in ("nominal", "local-poe")
    ]
    assert ("definition" in value) == name.endswith(".h5")
    text = run("info", "-", stdin=Path(name).read_bytes()).stdout
    assert f"study: {value['study']}\n" in text
    assert re.search(r"^ +local-poe +20 ", text, re.MULTILINE)


def test_tables_for_people_fit_a_terminal_and_show_the_clear_parameters_first(files: Files) -> None:
    run("identify", files.measurements, "--model", "complete", "-o", "c.h5")
    table = answer("info", "c.h5")["base"]["parameter_table"]
    clearest = max(table, key=lambda row: abs(row["value"]) / row["std"])
    text = run("info", "c.h5").stdout
    rows = text.partition("parameter_table:\n")[2].splitlines()
    assert rows[2].split()[0] == clearest["name"]
    assert max(len(row) for row in rows[: rows.index("  correlations:")]) <= 80


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("arm.urdf", "<robot name='a'/>\n", "XML; expected a file that calibtool wrote"),
        ("points.csv", "x_mm,y_mm\n1,2\n", "text; expected a file that calibtool wrote"),
        ("notes.txt", "hello\n", "calibtool import reads tables"),
        ("noise.bin", "\x00\x01\x02", "not an HDF5 file; expected"),
    ],
)
def test_a_foreign_file_is_told_by_its_contents(name: str, text: str, told: str) -> None:
    Path(name).write_text(text)
    assert told in refused(3, "info", name)
