"""The command line: modules parse options, call one library function, and write the result."""

import os
import sys

from calibtool.cli.interrupts import leaving_at_once

# Matrices here are small: threads of the linear algebra only slow each other down. Before
# numpy is imported.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

with leaving_at_once():  # this import takes long enough for a Ctrl-C
    from calibtool.cli.app import app

__all__ = ["app", "main"]


def main() -> None:
    """Entry point of the console script."""
    with leaving_at_once():
        import logging

        _occupy_closed_streams()
        logging.getLogger("matplotlib").setLevel(
            logging.ERROR
        )  # no place for its cache: nothing that people need to know
        app(prog_name="calibtool")


def _occupy_closed_streams() -> None:
    """A closed stdin is empty, a closed stderr silent, and a closed stdout an error later; no file
    gets their numbers.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number
    if sys.stdin is None:
        sys.stdin = open(os.devnull, encoding="utf-8")  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
