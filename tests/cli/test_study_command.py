"""calibtool study: table, summary and picture; goes on after an interruption; the same bytes from
any number of workers.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from commandline import ENVIRONMENT, answer, refused, rows_of, run

SMALL = [
    "fanuc-m1000ia",
    "--runs",
    3,
    "-n",
    20,
    "--fresh",
    10,
    "--methods",
    "local-poe",
    "--workers",
    1,
]
JOURNAL = Path("s.csv.journal")
KEYS = {
    "robot",
    "workspace",
    "errors",
    "error_scale",
    "noise_mm",
    "configurations",
    "fresh",
    "method",
    "runs",
    "failed",
}


@pytest.fixture(scope="session")
def table(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("study") / "s.csv"
    run("study", *SMALL, "--workers", 2, "-o", path)
    return path.read_bytes()


def test_table_on_stdout_and_medians_on_stderr(table: bytes) -> None:
    result = run("study", *SMALL)
    assert result.stdout_bytes == table
    assert "3 runs, judged on 10 fresh configurations" in result.stderr
    rows = rows_of(result.stdout)
    assert [(row["run"], row["method"]) for row in rows] == [
        (str(k), m) for k in (1, 2, 3) for m in ("nominal", "local-poe")
    ]


def test_a_finished_study_is_not_performed_again(table: bytes) -> None:
    Path("s.csv").write_bytes(table)
    for image in ("s.svg", "s.png"):
        result = run("study", *SMALL, "-o", "s.csv", "--box-plot", image)
        assert "finished already" in result.stderr
    assert "local-poe" in Path("s.svg").read_text()
    assert Path("s.csv").read_bytes() == table
    value = answer("study", *SMALL, "-o", "s.csv")
    assert (value["schema"], value["schema_version"], value["rows"], value["failed"]) == (
        "calibtool/study",
        1,
        6,
        0,
    )
    group = value["groups"][1]
    assert set(group) >= KEYS
    assert set(group["position_mm"]) == {"mean", "std", "rms", "p95", "max"}
    values = sorted(
        float(row["position_max_mm"])
        for row in rows_of(table.decode())
        if row["method"] == "local-poe"
    )
    assert [group["position_mm"]["max"][q] for q in ("min", "median", "max")] == values


def test_plan_file_options_before_its_keys_and_hdf5() -> None:
    Path("plan.toml").write_text(
        'robots = ["planar-3r"]\nruns = 9\nconfigurations = 15\nfresh = 5\nmethods = "complete"\n'
    )
    arguments = ["study", "--plan", "plan.toml", "--runs", 1, "--workers", 1]
    value = answer(*arguments, "--noise-mm", "0.01,0.1", "-o", "s.h5")
    assert [(g["noise_mm"], g["method"], g["runs"]) for g in value["groups"]] == [
        (noise, method, 1) for noise in (0.01, 0.1) for method in ("nominal", "complete")
    ]
    assert answer(*arguments, "--noise-mm", 0.01, "--noise-mm", 0.1, "-o", "s.h5") == value


def stopped(with_signal: signal.Signals) -> tuple[int, str]:
    """A study into s.csv that got a signal after its first finished run:
    its exit code and stderr.
    """
    command = [sys.executable, "-m", "calibtool", "study", *map(str, SMALL), "-o", "s.csv"]
    with subprocess.Popen(
        command, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        while (
            not (JOURNAL.exists() and JOURNAL.read_bytes().count(b"\n") >= 2)
            and process.poll() is None
        ):
            time.sleep(0.002)
        os.kill(process.pid, with_signal)
        _, told = process.communicate(timeout=60)
    return process.returncode, told.decode()


def test_killed_and_started_again_the_table_is_the_same(table: bytes) -> None:
    """SIGKILL after the first finished run: no process stays, and the next command
    performs the rest.
    """
    stopped(signal.SIGKILL)
    assert "another study" in refused(2, "study", *SMALL, "--seed", 1, "-o", "s.csv")
    result = run("study", *SMALL, "-o", "s.csv")
    assert "runs are finished already" in result.stderr
    assert Path("s.csv").read_bytes() == table
    assert not JOURNAL.exists()


def test_ctrl_c_keeps_what_is_finished(table: bytes) -> None:
    code, told = stopped(signal.SIGINT)
    if not JOURNAL.exists():  # it was quicker
        assert Path("s.csv").read_bytes() == table
        return
    assert code == 130
    assert "of 3 runs are kept; the same command goes on" in told


def test_a_device_gets_no_journal() -> None:
    assert "No space left" in refused(2, "study", *SMALL, "-o", "/dev/full")
    assert not Path("/dev/full.journal").exists()


def test_results_of_another_study_are_refused(table: bytes) -> None:
    Path("s.csv").write_bytes(table)
    assert "holds another study" in refused(2, "study", *SMALL, "--seed", 1, "-o", "s.csv")
    Path("s.csv").write_bytes(table[: table.rstrip().rindex(b"\n") + 1])
    assert "lost rows" in refused(2, "study", *SMALL, "-o", "s.csv")
    Path("s.csv").write_text("my notes\n")
    assert "no study's table" in refused(2, "study", *SMALL, "-o", "s.csv")
    run("study", *SMALL, "-o", "s.csv", "--force")
    assert Path("s.csv").read_bytes() == table


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["study"], "no robot"),
        (["study", "fanuc"], "did you mean"),
        (["study", "scara", "--methods", "complet"], "did you mean complete"),
        (["study", "scara", "--noise-mm", "a"], "--noise-mm"),
        (["study", "scara", "--noise-mm", "inf"], "--noise-mm"),
        (["study", "scara", "-n", "0"], "--configurations"),
        (["study", "scara", "--errors", "rust"], "--errors"),
        (["study", "scara", "--workers", 2, "--cluster", "tcp://a:1"], "exclude each other"),
        (["study", "scara", "--plan", "none.toml"], "none.toml"),
        (["study", "scara", "--box-plot", "s.eps"], ".png, .svg or .pdf"),
        (["study", "scara", "-o", "none/s.csv"], "none"),
        (["study", "scara", "-o", "-", "--json"], "stdout"),
    ],
)
def test_wrong_usage(arguments: list[object], words: str) -> None:
    assert words in refused(2, *arguments)


def test_a_wrong_plan_is_bad_data() -> None:
    Path("plan.toml").write_text("rums = 3\n")
    assert refused(3, "study", "--plan", "plan.toml").startswith(
        "plan.toml: unknown key 'rums'; did you mean runs"
    )
