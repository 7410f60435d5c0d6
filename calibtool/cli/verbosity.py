"""Verbosity of stderr: -q only warnings and errors, -v also the steps and their durations."""

import os
import sys
from time import perf_counter

from calibtool.errors import UsageError, printable

_QUIET, _VERBOSE = ("-q", "--quiet"), ("-v", "--verbose")
SWITCHES = (*_QUIET, *_VERBOSE, "--debug")

_level = 0
_start = perf_counter()


def take_switches(arguments: list[str]) -> list[str]:
    """The arguments without the switches that every command understands, before and after it."""
    global _level, _start
    _start = perf_counter()
    _level = 0
    end = arguments.index("--") if "--" in arguments else len(arguments)
    given = [argument for argument in arguments[:end] if argument in SWITCHES]
    quiet, verbose = any(name in given for name in _QUIET), any(name in given for name in _VERBOSE)
    if quiet and verbose:
        raise UsageError("--quiet and --verbose contradict each other; give one")
    _level = verbose - quiet
    return [argument for argument in arguments[:end] if argument not in SWITCHES] + arguments[end:]


def is_quiet() -> bool:
    """Whether only warnings and errors are wanted."""
    return _level < 0


def seconds() -> float:
    """Since the command began."""
    return perf_counter() - _start


def tell(lines: list[str]) -> None:
    """Lines on stderr; when stderr is closed, this and all later lines are dropped."""
    try:
        print("\n".join(lines), file=sys.stderr, flush=True)  # noqa: T201
    except OSError:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


def detail(text: str) -> None:
    """A line for --verbose, on stderr, with the time since the command began."""
    if _level > 0:
        tell([f"{seconds():7.2f} s  {printable(text)}"])
