"""The same runs on a real Dask cluster of two processes, one of which is killed."""

import os
import signal
import sys

import pytest

from calibtool.errors import CalibtoolError, UsageError
from calibtool.evaluation.study import Definition, Study, cluster, perform
from calibtool.evaluation.study.cluster import on_cluster

STUDY = Study.of(
    Definition(
        robots=["fanuc-m1000ia"], runs=10, configurations=[20], fresh=10, methods=["local-poe"]
    )
)


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


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (None, "the cluster is lost: it has dropped the runs"),
        (CalibtoolError("install the same calibtool"), "install the same calibtool"),
        (
            ImportError("No module named 'calibtool'"),
            "a worker cannot perform runs: No module named 'calibtool'; install",
        ),
        (ZeroDivisionError("a\nb"), "a worker failed: ZeroDivisionError: a b"),
    ],
)
def test_what_stops_a_cluster_is_one_line(error: Exception | None, words: str) -> None:
    line = cluster._reason("tcp://a:8786", error)
    assert line.startswith(f"tcp://a:8786: {words}")
    assert "\n" not in line
