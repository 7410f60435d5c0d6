"""Damaged and hostile files at the command line: exit code 3, one line, nothing written."""

import io
import zipfile
from pathlib import Path

import pytest
from commandline import Files, refused, run

from calibtool.robot.catalogue import load_robot


def test_a_damaged_sector_of_a_measurements_file(files: Files) -> None:
    data = bytearray(Path(files.measurements).read_bytes())
    data[1024:1536] = bytes(512)
    Path("bad.h5").write_bytes(data)
    for command in (
        ("info", "bad.h5"),
        ("identify", "bad.h5", "-o", "out.h5"),
        ("train", "-", "-o", "out.h5"),
    ):
        message = refused(3, *command, stdin=bytes(data))
        assert "do not match its SHA-256" in message


def test_a_file_without_a_digest_is_read(files: Files) -> None:
    Path("plain.h5").write_bytes(Path(files.measurements).read_bytes()[:-82])
    assert run("info", "plain.h5").stdout == run("info", files.measurements).stdout


def test_a_robot_that_points_outside_of_its_folder() -> None:
    Path("arm").mkdir()
    Path("robot.urdf").write_text(load_robot("planar-3r").source.urdf_text, encoding="utf-8")
    text = load_robot("planar-3r").source.toml_text.replace("robot.urdf", "../robot.urdf")
    Path("arm/robot.toml").write_text(text, encoding="utf-8")
    for command in (("robots", "arm/robot.toml"), ("simulate", "arm", "-o", "out.h5")):
        assert "is outside of arm; copy the file there" in refused(3, *command)


def test_a_folder_that_is_allowed() -> None:
    Path("arm").mkdir()
    Path("urdf/deep").mkdir(parents=True)
    Path("urdf/deep/robot.urdf").write_text(load_robot("planar-3r").source.urdf_text)
    named = load_robot("planar-3r").source.toml_text.replace(
        "robot.urdf", "../urdf/deep/robot.urdf"
    )
    Path("arm/robot.toml").write_text(named)
    run("robots", "arm", "--allow", "urdf")
    run("simulate", "arm", "--allow", "urdf", "-n", "5", "-o", "out.h5")
    assert "is outside of arm" in refused(3, "robots", "arm", "--allow", "arm")
    assert "--allow: gone: no such folder" in refused(2, "robots", "arm", "--allow", "gone")
    Path("out.h5").unlink()


@pytest.mark.parametrize(
    "text", ["a = " + "[" * 5000, "a = " + "9" * 5000, "a." * 30_000 + "b = 1"]
)
def test_toml_files(files: Files, text: str) -> None:
    Path("x.toml").write_text(text, encoding="utf-8")
    Path("t.csv").write_text("j1_deg,j2_deg,j3_deg,x_mm,y_mm,z_mm\n1,2,3,4,5,6\n", encoding="utf-8")
    Path("p.script").write_text("movej([0, 0, 0])\n", encoding="utf-8")
    for command in (
        ("robots", "x.toml"),
        ("import", "t.csv", "--robot", "planar-3r", "--columns", "x.toml", "-o", "out.h5"),
        ("compensate", files.local_poe, "p.script", "--frames", "x.toml", "-o", "out.script"),
    ):
        assert refused(3, *command).startswith("x.toml: not valid TOML: ")


def test_json_rows(files: Files) -> None:
    row = '{"j1_deg": ' + "[" * 50_000
    refused(3, "compensate", files.local_poe, "-", "--format", "ndjson", stdin=row)


def test_a_workbook_that_is_a_bomb() -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/worksheets/sheet1.xml", bytes(40 << 20))
    Path("w.xlsx").write_bytes(out.getvalue())
    assert "unpacks to" in refused(3, "import", "w.xlsx", "--robot", "planar-3r", "-o", "out.h5")
