"""calibtool robots: the catalogue, one robot, and a user's own."""

import json
import math
import subprocess
import sys
from pathlib import Path
from shutil import copytree

import pytest
from commandline import ENVIRONMENT, answer, refused, run

from calibtool.robot.catalogue import robot_names, shipped

NAMES = robot_names()


def test_the_list_has_every_robot_of_the_folder() -> None:
    result = run("robots")
    listed = [line.split()[0] for line in result.stdout.splitlines()]
    assert listed == sorted(
        path.name for path in shipped("robots").iterdir() if (path / "robot.toml").is_file()
    )
    assert "fanuc-m1000ia" in listed
    assert result.stderr == ""


def test_json_of_the_list_states_the_same() -> None:
    value = answer("robots")
    assert value["schema"] == "calibtool/robots"
    assert value["schema_version"] == 1
    lines = run("robots").stdout.splitlines()
    for entry, line in zip(value["robots"], lines, strict=True):
        assert set(entry) == {"name", "joints", "title", "workspaces"}
        assert line.split()[:2] == [entry["name"], entry["joints"]]
        assert line.endswith(entry["title"])
        assert entry["workspaces"][-1] == "full"


def test_the_machining_workspace_is_the_default_of_the_m1000ia() -> None:
    assert answer("robots", "fanuc-m1000ia")["workspaces"][0] == "machining"


@pytest.mark.parametrize(
    ("name", "joints"),
    [
        ("planar-3r", "RRR"),
        ("scara", "RRPR"),
        ("gantry", "PPPRR"),
        ("fanuc-m1000ia", "R" * 6),
        ("panda", "R" * 7),
    ],
)
def test_joints_of_one_robot(name: str, joints: str) -> None:
    value = answer("robots", name)
    assert value["schema"] == "calibtool/robot"
    assert value["joints"] == joints
    kinds = ["prismatic" if joint == "P" else "revolute" for joint in joints]
    assert [joint["kind"] for joint in value["joint_table"]] == kinds
    for joint in value["joint_table"]:
        unit = "mm" if joint["kind"] == "prismatic" else "deg"
        assert joint[f"lower_{unit}"] < joint[f"upper_{unit}"]
        assert math.hypot(*joint["axis"]) == pytest.approx(1.0)


@pytest.mark.parametrize("name", NAMES)
def test_virtual_joints_fill_up_to_six(name: str) -> None:
    value = answer("robots", name)
    assert len(set(value["virtual_joints"])) == max(6 - len(value["joints"]), 0)


def test_planar_arm_by_hand() -> None:
    """Links of 500, 400 and 200 mm, home at 20, 60 and 20 deg: the tool is where
    trigonometry puts it.
    """
    value = answer("robots", "planar-3r")
    angles = [math.radians(a) for a in (20, 80, 100)]
    links = (500, 400, 200)
    x = sum(length * math.cos(a) for length, a in zip(links, angles, strict=True))
    y = sum(length * math.sin(a) for length, a in zip(links, angles, strict=True))
    assert value["home_tool_position_mm"] == pytest.approx([x, y, 0.0], abs=2e-3)
    assert [joint["axis"] for joint in value["joint_table"]] == [[0.0, 0.0, 1.0]] * 3
    assert [joint["upper_deg"] for joint in value["joint_table"]] == pytest.approx(
        [170, 160, 170], abs=1e-6
    )


def test_text_for_people_holds_what_json_holds() -> None:
    text, value = run("robots", "planar-3r").stdout, answer("robots", "planar-3r")
    for key in value:
        assert f"{key}:" in text
    for joint in value["joint_table"]:
        assert f"\n  {joint['name']} " in text
    for note in value["notes"]:
        assert note in " ".join(text.split())


def test_a_robot_of_ones_own_by_folder_toml_and_urdf() -> None:
    copytree(shipped("robots") / "planar-3r", "mine")
    original = answer("robots", "planar-3r")
    assert answer("robots", "mine") == original
    assert answer("robots", "./mine") == original
    assert answer("robots", "mine/robot.toml") == original
    bare = answer("robots", "mine/robot.urdf")
    assert bare["joint_table"] == original["joint_table"]
    assert bare["workspaces"] == ["full"]
    assert bare["tool_frame"] == original["tool_frame"]


@pytest.mark.parametrize("start", [["robots"], ["simulate"], ["import", "t.csv", "--robot"]])
def test_unknown_robot_lists_near_names(start: list[str]) -> None:
    Path("t.csv").write_text("j1_deg,x_mm,y_mm,z_mm\n1,2,3,4\n")
    message = refused(2, *start, "plannar-3r")
    assert "'plannar-3r'" in message
    assert "planar-3r" in message.replace("plannar-3r", "")
    assert "fanuc-m900ib-700" in refused(2, *start, "fanuc-m900")


def test_json_is_readable_whatever_the_terminal_s_encoding() -> None:
    """Titles and notes hold ², ± and °; a JSON text is UTF-8 (or escaped), whatever
    stdout's encoding is.
    """
    finished = subprocess.run(
        [sys.executable, "-m", "calibtool", "robots", "fanuc-m1000ia", "--json"],
        capture_output=True,
        env={**ENVIRONMENT, "PYTHONIOENCODING": "latin-1:strict"},
        timeout=60,
    )
    assert finished.returncode == 0, finished.stderr.decode()
    assert (
        json.loads(finished.stdout.decode("utf-8"))["notes"]
        == answer("robots", "fanuc-m1000ia")["notes"]
    )
