"""The same runs on a real Dask cluster of two processes, one of which is killed."""

import os
import signal
import sys

import pytest

from calibtool.errors import UsageError
from calibtool.evaluation.study import Definition, Study, perform
from calibtool.evaluation.study.cluster import on_cluster

STUDY = Study.of(Definition(robots=["fanuc-m1000ia"], runs=10, configurations=[20], fresh=10, methods=["local-poe"]))


def test_a_worker_is_killed_and_nothing_is_lost() -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        found = {}
        for index, rows in on_cluster(STUDY, range(STUDY.count), cluster.scheduler_address):
            if not found:
                os.kill(cluster.workers[0].pid, signal.SIGKILL)
            found[index] = rows
    assert found == {index: perform(STUDY, index) for index in range(STUDY.count)}


@pytest.mark.parametrize("address", ["nonsense", "foo://here:1"])
def test_an_address_that_is_none(address: str) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(UsageError, match="no Dask scheduler"):
        next(on_cluster(STUDY, [0], address))


def test_an_address_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("calibtool.evaluation.study.cluster.REACH_SECONDS", 1.2)
    with pytest.raises(UsageError, match=r"tcp://127\.0\.0\.1:9: no Dask scheduler"):
        next(on_cluster(STUDY, [0], "tcp://127.0.0.1:9"))


def test_without_dask_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"calibtool\[cluster\]"):
        next(on_cluster(STUDY, [0], "tcp://127.0.0.1:8786"))
