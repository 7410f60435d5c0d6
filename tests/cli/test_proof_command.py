"""Measured again after the correction: the sample, limits, and files that do not fit."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from commandline import Files, answer, contents, refused, rows_of, run, stored, write_table

FANUC = ["--robot", "fanuc-m1000ia", "--joint-values", "controller"]
AFTER = ["s/after.csv", "--joints", "s/driven.csv", "--commanded", "s/before.csv", *FANUC]


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample, a calibration c.h5 of it, before.h5 and after.h5."""
    folder = tmp_path_factory.mktemp("sample")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run("demo", "--sample", "-o", "s")
        run("import", "s/tracker.csv", *FANUC, "-o", "m.h5")
        run("identify", "m.h5", "-o", "c.h5")
        run("import", "s/before.csv", *FANUC, "-o", "before.h5")
        run("import", *AFTER, "-o", "after.h5")
    return folder


@pytest.fixture
def there(sample: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(sample)
    return sample


def test_the_sample_was_driven_to_what_compensate_asks_for(there: Path) -> None:
    """To a hundredth of a degree; the file itself is a record, and stays when estimators change."""
    done = run("compensate", "c.h5", "s/before.csv", "--joint-values", "controller")
    names = [f"j{j}_controller_deg" if j == 3 else f"j{j}_deg" for j in range(1, 7)]
    asked = [[float(row[name]) for name in names] for row in rows_of(done.stdout)]
    driven = [
        [float(row[f"j{j}_deg"]) for j in range(1, 7)]
        for row in rows_of(Path("s/driven.csv").read_text())
    ]
    assert np.abs(np.array(asked) - driven).max() < 0.01


def test_before_and_after_are_measured_and_state_so(there: Path) -> None:
    value = answer("evaluate", "c.h5", "--on", "after.h5", "--before", "before.h5")
    assert (value["kind"], value["before"], value["configurations"]) == ("measured", "measured", 30)
    nominal, after = value["methods"]
    assert (nominal["name"], after["name"]) == ("nominal", "c")
    assert 0.9 < nominal["position_mm"]["mean"] < 1.2
    assert after["position_mm"]["mean"] < 0.12
    test = value["iso9283"]
    assert test["poses"] == ["P1", "P2", "P3", "P4", "P5"]
    assert max(test["methods"][1]["ap_mm"]) < 0.1 < 1 < max(test["methods"][0]["ap_mm"])
    assert len(test["rp_mm"]) == len(test["rp_before_mm"]) == 5
    said = run("evaluate", "c.h5", "--on", "after.h5", "--before", "before.h5").stderr
    assert "commanded against measured" in said
    for words in (
        "before, measured",
        "corrected by c",
        "expected, without noise",
        "AP after, measured",
        "RP before",
    ):
        assert words in said, words


def test_without_before_it_is_expected(there: Path) -> None:
    value = answer("evaluate", "c.h5", "--on", "after.h5")
    assert (value["kind"], value["before"]) == ("measured", "expected")
    assert "rp_before_mm" not in value["iso9283"]
    assert value["expected"]["position_mm"]["max"] < 0.02
    said = run("evaluate", "c.h5", "--on", "after.h5").stderr
    assert "expected before correction" in said
    assert "before, measured" not in said


def test_predictions_are_not_called_after(there: Path) -> None:
    run("import", "s/verification.csv", *FANUC, "-o", "v.h5")
    said = " ".join(run("evaluate", "c.h5", "--on", "v.h5").stderr.split())
    assert "expected after correction: measured minus predicted" in said
    run("report", "c.h5", "--on", "v.h5", "-o", "v.html")
    run("report", "c.h5", "--on", "after.h5", "--before", "before.h5", "-o", "p.html")
    predicted, proof = (plain(Path(name).read_text()) for name in ("v.html", "p.html"))
    assert "nominal robot expected after correction change" in predicted
    assert "is to be expected" in predicted
    assert "before, measured after, measured change" in proof
    brought = r"brought the mean position error from 1\.\d+ mm to 0\.\d+ mm, measured on the arm"
    assert re.search(rf"The calibration {brought}", proof)
    assert "RP before the correction" in proof
    assert "after, measured" not in predicted


def plain(page: str) -> str:
    """The words of a page."""
    page = re.sub(r"<(script|style|svg).*?</\1>", "", page, flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))


@pytest.mark.parametrize(
    ("limit", "code"),
    [
        ("position_mean_mm=0.2", 0),
        ("position_mean_mm=0.01", 5),
        ("ap_max_mm=0.2", 0),
        ("ap_max_mm=0.01", 5),
        ("rp_max_mm=1", 0),
        ("rp_mean_mrad=0.001", 5),
        ("ap_mean_mrad=0.5", 0),
    ],
)
def test_limits_judge_what_was_measured_after(there: Path, limit: str, code: int) -> None:
    for command in (["evaluate"], ["report", "-o", "l.html", "--force"]):
        done = run(
            *command[:1], "c.h5", "--on", "after.h5", *command[1:], "--require", limit, code=code
        )
        last = done.stderr.splitlines()[-1]
        assert ("is above the limit" in last) == (code == 5)
    page = plain(Path("l.html").read_text())
    assert ("not met" in page.lower()) == (code == 5)


# --- files that do not fit: one line, exit code 3, nothing written --------------------------------


def changed(source: str, name: str, change: object) -> str:
    """The rows of a table after a change."""
    with Path(source).open() as stream:
        header, *rows = list(csv.reader(stream))
    return write_table(name, header, change(rows))


@pytest.mark.parametrize("option", ["--joints", "--commanded"])
@pytest.mark.parametrize("change", [lambda rows: rows[:-1], lambda rows: [*rows, rows[0]]])
def test_another_number_of_rows(sample: Path, here: Path, option: str, change: object) -> None:
    options = {"--joints": f"{sample}/s/driven.csv", "--commanded": f"{sample}/s/before.csv"}
    options[option] = changed(options[option], "other.csv", change)
    files = [part for pair in options.items() for part in pair]
    line = refused(3, "import", f"{sample}/s/after.csv", *files, *FANUC, "-o", "after.h5")
    assert re.match(r"other\.csv: (29|31) rows, but .*after\.csv has 30 configurations", line)


DRIVEN_TO = {
    "the commands": lambda rows: rows,
    "a row further": lambda rows: [rows[-1], *rows[:-1]],
    "radians": lambda rows: [[f"{np.deg2rad(float(v)):.8f}" for v in row] for row in rows],
}


@pytest.mark.parametrize("wrong", list(DRIVEN_TO))
def test_joints_that_the_calibration_would_not_have_asked_for(
    sample: Path, here: Path, wrong: str
) -> None:
    source = "before.csv" if wrong == "the commands" else "driven.csv"
    joints = changed(f"{sample}/s/{source}", "joints.csv", DRIVEN_TO[wrong])
    files = ["--joints", joints, "--commanded", f"{sample}/s/before.csv"]
    run("import", f"{sample}/s/after.csv", *files, *FANUC, "-o", "after.h5")
    named = [f"{sample}/c.h5", "--on", "after.h5"]
    for command in (
        ["evaluate", *named, "-o", "errors.csv"],
        ["report", *named, "-o", "page.html"],
    ):
        line = refused(3, *command)
        assert re.match(
            r"the measurements: \d+ of 30 rows were driven to other joints than 'c' asks for", line
        )


def test_another_frame_is_another_correction(sample: Path, here: Path) -> None:
    line = refused(
        3, "evaluate", f"{sample}/c.h5", "--on", f"{sample}/after.h5", "--frame", "fitted"
    )
    assert "are calibration, frame and commanded rows those of the correction?" in line


def test_before_must_have_the_same_commands(sample: Path, here: Path) -> None:
    run("import", f"{sample}/s/verification.csv", *FANUC, "-o", "v.h5")
    named = ["evaluate", f"{sample}/c.h5", "--on", f"{sample}/after.h5", "-o", "e.csv", "--before"]
    assert "20 rows before the correction, 30 after it" in refused(3, *named, "v.h5")
    turned = changed(f"{sample}/s/before.csv", "turned.csv", lambda rows: rows[1:] + rows[:1])
    run("import", turned, *FANUC, "-o", "turned.h5")
    assert re.search(r"row 1 was commanded \d+ mm from that row", refused(3, *named, "turned.h5"))
    line = refused(2, "evaluate", f"{sample}/c.h5", "--on", "v.h5", "--before", "v.h5")
    assert "import them with --commanded" in line
    line = refused(2, "evaluate", f"{sample}/c.h5", f"{sample}/c.h5", "--on", f"{sample}/after.h5")
    assert "give its calibration alone" in line


# --- rehearsed in simulation ----------------------------------------------------------------------


def test_a_correction_is_rehearsed_in_simulation(files: Files, here: Path) -> None:
    q = np.rad2deg(stored(files.six_fresh, "measurements/joint_positions"))[:6]
    names = [f"j{j}_serial_deg" if j == 3 else f"j{j}_deg" for j in range(1, 7)]
    write_table("targets.csv", names, q.tolist())
    run("identify", files.six_measurements, "-o", "c.h5")
    run("compensate", "c.h5", "targets.csv", "-o", "corrected.csv")
    same = ["simulate", "fanuc-m1000ia", "--same-robot", files.six_measurements]
    run(*same, "--at", "corrected.csv", "--commanded", "targets.csv", "-o", "after.h5")
    run(*same, "--seed", 1, "--at", "targets.csv", "-o", "before.h5")
    value = answer("evaluate", "c.h5", "--on", "after.h5", "--before", "before.h5")
    nominal, after = value["methods"]
    assert value["kind"] == "measured"
    assert after["position_mm"]["max"] < 0.3 * nominal["position_mm"]["mean"]
    assert answer("info", "after.h5")["commanded"] == "poses, apart from the joints"
    assert answer("info", "before.h5")["commanded"] == "the joints"
    for figure in ("errors", "iso9283"):
        code = 0 if figure == "errors" else 3
        run(
            "plot",
            figure,
            "c.h5",
            "--on",
            "after.h5",
            "--before",
            "before.h5",
            "-o",
            f"{figure}.svg",
            code=code,
        )
    before = contents(here)
    write_table("less.csv", names, q[:5].tolist())
    before = contents(here)
    line = refused(3, *same, "--at", "corrected.csv", "--commanded", "less.csv", "-o", "x.h5")
    assert line == "less.csv: 5 rows, but corrected.csv has 6"
    assert "--commanded belongs to --at" in refused(
        2, *same, "--commanded", "targets.csv", "-o", "x.h5"
    )
    assert contents(here) == before
    assert (
        json.loads(run("evaluate", "c.h5", "--on", "after.h5", "--json", "-o", "e.csv").stdout)[
            "before"
        ]
        == "expected"
    )
    assert len(rows_of(Path("e.csv").read_text())) == 12
