"""Runs in local processes: the same rows as in this one, also when a process is killed."""

import os
import signal
from multiprocessing import active_children
from pathlib import Path

import pytest

from calibtool.errors import CalibtoolError
from calibtool.evaluation.study import Definition, Study, perform
from calibtool.evaluation.study import local as module
from calibtool.evaluation.study.local import in_processes

STUDY = Study.of(
    Definition(
        robots=["fanuc-m1000ia"], runs=8, configurations=[20], fresh=10, methods=["local-poe"]
    )
)


def kill_one() -> None:
    os.kill(int(active_children()[0].pid or 0), signal.SIGKILL)


def test_two_processes_give_the_rows_of_this_one_although_one_is_killed() -> None:
    found = {}
    for index, rows in in_processes(STUDY, range(STUDY.count), 2):
        if not found:
            kill_one()
        assert index not in found
        found[index] = rows
    assert found == {index: perform(STUDY, index) for index in range(STUDY.count)}
    assert not active_children()


def test_a_run_that_always_kills_its_process_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_TRIES", 0)  # the first death counts as the last
    results = in_processes(STUDY, range(3), 1)
    found = dict([next(results)])
    kill_one()
    found |= dict(results)
    assert set(found) == {0, 1, 2}
    assert found[0] == perform(STUDY, 0)
    assert "killed" in str(found[1][0])
    assert found[2] == perform(STUDY, 2)


@pytest.mark.parametrize("killed", [1, 99])
def test_processes_that_are_killed_before_they_work(
    monkeypatch: pytest.MonkeyPatch, killed: int
) -> None:
    """One is replaced; when all end so, the study ends with an error instead of starting
    processes for ever.
    """

    class Stillborn(module._Worker):
        started = 0

        def __init__(self, study: Study) -> None:
            super().__init__(study)
            Stillborn.started += 1
            if Stillborn.started <= killed:
                self.process.kill()

    monkeypatch.setattr(module, "_Worker", Stillborn)
    if killed == 1:
        assert dict(in_processes(STUDY, [0], 1)) == {0: perform(STUDY, 0)}
        return
    with pytest.raises(CalibtoolError, match="before they are ready"):
        dict(in_processes(STUDY, range(STUDY.count), 2))
    assert not active_children()


def test_leaving_early_ends_the_processes() -> None:
    results = in_processes(STUDY, range(STUDY.count), 1)
    next(results)
    results.close()
    assert not active_children()


def test_nothing_to_do_starts_nothing() -> None:
    assert list(in_processes(STUDY, [], 2)) == []


def test_processes_get_one_blas_thread_and_this_one_keeps_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    results = in_processes(STUDY, [0], 1)
    next(results)
    (worker,) = active_children()
    given = Path(f"/proc/{worker.pid}/environ")
    if not given.exists():
        pytest.skip("needs /proc to see the environment of a process")
    assert {b"OMP_NUM_THREADS=1", b"OPENBLAS_NUM_THREADS=1"} <= set(given.read_bytes().split(b"\0"))
    results.close()
    assert (os.environ["OMP_NUM_THREADS"], "OPENBLAS_NUM_THREADS" in os.environ) == ("7", False)
