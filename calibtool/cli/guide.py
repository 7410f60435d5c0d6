"""calibtool guide: a guided session that prints the commands that do the same."""

import shlex
import subprocess
import sys
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Annotated

import typer

from calibtool.cli.files import message
from calibtool.cli.options import choice
from calibtool.errors import CalibtoolError, UsageError

_SAMPLE = "sample"
_TRIES = 3  # number of wrong answers to a question after which the session ends
_CORRECT = "Correct the header or give a column map (docs/file-formats.md), then begin again."


def guide(
    folder: Annotated[
        str,
        typer.Option("-o", "--output", metavar="DIR", help="Folder for the files of the session."),
    ] = "guided",
) -> None:
    """Be guided from measurements to a corrected program.

    Asks for robot, file and limits, with a default for everything (press Enter), and runs the
    commands one after another: import, train, evaluate, report, compensate. Every command is
    printed before it runs, so that the session can be repeated without questions. Needs a terminal;
    nothing moves the arm.

    Example: calibtool guide -o cell-4
    """
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise UsageError(
            "guide asks questions and needs a terminal; scripts use the commands that it prints, "
            "see docs/get-started.md"
        )
    Path(folder).mkdir(parents=True, exist_ok=True)
    session(Path(folder), asked, performed)


def session(
    folder: Path, ask: Callable[[str, str], str], perform: Callable[[list[str]], int]
) -> None:
    """The session; ask(question, default) returns the answer, perform runs `calibtool ARGUMENTS`
    and returns its exit code.
    """
    measured, rest = str(folder / "measurements.h5"), str(folder / "rest.h5")
    calibration = str(folder / "calibration.h5")
    message("Enter takes the answer in brackets. Ctrl-C ends the session; what is written stays.")
    table = _accepted(
        ask, "table of measurements, or 'sample' for a file to try", _SAMPLE, _check_table
    )
    joint_values: list[str] = []
    robot_default, program = "ur10", ""
    if table == _SAMPLE:
        where = folder / _SAMPLE
        if not where.is_dir():
            perform(["demo", "--sample", "-o", str(where)])
        table, robot_default = str(where / "tracker.csv"), "fanuc-m1000ia"
        program = str(where / "seam.ls")
    robot = _accepted(
        ask,
        "robot: a built-in name (calibtool robots lists them), or a file",
        robot_default,
        _counts_its_own,
    )
    if _counts_its_own(robot):
        whose = _accepted(
            ask,
            "joint values of the table: serial or controller",
            "controller",
            lambda answer: choice(answer, ("serial", "controller"), "joint values"),
        )
        joint_values = ["--joint-values", whose]
    message("How the table is understood:")
    read = ["import", table, "--robot", robot, *joint_values]
    if perform([*read, "--dry-run"]) != 0:
        return message(_CORRECT)
    if ask("is that what you measured? yes or no", "yes").lower().startswith("n"):
        return message(_CORRECT)
    total = _count(table)
    part = _accepted(
        ask, "rows for the fit; the others judge it", "75%", lambda answer: _rows(answer, total)
    )
    count = _rows(part, total)
    split = ["--sample", str(count), "--rest", rest, "-o", measured, "--force"]
    if perform([*read, *split]) != 0:
        return message("The measurements are not usable yet: the line above says why.")
    message("Finding the errors of the robot:")
    if perform(["train", measured, "-o", calibration, "--force"]) != 0:
        return message("No calibration was found: the line above says why.")
    limit = _accepted(ask, "largest position error that is allowed, mm", "0.5", _check_number)
    judged = [calibration, "--on", rest, "--require", f"position_max_mm={limit}"]
    met = perform(["evaluate", *judged]) == 0
    perform(["report", *judged, "-o", str(folder / "report.html"), "--force"])
    message(
        "The limit is met on rows that the fit has not seen."
        if met
        else "The limit is not met: measure more rows, or look at the report."
    )
    program = _accepted(ask, "program or targets to correct (empty: none)", program, _check_program)
    if program:
        corrected = str(folder / f"corrected{Path(program).suffix}")
        perform(["compensate", calibration, program, "-o", corrected, "--force"])
    message(f"Everything is in {folder}. Next: prove it on the arm (docs/how-to/prove-it.md).")
    return None


def _accepted(
    ask: Callable[[str, str], str], question: str, default: str, check: Callable[[str], object]
) -> str:
    """The answer to a question; one that `check` refuses is asked again, up to three times."""
    for remaining in reversed(range(_TRIES)):
        answer = ask(question, default)
        try:
            check(answer)
            break
        except CalibtoolError as error:
            if not remaining:
                raise
            message(str(error))
    return answer


def _check_table(answer: str) -> None:
    if answer != _SAMPLE:
        _check_program(answer)


def _check_program(answer: str) -> None:
    if answer and not Path(answer).is_file():
        raise UsageError(f"{answer}: no such file")


def _check_number(answer: str) -> None:
    try:
        number = float(answer)
    except ValueError:
        number = 0.0
    if not 0.0 < number < inf:
        raise UsageError(f"'{answer}' is not a length; expected a number above 0, such as 0.5")


def asked(question: str, default: str) -> str:
    """The answer of the person at the terminal."""
    print(f"{question} [{default}]: ", end="", file=sys.stderr, flush=True)  # noqa: T201
    answer = sys.stdin.readline()
    if not answer:
        raise KeyboardInterrupt
    return answer.strip() or default


def performed(arguments: list[str]) -> int:
    """Print a command and run it, as a process of its own."""
    message(f"\n$ {shlex.join(['calibtool', *arguments])}".strip())
    return subprocess.run([sys.executable, "-m", "calibtool", *arguments], check=False).returncode


def _counts_its_own(robot: str) -> bool:
    from calibtool.robot.catalogue import load_robot

    return load_robot(robot).coupled


def _count(table: str) -> int:
    """About how many rows a table has."""
    with open(table, "rb") as stream:
        return max(sum(1 for line in stream if line.strip()) - 1, 2)


def _rows(part: str, count: int) -> int:
    """Rows of an answer such as 75% or 45, at least one and not all. UsageError otherwise."""
    text = part.strip()
    try:
        value = float(text.rstrip("%"))
    except ValueError:
        raise UsageError(f"'{part}' is no number of rows; expected 45 or 75%") from None
    rows = round(count * value / 100) if text.endswith("%") else round(value)
    if not 1 <= rows < count:
        raise UsageError(f"{part} of {count} rows; expected at least 1, and fewer than all")
    return rows
