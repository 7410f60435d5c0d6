"""The whole way on a robot with closed loops, command by command."""

import re
from pathlib import Path

import pytest
from commandline import answer, refused, run

from calibtool.robot.catalogue import shipped


@pytest.fixture
def calibration() -> str:
    run("simulate", "delta", "-n", 25, "--seed", 1, "-o", "m.h5")
    run("identify", "m.h5", "-o", "c.h5")
    return "c.h5"


def test_from_a_simulation_to_a_page(calibration: str) -> None:
    run("simulate", "delta", "-n", 60, "--seed", 1, "--same-robot", "m.h5", "-o", "f.h5")
    nominal, complete = answer("evaluate", calibration, "--on", "f.h5")["methods"]
    assert complete["position_mm"]["max"] < 0.1 * nominal["position_mm"]["max"]
    summary = answer("info", calibration)
    assert summary["virtual_joints"] == ["rx", "ry", "rz"]
    assert any("loop1.a" in row["id"] for row in summary["base"]["parameter_table"])
    run("report", calibration, "--on", "f.h5", "-o", "page.html")
    run("view", calibration, "--html", "view.html")
    assert "delta" in Path("view.html").read_text()


def test_a_plan_is_measured_and_corrected(calibration: str) -> None:
    run("plan", "delta", "-n", 8, "--candidates", 40, "-o", "plan.csv")
    run("simulate", "delta", "--at", "plan.csv", "--same-robot", "m.h5", "-o", "p.h5")
    corrected = run("compensate", calibration, "plan.csv").stdout.splitlines()
    header = corrected[0].split(",")
    assert header[:3] == ["j1_deg", "j2_deg", "j3_deg"]
    assert len(corrected) == 9


def test_a_row_that_does_not_close_is_a_row_with_a_status(calibration: str) -> None:
    run("simulate", "fivebar", "-n", 20, "--seed", 1, "-o", "b.h5")
    run("identify", "b.h5", "-o", "b-calibration.h5")
    Path("targets.csv").write_text("j1_deg,j2_deg\n145,35\n111,69\n")
    result = run("compensate", "b-calibration.h5", "targets.csv")
    assert [line.split(",")[2] for line in result.stdout.splitlines()[1:]] == ["not-closed", "ok"]
    assert "targets.csv:2: the closed loops do not close there" in result.stderr


def test_what_is_wrong_in_a_description_is_one_line() -> None:
    folder = shipped("robots") / "fivebar"
    Path("own").mkdir()
    toml = (folder / "robot.toml").read_text()
    (Path("own") / "robot.urdf").write_text((folder / "robot.urdf").read_text())
    (Path("own") / "robot.toml").write_text(toml.replace('"planar"', '"weld"'))
    message = refused(3, "robots", "--check", "own")
    assert "loop 'loop1': over-constrained" in message
    assert message.count("\n") <= 1


def test_a_controllers_own_model_is_for_serial_arms(calibration: str) -> None:
    Path("dh.csv").write_text("a_mm,alpha_deg,d_mm,theta_deg\n0,0,0,0\n")
    Path("p.src").write_text("DEF p()\nPTP {A1 0,A2 0,A3 0}\nEND\n")
    arguments = ("--controller", "dh.csv", "--dh", "standard")
    message = refused(2, "compensate", calibration, "p.src", *arguments)
    assert "closed loops" in message


@pytest.mark.parametrize(
    ("robot", "change", "limit"),
    [
        ("hexapod", 0.5, r"6\.54 mm"),
        ("fivebar", 0.5, "0.5 deg"),
        ("hybrid", 0.5, r"0\.5 deg, of a slide 5\.24 mm"),
    ],
)
def test_the_limit_of_a_change_is_in_the_units_of_the_joints(
    robot: str, change: float, limit: str
) -> None:
    """A slide may move by the angle (rad) times the characteristic length."""
    run("simulate", robot, "-n", 20, "--seed", 1, "-o", "m.h5")
    run("identify", "m.h5", "-o", "c.h5")
    run("plan", robot, "-n", 2, "--candidates", 10, "--no-refine", "-o", "t.csv")
    result = run("compensate", "c.h5", "t.csv", "--largest-change-deg", change)
    assert re.search(rf"limit of the change of a joint: {limit} \(--", result.stderr)
