"""calibtool compensate as a stream: another program talks to it, JSON lines, nothing half
written, verification.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from commandline import ENVIRONMENT, Files, refused, run, shell, write_table

PLANAR = ["j1_deg", "j2_deg", "j3_deg"]


def test_a_program_asks_and_is_answered_row_by_row(files: Files) -> None:
    command = [sys.executable, "-m", "calibtool", "compensate", files.network, "--line-buffered"]
    with subprocess.Popen(
        command, env=ENVIRONMENT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write("j1_deg,j2_deg,j3_deg\n")
        answers = []
        for angle in (10, 20, 30):
            process.stdin.write(f"{angle},20,30\n")
            process.stdin.flush()
            if not answers:
                assert process.stdout.readline().startswith("j1_deg,j2_deg,j3_deg,status")
            answers.append(process.stdout.readline())  # hangs if rows are held back
        process.stdin.close()
        assert process.wait(timeout=60) == 0
    for answer, angle in zip(answers, (10, 20, 30), strict=True):
        assert abs(float(answer.split(",")[0]) - angle) < 1.0


def test_json_lines_are_recognised(files: Files) -> None:
    text = "".join(
        json.dumps({"j1_deg": a, "j2_deg": 20, "j3_deg": 30, "note": "x"}) + "\n" for a in (10, 20)
    )
    found = [
        json.loads(line)
        for line in run("compensate", files.network, stdin=text).stdout.splitlines()
    ]
    write_table("t.csv", PLANAR, [[10, 20, 30], [20, 20, 30]])
    rows = run("compensate", files.network, "t.csv").stdout.splitlines()[1:]
    for answer, row in zip(found, rows, strict=True):
        assert [answer[name] for name in PLANAR] == pytest.approx(
            [float(cell) for cell in row.split(",")[:3]]
        )
        assert answer["note"] == "x"


def test_a_bad_row_far_down_leaves_no_file(files: Files) -> None:
    write_table("t.csv", PLANAR, [[10, 20, 30]] * 5000 + [[10, "n/a", 30]])
    line = refused(3, "compensate", files.network, "t.csv", "-o", "out.csv")
    assert line.startswith("t.csv:5002: column 'j2_deg' holds 'n/a'")


def test_a_reader_that_goes_away_ends_it_quietly(files: Files) -> None:
    write_table("t.csv", PLANAR, [[10, 20, 30]] * 50_000)
    result = shell(
        f"calibtool compensate {files.network} t.csv | head -2 > two.csv; echo ${{PIPESTATUS[0]}}",
        Path.cwd(),
    )
    assert len(Path("two.csv").read_text().splitlines()) == 2
    assert b"Traceback" not in result.stderr


def test_verification_reports_what_the_model_leaves(files: Files) -> None:
    write_table("t.csv", PLANAR, [[10, 20, 30], [20, 30, 40]])
    result = run("compensate", files.network, "t.csv", "--verify")
    assert result.stdout.splitlines()[0].endswith("status,left_mm,left_mrad")
    bounds, verified = result.stderr.splitlines()
    assert bounds.startswith("limit of the change of a joint: ")
    assert verified.startswith("2 rows verified: the calibrated model stays within ")


def test_an_unknown_format_is_refused(files: Files) -> None:
    write_table("t.csv", PLANAR, [[10, 20, 30]])
    assert "--format" in refused(2, "compensate", files.network, "t.csv", "--format", "cvs")
