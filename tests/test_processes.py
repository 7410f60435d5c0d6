"""Items computed by processes beside this one: in order, however many there are, whoever dies."""

import os
import signal
from collections.abc import Iterator
from multiprocessing import active_children

import pytest

from calibtool.processes import Worker, in_order


def squared(value: int) -> int:
    return value * value


def squared_beside(value: int) -> tuple[int, int]:
    return value * value, os.getpid()


@pytest.mark.parametrize(
    ("count", "workers", "alone"), [(0, 2, 0), (3, 2, 5), (9, 1, 2), (9, 4, 0)]
)
def test_results_come_in_the_order_of_the_items(count: int, workers: int, alone: int) -> None:
    assert list(in_order(squared, range(count), workers, alone)) == [k * k for k in range(count)]
    assert not active_children()


def test_this_process_computes_the_first_ones_and_others_the_rest() -> None:
    found = list(in_order(squared_beside, range(8), 2, 3))
    assert [value for value, _ in found] == [k * k for k in range(8)]
    assert {process for _, process in found[:3]} == {os.getpid()}
    assert os.getpid() not in {process for _, process in found[3:]}


@pytest.mark.parametrize("killed", [1, 2])
def test_what_a_killed_process_should_have_computed_is_not_lost(killed: int) -> None:
    results = in_order(squared, range(12), 2, 1)
    found = [next(results), next(results)]
    for child in active_children()[:killed]:
        os.kill(int(child.pid or 0), signal.SIGKILL)
    assert [*found, *results] == [k * k for k in range(12)]
    assert not active_children()


def test_items_are_taken_no_farther_ahead_than_there_are_workers() -> None:
    taken: list[int] = []

    def items() -> Iterator[int]:
        for value in range(20):
            taken.append(value)
            yield value

    results = in_order(squared, items(), 2, 1)
    for k in range(6):
        assert next(results) == k * k
        assert len(taken) <= k + 1 + 2
    results.close()
    assert not active_children()


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="Windows has no signal masks")
def test_ctrl_c_while_a_worker_loads_does_not_end_it() -> None:
    worker = Worker(abs)
    try:
        assert worker.process.pid is not None
        os.kill(worker.process.pid, signal.SIGINT)
        worker.give(-3)
        assert worker.result() == 3
    finally:
        worker.end()
