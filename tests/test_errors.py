"""A message is one line of printable characters, whatever words of a file are in it, and
nothing of it is lost.
"""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibtool.errors import (
    AcceptanceError,
    CalibtoolError,
    InputError,
    NoSolutionError,
    UsageError,
    near_names,
    printable,
)

EVERY = (CalibtoolError, UsageError, InputError, NoSolutionError, AcceptanceError)


@given(st.text())
def test_whatever_a_file_states_is_printed_in_one_printable_line(text: str) -> None:
    for kind in EVERY:
        message = str(kind(text))
        assert message.isprintable()
        assert len(message.splitlines()) <= 1


@given(st.text(st.characters(codec="ascii", exclude_characters="\\")))
def test_escapes_tell_what_was_there(text: str) -> None:
    assert printable(text).encode("ascii").decode("unicode_escape") == text


@pytest.mark.parametrize("text", ["", "c.h5: 3 µm, δρ̂ ≥ 0.1°", "größe.csv:2", "ロボット"])
def test_what_is_printable_is_left_alone(text: str) -> None:
    assert printable(text) == text


def test_every_kind_has_an_exit_code_of_its_own() -> None:
    assert len({kind.exit_code for kind in EVERY}) == len(EVERY)


@pytest.mark.parametrize(
    ("name", "known", "end"),
    [
        ("kuka", ["abb-irb120", "kuka-a", "kuka-b", "ur5"], "did you mean kuka-a or kuka-b?"),
        ("UR", ["ur5", "ur3", "xarm7"], "did you mean ur5 or ur3?"),
        ("--on", ["--html", "--port", "--frame"], "known: --html, --port, --frame"),
        ("--no-gravty", ["--harmonics", "--no-gravity"], "did you mean --no-gravity?"),
        ("UR5", ["ur5", "ur5e"], "did you mean ur5?"),
        ("xyz", ["ur5", "ur3"], "known: ur5, ur3"),
    ],
)
def test_near_names_begin_alike_or_are_spelled_alike(name: str, known: list[str], end: str) -> None:
    assert near_names(name, known) == end
