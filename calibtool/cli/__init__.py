"""The command line: every module parses, calls one library function, and writes."""

from calibtool.cli.app import app

__all__ = ["app", "main"]


def main() -> None:
    """Entry point of the console script."""
    app(prog_name="calibtool")
