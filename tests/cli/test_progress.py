"""What stderr reports while something runs: a first line and progress on a terminal only, more with
-v, less with -q.
"""

import os
import pty
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from commandline import COMMANDS, ENVIRONMENT, Files, only_line, refused, run

from calibtool.__main__ import DOING, first_line

ERASE = "\x1b[2K"


def on_terminal(*arguments: str) -> tuple[str, int]:
    """What a command writes to stderr when that is a terminal, and its exit code."""
    parent, child = pty.openpty()
    environment = {**ENVIRONMENT, "TERM": "xterm", "COLUMNS": "100"}
    command = [sys.executable, "-m", "calibtool", *arguments]
    with subprocess.Popen(
        command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=child
    ) as process:
        os.close(child)
        said = b""
        while True:
            try:
                part = os.read(parent, 65536)
            except OSError:  # Linux: the other end is closed
                break
            if not part:
                break
            said += part
    os.close(parent)
    return said.decode(), process.returncode


@pytest.fixture(scope="module")
def trained(files: Files, tmp_path_factory: pytest.TempPathFactory) -> str:
    output = tmp_path_factory.mktemp("terminal") / "c.h5"
    base = ["--base", "local-poe", "--regularisation", "bayes", "--folds", "2", "--restarts", "2"]
    said, code = on_terminal("train", files.measurements, *base, "-o", str(output))
    assert code == 0, said
    return said


def test_the_first_line_comes_before_everything_else(trained: str, files: Files) -> None:
    assert trained.splitlines()[0] == f"training on {files.measurements} …"


def test_progress_is_shown_on_a_terminal_and_goes_without_a_trace(trained: str) -> None:
    assert "training on 40 configurations" in trained
    assert "of 2 folds" in trained
    assert ERASE in trained
    left = trained.split(ERASE)[-1]  # what stays below the first line
    assert "folds" not in left
    assert "local-poe model of planar-3r, 40 configurations" in left


def test_nothing_of_it_elsewhere(files: Files) -> None:
    result = run(
        "train",
        files.measurements,
        "--base",
        "local-poe",
        "--restarts",
        1,
        "--folds",
        2,
        "-o",
        "c.h5",
    )
    assert "training on" not in result.stderr
    assert "\x1b" not in result.stderr


@pytest.mark.parametrize("place", [0, -1])
def test_quiet_leaves_warnings_and_errors(files: Files, place: int) -> None:
    words = ["identify", files.measurements, "-o", "c.h5"]
    loud = run(*words, "--force").stderr.splitlines()
    words.insert(0 if place == 0 else len(words), "--quiet")
    lines = run(*words, "--force").stderr.splitlines()
    assert lines == [line for line in loud if line.startswith("warning")]
    assert len(lines) < len(loud)
    assert "no such file" in refused(2, "-q", "identify", "nothing.h5")


def test_quiet_keeps_the_rows_that_have_no_joints(files: Files) -> None:
    Path("far.csv").write_text("x_mm,y_mm,z_mm,qw,qx,qy,qz\n99999,0,0,1,0,0,0\n")
    said = run(
        "compensate",
        files.six_network,
        "far.csv",
        "-q",
        "--joint-values",
        "serial",
        "-o",
        "out.csv",
        code=4,
    ).stderr
    assert "unreachable" in said.splitlines()[0]


def test_quiet_is_quiet_on_a_terminal(files: Files, here: Path) -> None:
    said, code = on_terminal(
        "-q", "identify", files.measurements, "--model", "local-poe", "-o", "c.h5"
    )
    assert (said, code) == ("", 0)


def test_verbose_states_what_is_done_and_how_long_it_took(files: Files) -> None:
    said = run(
        "train",
        files.measurements,
        "--base",
        "local-poe",
        "--folds",
        2,
        "--restarts",
        1,
        "-v",
        "-o",
        "c.h5",
    ).stderr
    for part in (
        "measurements.h5: ",
        " bytes read",
        "2 folds: ",
        "training on 40 configurations: ",
        " bytes written",
    ):
        assert part in said
    assert said.splitlines()[-1].endswith(" s  done")


def test_the_switches_change_no_byte(files: Files) -> None:
    for name, switches in (("a", []), ("b", ["-v"]), ("c", ["--quiet"])):
        run("identify", files.measurements, "-o", f"{name}.h5", *switches)
    assert Path("a.h5").read_bytes() == Path("b.h5").read_bytes() == Path("c.h5").read_bytes()


def test_quiet_and_verbose_contradict_each_other() -> None:
    result = run("robots", "-q", "--verbose", code=2)
    assert only_line(result.stderr) == "--quiet and --verbose contradict each other; give one"


def test_a_first_line_for_every_command_that_may_take_longer() -> None:
    assert set(COMMANDS) - {"robots", "info", "guide"} <= set(DOING)
    assert first_line(["train", "m.h5", "--base", "nominal"]) == "training on m.h5 …"
    assert first_line(["-v", "train", "-"]) == "training on stdin …"
    assert first_line(["train", "--base", "nominal", "m.h5"]) == "training …"
    assert first_line(["demo", "-o", "x"]) == "running the demo …"
    for silent in ([], ["robots"], ["train", "m.h5", "-q"], ["train", "--help"], ["tarin", "m.h5"]):
        assert first_line(silent) is None


def test_the_first_line_needs_no_import() -> None:
    """Everything that takes time is imported after it."""
    code = "import sys, calibtool.__main__; print('typer' in sys.modules, 'numpy' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, env=ENVIRONMENT, text=True, check=True
    )
    assert done.stdout.split() == ["False", "False"]


def test_ctrl_c_before_the_command_line_is_loaded_ends_without_a_word() -> None:
    """The import of the command line is where Ctrl-C meets Python's own handler."""
    code = """
import sys
from calibtool.__main__ import main
class Interrupted:
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[1]:
            raise KeyboardInterrupt if name == "calibtool.cli" else ZeroDivisionError
sys.meta_path.insert(0, Interrupted())
main()
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        [*command, "calibtool.cli"], capture_output=True, env=ENVIRONMENT, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, b"", b"")
    done = subprocess.run(
        [*command, "calibtool.cli.app"], capture_output=True, env=ENVIRONMENT, check=False
    )
    assert done.returncode == 1
    assert b"ZeroDivisionError" in done.stderr  # what is no interrupt is told
