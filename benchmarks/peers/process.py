"""Peers in processes of their own, so that none disturbs another, and a line for each that
is not installed.
"""

import importlib.util
import subprocess
import sys
from collections.abc import Sequence

REQUIREMENTS = "benchmarks/peers/requirements.txt"


class PeerError(Exception):
    """A peer that could not be compared; the message is the line for the table."""


def require(package: str) -> None:
    """PeerError when a package is not installed in this interpreter; it is looked
    for, not imported.
    """
    if importlib.util.find_spec(package) is None:
        raise PeerError(f"skipped: {package} is not installed (pip install -r {REQUIREMENTS})")


def output(arguments: Sequence[str]) -> str:
    """stdout of this interpreter with `arguments`.

    PeerError with the last line of stderr when it fails.
    """
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["no message"]
        raise PeerError(f"failed: {lines[-1][:200]}")
    return done.stdout
