"""How long a moving program waits for a corrected row: from the exported C, and from `serve`.

Run: python benchmarks/latency.py [--rows 5000] [--robot fanuc-m1000ia] [--rate 500].
A complete model with a network and harmonics, joint rows along smooth paths of the default
workspace, one every 1/rate s; what passes from before a row is sent until its answer is there.
Other work on the machine counts: the load average is printed. The last line leaves it out: CPU time
of every correction inside of the process, the least of four passes over the same rows, with and
without garbage collection.
`chrt -f 50 python benchmarks/latency.py` (root) keeps other work out.
"""

import argparse
import ctypes
import gc
import json
import os
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from calibtool.compensation.row_by_row import Live
from calibtool.measurement.sampling import sample_configurations
from calibtool.robot.catalogue import load_robot
from calibtool.storage import read_calibration

CALIBTOOL = [sys.executable, "-m", "calibtool"]


def path_of(name: str, rows: int) -> np.ndarray:
    """Joint rows (rows, n) between configurations of the workspace, rad or m."""
    robot = load_robot(name)
    corners = sample_configurations(robot, robot.workspace(), 11, np.random.default_rng(0))
    at = np.linspace(0, 10, rows)
    return np.column_stack([np.interp(at, range(11), corner) for corner in corners.T])


def measured(ask: Callable[[np.ndarray], None], q: np.ndarray, rate: float) -> np.ndarray:
    """Seconds of every row, the first tenth left out."""
    found, start = [], time.perf_counter()
    for k, row in enumerate(q):
        while time.perf_counter() - start < k / rate:
            time.sleep(max(0.0, min(1e-3, k / rate - (time.perf_counter() - start) - 5e-4)))
        before = time.perf_counter()
        ask(row)
        found.append(time.perf_counter() - before)
    return np.array(found[len(found) // 10 :])


def cpu_seconds(process: int | None) -> float:
    """User and system time of a process (Linux), 0 for None."""
    if process is None:
        return 0.0
    words = Path(f"/proc/{process}/stat").read_text().rsplit(") ", 1)[1].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def cpu_milliseconds(calibration: Path, q: np.ndarray) -> np.ndarray:
    """CPU time of the correction of every row, the least of four passes."""
    with calibration.open("rb") as file:
        loaded = read_calibration(file, calibration.name)
    passes = []
    for _ in range(4):
        live, found = Live(loaded, "serial"), []
        for row in q:
            before = time.thread_time_ns()
            live.corrected(row)
            found.append(time.thread_time_ns() - before)
        passes.append(found)
    return np.min(passes, axis=0)[len(q) // 10 :] / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=5000)
    parser.add_argument("--robot", default="fanuc-m1000ia")
    parser.add_argument("--rate", type=float, default=500.0)
    options = parser.parse_args()
    q = path_of(options.robot, options.rows)
    n = q.shape[1]
    with tempfile.TemporaryDirectory() as folder:

        def run(*arguments: str) -> None:
            subprocess.run([*CALIBTOOL, "-q", *arguments], check=True, cwd=folder)

        errors = "geometric,gear,gravity"
        run("simulate", options.robot, "-n", "120", "--errors", errors, "-o", "m.h5")
        run("train", "m.h5", "-o", "c.h5")
        run("export", "c.h5", "--joint-values", "serial", "-o", "arm.c")
        subprocess.run(
            ["cc", "-std=c99", "-O2", "-shared", "-fPIC", "-o", "arm.so", "arm.c", "-lm"],
            check=True,
            cwd=folder,
        )
        library = ctypes.CDLL(str(Path(folder, "arm.so")))
        joints, moved = (ctypes.c_double * n)(), (ctypes.c_double * n)()

        def by_library(row: np.ndarray) -> None:
            joints[:] = row.tolist()
            library.arm_correct(joints, moved)

        print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; ms per row")
        print("| | p50 | p99 | largest | CPU of the server |\n|---|---|---|---|---|")

        def show(name: str, ask: Callable[[np.ndarray], None], process: int | None = None) -> None:
            before = cpu_seconds(process)
            ms = 1e3 * measured(ask, q, options.rate)
            used = 1e3 * (cpu_seconds(process) - before) / len(q)
            p50, p99 = np.percentile(ms, [50, 99])
            cpu = f"{used:.3f}" if process else ""
            print(f"| {name} | {p50:.3f} | {p99:.3f} | {ms.max():.3f} | {cpu} |", flush=True)

        show("C library, from Python by ctypes", by_library)
        columns = [f"j{j + 1}_rad" for j in range(n)]
        serve = [*CALIBTOOL, "serve", "c.h5", "--joint-values", "serial"]

        def line_of(row: np.ndarray) -> bytes:
            return json.dumps(dict(zip(columns, row.tolist(), strict=True))).encode() + b"\n"

        for kind in ("ndjson", "binary"):
            for way in ("stdin, stdout", "socket"):
                command = [*serve, "--rows", kind, *(["--port", "0"] if way == "socket" else [])]
                process = subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    cwd=folder,
                )
                write, read = process.stdin, process.stdout
                if way == "socket":
                    port = int(process.stderr.readline().split(b":")[1].split()[0])
                    client = socket.create_connection(("127.0.0.1", port))
                    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    write, read = client.makefile("wb"), client.makefile("rb")

                def ask(row: np.ndarray, write=write, read=read, kind=kind) -> None:
                    write.write(line_of(row) if kind == "ndjson" else struct.pack(f"<{n}d", *row))
                    write.flush()
                    read.readline() if kind == "ndjson" else read.read(8 * (n + 1))

                show(f"serve, {kind}, {way}", ask, process.pid)
                process.kill()
                process.wait()
        for name in ("with", "without"):
            if name == "without":
                gc.disable()
            ms = cpu_milliseconds(Path(folder, "c.h5"), q[:2000])
            p50, p99 = np.percentile(ms, [50, 99])
            print(f"| CPU, {name} collection | {p50:.3f} | {p99:.3f} | {ms.max():.3f} | |")


if __name__ == "__main__":
    main()
