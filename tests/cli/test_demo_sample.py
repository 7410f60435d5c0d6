"""The sample of `demo --sample`: its files, and what the checks on import say of them. What the
pages do with it is tested by tests/test_pages.py.
"""

from pathlib import Path

import pytest
from commandline import refused, remarks, run


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
