"""Mutated files through every reader: exceptions other than calibtool's, hangs, memory, crashes
of the process.

Run: python benchmarks/fuzz.py --inputs 100000 --reader csv --seed 0

Without --reader all readers are run, one after the other. Every input follows from reader, seed and
number, so that `--first NUMBER --inputs 1` makes one again. A worker process has 1 GiB more than it
started with, every input 5 s of the processor; after a crash or an endless loop a new one goes on.
What Python opens, runs or connects to in between is a finding too (tests/fuzz/watched.py).
Findings, one per place, are kept in --findings FOLDER. A Markdown row per reader goes to stdout.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import contextlib
import json
import multiprocessing as mp
import resource
import signal
import sys
import time
import traceback
import warnings
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "fuzz"))

from readers import READERS, case
from watched import watched

from calibtool.errors import CalibtoolError

SECONDS, MEMORY = 5, 1 << 30
PACKAGE = str(Path(__file__).resolve().parent.parent)


class Hang(BaseException):
    """An input took longer than SECONDS."""


def place(error: BaseException) -> str:
    """Kind and deepest line of the project's own in a traceback: what
    makes two findings the same.
    """
    frames = traceback.extract_tb(error.__traceback__)
    own = [
        f for f in frames if f.filename.startswith(PACKAGE) and "site-packages" not in f.filename
    ] or frames
    return f"{type(error).__name__} {Path(own[-1].filename).name}:{own[-1].lineno}"


def seconds_of(pid: int | None) -> float:
    """Processor time of a process: the machine may be busy with something else."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def work(name: str, seed: int, first: int, end: int, state: Any, found: Connection) -> None:
    """The worker: inputs first … end; state holds the number of the input at work, the worst
    seconds and its number.
    """
    reader = READERS[name]
    seeds = reader.seeds()
    for data in seeds:  # caches are filled before the clock starts
        with contextlib.suppress(CalibtoolError):
            reader.read(data)
    warnings.simplefilter("ignore")
    warnings.simplefilter("error", RuntimeWarning)
    with open("/proc/self/statm", encoding="ascii") as file:
        now = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY, now + MEMORY))

    def expired(*_: object) -> None:
        raise Hang

    signal.signal(signal.SIGPROF, expired)
    state[3] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for index in range(first, end):
        data = case(name, seeds, seed, index)
        state[0] = index
        started = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        outside: list[str] = []
        try:
            with watched() as outside:
                reader.read(data)
            state[5] += 1
        except CalibtoolError as error:
            if not (str(error) and str(error).isprintable()):
                found.send(
                    (
                        index,
                        f"message is not one line of printable characters {place(error)}",
                        str(error),
                    )
                )
        except (Exception, Hang) as error:
            found.send((index, place(error), f"{type(error).__name__}: {error}"[:300]))
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        if outside:
            found.send((index, f"outside: {outside[0].split()[0]}", "; ".join(outside)[:300]))
        taken = time.process_time() - started
        if taken > state[1]:
            state[1], state[2] = taken, index
        state[4] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    state[0] = end


def fuzz(name: str, inputs: int, seed: int, first: int, folder: Path | None) -> dict[str, Any]:
    """All inputs of one reader: how many were valid, the worst seconds, the most
    memory, what was found.
    """
    context = mp.get_context("fork")
    state = context.Array("d", 6, lock=False)
    findings: dict[str, list[Any]] = {}
    start, end, started = first, first + inputs, time.perf_counter()
    base = peak = 0.0

    def note(index: int, where: str, what: str) -> None:
        if where not in findings:
            findings[where] = [0, index, what]
            print(f"{name} {index}: {where}: {what}", file=sys.stderr, flush=True)
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
                data = case(name, READERS[name].seeds(), seed, index)
                (folder / f"{name}-{seed}-{index}").write_bytes(data)
        findings[where][0] += 1

    while start < end:
        ours, theirs = context.Pipe(duplex=False)
        state[0] = start
        worker = context.Process(target=work, args=(name, seed, start, end, state, theirs))
        worker.start()
        theirs.close()
        killed, at, began, waited = False, -1.0, 0.0, 0.0
        while True:
            try:
                while ours.poll(0.2):
                    note(*ours.recv())
            except EOFError:
                break
            if state[0] != at:
                at, began, waited = state[0], seconds_of(worker.pid), time.monotonic()
            elif (
                seconds_of(worker.pid) - began > 3 * SECONDS
                or time.monotonic() - waited > 100 * SECONDS
            ):
                killed = True
                worker.kill()
        worker.join()
        base, peak = state[3], max(peak, state[4])
        if worker.exitcode == 0:
            break
        last = int(state[0])
        if worker.exitcode == 1:
            sys.exit(f"{name}: the fuzzer itself failed at input {last}")
        if killed:
            note(last, "endless loop in C", f"more than {3 * SECONDS} s")
        else:
            note(last, f"crash {worker.exitcode}", "the process died")
        start = last + 1
    taken = time.perf_counter() - started
    count = sum(finding[0] for finding in findings.values())
    found: dict[str, Any] = {
        "reader": name,
        "inputs": inputs,
        "valid": int(state[5]),
        "worst_ms": round(state[1] * 1e3),
    }
    found |= {
        "memory_mib": round((peak - base) / 1024),
        "findings": count,
        "places": sorted(findings),
    }
    print(
        f"{name}: {taken:.0f} s, worst input {int(state[2])}, findings {findings}",
        file=sys.stderr,
        flush=True,
    )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description="Mutated files through every reader.")
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--reader", choices=READERS, action="append")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--findings", type=Path)
    parser.add_argument("--json", action="store_true", help="One object per reader.")
    options = parser.parse_args()
    if not options.json:
        print(
            "| reader | inputs | of them valid | worst time | more memory | findings |\n"
            "|---|---|---|---|---|---|"
        )
    for name in options.reader or READERS:
        row = fuzz(name, options.inputs, options.seed, options.first, options.findings)
        told = [
            f"{row['inputs']:,}",
            f"{row['valid']:,}",
            f"{row['worst_ms']} ms",
            f"{row['memory_mib']} MiB",
        ]
        line = f"| {' | '.join([name, *told, str(row['findings'])])} |"
        print(json.dumps(row) if options.json else line, flush=True)


if __name__ == "__main__":
    main()
