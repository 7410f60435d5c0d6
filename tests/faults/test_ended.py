"""Whatever happens to a command, and whenever: every output is the old file, the new file or
absent, never half.

`python benchmarks/faults.py` tries every command at a hundred moments; here a handful of
them, the same laws.
"""

import contextlib
import os
import random
import re
import signal
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import ended
import pytest
from ended import WRITERS, Writer, broken, everything, finished, parts, snapshot, start
from surroundings import SURROUNDINGS, german_locale, placed, run

from calibtool.atomic_output import SUFFIX

QUICK = [
    "simulate",
    *(
        "import",
        "import, two files",
        "train",
        "compensate, rows",
        "compensate, program",
        "export, JSON",
        "export, C",
    ),
    "plot",
]  # the rest write as these do
each = pytest.mark.parametrize("name", QUICK)
SIMULATE = ["simulate", "planar-3r", "-n", "5", "-o", "out.h5"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The inputs of all commands."""
    made = tmp_path_factory.mktemp("faults")
    ended.make_inputs(made)
    return made


@pytest.fixture
def clean(folder: Path) -> Iterator[Path]:
    """The same, without outputs before and after the test."""
    inputs = everything(folder)
    yield folder
    for name in everything(folder) - inputs:
        (folder / name).unlink()


def before(folder: Path, writer: Writer, existing: bool) -> dict[str, bytes]:
    """Old outputs, or none."""
    ended.remove_outputs(folder, writer)
    for name in writer.outputs if existing else ():
        (folder / name).write_bytes(b"old")
    return snapshot(folder, writer)


@each
def test_killed_at_any_moment(name: str, clean: Path) -> None:
    """SIGKILL at steps of the writing and at any time; the next run leaves no trace of it."""
    writer, others, rng = WRITERS[name], everything(clean), random.Random(name)
    steps = ended.count_steps(writer.words, clean)
    new = snapshot(clean, writer)
    assert set(new) == set(writer.outputs)
    for existing in (False, True):
        old = before(clean, writer, existing)
        step = rng.randint(1, steps)
        assert (
            finished(start(writer.words, clean, ended.signal_at_step(step, signal.SIGKILL)))
            == -signal.SIGKILL
        )
        assert not broken(clean, writer, old, new, others), step
        old = before(clean, writer, existing)
        ended.signal_after(start(writer.words, clean), rng.uniform(0, 0.3), signal.SIGKILL)
        assert not broken(clean, writer, old, new, others)
    before(clean, writer, True)
    finished(start(writer.words, clean, ended.signal_at_step(steps // 3, signal.SIGKILL)))
    assert finished(start(writer.words, clean)) == 0
    assert snapshot(clean, writer) == new
    assert parts(clean) == []


@pytest.mark.parametrize("name", ["simulate", "export, C", "compensate, rows"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_asked_to_end(name: str, number: int, clean: Path) -> None:
    """As above, and nothing is left over; two files that belong together
    are both old or both new.
    """
    writer, others, rng = WRITERS[name], everything(clean), random.Random(name)
    steps = ended.count_steps(writer.words, clean)
    new = snapshot(clean, writer)
    for existing in (False, True):
        old = before(clean, writer, existing)
        code = finished(
            start(writer.words, clean, ended.signal_at_step(rng.randint(1, steps), number))
        )
        assert code in (0, 128 + number)  # 0: on the last step, when everything is done
        assert not broken(clean, writer, old, new, others)
        assert snapshot(clean, writer) in (old, new)
        assert parts(clean) == []


@each
def test_a_full_disk(name: str, clean: Path) -> None:
    writer = WRITERS[name]
    for existing, size in ((False, 100), (True, 0)):
        old = before(clean, writer, existing)
        inputs = everything(clean)
        assert finished(start(writer.words, clean, ended.limit_file_size(size))) == 2
        assert snapshot(clean, writer) == old
        assert everything(clean) == inputs


@pytest.mark.skipif(os.geteuid() != 0, reason="mounting needs root")
def test_a_disk_that_is_really_full(clean: Path) -> None:
    """A tmpfs with no page left, and with one for an output of four."""
    disk = clean / "disk"
    disk.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(disk)], capture_output=True
    ).returncode:
        pytest.skip("mounting is not allowed here")
    try:
        for free in (0, 4096):
            (disk / "filler").unlink(missing_ok=True)
            (disk / "out.h5").unlink(missing_ok=True)
            (disk / "out.h5").write_bytes(b"old")
            with open(disk / "filler", "wb", buffering=0) as filler, contextlib.suppress(OSError):
                while True:
                    filler.write(bytes(4096))
            os.truncate(disk / "filler", (disk / "filler").stat().st_size - free)
            words = ["simulate", "planar-3r", "-n", "5", "-o", "disk/out.h5", "--force"]
            assert finished(start(words, clean)) == 2
            assert (disk / "out.h5").read_bytes() == b"old"
            assert everything(disk) == {"filler", "out.h5"}
    finally:
        subprocess.run(["umount", str(disk)], check=True)
        disk.rmdir()


def test_no_room_for_the_end_of_the_second_of_two_files(clean: Path) -> None:
    """What is left in the buffer when the first write failed does not fit either: exit
    code 2 all the same.
    """
    writer = WRITERS["export, C"]
    assert finished(start(writer.words, clean)) == 0
    sizes = [len(data) for data in snapshot(clean, writer).values()]
    ended.remove_outputs(clean, writer)
    assert finished(start(writer.words, clean, ended.limit_file_size(max(sizes) - 1))) == 2
    assert not snapshot(clean, writer)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_a_folder_of_somebody_else(clean: Path) -> None:
    inputs = everything(clean)
    mode = clean.stat().st_mode
    clean.chmod(0o555)
    try:
        for words in (SIMULATE, [*SIMULATE, "--force"]):
            assert finished(start(words, clean, lambda: os.setresuid(65534, 65534, 65534))) == 2
    finally:
        clean.chmod(mode)
    assert everything(clean) == inputs


@pytest.mark.parametrize(("force", "codes"), [([], [0, 2]), (["--force"], [0, 0])])
def test_two_at_once(force: list[str], codes: list[int], clean: Path) -> None:
    """One output for two processes: the file of one of them; without --force, the second is
    refused however late.
    """
    made = []
    for seed in ("1", "2"):
        assert finished(start([*SIMULATE, "--seed", seed, "--force"], clean)) == 0
        made.append((clean / "out.h5").read_bytes())
    (clean / "out.h5").unlink()
    running = [start([*SIMULATE, "--seed", seed, *force], clean) for seed in ("1", "2")]
    assert sorted(finished(process) for process in running) == codes
    assert (clean / "out.h5").read_bytes() in made
    assert parts(clean) == []


def test_the_temporary_file_of_a_living_process_stays(clean: Path) -> None:
    """One process pauses in the middle of its writing; another run cleans up, but not that."""
    paused = start(SIMULATE, clean, ended.signal_at_step(50, signal.SIGSTOP))
    os.waitpid(paused, os.WUNTRACED)
    (part,) = parts(clean)
    abandoned = clean / f".out.h5.abcdefgh{SUFFIX}"
    abandoned.write_bytes(b"left by a process that was killed")
    kept = clean / f".out.h5.old.abcdefgh{SUFFIX}"
    kept.write_bytes(b"of another output")
    assert finished(start(SIMULATE, clean)) == 0
    assert set(parts(clean)) == {part, kept.name}
    os.kill(paused, signal.SIGCONT)
    assert finished(paused) == 2  # by now there is an out.h5
    assert parts(clean) == [kept.name]


def test_a_link_is_written_through(clean: Path) -> None:
    (clean / "real").mkdir(exist_ok=True)
    target, link = clean / "real" / "target.h5", clean / "out.h5"
    target.write_bytes(b"old")
    target.chmod(0o640)
    link.symlink_to("real/target.h5")
    assert finished(start(SIMULATE, clean)) == 2
    assert target.read_bytes() == b"old"
    assert finished(start([*SIMULATE, "--force"], clean)) == 0
    assert link.is_symlink()
    assert target.read_bytes() != b"old"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640  # permissions stay too
    target.unlink()
    assert finished(start(SIMULATE, clean)) == 0  # a link to a file that is not there yet
    assert target.exists()
    assert link.is_symlink()


@pytest.mark.parametrize("closed", [(0,), (2,), (0, 1, 2)])
def test_closed_streams_end_up_in_no_file(closed: tuple[int, ...], clean: Path) -> None:
    """A file that takes the number of a closed stream would receive what is said to the stream."""
    assert finished(start([*SIMULATE, "--force"], clean)) == 0
    expected = (clean / "out.h5").read_bytes()
    shut = " ".join(f"{number}{'<' if number == 0 else '>'}&-" for number in closed)
    code = subprocess.call(
        ["bash", "-c", f"{sys.executable} -m calibtool {' '.join(SIMULATE)} --force {shut}"],
        cwd=clean,
    )
    assert code == 0
    assert (clean / "out.h5").read_bytes() == expected


@pytest.mark.parametrize(
    "fault", [name for name in SURROUNDINGS if "HOME" not in name and "closed" not in name]
)
def test_surroundings_change_no_byte(fault: str, clean: Path, tmp_path: Path) -> None:
    words = WRITERS["compensate, rows"].words
    chosen, german = SURROUNDINGS[fault], "de_DE" in fault
    if german and not german_locale(tmp_path):
        pytest.skip("this system cannot make a German locale")
    assert finished(start(words, clean)) == 0
    with placed(clean, tmp_path, chosen) as folder:
        assert run(words, folder, chosen, tmp_path if german else None) == 0
        assert (folder / "out.csv").read_bytes() == (clean / "out.csv").read_bytes()


def test_a_hostile_environment_changes_nothing(clean: Path) -> None:
    """No home, no cache, no UTF-8 locale: the same bytes, no word but what was written, and a
    name that is not ASCII.
    """
    words = ["plot", "training", "c.h5", "--force", "-o"]
    assert finished(start([*words, "out.svg"], clean)) == 0
    environment = {
        "LC_ALL": "POSIX",
        "PYTHONUTF8": "0",
        "PYTHONCOERCECLOCALE": "0",
        "MPLCONFIGDIR": "/proc/none",
    }
    done = subprocess.run(
        [sys.executable, "-m", "calibtool", *words, "größe ω.svg"],
        cwd=clean,
        env=environment,
        capture_output=True,
    )
    assert (done.returncode, done.stdout) == (0, b"")
    assert re.fullmatch(rb"wrote gr\S+ \S+\.svg: figure training\n", done.stderr)
    assert (clean / "größe ω.svg").read_bytes() == (clean / "out.svg").read_bytes()


INTERRUPTED = """
import os, signal, sys
class Count:
    left = None
    def find_spec(self, name, path, target=None):
        if name == "calibtool.cli.app":  # from here on it is calibtool's own concern
            Count.left = {step}
        elif Count.left:
            Count.left -= 1
            if Count.left == 0:
                os.kill(os.getpid(), signal.SIGINT)
# A job in the background starts with Ctrl-C ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv = ["calibtool", "simulate", "planar-3r", "-o", "out.h5", "--force"]
sys.meta_path.insert(0, Count())
from calibtool.cli import main
main()
"""


@pytest.mark.parametrize("step", [1, 100, 400])
def test_an_interrupt_while_modules_are_imported_is_silent(step: int, clean: Path) -> None:
    command = [sys.executable, "-c", INTERRUPTED.format(step=step)]
    environment = {
        **os.environ,
        "COVERAGE_PROCESS_CONFIG": "",
    }  # its measurement changes how much is imported
    done = subprocess.run(command, cwd=clean, env=environment, capture_output=True)
    assert (done.returncode, done.stderr) == (130, b"")


def test_the_clock_is_not_read(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Inputs from the future and a clock that was set back: the same bytes."""
    assert finished(start(["identify", "m.h5", "-o", "out.h5"], clean)) == 0
    os.utime(clean / "m.h5", (2**32, 2**32))

    def set_back() -> None:
        import time

        monkeypatch.setattr(time, "time", lambda: 0.0)
        monkeypatch.setattr(time, "time_ns", lambda: 0)

    assert finished(start(["identify", "m.h5", "-o", "rest.h5"], clean, set_back)) == 0
    assert (clean / "rest.h5").read_bytes() == (clean / "out.h5").read_bytes()
