"""calibtool guide: asks, prints every command, and does what these commands do."""

import os
import pty
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from commandline import ENVIRONMENT, refused, run

from calibtool.cli.guide import session
from calibtool.errors import UsageError


def test_it_refuses_without_a_terminal() -> None:
    assert "needs a terminal" in refused(2, "guide")


def scripted(answers: dict[str, str]) -> tuple[list[list[str]], list[str]]:
    """The commands of a session in this process, and its questions; other answers are defaults."""
    done: list[list[str]] = []
    questions: list[str] = []

    def ask(question: str, default: str) -> str:
        questions.append(question)
        return next((a for start, a in answers.items() if question.startswith(start)), default)

    def perform(arguments: list[str]) -> int:
        done.append(arguments)
        run(*arguments)
        return 0

    Path("guided").mkdir(exist_ok=True)
    session(Path("guided"), ask, perform)
    return done, questions


def test_defaults_lead_to_a_corrected_program() -> None:
    done, _ = scripted({})
    assert [words[0] for words in done] == [
        "demo",
        "import",
        "import",
        "train",
        "evaluate",
        "report",
        "compensate",
    ]
    assert Path("guided/corrected.ls").read_text() != Path("guided/sample/seam.ls").read_text()
    assert "45" in done[2]


def test_no_ends_the_session_and_wrong_answers_are_refused() -> None:
    done, questions = scripted({"is that": "no"})
    assert [words[0] for words in done] == ["demo", "import"]
    assert len(questions) == 4
    with pytest.raises(UsageError, match="no such file"):
        scripted({"table": "nothing.csv"})
    with pytest.raises(UsageError, match="fewer than all"):
        scripted({"rows": "200%"})


def test_an_answer_that_cannot_be_used_is_asked_again() -> None:
    answers = iter(
        ["nothing.csv", "sample", "fanuk-m1000ia", "fanuc-m1000ia", "mine", "serial", "no"]
    )
    asked: list[str] = []

    def ask(question: str, default: str) -> str:
        asked.append(question.split()[0])
        return next(answers)

    Path("guided").mkdir()
    session(Path("guided"), ask, lambda arguments: run(*arguments).exit_code)
    assert asked == ["table", "table", "robot:", "robot:", "joint", "joint", "is"]


def test_on_a_terminal_it_prints_commands_that_can_be_repeated(here: Path) -> None:
    parent, child = pty.openpty()
    answers = b"\n\n\n\n\n\n\n\n"
    command = [sys.executable, "-m", "calibtool", "guide"]
    environment = {**ENVIRONMENT, "TERM": "dumb", "COLUMNS": "300"}
    with subprocess.Popen(
        command, env=environment, stdin=child, stdout=subprocess.DEVNULL, stderr=child
    ) as process:
        os.close(child)
        os.write(parent, answers)
        said = b""
        while True:
            try:
                part = os.read(parent, 65536)
            except OSError:
                break
            if not part:
                break
            said += part
    os.close(parent)
    assert process.returncode == 0, said.decode()
    printed = re.findall(r"\$ (calibtool .*?)\r?\n", said.decode())
    assert [shlex.split(line)[1] for line in printed][-1] == "compensate"
    assert "wrote guided/corrected.ls" in said.decode()
