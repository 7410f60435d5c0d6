"""Output files of every command that writes: whole or not at all, never
over another one unasked.
"""

import errno
import os
import pty
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from commandline import (
    ENVIRONMENT,
    Files,
    contents,
    measured_table,
    only_line,
    refused,
    run,
    write_table,
)

# Per command: arguments without the output, and the output's name. `m`, `c` and `t` are
# made by `inputs`.
WRITERS: dict[str, tuple[list[str], str]] = {
    "simulate": (["simulate", "planar-3r", "-n", "5"], "out.h5"),
    "import": (["import", "t.csv", "--robot", "planar-3r"], "out.h5"),
    "identify": (["identify", "m.h5"], "out.h5"),
    "identify --json": (["identify", "m.h5", "--json"], "out.h5"),
    "train": (["train", "m.h5", "--base", "nominal", "--restarts", "1"], "out.h5"),
    "evaluate": (["evaluate", "c.h5", "--on", "m.h5"], "out.csv"),
    "compensate": (["compensate", "c.h5", "targets.csv"], "out.csv"),
    "export json": (["export", "c.h5", "--format", "json"], "out.json"),
    "export c": (["export", "c.h5", "--format", "c"], "out.c"),
    "plot": (["plot", "training", "c.h5"], "out.svg"),
}
each = pytest.mark.parametrize("writer", WRITERS)


@pytest.fixture(autouse=True)
def inputs(files: Files, here: Path) -> None:
    for name, path in (("m.h5", files.measurements), ("c.h5", files.network)):
        (here / name).write_bytes(Path(path).read_bytes())
    measured_table("m.h5", "t.csv")
    write_table("targets.csv", ["j1_deg", "j2_deg", "j3_deg"], [[10, 20, 30]])


def made(action: Callable[[], object]) -> set[str]:
    """Files that an action leaves behind."""
    before = set(contents(Path.cwd()))
    action()
    return set(contents(Path.cwd())) - before


@each
def test_it_writes_its_output_and_nothing_beside(writer: str) -> None:
    arguments, output = WRITERS[writer]
    expected = {output, "out.h"} if writer == "export c" else {output}
    assert made(lambda: run(*arguments, "-o", output)) == expected
    Path("sub").mkdir()
    below = {f"sub/{name}" for name in expected}
    assert made(lambda: run(*arguments, "--output", f"sub/{output}")) == below
    assert Path("sub", output).read_bytes() == Path(output).read_bytes()


@each
def test_an_existing_file_is_kept(writer: str) -> None:
    arguments, output = WRITERS[writer]
    Path(output).write_text("mine")
    message = refused(2, *arguments, "-o", output)
    assert message.startswith(f"{output}: ")
    assert "--force" in message


@each
def test_force_replaces_an_existing_file(writer: str) -> None:
    arguments, output = WRITERS[writer]
    Path(output).write_text("mine" * 100_000)
    Path("sub").mkdir()
    run(*arguments, "-o", output, "--force")
    run(*arguments, "-o", f"sub/{output}", "--force")
    assert Path(output).read_bytes() == Path("sub", output).read_bytes()


@each
def test_the_output_is_checked_before_the_work(writer: str) -> None:
    """Whatever is wrong with the inputs: minutes of work must not end in `exists already`."""
    arguments, output = WRITERS[writer]
    Path(output).write_text("mine")
    for name in ("m.h5", "c.h5", "t.csv", "targets.csv"):
        Path(name).write_bytes(b"not what it should be")
    assert "--force" in refused(2, *arguments, "-o", output)


@each
@pytest.mark.parametrize("folder", ["missing", "missing/below", "t.csv", "t.csv/below"])
def test_a_folder_that_is_not_there(writer: str, folder: str) -> None:
    arguments, output = WRITERS[writer]
    for force in ([], ["--force"]):
        message = refused(2, *arguments, "-o", f"{folder}/{output}", *force)
        assert f"{folder}/{output}" in message
        assert "folder" in message


@each
def test_a_folder_as_output(writer: str) -> None:
    arguments, output = WRITERS[writer]
    Path(output).mkdir()
    for force in ([], ["--force"]):
        message = refused(2, *arguments, "-o", output, *force)
        assert message.startswith(f"{output}: is a folder")


@each
def test_no_name_as_output(writer: str) -> None:
    refused(2, *WRITERS[writer][0], "-o", "")


@each
def test_a_folder_without_permission(writer: str) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    arguments, output = WRITERS[writer]
    Path("locked").mkdir(mode=0o555)
    try:
        assert f"locked/{output}" in refused(2, *arguments, "-o", f"locked/{output}")
    finally:
        Path("locked").chmod(0o755)


@each
@pytest.mark.parametrize("broken", ["replace", "fsync"])
def test_a_failure_while_writing_leaves_everything_as_it_was(
    writer: str, broken: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk, just before the end: one line, no temporary file, the old contents."""

    def fail(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    arguments, output = WRITERS[writer]
    Path(output).write_text("mine")
    monkeypatch.setattr(f"calibtool.atomic_output.os.{broken}", fail)
    before = contents(Path.cwd())
    result = run(*arguments, "-o", output, "--force", code=2)
    assert contents(Path.cwd()) == before
    last = result.stderr.splitlines()[-1]
    assert "cannot be written" in last
    assert os.strerror(errno.ENOSPC) in last


@pytest.mark.parametrize("existing", [[], ["out.c"], ["out.h"], ["out.c", "out.h"]])
def test_c_code_is_written_whole_or_not_at_all(
    existing: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two files: when the second one fails, the first one is as it was before."""
    for name in existing:
        Path(name).write_text("mine")
    replace = os.replace

    def fail(source: str, target: object) -> None:
        if str(target).endswith(".c"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        replace(source, str(target))

    monkeypatch.setattr("calibtool.atomic_output.os.replace", fail)
    refused(2, "export", "c.h5", "--format", "c", "-o", "out.c", "--force")


def test_measurements_and_the_rest_are_written_whole_or_not_at_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The same for the two parts of a table."""
    link = os.link

    def fail(source: str, target: object) -> None:
        if str(target).endswith("rest.h5"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        link(source, str(target))

    monkeypatch.setattr("calibtool.atomic_output.os.link", fail)
    monkeypatch.setattr("calibtool.atomic_output.os.replace", fail)
    message = refused(
        2,
        "import",
        "t.csv",
        "--robot",
        "planar-3r",
        "--sample",
        "30",
        "-o",
        "out.h5",
        "--rest",
        "rest.h5",
    )
    assert message.startswith("rest.h5: ")


def test_permissions_follow_the_umask() -> None:
    before = os.umask(0o027)
    try:
        run("simulate", "planar-3r", "-n", 3, "-o", "a.h5")
    finally:
        os.umask(before)
    assert stat.S_IMODE(Path("a.h5").stat().st_mode) == 0o640


def test_an_input_may_be_replaced_by_the_output() -> None:
    expected = run("compensate", "c.h5", "targets.csv").stdout
    assert "--force" in refused(2, "compensate", "c.h5", "targets.csv", "-o", "targets.csv")
    run("compensate", "c.h5", "targets.csv", "-o", "targets.csv", "--force")
    assert Path("targets.csv").read_text() == expected


@pytest.mark.parametrize("force", [[], ["--force"]])
def test_what_is_no_regular_file_is_never_replaced(force: list[str]) -> None:
    """A named pipe stands for every device: --force as root on the null device must not put a
    file in its place.
    """
    os.mkfifo("pipe")
    held = os.open(
        "pipe", os.O_RDWR | os.O_NONBLOCK
    )  # a reader, so that whoever writes into the pipe is not stopped
    try:
        from typer.testing import CliRunner

        from calibtool.cli import app

        CliRunner().invoke(app, ["simulate", "planar-3r", "-n", "3", "-o", "pipe", *force])
        assert stat.S_ISFIFO(Path("pipe").stat().st_mode)
    finally:
        os.close(held)


# --- a terminal at either end ---------------------------------------------------------------------


def on_a_terminal(stream: str, *arguments: str) -> str:
    """What a command that must be refused says when its stdin or stdout is a terminal."""
    parent, child = pty.openpty()
    streams = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        stream: child,
    }
    command = [sys.executable, "-m", "calibtool", *arguments]
    try:
        done = subprocess.run(command, env=ENVIRONMENT, **streams)
        assert done.returncode == 2
        return only_line(done.stderr.decode())
    finally:
        os.close(child)
        os.close(parent)


def test_nothing_binary_is_written_to_a_terminal() -> None:
    assert "stdout is a terminal; give -o FILE, or a pipe" in on_a_terminal(
        "stdout", "simulate", "planar-3r", "-n", "3"
    )


def test_nobody_types_a_file() -> None:
    assert on_a_terminal("stdin", "info", "-") == "stdin is a terminal; give a file, or pipe one in"


def test_rows_are_not_typed_either(files: Files) -> None:
    assert on_a_terminal("stdin", "compensate", files.paper, "-").startswith("stdin is a terminal")


@pytest.mark.parametrize("writer", ["simulate", "import", "identify", "train", "evaluate"])
@pytest.mark.parametrize("suffix", [".docx", ".json", ".PNG"])
def test_a_suffix_of_another_format_is_refused(writer: str, suffix: str) -> None:
    arguments, output = WRITERS[writer]
    wrong = f"out{suffix}"
    found: list[str] = []
    assert made(lambda: found.append(refused(2, *arguments, "-o", wrong))) == set()
    right = Path(output).suffix
    assert found[0].startswith(
        f"{wrong}: {suffix.lower()} is another format; this output is {right}"
    )


def test_a_suffix_of_no_format_is_taken() -> None:
    arguments, _ = WRITERS["simulate"]
    assert made(lambda: run(*arguments, "-o", "out.cell-4")) == {"out.cell-4"}
