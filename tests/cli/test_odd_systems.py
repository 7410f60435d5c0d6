"""File systems that know less than ours, names that are no UTF-8, links and pipes where files are
expected, and people who stop listening: what was asked for is written, and nothing else is touched.
"""

import errno
import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from commandline import ENVIRONMENT, Files, refused, run

import calibtool
from calibtool.storage import read_any

SYSTEM_CALLS = {
    "fchmod": ("permissions", os, "fchmod"),
    "flock": ("locks", fcntl, "flock"),
    "fsync": ("fsync", os, "fsync"),
    "link": ("hard links", os, "link"),
}


def unknown(monkeypatch: pytest.MonkeyPatch, code: int, *names: str) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(code, os.strerror(code))

    for name in names:
        _, module, function = SYSTEM_CALLS[name]
        monkeypatch.setattr(module, function, fail)


@pytest.mark.parametrize("code", [errno.EPERM, errno.ENOTSUP, errno.ENOSYS])
@pytest.mark.parametrize("names", [*((name,) for name in SYSTEM_CALLS), tuple(SYSTEM_CALLS)])
@pytest.mark.parametrize("force", [False, True])
def test_a_weaker_guarantee_is_said_and_the_file_written(
    monkeypatch: pytest.MonkeyPatch, code: int, names: tuple[str, ...], force: bool
) -> None:
    expected = run("simulate", "planar-3r", "-n", 3, "-o", "-").stdout_bytes
    if force:
        Path("a.h5").write_text("old")
    unknown(monkeypatch, code, *names)
    said = run("simulate", "planar-3r", "-n", 3, "-o", "a.h5", *["--force"] * force).stderr
    assert Path("a.h5").read_bytes() == expected
    lost = [SYSTEM_CALLS[name][0] for name in names if not (force and name == "link")]
    assert all(f"no {what}" in said for what in lost)
    assert ("weaker guarantee" in said) == bool(lost)
    assert os.listdir() == ["a.h5"]


def test_without_hard_links_nothing_is_replaced_unasked(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("a.h5").write_text("mine")
    unknown(monkeypatch, errno.EPERM, *SYSTEM_CALLS)
    assert "exists already" in refused(2, "simulate", "planar-3r", "-n", 3, "-o", "a.h5")
    assert Path("a.h5").read_text() == "mine"


def test_two_outputs_that_belong_together(monkeypatch: pytest.MonkeyPatch, files: Files) -> None:
    unknown(monkeypatch, errno.ENOTSUP, *SYSTEM_CALLS)
    run("export", files.local_poe, "--format", "c", "-o", "a.c")
    assert sorted(os.listdir()) == ["a.c", "a.h"]


def test_the_library_writes_there_too(monkeypatch: pytest.MonkeyPatch, files: Files) -> None:
    measurements = calibtool.read(files.measurements)
    unknown(monkeypatch, errno.EPERM, *SYSTEM_CALLS)
    calibtool.write(measurements, "b.h5")
    assert Path("b.h5").read_bytes() == Path(files.measurements).read_bytes()


def test_a_disk_that_is_full_is_no_odd_system(monkeypatch: pytest.MonkeyPatch) -> None:
    unknown(monkeypatch, errno.ENOSPC, "fsync")
    assert "cannot be written" in refused(2, "simulate", "planar-3r", "-n", 3, "-o", "a.h5")


STUDY = ("study", "planar-3r", "--runs", 2, "--fresh", 5, "--methods", "local-poe", "--workers", 1)


def test_a_study_without_locks_and_fsync(monkeypatch: pytest.MonkeyPatch) -> None:
    unknown(monkeypatch, errno.ENOTSUP, "flock", "fsync")
    said = run(*STUDY, "-o", "s.csv").stderr
    assert "s.csv.journal: written with a weaker guarantee" in said
    assert os.listdir() == ["s.csv"]


# --- links and pipes ------------------------------------------------------------------------------


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("there", [True, False])
def test_a_link_in_place_of_a_journal_is_not_followed(force: bool, there: bool) -> None:
    if there:
        Path("mine.txt").write_text("precious\n")
    os.symlink("mine.txt", "s.csv.journal")
    assert "is a link" in refused(2, *STUDY, "-o", "s.csv", *["--force"] * force)
    assert Path("mine.txt").exists() == there
    assert not there or Path("mine.txt").read_text() == "precious\n"


@pytest.mark.parametrize("force", [False, True])
def test_a_pipe_in_place_of_a_journal_is_not_waited_for(force: bool) -> None:
    os.mkfifo("s.csv.journal")
    assert "no regular file" in refused(2, *STUDY, "-o", "s.csv", *["--force"] * force)


def test_a_link_in_place_of_an_output_stays_one() -> None:
    Path("target.h5").write_text("old")
    os.symlink("target.h5", "a.h5")
    assert "exists already" in refused(2, "simulate", "planar-3r", "-n", 3, "-o", "a.h5")
    run("simulate", "planar-3r", "-n", 3, "-o", "a.h5", "--force")
    assert Path("a.h5").is_symlink()
    assert Path("target.h5").read_bytes()[:4] == b"\x89HDF"
    calibtool.write(calibtool.read("a.h5"), "a.h5", force=True)
    assert Path("a.h5").is_symlink()


def test_a_pipe_in_place_of_an_output_is_written_to() -> None:
    os.mkfifo("pipe")
    with subprocess.Popen(["cat", "pipe"], stdout=subprocess.PIPE) as reader:
        run("simulate", "planar-3r", "-n", 3, "-o", "pipe")
        out, _ = reader.communicate(timeout=60)
    assert out == run("simulate", "planar-3r", "-n", 3, "-o", "-").stdout_bytes


# --- names ----------------------------------------------------------------------------------------

ODD = os.fsdecode(b"a\xff \xc3(\n$b")


def test_names_that_are_no_utf_8(files: Files) -> None:
    """In every command that writes what a file is called, and as the name of an output."""
    odd, measured = Path(f"{ODD}.h5"), Path(files.measurements)
    odd.write_bytes(Path(files.local_poe).read_bytes())
    run("info", odd)
    run("info", odd, "--json")
    run("evaluate", odd, "--on", measured, "-o", f"{ODD}.csv", "--json")
    run("report", odd, "--on", measured, "-o", f"{ODD}.html")
    run("plot", "errors", odd, "--on", measured, "-o", f"{ODD}.svg")
    run("identify", measured, "--model", "local-poe", "-o", f"{ODD}2.h5")
    run("export", odd, "--format", "json", "-o", f"{ODD}.json")
    for suffix in ("csv", "html", "svg", "json"):
        Path(f"{ODD}.{suffix}").read_bytes().decode("utf-8")
    with open(f"{ODD}2.h5", "rb") as stream:
        assert read_any(stream, "x").robot.name == "planar-3r"
    assert ODD.encode("utf-8", "surrogateescape") not in os.fsencode("".join(os.listdir("/tmp")))


# --- who stops listening --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "output"),
    [
        (("identify", "M"), "out.h5"),
        (("train", "M", "--base", "nominal", "--restarts", "1"), "out.h5"),
        (("evaluate", "C", "--on", "M"), "out.csv"),
        (("plan", "planar-3r", "-n", "8"), "out.csv"),
        (("simulate", "planar-3r", "-n", "20", "-v"), "out.h5"),
    ],
)
def test_nobody_reads_stderr_and_the_output_is_there(
    files: Files, words: tuple[str, ...], output: str
) -> None:
    """As `2>&1 | head -1` does it, at once."""
    names = {"M": files.measurements, "C": files.local_poe}
    expected = run(*(names.get(word, word) for word in words), "-o", "expected" + output[-4:])
    assert expected.exit_code == 0
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "calibtool", *(names.get(w, w) for w in words), "-o", output]
    done = subprocess.run(command, env=ENVIRONMENT, stderr=writer, stdout=writer, timeout=120)
    os.close(writer)
    assert Path(output).stat().st_size == Path("expected" + output[-4:]).stat().st_size
    assert done.returncode in (0, 1)  # 1: stdout, too, has no reader


def test_signals_while_a_urdf_is_read_leave_nothing(tmp_path: Path) -> None:
    before = set(os.listdir(tempfile.gettempdir()))
    for k in range(6):
        command = [sys.executable, "-m", "calibtool", "robots", "fanuc-m1000ia"]
        with subprocess.Popen(
            command,
            env={**ENVIRONMENT, "TMPDIR": str(tmp_path)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as process:
            time.sleep(0.15 * (k + 1))
            process.send_signal(signal.SIGTERM if k % 2 else signal.SIGINT)
            process.wait(timeout=60)
    assert os.listdir(tmp_path) == ["work"]
    assert not [x for x in set(os.listdir(tempfile.gettempdir())) - before if "calibtool-" in x]


def test_a_history_grows_on_a_file_system_without_locks(
    files: Files, monkeypatch: pytest.MonkeyPatch
) -> None:
    run("identify", files.six_measurements, "-q", "-o", "c.h5")
    unknown(monkeypatch, errno.ENOTSUP, "flock", "fsync")
    for count in (1, 2):
        check = ("monitor", "c.h5", "--on", files.six_fresh, "--history", "h.ndjson")
        said = run(*check).stderr
        assert "h.ndjson: written with a weaker guarantee: the file system knows no locks" in said
        assert len(Path("h.ndjson").read_text().splitlines()) == count
