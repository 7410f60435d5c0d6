"""Every failure that a user can meet, with its exit code.

A message is one line: place, what is wrong, remedy.
"""

from collections.abc import Iterable
from difflib import get_close_matches
from math import inf
from numbers import Integral

_BEGINNING = 2  # number of characters by which the beginning of a name is recognised


def printable(text: str) -> str:
    """The text with escapes for unprintable characters, which could move a terminal's cursor."""
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text
    )


class CalibtoolError(Exception):
    """Root of all failures that calibtool foresees.

    The message is made one line of printable characters.
    """

    exit_code = 1

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class UsageError(CalibtoolError):
    """The command or call is wrong: an unknown name, options that contradict each other."""

    exit_code = 2


class InputError(CalibtoolError):
    """The data are bad: a cell, a file, a description."""

    exit_code = 3


class NoSolutionError(CalibtoolError):
    """The data are in order but there is no answer: not converged, not observable, unreachable."""

    exit_code = 4


class AcceptanceError(CalibtoolError):
    """The answer does not meet a limit that the user set."""

    exit_code = 5


def near_names(name: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown name: the near names, or all when none is near.

    Near are names that begin with it, otherwise those that are spelled alike. Upper and lower case
    and the dashes of options do not count.
    """
    names = list(known)
    plain = [other.casefold().lstrip("-") for other in names]
    wanted = name.casefold().lstrip("-")
    if wanted in plain:
        return f"did you mean {names[plain.index(wanted)]}?"
    near = [other for other, text in zip(names, plain, strict=True) if text.startswith(wanted)]
    if len(wanted) < _BEGINNING or not near:
        alike = get_close_matches(wanted, plain, n=3, cutoff=0.6)
        near = [names[plain.index(match)] for match in alike]
    if not near:
        return f"known: {', '.join(names)}"
    *others, last = dict.fromkeys(near)
    listed = f"{', '.join(others)} or {last}" if others else last
    return f"did you mean {listed}?"


def check_choice(value: str, allowed: Iterable[str], what: str) -> None:
    """UsageError with near names unless `value` is allowed."""
    names = list(allowed)
    if value not in names:
        raise UsageError(f"{what}: unknown '{value}'; {near_names(str(value), names)}")


def check_whole(value: int, what: str, least: int) -> None:
    """UsageError unless value is a whole number of at least `least`."""
    if not isinstance(value, Integral):
        raise UsageError(f"{what}: {value!r} is no whole number")
    check_number(int(value), what, least)


def check_number(value: float, what: str, least: float, below: float = inf) -> None:
    """UsageError unless least ≤ value < below."""
    if not least <= value < below:
        bounds = (
            f"at least {least:g}" if below == inf else f"at least {least:g} and less than {below:g}"
        )
        raise UsageError(f"{what}: {value} is not possible; expected {bounds}")
