"""What nobody expected: one line and exit code 1 all the same, everything about it with --debug."""

import errno
import os

import pytest
from commandline import only_line, refused, run

import calibtool.robot.catalogue
from calibtool.errors import InputError


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """`calibtool robots` meets the exception that is the test's parameter."""

    def fail() -> None:
        raise request.param

    monkeypatch.setattr(calibtool.robot.catalogue, "robot_names", fail)


@pytest.mark.parametrize(
    ("failing", "line"),
    [
        (MemoryError(), "out of memory; use fewer configurations at a time"),
        (
            OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)),
            "standard streams: No space left on device",
        ),
        (OSError(errno.EIO, os.strerror(errno.EIO), "x.h5"), "x.h5: Input/output error"),
    ],
    indirect=["failing"],
)
@pytest.mark.usefixtures("failing")
def test_what_the_system_refuses_is_reported(line: str) -> None:
    assert refused(1, "robots") == line


@pytest.mark.parametrize("failing", [ZeroDivisionError("a\nb")], indirect=True)
@pytest.mark.usefixtures("failing")
def test_a_bug_is_one_line_that_asks_for_a_report() -> None:
    line = run("robots", code=1).stderr
    assert (
        line == "unexpected ZeroDivisionError: a b; please report it with the output of --debug\n"
    )
    assert isinstance(run("--debug", "robots", code=1).exception, ZeroDivisionError)


@pytest.mark.parametrize("failing", [InputError("x.toml: wrong")], indirect=True)
@pytest.mark.usefixtures("failing")
def test_debug_shows_where_an_error_comes_from() -> None:
    assert only_line(run("robots", code=3).stderr) == "x.toml: wrong"
    shown = run("--debug", "robots", code=3).stderr
    assert shown.startswith("Traceback")
    assert shown.endswith("x.toml: wrong\n")
