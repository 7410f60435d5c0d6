"""Runs in processes of this machine: a killed process is replaced and its run repeated once."""

from collections import deque
from collections.abc import Generator, Sequence
from functools import partial
from multiprocessing.connection import wait

from calibtool.errors import CalibtoolError
from calibtool.evaluation.study.definition import Study
from calibtool.evaluation.study.runs import lost, perform
from calibtool.evaluation.study.study_table import Row, StudyTable, table_of
from calibtool.processes import Worker

_TRIES = 2


def run_study(study: Study, workers: int = 1) -> StudyTable:
    """The table of all runs of a study; it does not depend on the number of workers.

    With one worker the runs are done in this process. More workers are processes that import the
    calling script again; its own work must then be under `if __name__ == "__main__":`.
    """
    indices = range(study.count)
    if workers == 1:
        rows = {index: perform(study, index) for index in indices}
    else:
        rows = dict(in_processes(study, indices, workers))
    return table_of([row for index in indices for row in rows[index]], "study")


def in_processes(
    study: Study, indices: Sequence[int], workers: int
) -> Generator[tuple[int, list[Row]], None, None]:
    """(index, rows) of every run, in the order in which they finish, from `workers` processes.

    A run whose process is killed twice gets rows with that status. Raises CalibtoolError when
    processes cannot start. The processes end with the iterator, and by themselves when this
    process is killed.
    """
    waiting = deque(indices)
    tries = dict.fromkeys(indices, 0)
    failed_starts = 0  # processes in a row that ended before they could work
    pool = [_Worker(study) for _ in range(min(workers, len(indices)))]
    try:
        while waiting or any(worker.index is not None for worker in pool):
            heard = wait([worker.connection for worker in pool if worker.busy])
            for place, worker in enumerate(pool):
                if worker.connection not in heard:
                    continue
                index = worker.index
                try:
                    answer = worker.connection.recv()
                except (EOFError, OSError):
                    failed_starts = 0 if worker.ready else failed_starts + 1
                    if failed_starts > _TRIES * len(pool):
                        raise CalibtoolError(
                            "the worker processes end before they are ready"
                        ) from None
                    worker.end()
                    pool[place] = _Worker(study)
                    if index is None:
                        continue
                    if tries[index] < _TRIES:
                        waiting.appendleft(index)
                    else:
                        yield (
                            index,
                            lost(study, index, f"its worker process was killed {_TRIES} times"),
                        )
                    continue
                worker.index, worker.ready, failed_starts = None, True, 0
                if waiting:
                    following = waiting.popleft()
                    tries[following] += 1
                    worker.start(following)
                if index is not None:
                    yield index, answer
    finally:
        for worker in pool:
            worker.end()


class _Worker(Worker):
    """A process that performs one run at a time."""

    def __init__(self, study: Study) -> None:
        super().__init__(partial(perform, study))
        self.index: int | None = None

    @property
    def busy(self) -> bool:
        return not self.ready or self.index is not None

    def start(self, index: int) -> None:
        self.index = index
        self.give(index)
