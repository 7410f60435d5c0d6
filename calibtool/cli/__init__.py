"""The command line: every module parses, calls one library function, and writes."""

import os

# Matrices here are small: threads of the linear algebra only get into each other's way. Before numpy is imported.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from calibtool.cli.app import app  # noqa: E402

__all__ = ["app", "main"]


def main() -> None:
    """Entry point of the console script."""
    app(prog_name="calibtool")
