"""calibtool monitor: a line per check, exit code 5 on alarm."""

import json
from pathlib import Path

import pytest
from commandline import Files, answer, refused, run


@pytest.fixture
def known(files: Files) -> str:
    run("identify", files.six_measurements, "-q", "-o", "c.h5")
    return "c.h5"


def test_an_unchanged_arm_and_another_one(files: Files, known: str) -> None:
    history = ["--history", "h.ndjson"]
    said = run("monitor", known, "--on", files.six_fresh, *history, "--date", "monday").stderr
    assert "no drift is seen" in said
    assert "wrote h.ndjson: 1 check" in said
    run("simulate", "fanuc-m1000ia", "-n", 5, "--seed", 9, "-o", "other.h5")
    found = answer("monitor", known, "--on", "other.h5", *history, "--chart", "h.svg", code=5)
    assert found["alarm"]
    assert found["likely"]
    lines = [json.loads(line) for line in Path("h.ndjson").read_text().splitlines()]
    assert [line["alarm"] for line in lines] == [False, True]
    assert lines[0]["date"] == "monday"
    assert lines[1] == found
    assert "<svg" in Path("h.svg").read_text()
    last = run("monitor", known, "--on", "other.h5", code=5).stderr.splitlines()[-1]
    assert last.startswith("drift: ")


def test_wrong_usage(files: Files, known: str) -> None:
    check = ["monitor", known, "--on", files.six_fresh]
    assert "--false-alarm" in refused(2, *check, "--false-alarm", "0")
    assert "--history" in refused(2, *check, "--chart", "h.svg")
    Path("other.txt").write_text("mine\n{}\n")
    assert "history" in refused(3, *check, "--history", "other.txt")
    assert Path("other.txt").read_text() == "mine\n{}\n"
    assert "kinematics differ" in refused(3, "monitor", known, "--on", files.fresh)
