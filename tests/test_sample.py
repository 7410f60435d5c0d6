"""The sample of the pages: made again, byte for byte, and small."""

import re
import runpy
from pathlib import Path

SAMPLE = Path(__file__).resolve().parent.parent / "data" / "sample"


def test_the_sample_is_what_its_script_makes() -> None:
    made = runpy.run_path(str(SAMPLE / "make.py"))["files"]()
    assert {path.name for path in SAMPLE.iterdir() if path.is_file()} == {
        *made,
        "make.py",
        "driven.csv",
    }
    for name, text in made.items():
        assert (SAMPLE / name).read_bytes() == text.encode(), name


def test_the_sample_is_small() -> None:
    assert sum(path.stat().st_size for path in SAMPLE.iterdir() if path.is_file()) < 200_000


def test_the_page_of_the_proof_simulates_the_arm_of_the_sample() -> None:
    """`--errors` of docs/how-to/prove-it.md are those of the script."""
    page = SAMPLE.parents[1] / "docs" / "how-to" / "prove-it.md"
    script = runpy.run_path(str(SAMPLE / "make.py"))
    found = re.findall(
        r"simulate (\S+) --seed (\d+) --unregistered .*\\\n +--errors (\S+)", page.read_text()
    )
    assert found == [(script["ROBOT"], str(script["SEED"]), ",".join(script["KINDS"]))]
