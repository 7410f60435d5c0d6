"""Peers in processes of their own, so that none disturbs another, and a line for each that
is not installed.
"""

import argparse
import subprocess
import sys
from collections.abc import Sequence

REQUIREMENTS = "benchmarks/peers/requirements.txt"
WITH_NUMPY_1 = "benchmarks/peers/requirements-numpy1.txt"


class PeerError(Exception):
    """A peer that could not be compared; the message is the line for the table."""


class Interpreters(dict[str, str]):
    """The Python interpreter of a package that has one of its own; of the others, this one."""

    def __missing__(self, package: str) -> str:
        return sys.executable


def add_interpreters(parser: argparse.ArgumentParser) -> None:
    """`--python PACKAGE=PYTHON`, see `interpreters`."""
    parser.add_argument(
        "--python",
        metavar="PACKAGE=PYTHON",
        type=_pair,
        action="append",
        default=[],
        help="The interpreter in which this package is installed, if not this one; repeatable.",
    )


def _pair(text: str) -> tuple[str, str]:
    package, _, python = text.partition("=")
    if not (package and python):
        raise argparse.ArgumentTypeError("expected PACKAGE=PYTHON")
    return package, python


def interpreters(options: argparse.Namespace) -> Interpreters:
    """Those that were given."""
    return Interpreters(options.python)


def require(package: str, python: str = sys.executable) -> None:
    """PeerError when a package is not installed in an interpreter; it is looked for, not
    imported.
    """
    look = f"import importlib.util as u, sys; sys.exit(u.find_spec({package!r}) is None)"
    try:
        missing = subprocess.run([python, "-c", look], check=False).returncode
    except OSError as error:
        raise PeerError(f"skipped: {package}: no interpreter: {error.strerror}") from error
    if missing:
        file = WITH_NUMPY_1 if package in ("pybotics", "robotkinecal") else REQUIREMENTS
        raise PeerError(f"skipped: {package} is not installed (pip install -r {file})")


def output(arguments: Sequence[str], python: str = sys.executable) -> str:
    """stdout of an interpreter with `arguments`.

    PeerError with the last line of stderr when it fails.
    """
    done = subprocess.run([python, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["no message"]
        raise PeerError(f"failed: {lines[-1][:200]}")
    return done.stdout
