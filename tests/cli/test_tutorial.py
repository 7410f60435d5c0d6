"""Every command of docs/tutorial.md, through a real shell, from an empty directory with the data
that come along.
"""

import re
from pathlib import Path

import pytest
from commandline import refused, remarks, run, shell

TUTORIAL = Path(__file__).resolve().parents[2] / "docs" / "tutorial.md"


def commands() -> str:
    blocks = re.findall(r"```sh\n(.*?)```", TUTORIAL.read_text("utf-8"), re.DOTALL)
    assert len(blocks) == 13
    return "\n".join(blocks)


def mean_of(table: str, method: str) -> float:
    """The mean position error of a method in the last table of evaluate that names it."""
    positions = [part.partition("orientation")[0] for part in table.split("position error, mm")]
    found = re.findall(rf"^\s*{method}\s+([0-9.]+)", "".join(positions[1:]), re.MULTILINE)
    return float(found[-1])


def test_the_tutorial_runs_and_states_what_is_true(here: Path) -> None:
    done = shell("set -e\n" + commands(), here, timeout=600)
    said = done.stderr.decode()
    assert done.returncode == 0, said
    assert re.search(r"nominal robot: 1\.2\d* mm rms", done.stdout.decode())
    first, last = said.split("driven to corrected joints")
    assert 1.1 < mean_of(first, "nominal") < 1.3
    assert 0.08 < mean_of(first, "calibration") < 0.13  # "about 0.1 mm"
    assert 0.015 < mean_of(last, "calibration") < 0.025  # "about 0.02 mm"
    assert mean_of(last, "nominal") > 0.5
    assert re.search(r"warning: 1 row does not fit .*\n  configuration 1: ", said)
    assert re.search(r"─\s+backlash1 +0\.(09|10)", said)  # the clearest
    old, new = (
        Path(name).read_text().splitlines() for name in ("sample/seam.ls", "seam_corrected.ls")
    )
    changed = [line for line, after in zip(old, new, strict=True) if line != after]
    assert len(changed) == 8  # two lines of each of four targets
    assert len(Path("next.csv").read_text().splitlines()) == 1 + 5
    assert Path("corrected.csv").read_text().count(",ok,") == 8


def test_the_sample_goes_into_a_folder_of_its_own(here: Path) -> None:
    run("demo", "--sample", "-o", "s")
    assert sorted(path.name for path in Path("s").iterdir()) == [
        "after.csv",
        "before.csv",
        "driven.csv",
        "seam.ls",
        "targets.csv",
        "tracker.csv",
        "verification.csv",
    ]
    assert "not empty" in refused(2, "demo", "--sample", "-o", "s")


@pytest.mark.parametrize("name", ["tracker.csv", "verification.csv"])
def test_the_sample_gives_no_findings(name: str, here: Path) -> None:
    run("demo", "--sample", "-o", "s")
    result = run(
        "import",
        f"s/{name}",
        "--robot",
        "fanuc-m1000ia",
        "--joint-values",
        "controller",
        "-o",
        "m.h5",
    )
    assert remarks(result) == ""
