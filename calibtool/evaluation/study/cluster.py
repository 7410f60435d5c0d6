"""The same runs on a Dask cluster: the scheduler repeats the runs of a lost worker elsewhere."""

import asyncio
import contextlib
import logging
import threading
from collections.abc import Callable, Generator, Sequence
from typing import TYPE_CHECKING, Any

from calibtool.errors import CalibtoolError, UsageError
from calibtool.evaluation.study.cluster_security import ClusterSecurity
from calibtool.evaluation.study.definition import Study
from calibtool.evaluation.study.runs import lost, perform
from calibtool.evaluation.study.study_table import Row

if TYPE_CHECKING:
    from distributed import Client

REACH_SECONDS = 4  # time in which a scheduler must answer
WORKER_SECONDS = 5  # time without a worker after which the user is told


def on_cluster(
    study: Study,
    indices: Sequence[int],
    address: str,
    security: ClusterSecurity | None = None,
    notify: Callable[[str], None] = lambda text: None,
) -> Generator[tuple[int, list[Row]], None, None]:
    """(index, rows) of every run, in the order in which they finish, from the workers of
    a Dask scheduler.

    Workers need calibtool of this version. A run whose worker ends repeatedly gets rows with that
    status. security: TLS files, for an address tls://HOST:PORT; scheduler, workers and this process
    trust each other (docs/study.md). notify: is called with a message when there are no workers;
    the study waits for them. UsageError without dask[distributed], or when no scheduler answers at
    `address`; CalibtoolError when the cluster goes away, or a worker cannot perform runs.
    """
    client = _connect(address, security)
    from distributed import KilledWorker, as_completed

    stop = threading.Event()
    watching = threading.Thread(target=_watch, args=(client, address, notify, stop), daemon=True)
    watching.start()
    try:
        shared = client.submit(_given, study, key=f"calibtool-study-{study.key}")
        futures = {client.submit(perform, shared, index, pure=False): index for index in indices}
        with client.as_current():
            completed = as_completed(list(futures))
        for future in completed:
            index = futures.pop(future)
            error = future.exception() if future.status == "error" else None
            if isinstance(error, KilledWorker):
                yield index, lost(study, index, "its workers were lost again and again")
            elif error is not None or future.status != "finished":
                raise CalibtoolError(_reason(address, error))
            else:
                yield index, future.result()
    except (OSError, RuntimeError, TimeoutError) as error:
        raise CalibtoolError(
            f"{address}: the cluster is lost: {' '.join(str(error).split())}"
        ) from None
    finally:
        stop.set()
        with contextlib.suppress(Exception):
            client.close(timeout=2)


def _watch(
    client: "Client", address: str, notify: Callable[[str], None], stop: threading.Event
) -> None:
    """Report when there have been no workers for a while, once each time."""
    silent = False
    while not stop.wait(WORKER_SECONDS):
        try:
            workers = len(client.scheduler_info(n_workers=1)["workers"])
        except Exception:  # the scheduler is gone: waiting for runs raises, too
            return
        if not workers and not silent:
            notify(f"{address}: no workers yet; waiting for some: dask worker {address}")
        silent = not workers


def _given(study: Study) -> Study:
    """The study as a task: it is sent once, and made again when its worker is lost."""
    return study


def _connect(address: str, security: ClusterSecurity | None) -> "Client":
    try:
        from distributed import Client, Security
    except ImportError:
        raise UsageError("--cluster needs Dask; run: pip install 'calibtool[cluster]'") from None
    _silence()
    options = Security() if security is None else Security(**security.options)
    try:
        asyncio.run(
            asyncio.wait_for(_reach(address, options), REACH_SECONDS)
        )  # a Client that fails to connect prints messages
        return Client(address, timeout=REACH_SECONDS, set_as_default=False, security=options)
    except Exception as error:  # also from a server with another protocol, such as MemoryError
        text = " ".join(str(error).split()) if isinstance(error, OSError | ValueError) else ""
        text = text or f"it does not answer like one within {REACH_SECONDS} s"
        raise UsageError(f"--cluster {address}: no Dask scheduler: {text}") from None


def _silence() -> None:
    """Silence Dask's log messages: the error has the reason. Each of its modules has its own
    level."""
    for name in ["distributed", *logging.root.manager.loggerDict]:
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)


async def _reach(address: str, security: Any) -> None:
    """Shake hands with the scheduler."""
    from distributed.comm import connect

    comm = await connect(
        address, timeout=REACH_SECONDS - 1, **security.get_connection_args("client")
    )
    comm.abort()


def _reason(address: str, error: Any) -> str:
    if error is None:
        return f"{address}: the cluster is lost: it has dropped the runs"
    if isinstance(error, CalibtoolError):
        return f"{address}: {error}"
    if isinstance(error, ImportError):
        return (
            f"{address}: a worker cannot perform runs: {error}; install calibtool "
            f"{_version()} there"
        )
    return f"{address}: a worker failed: {type(error).__name__}: {' '.join(str(error).split())}"


def _version() -> str:
    from calibtool import __version__

    return __version__
