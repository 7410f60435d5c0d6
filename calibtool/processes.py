"""Processes beside this one that compute one item at a time; they end with this one."""

import contextlib
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def processors() -> int:
    """How many processors this process may use; where the system does not tell, all there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Worker:
    """A process that computes a picklable `function` of one item after the other.

    It says None first, when it is ready. It starts from nothing (`spawn`): a script that uses it
    needs `if __name__ == "__main__":`. It ends by itself when this process is killed.
    """

    def __init__(self, function: Callable[[Any], Any]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process: SpawnProcess = context.Process(
            target=_serve, args=(theirs, function), daemon=True
        )
        with _one_blas_thread(), _interrupts_held():
            self.process.start()
        theirs.close()
        self.ready = False

    def give(self, item: object) -> None:
        """Send an item. If the process was killed a moment ago, the next reading reports that."""
        with contextlib.suppress(OSError):
            self.connection.send(item)

    def result(self) -> Any:
        """The function of the item that was given. Raises EOFError or OSError when killed."""
        while not self.ready:
            self.ready = self.connection.recv() is None
        return self.connection.recv()

    def end(self) -> None:
        """End the process, whatever it does."""
        self.connection.close()
        self.process.terminate()
        self.process.join()


def in_order(
    function: Callable[[Item], Result], items: Iterable[Item], workers: int, alone: int
) -> Iterator[Result]:
    """function(item) of every item, in order, from `workers` processes.

    This process computes the first `alone` items, so that few items start no other, and those
    whose process is killed. At most one item per worker is ahead of the result that is waited for.
    """
    source = iter(items)
    yield from map(function, islice(source, alone))
    idle: list[Worker] = []
    given: deque[tuple[Worker, Item]] = deque()
    started = False

    def oldest() -> Result:
        worker, item = given.popleft()
        try:
            result: Result = worker.result()
        except (EOFError, OSError):
            worker.end()
            return function(item)
        idle.append(worker)
        return result

    try:
        for item in source:
            if not started:
                idle += [Worker(function) for _ in range(workers)]
                started = True
            while given and not idle:
                yield oldest()
            if idle:
                worker = idle.pop()
                worker.give(item)
                given.append((worker, item))
            else:  # all of them were killed
                yield function(item)
        while given:
            yield oldest()
    finally:
        for worker in [*idle, *(worker for worker, _ in given)]:
            worker.end()


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Ctrl-C waits; processes that are started meanwhile never see it, not even while they load."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Processes started inside get one BLAS thread, so that workers do not compete."""
    before = {name: os.environ.get(name) for name in _BLAS_THREADS}
    os.environ.update(dict.fromkeys(_BLAS_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _serve(connection: Connection, function: Callable[[Any], Any]) -> None:
    """The life of a worker process: until the other end is closed, or gone with its process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that started this one
    with contextlib.suppress(EOFError, OSError):
        connection.send(None)
        while True:
            connection.send(function(connection.recv()))
