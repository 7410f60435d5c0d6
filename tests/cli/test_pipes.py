"""Real pipes between real processes."""

import subprocess
import sys
from pathlib import Path

import pytest
from commandline import ENVIRONMENT, Files, only_line, rows_of, run, shell

SIMULATE = "calibtool simulate planar-3r -n 30 --seed 3"


def targets(folder: Path) -> None:
    (folder / "targets.csv").write_text("id,j1_deg,j2_deg,j3_deg\na,10,20,30\nb,0,60,-20\n")


def test_from_the_robot_to_corrected_joints_without_a_file_between(here: Path) -> None:
    """The pipe of the design document; the same commands with files in between give
    the same joints.
    """
    joints = (
        "j1_deg,j2_deg,j3_serial_deg,j4_deg,j5_deg,j6_deg"  # states whose: on a FANUC it matters
    )
    (here / "targets.csv").write_text(f"{joints},id\n0,10,-10,0,-70,0,a\n")
    script = (
        "calibtool simulate fanuc-m1000ia -n 40 -o - | calibtool train - --restarts 1 -o - | "
        "calibtool compensate - targets.csv -o corrected.csv"
    )
    finished = shell(script, here)
    assert finished.returncode == 0, finished.stderr.decode()
    assert finished.stdout == b""
    (row,) = rows_of(Path("corrected.csv").read_text())
    assert (row["id"], row["status"]) == ("a", "ok")
    run("simulate", "fanuc-m1000ia", "-n", 40, "-o", "m.h5")
    run("train", "m.h5", "--restarts", 1, "-o", "c.h5")
    assert run("compensate", "c.h5", "targets.csv").stdout == Path("corrected.csv").read_text()


def test_identical_commands_give_identical_bytes(here: Path) -> None:
    """Whatever the output is called, and on stdout."""
    finished = shell(f"{SIMULATE} > a.h5 && {SIMULATE} -o - | cat > b.h5", here)
    assert finished.returncode == 0, finished.stderr.decode()
    arguments = SIMULATE.split()[1:]
    run(*arguments, "-o", "c.h5")
    run(*arguments, "--output=d.h5")
    run(*arguments, "--output", "e.h5", "--force")
    run("simulate", "-of.h5", *arguments[1:])
    first = Path("a.h5").read_bytes()
    assert len(first) > 1000
    for name in "bcdef":
        assert Path(f"{name}.h5").read_bytes() == first, name


def test_identical_fits_give_identical_bytes(here: Path) -> None:
    """In processes of their own, with a hash seed of their own; `train` identifies its
    base model first.
    """
    run("simulate", "planar-3r", "-n", 30, "-o", "m.h5")
    for seed, name in (("1", "a"), ("2", "b")):
        finished = shell(
            f"calibtool train m.h5 --restarts 1 -o {name}.h5", here, PYTHONHASHSEED=seed
        )
        assert finished.returncode == 0, finished.stderr.decode()
    assert Path("a.h5").read_bytes() == Path("b.h5").read_bytes()


def test_info_of_a_stream(here: Path) -> None:
    finished = shell(
        f"{SIMULATE} | calibtool identify - --model local-poe 2> report | calibtool "
        "info - | head -n 1",
        here,
    )
    assert finished.stdout == b"kind: calibration\n"
    assert finished.stderr == b""
    assert Path("report").read_text().startswith("local-poe model of planar-3r, 30 configurations")


def test_evaluate_a_stream(here: Path, files: Files) -> None:
    finished = shell(
        f"cat '{files.paper}' | calibtool evaluate - --on '{files.fresh}' --json", here
    )
    assert finished.returncode == 0
    assert b'"name": "stdin"' in finished.stdout
    assert finished.stderr == b""


def test_targets_of_a_stream(here: Path, files: Files) -> None:
    """Between the ordinary tools of a shell."""
    targets(here)
    script = (
        f"cat targets.csv | calibtool compensate '{files.network}' | tee all.csv | tail -n +2 | "
        "cut -d, -f4 | sort -r"
    )
    finished = shell(script, here)
    assert finished.returncode == 0
    assert finished.stdout == b"b\na\n"
    assert Path("all.csv").read_text() == run("compensate", files.network, "targets.csv").stdout


LARGE_AND_SMALL = {
    "help": "--help",
    "text": "info {m}",
    "json": "evaluate {c} --on {m} --json",
    "csv": "compensate {c} targets.csv",
    "hdf5": "simulate planar-3r -n 2000",
    "report beside it": "identify {m}",
}


@pytest.mark.parametrize("kind", LARGE_AND_SMALL)
def test_a_reader_that_was_never_there(here: Path, files: Files, kind: str) -> None:
    """No traceback, no word about it, whatever is written: the output comes before the report."""
    targets(here)
    command = LARGE_AND_SMALL[kind].format(m=files.measurements, c=files.network)
    process = subprocess.Popen(
        [sys.executable, "-m", "calibtool", *command.split()],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        env=ENVIRONMENT,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    said = process.stderr.read().decode()
    process.stderr.close()
    process.wait(timeout=60)
    assert _complaints(said) == []
    assert said == ""


def _complaints(stderr: str) -> list[str]:
    words = ("Traceback", "unexpected", "Errno", "BrokenPipe", "Exception ignored")
    return [line for line in stderr.splitlines() if any(word in line for word in words)]


def test_stdout_that_is_closed_is_no_bug(here: Path, files: Files) -> None:
    """`>&-`: whatever the exit code, the user is not asked to report a bug."""
    finished = shell(f"calibtool info '{files.measurements}' --json >&-", here)
    assert _complaints(finished.stderr.decode()) == []


# 64 KiB per file: fails as a full disk does. A measurement of the coverage would
# want to write, too.
LIMITED = (
    "trap '' XFSZ; ulimit -f 64; unset COVERAGE_PROCESS_CONFIG; calibtool simulate "
    "planar-3r -n 2000"
)
both = pytest.mark.parametrize("unbuffered", ["", "1"])  # PYTHONUNBUFFERED, as containers set it


@both
def test_a_full_disk_behind_stdout_is_a_failure_and_no_bug(here: Path, unbuffered: str) -> None:
    """A truncated file must not end with exit code 0."""
    finished = shell(f"{LIMITED} > out.h5; exit $?", here, PYTHONUNBUFFERED=unbuffered)
    assert finished.returncode == 2
    assert only_line(finished.stderr.decode()).startswith("stdout: cannot be written")


@both
def test_a_reader_that_goes_away_is_a_failure(here: Path, unbuffered: str) -> None:
    """200 kB do not fit into a pipe: the writer learns that nobody takes the rest."""
    finished = shell(
        "calibtool simulate planar-3r -n 2000 | head -c 1 | wc -c",
        here,
        PYTHONUNBUFFERED=unbuffered,
    )
    assert finished.returncode != 0
    assert finished.stdout.split() == [b"1"]
    assert finished.stderr == b""


def test_large_output_arrives_whole(here: Path) -> None:
    """Through a pipe that is read late, from an unbuffered stdout."""
    script = "calibtool simulate planar-3r -n 2000 | { sleep 0.2; cat; } > out.h5"
    assert shell(script, here, PYTHONUNBUFFERED="1").returncode == 0
    run("simulate", "planar-3r", "-n", 2000, "-o", "file.h5")
    assert Path("out.h5").read_bytes() == Path("file.h5").read_bytes()


def test_a_full_disk_behind_a_file_leaves_nothing(here: Path) -> None:
    finished = shell(f"{LIMITED} -o out.h5; exit $?", here)
    assert finished.returncode == 2
    assert only_line(finished.stderr.decode()).startswith("out.h5: cannot be written")
    assert list(here.iterdir()) == []


def test_a_first_command_that_fails(here: Path) -> None:
    """One line each: the reason from the first, an empty stdin from the second; the pipe's
    code is a failure.
    """
    targets(here)
    script = "calibtool simulate plannar-3r 2> first | calibtool compensate - targets.csv 2> second"
    finished = shell(script, here)
    assert finished.returncode == 3
    assert finished.stdout == b""
    assert "unknown robot 'plannar-3r'" in only_line(Path("first").read_text())
    assert only_line(Path("second").read_text()).startswith("stdin: empty")


def test_a_whole_pipe_that_fails(here: Path) -> None:
    targets(here)
    script = (
        "calibtool simulate nothing -o - | calibtool train - -o - | calibtool compensate - "
        "targets.csv -o c.csv"
    )
    finished = shell(script, here)
    assert finished.returncode == 3
    assert len(finished.stderr.decode().splitlines()) == 3
    assert not Path("c.csv").exists()


def test_exit_codes_reach_the_shell(here: Path, files: Files) -> None:
    script = (
        f"calibtool info '{__file__}'; echo $?; calibtool simulate planar-3r -n 1 "
        f"--unregistered; echo $?; calibtool evaluate '{files.paper}' --on '{files.fresh}' "
        "--require position_max_mm=0; echo $?"
    )
    assert shell(script, here).stdout.decode().split() == ["3", "4", "5"]


def test_an_interrupt_is_130_and_silent(monkeypatch: pytest.MonkeyPatch, files: Files) -> None:
    def interrupted(path: str) -> bytes:
        raise KeyboardInterrupt(path)

    monkeypatch.setattr("calibtool.cli.info.read_bytes", interrupted)
    result = run("info", files.paper, code=130)
    assert result.stdout_bytes == b""
    assert "Traceback" not in result.stderr
    assert "unexpected" not in result.stderr
