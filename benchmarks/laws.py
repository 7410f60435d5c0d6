"""How many laws the hypothesis suite states, and on how many cases each held.

Run: python benchmarks/laws.py [--quick] [--json]

The full run draws twenty times as many cases as the suite does, new ones every time.
"""

import argparse
import json
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_LAW = re.compile(r"^tests/laws/test_law_(\w+)\.py::(\w+).*:$")
_CASES = re.compile(r"(\d+) passing, (\d+) failing")


def counted(report: str) -> dict[str, dict[str, int]]:
    """Laws, cases and failures by subject, from pytest's report with hypothesis' statistics."""
    found: dict[str, dict[str, int]] = {}
    subject = ""
    for line in report.splitlines():
        if law := _LAW.match(line):
            subject = law[1]
            found.setdefault(subject, {"laws": 0, "cases": 0, "failures": 0})["laws"] += 1
        elif subject and (cases := _CASES.search(line)):
            found[subject]["cases"] += int(cases[1])
            found[subject]["failures"] += int(cases[2])
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description="Laws and cases of the hypothesis suite.")
    parser.add_argument("--quick", action="store_true", help="The cases of the suite.")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    profile = "fixed" if options.quick else "thorough"
    command = [
        sys.executable,
        "-m",
        "pytest",
        "tests/laws",
        "-p",
        "no:cacheprovider",
        "--hypothesis-show-statistics",
    ]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [*command, f"--hypothesis-profile={profile}"],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
    )
    if done.returncode not in (0, 1):
        sys.exit(done.stdout + done.stderr)
    found = counted(done.stdout)
    if options.json:
        print(json.dumps(found))
        return
    print("| laws about | laws | cases | failures |\n|---|---|---|---|")
    for subject, row in found.items():
        print(f"| {subject} | {row['laws']} | {row['cases']} | {row['failures']} |")
    sys.exit(done.returncode)


if __name__ == "__main__":
    main()
