"""Known holes in the installed packages, by pip-audit.

Run: python benchmarks/audit.py     (make audit)

Exit code 1 for a hole. Without pip-audit, or where its database is not reached, it says so and
ends with 0: a machine without the internet must be able to run everything else.
"""

import json
import subprocess
import sys

_SECONDS = 300


def main() -> int:
    """Audit the packages of this interpreter."""
    command = [sys.executable, "-m", "pip_audit", "--format", "json", "--progress-spinner", "off"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_SECONDS)
        found = json.loads(done.stdout)["dependencies"]
    except subprocess.TimeoutExpired:
        return skipped(f"pip-audit gave no answer in {_SECONDS} s")
    except (ValueError, KeyError):
        lines = done.stderr.strip().splitlines()
        return skipped(lines[-1][:200] if lines else "pip-audit said nothing")
    holes = [
        f"{package['name']} {package['version']}: {hole['id']}"
        for package in found
        for hole in package.get("vulns", ())
    ]
    print(*(holes or [f"audit: {len(found)} packages, no known hole"]), sep="\n")
    return 1 if holes else 0


def skipped(why: str) -> int:
    print(f"audit: skipped: {why}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
