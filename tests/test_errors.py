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
